//! Pairs of materials with contact laws of their own.

use glebe_engine::backend::Backend;
use glebe_engine::lattice::{norm, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_physics::{ContactModel, LawChoice, PairLaws, PairOverride};

use crate::support::{Body, CPU, Run, Subject, grain, open_world, plane};

const RADIUS: f64 = 1e-3;

/// The laws of soil and steel: elastic, with springs that a contact remembers.
fn plain() -> ContactModel {
    let rolling = LawChoice::named("epsd");
    ContactModel { rolling, ..ContactModel::default() }
}

/// The laws of soil: it yields, sticks, and has no tangential spring that could be remembered.
fn sticky() -> ContactModel {
    ContactModel {
        normal: LawChoice::named("eepa").with("plasticity", 0.6).with("adhesion", 0.2),
        tangential: LawChoice::named("none"),
        rolling: LawChoice::named("constant-torque"),
        cohesion: LawChoice::named("jkr").with("work_of_adhesion", 0.05),
        ..ContactModel::default()
    }
}

fn own(m: ContactModel) -> PairOverride {
    let laws = PairLaws {
        normal: Some(m.normal),
        tangential: Some(m.tangential),
        rolling: Some(m.rolling),
        cohesion: Some(m.cohesion),
        bond: None,
    };
    PairOverride { laws, ..PairOverride::default() }
}

/// Far apart from each other: two grains of soil that meet obliquely, a grain of soil and one of steel, and a grain
/// that falls onto steel.
fn impacts(contact: ContactModel) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.05, 1e-6, grain(0.6, 0.5));
    w.materials.push(grain(0.4, 0.3));
    w.contact = contact;
    let (v, spin) = ([0.1, 0.02, -0.3], [20.0, -60.0, 35.0]);
    for (x, other) in [(-0.02, 0), (0.0, 1)] {
        w.particles.push([x, 0.0, 0.02], RADIUS, other);
        w.particles.push_moving([x + 0.3 * RADIUS, 0.0, 0.02 + 1.96 * RADIUS], RADIUS, 0, v, spin);
    }
    w.particles.push_moving([0.02, 0.0, 1.01 * RADIUS], RADIUS, 0, v, spin);
    let mut floor = plane([0.0, 0.0, 1.0], [0.0; 3]);
    floor.material = 1;
    w.surfaces = vec![floor];
    w
}

fn mixed() -> WorldSpec {
    let mut w = impacts(plain());
    w.pairs.push((0, 0, own(sticky())));
    w
}

/// Each pair moves as it would if its laws were those of the whole world.
pub fn a_pair_follows_its_own_laws(on: &Subject) {
    const STEPS: u64 = 700;
    let mixed = Run::new(on, mixed()).steps(STEPS).bodies();
    // Devices have each law in other suites: one kernel is enough here.
    let whole = if on.exact_reach { on } else { &CPU };
    let [sticky, plain] =
        [sticky(), plain()].map(|laws| Run::new(whole, impacts(laws)).steps(STEPS).bodies());
    let most = &on.bounds.trajectory;
    let near = |what: &str, a: &Body, b: &Body, c: &Body| {
        let off = |f: fn(&Body) -> Vec3, other: &Body| norm(sub(f(a), f(other)));
        if on.exact_reach {
            assert_eq!((a.v, a.w), (b.v, b.w), "{what}");
        }
        assert!(off(|b| b.v, b) <= most.velocity * 0.3, "{what}: {:?} instead of {:?} m/s", a.v, b.v);
        assert!(off(|b| b.w, b) <= most.spin * 100.0, "{what}: {:?} instead of {:?} rad/s", a.w, b.w);
        assert!(off(|b| b.v, c) > 1e-3, "{what}: the laws make no difference");
    };
    for k in 0..2 {
        near("soil and soil", &mixed[k], &sticky[k], &plain[k]);
    }
    for k in 2..5 {
        near("soil and steel", &mixed[k], &plain[k], &sticky[k]);
    }
}

/// What contacts of different laws remember survives a checkpoint to the bit.
pub fn memories_of_different_laws_survive_a_checkpoint(on: &Subject) {
    if !on.exact_states {
        return;
    }
    let mut whole = Run::new(on, mixed());
    whole.steps(150);
    let state = whole.state();
    assert!(state.contacts.len() == 2 && state.surface_contacts.len() == 1, "{:?}", state.contacts);
    // A tangential and a rolling spring where soil meets steel, plastic overlap and attachment where it meets soil.
    let floats = |id: [u32; 2]| &state.contacts.iter().find(|m| m.id == id).unwrap().history;
    let holds = |h: &[f32]| [0..3, 4..7, 7..8, 8..9].map(|floats| h[floats].iter().any(|x| *x != 0.0));
    assert_eq!(holds(floats([0, 1])), [false, false, true, true]);
    assert_eq!(holds(floats([2, 3])), [true, true, false, false]);
    let mut again = Run::resume(on, whole.c.clone(), state);
    whole.steps(300);
    again.steps(300);
    assert_eq!(whole.state().hash(), again.state().hash());
}

/// The host takes any number of laws; a device says which ones are too many.
pub fn a_device_refuses_more_than_two_laws_of_a_slot(on: &Subject) {
    let mut w = mixed();
    let luding = LawChoice::named("luding").with("stiffness", 1e4).with("unloading_stiffness", 2e4);
    let laws = PairLaws { normal: Some(luding), ..PairLaws::default() };
    w.pairs.push((1, 1, PairOverride { laws, ..PairOverride::default() }));
    let (two, three) = (prepare(mixed()).unwrap().0, prepare(w).unwrap().0);
    assert_eq!(on.backend.refusal(std::slice::from_ref(&two)), None);
    match on.backend {
        Backend::Cpu | Backend::Reference => assert_eq!(on.backend.refusal(&[two, three]), None),
        _ => {
            let why = on.backend.refusal(&[two, three]).unwrap();
            assert!(why.contains("3 different normal laws (hertz, luding, eepa)"), "{why}");
        }
    }
}
