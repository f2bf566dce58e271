//! Cohesion and yielding contacts in motion: what holds, what parts, what is lost on the way.

use std::f64::consts::PI;

use glebe_engine::spec::{Domain, Side, WorldSpec};
use glebe_physics::{ContactModel, LawChoice, PairOverride};

use crate::support::{Random, Run, Subject, e_star, grain, label, open_world, plane, sphere_mass};

const RADIUS: f64 = 1e-3;
const WORK: f64 = 0.1;

fn sticky(cohesion: LawChoice) -> ContactModel {
    ContactModel { cohesion, tangential: LawChoice::named("none"), ..ContactModel::default() }
}

fn adhesives() -> [(LawChoice, f64); 2] {
    let of = |name: &str| LawChoice::named(name).with("work_of_adhesion", WORK);
    // Pull-off forces on a plane, where R* = R.
    [(of("jkr"), 1.5 * PI * WORK * RADIUS), (of("dmt"), 2.0 * PI * WORK * RADIUS)]
}

/// A sphere of material 0 under a plane of material 0, hung there by adhesion, its weight a share of the pull-off force.
fn hung(cohesion: &LawChoice, off: f64, share: f64) -> WorldSpec {
    let m = grain(0.3, 0.0);
    // Where it hangs without weight.
    let overlap = (0.75 * off / (e_star(&m) * RADIUS.sqrt())).powf(2.0 / 3.0);
    let mass = sphere_mass(RADIUS, &m);
    let mut w = open_world([0.0; 3], 0.05, 2e-6, m);
    w.contact = sticky(cohesion.clone());
    w.gravity = [0.0, 0.0, -share * off / mass];
    w.particles.push([0.0, 0.0, overlap - RADIUS], RADIUS, 0);
    w.surfaces = vec![plane([0.0, 0.0, -1.0], [0.0; 3])];
    w
}

/// A weight a little below the pull-off force is held, one a little above it is not.
pub fn adhesion_holds_up_to_the_pull_off_force(on: &Subject) {
    for (law, off) in adhesives() {
        for (share, holds) in [(0.8, true), (1.05, false)] {
            let mut run = Run::new(on, hung(&law, off, share));
            run.steps(5_000);
            let touches = run.moment().surface_contacts == 1;
            assert_eq!(touches, holds, "{}: {share} of the pull-off force", law.law);
            if holds {
                let b = run.bodies()[0];
                assert!(b.v[2].abs() < 1e-4, "{}: it swings at {} m/s", law.law, b.v[2]);
                assert!((b.force[2] / (share * off) - 1.0).abs() < 0.01, "{}: {} N", law.law, b.force[2]);
            }
        }
    }
}

/// Two spheres that fly apart pay for the bridge between them, and the ledger says so.
pub fn a_bridge_takes_its_energy_when_it_ruptures(on: &Subject) {
    const SPEED: f64 = 0.2;
    let (gamma, content, theta) = (0.072, 0.005, 0.2);
    let law = LawChoice::named("capillary").with("surface_tension", gamma).with("liquid_content", content);
    let m = grain(1.0, 0.0);
    let mass = sphere_mass(RADIUS, &m);
    let mut w = open_world([0.0; 3], 0.05, 1e-6, m);
    w.contact = sticky(law.with("contact_angle", theta));
    let apart = RADIUS - 1e-9;
    w.particles.push_moving([-apart, 0.0, 0.0], RADIUS, 0, [-SPEED, 0.0, 0.0], [0.0; 3]);
    w.particles.push_moving([apart, 0.0, 0.0], RADIUS, 0, [SPEED, 0.0, 0.0], [0.0; 3]);
    let mut run = Run::new(on, w);
    run.steps(4_000);
    assert_eq!(run.moment().contacts, 0);
    // The force over the separation up to rupture, by Simpson's rule.
    let volume: f64 = content * 4.0 / 3.0 * PI * RADIUS.powi(3);
    let ruptures = (1.0 + 0.5 * theta) * (volume.cbrt() + 0.1 * volume.powf(2.0 / 3.0) / RADIUS);
    let force = |s: f64| {
        let x = s * (RADIUS / volume).sqrt();
        2.0 * PI * RADIUS * gamma * theta.cos() / (1.0 + 1.05 * x + 2.5 * x * x)
    };
    let n = 2_000;
    let h = ruptures / f64::from(n);
    let weight = |k: i32| {
        if k == 0 || k == n {
            1.0
        } else if k % 2 == 1 {
            4.0
        } else {
            2.0
        }
    };
    let bridge: f64 = (0..=n).map(|k| weight(k) * force(h * f64::from(k))).sum::<f64>() * h / 3.0;
    let left = mass * SPEED * SPEED - bridge;
    assert!(bridge > 0.1 * mass * SPEED * SPEED && left > 0.0, "{bridge:e} J of {:e} J", left + bridge);
    let kinetic = run.moment().kinetic();
    assert!((kinetic / left - 1.0).abs() < 2e-3, "{kinetic:e} J are left instead of {left:e} J");
    let lost = run.g.ledger.friction;
    assert!((lost / bridge - 1.0).abs() < 2e-3, "{lost:e} J were lost, {bridge:e} J stored");
}

/// A sphere of one material hangs from a plane, a sphere of another, whose pair with it has no cohesion, falls.
pub fn only_pairs_with_cohesion_stick(on: &Subject) {
    for (law, off) in adhesives() {
        let mut w = hung(&law, off, 0.5);
        w.materials.push(grain(0.3, 0.0));
        let x = w.particles.position[0];
        w.particles.push([0.01, 0.0, x[2]], RADIUS, 1);
        w.pairs.push((1, 0, PairOverride { cohesion: Some(0.0), ..PairOverride::default() }));
        let mut run = Run::new(on, w);
        run.steps(3_000);
        let b = run.bodies();
        assert_eq!(run.moment().surface_contacts, 1, "{}", law.law);
        assert!(b[0].x[2] > -1.001 * RADIUS, "{}: {:?}", law.law, b[0].x);
        assert!(b[1].x[2] < -1.1 * RADIUS, "{}: {:?}", law.law, b[1].x);
    }
}

/// The rebound of a sphere from a plane: Luding's loses all but k₁/k₂ of its energy, EEPA's all but
/// `(k₂/k₁) (1 - 5/2 s + 3/2 s^(5/3))`, `s = λ²`. The ledger has the rest.
pub fn plastic_contacts_lose_what_their_path_takes(on: &Subject) {
    const SPEED: f64 = 0.5;
    let luding = LawChoice::named("luding").with("stiffness", 1e4).with("unloading_stiffness", 2.5e4);
    let s: f64 = 0.36;
    let rest = (1.0 - 2.5 * s + 1.5 * s.powf(5.0 / 3.0)) / (1.0 - s);
    for (normal, left) in [(luding, 0.4), (LawChoice::named("eepa").with("plasticity", 0.6), rest)] {
        let mut w = open_world([0.0; 3], 0.05, 5e-7, grain(1.0, 0.0));
        w.contact = ContactModel { normal, tangential: LawChoice::named("none"), ..ContactModel::default() };
        w.particles.push_moving([0.0, 0.0, 1.001 * RADIUS], RADIUS, 0, [0.0, 0.0, -SPEED], [0.0; 3]);
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        let name = label(&w.contact);
        let mut run = Run::new(on, w);
        let before = run.moment().kinetic();
        run.steps(4_000);
        let m = run.moment();
        assert_eq!(m.surface_contacts, 0, "{name}");
        let share = m.kinetic() / before;
        assert!((share / left - 1.0).abs() < 0.01, "{name}: {share} of the energy is left, not {left}");
        let open = (before - m.kinetic() - run.g.ledger.dissipated()) / before;
        assert!(open.abs() < 0.01, "{name}: {open} of the energy is left open");
    }
}

/// A world whose laws remember in every slot goes on from its state to the same bits.
pub fn history_of_all_slots_survives_a_checkpoint(on: &Subject) {
    if !on.exact_states {
        return;
    }
    let mut w = open_world([0.0; 3], 0.05, 5e-6, grain(0.5, 0.5));
    // Pressed by the walls of a box.
    w.domain = Domain::aligned([0.0; 3], [7.7 * RADIUS; 3], [[Side::Wall; 2]; 3], Some(0));
    let normal = LawChoice::named("luding").with("stiffness", 1e3).with("unloading_stiffness", 2e3);
    w.contact = ContactModel {
        normal: normal.with("adhesion_stiffness", 5e2),
        rolling: LawChoice::named("moment-rotation"),
        cohesion: LawChoice::named("jkr").with("work_of_adhesion", WORK),
        ..ContactModel::default()
    };
    w.gravity = [0.0, 0.0, -9.81];
    let mut r = Random(3);
    for i in 0..64 {
        let at = [i % 4, i / 4 % 4, i / 16].map(|k| 1.925 * RADIUS * (f64::from(k) + 0.5));
        w.particles.push_moving(at, RADIUS * (0.9 + 0.1 * r.unit()), 0, r.vector(0.2), r.vector(50.0));
    }
    let mut whole = Run::new(on, w.clone());
    whole.steps(900);
    let state = whole.state();
    assert!(state.contacts.len() > 20 && state.surface_contacts.len() > 4);
    for k in 0..10 {
        let remembers = |h: &[f32]| h[k] != 0.0;
        // A slip bit may be nowhere set.
        assert!(k == 3 || state.contacts.iter().any(|m| remembers(&m.history)), "float {k} of pairs");
        assert!(
            k == 3 || state.surface_contacts.iter().any(|m| remembers(&m.history)),
            "float {k} of surfaces"
        );
    }
    let mut again = Run::resume(on, whole.c.clone(), state);
    whole.steps(400);
    again.steps(400);
    assert_eq!(whole.state().hash(), again.state().hash());
}
