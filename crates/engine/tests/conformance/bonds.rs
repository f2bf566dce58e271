//! Bonds between particles: what they hold, when they break, what is conserved.

use std::f64::consts::PI;

use glebe_engine::backend::Backend;
use glebe_engine::lattice::{add, cross, norm, scale, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_engine::state::State;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, PairLaws, PairOverride};

use crate::support::{CPU, REFERENCE, Random, Run, Subject, Together, grain, open_world, plane, sphere_mass};

const RADIUS: f64 = 1e-3;
/// Distance of bonded centres: surfaces do not touch, so that nothing but bonds acts.
const SPACING: f64 = 2.01 * RADIUS;
const NORMAL: f64 = 1e10;
const SHEAR: f64 = 4e9;
/// Of the bond.
const R: f64 = 0.8 * RADIUS;
const AREA: f64 = PI * R * R;
const INERTIA: f64 = 0.25 * AREA * R * R;
/// So strong that bonds of these tests hold.
const STRONG: f64 = 0.2 * RADIUS * NORMAL;

fn law(tensile: f64, shear: f64) -> LawChoice {
    LawChoice::named("parallel")
        .with("normal_stiffness", NORMAL)
        .with("shear_stiffness", SHEAR)
        .with("tensile_strength", tensile)
        .with("shear_strength", shear)
        .with("radius", R / RADIUS)
        .with("moment_contribution", 0.5)
        .with("gap", 0.02 * RADIUS)
}

/// An empty world of bonds without friction.
fn world(bond: LawChoice, dt: f64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.05, dt, grain(1.0, 0.0));
    let tangential = LawChoice::named("none");
    w.contact = ContactModel { tangential, bond, ..ContactModel::default() };
    w
}

/// A world that has begun, its particles bonded.
fn bonded(on: &Subject, w: WorldSpec) -> Run {
    let mut run = Run::new(on, w);
    run.edit(|c, state| state.bond(c));
    run
}

/// A beam of `n` bonds from a sphere too heavy to move, its end pressed down by a plane. Where it comes to rest the
/// deflection is that of the chain of bonds: `F (n/(kₛ A) + d²/(kₙ I) n (4n² - 1)/12)`; and near that of a beam of
/// `E I = kₙ I d` with shear, which has n³/3 instead.
pub fn a_cantilever_bends_as_its_bonds_say(on: &Subject) {
    const N: u32 = 10;
    let mut w = world(law(STRONG, STRONG), 4e-6);
    let mut heavy = w.materials[0].clone();
    heavy.density *= 1e9;
    w.materials.push(heavy);
    w.local_damping = 0.7;
    for k in 0..=N {
        w.particles.push([f64::from(k) * SPACING, 0.0, 0.0], RADIUS, usize::from(k == 0));
    }
    let end = f64::from(N) * SPACING;
    let (pressed, tilt) = (0.02 * RADIUS, 0.02_f64);
    // So tilted that only the end reaches it.
    w.surfaces = vec![plane([-tilt.sin(), 0.0, -tilt.cos()], [end, 0.0, RADIUS - pressed])];
    let mut run = bonded(on, w);
    assert_eq!(run.g.bonds.made, u64::from(N));
    run.steps(30_000);
    assert_eq!(run.g.bonds.broken, 0);
    let b = run.bodies();
    let height = |x: Vec3| (end - x[0]) * tilt.sin() + (RADIUS - pressed - x[2]) * tilt.cos();
    assert!(b[..N as usize].iter().all(|b| height(b.x) > RADIUS), "more than the end touches the plane");
    assert!(b[N as usize].v.iter().all(|v| v.abs() < 1e-7), "{:?}", b[N as usize].v);
    let deflection = b[0].x[2] - b[N as usize].x[2];
    // The plane is nearly across: the chain's stiff direction takes the rest.
    let force = run.detail().on_triangles[0][0][2];
    let n = f64::from(N);
    let shear = n / (SHEAR * AREA);
    let bending = SPACING * SPACING / (NORMAL * INERTIA);
    let chain = force * (shear + bending * n * (4.0 * n * n - 1.0) / 12.0);
    assert!((deflection / chain - 1.0).abs() < 2e-3, "{deflection:e} m, the chain's is {chain:e} m");
    let beam = force * (shear + bending * n * n * n / 3.0);
    assert!((deflection / beam - 1.0).abs() < 5e-3, "{deflection:e} m, the beam's is {beam:e} m");
}

/// Two spheres that are thrown apart, past each other, or are spun against each other about or across their line:
/// below the speed at which the largest stress reaches the strength the bond holds, above it breaks, and what it had
/// stored then is lost.
pub fn bonds_break_at_their_strength(on: &Subject) {
    const TENSILE: f64 = 2e5;
    const SHEARING: f64 = 1e5;
    const SHARE: f64 = 0.5;
    let m = grain(1.0, 0.0);
    let mass = sphere_mass(RADIUS, &m);
    let spin = 0.4 * mass * RADIUS * RADIUS;
    let arm = 0.5 * SPACING;
    // Stiffness, inertia of the relative motion, its amplitude at which the bond breaks, velocity and spin of the first
    // per unit of relative speed.
    let modes: [(&str, f64, f64, f64, Vec3, Vec3); 4] = [
        ("tension", NORMAL * AREA, 0.5 * mass, TENSILE / NORMAL, [-0.5, 0.0, 0.0], [0.0; 3]),
        (
            "shear",
            SHEAR * AREA,
            0.5 / (1.0 / mass + arm * arm / spin),
            SHEARING / SHEAR,
            [0.0, 0.5, 0.0],
            [0.0; 3],
        ),
        ("bending", NORMAL * INERTIA, 0.5 * spin, TENSILE / (NORMAL * SHARE * R), [0.0; 3], [0.0, 0.5, 0.0]),
        (
            "twist",
            2.0 * SHEAR * INERTIA,
            0.5 * spin,
            SHEARING / (SHEAR * SHARE * R),
            [0.0; 3],
            [0.5, 0.0, 0.0],
        ),
    ];
    for (name, stiffness, inertia, amplitude, v, turn) in modes {
        let frequency = (stiffness / inertia).sqrt();
        for (share, breaks) in [(0.98, 0), (1.02, 1)] {
            let speed = share * amplitude * frequency;
            let dt = 0.01 / frequency;
            let mut w = world(law(TENSILE, SHEARING), dt);
            for sign in [1.0, -1.0] {
                let (v, turn) = (scale(v, sign * speed), scale(turn, sign * speed));
                w.particles.push_moving([-sign * 0.5 * SPACING, 0.0, 0.0], RADIUS, 0, v, turn);
            }
            let mut run = bonded(on, w);
            let before = run.moment().kinetic();
            run.steps(400);
            assert_eq!((run.g.bonds.made, run.g.bonds.broken), (1, breaks), "{name} at {share}");
            if breaks == 1 {
                let stored = 0.5 * stiffness * amplitude * amplitude;
                let lost = run.g.ledger.friction;
                // It breaks in the step in which the stress passes its strength.
                assert!(
                    lost > 0.999 * stored && lost < stored * (share * share + 1e-3),
                    "{name}: {lost:e} J of {stored:e} J"
                );
                let m = run.moment();
                let open = (before - m.kinetic() - m.elastic_normal - lost) / before;
                assert!(open.abs() < 0.02, "{name}: {open} of the energy is left open");
                let state = run.state();
                assert!(state.bonds_of(&run.c).unwrap().iter().all(|n| *n == 0), "{name}");
            }
        }
    }
}

/// A block of 27 spheres, turning and shaken.
fn block(bond: LawChoice, dt: f64, shake: f64) -> WorldSpec {
    let mut w = world(bond, dt);
    let mut r = Random(5);
    for i in 0..27 {
        let at = [i % 3, i / 3 % 3, i / 9].map(|k| SPACING * (f64::from(k) - 1.0));
        let drift = add(cross([30.0, 50.0, -20.0], at), [0.7, -0.2, 0.4]);
        w.particles.push_moving(at, RADIUS, 0, add(drift, r.vector(shake)), r.vector(100.0 * shake));
    }
    w
}

/// Momentum, angular momentum and energy of a body of bonds that flies and swings, over several rebuilds.
pub fn a_bonded_body_keeps_momentum_and_energy(on: &Subject) {
    let mut w = block(law(STRONG, STRONG), 5e-7, 0.05);
    w.time.integrator = IntegratorKind::VelocityVerlet;
    let mut run = bonded(on, w);
    assert_eq!(run.g.bonds.made, 54);
    let sums = |run: &Run| {
        let b = run.bodies();
        let momentum = b.iter().fold([0.0; 3], |sum, b| add(sum, scale(b.v, b.mass)));
        let angular = b.iter().fold([0.0; 3], |sum, b| {
            let own = scale(b.w, 0.4 * b.mass * b.radius * b.radius);
            add(sum, add(scale(cross(b.x, b.v), b.mass), own))
        });
        (momentum, angular)
    };
    let (momentum, angular) = sums(&run);
    let whole = |run: &mut Run| run.moment().kinetic() + run.moment().elastic_normal;
    let energy = whole(&mut run);
    let shaken = {
        run.steps(200);
        run.moment().elastic_normal
    };
    assert!(shaken > 1e-3 * energy, "bonds hold {shaken:e} of {energy:e} J");
    run.steps(4_000);
    assert!(
        (run.g.rebuilds > 1 || on.backend == Backend::Reference) && run.g.bonds.broken == 0,
        "{:?}",
        run.g.bonds
    );
    let (p, l) = sums(&run);
    assert!(norm(sub(p, momentum)) < 1e-5 * norm(momentum), "{p:?} instead of {momentum:?}");
    assert!(norm(sub(l, angular)) < 1e-4 * norm(angular), "{l:?} instead of {angular:?}");
    let after = whole(&mut run);
    assert!((after / energy - 1.0).abs() < 1e-3, "{after:e} J instead of {energy:e} J");
    let state = run.state();
    let counts = state.bonds_of(&run.c).unwrap();
    let mut by_number: Vec<_> = state.particles.id.iter().zip(counts).collect();
    by_number.sort_unstable();
    // A corner, the middle of an edge, that of a face, and the centre.
    assert_eq!([0, 1, 4, 13].map(|k: usize| by_number[k].1), [3, 4, 5, 6]);
}

/// The block thrown onto a floor, where some bonds break.
fn thrown() -> WorldSpec {
    let mut w = block(law(2e4, 1.2e4), 1e-6, 0.002);
    w.particles.velocity.iter_mut().for_each(|v| v[2] -= 1.5);
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0, 0.0, -1.03 * SPACING - RADIUS])];
    w.contact.tangential = LawChoice::named("mindlin");
    w
}

/// A body that is breaking goes on from a checkpoint to the same bits.
pub fn broken_bonds_stay_broken_after_a_checkpoint(on: &Subject) {
    if !on.exact_states {
        return;
    }
    let mut whole = bonded(on, thrown());
    whole.steps(250);
    let bonds = whole.g.bonds;
    assert!(bonds.made == 54 && bonds.broken > 0 && bonds.broken < 54, "{bonds:?}");
    let state = State::from_bytes(&whole.state().to_bytes()).unwrap();
    let mut again = Run::resume(on, whole.c.clone(), state);
    whole.steps(500);
    again.steps(500);
    assert_eq!(whole.state().hash(), again.state().hash());
    assert!(whole.g.bonds.broken > bonds.broken, "{:?}", whole.g.bonds);
}

/// Bodies that break in a batch, one of them with fewer particles, come to the same bits as each alone; and a state goes
/// from one backend to another and back as it is.
pub fn bonded_worlds_equal_themselves_in_a_batch(on: &Subject) {
    if !on.exact_states {
        return;
    }
    let worlds = || {
        let mut fewer = thrown();
        let p = &mut fewer.particles;
        p.position.truncate(18);
        p.radius.truncate(18);
        p.material.truncate(18);
        p.velocity.truncate(18);
        p.spin.truncate(18);
        [thrown(), fewer].map(|w| {
            let (c, mut state) = prepare(w).unwrap();
            state.bond(&c);
            state.progress.stale = true;
            (c, state)
        })
    };
    let mut batch = Together::resume(on, worlds().to_vec());
    batch.advance(&[400, 400]);
    for (k, (c, state)) in worlds().into_iter().enumerate() {
        let mut alone = Run::resume(on, c.clone(), state);
        alone.steps(400);
        assert!(alone.g.bonds.broken > 0, "world {k}: {:?}", alone.g.bonds);
        assert_eq!(alone.g.bonds, batch.worlds[k].1.bonds, "world {k}");
        let state = alone.state();
        assert_eq!(state.hash(), batch.state(k).hash(), "world {k}");
        let moved = Run::resume(&CPU, c, state.clone()).state();
        assert_eq!(state.contacts, moved.contacts, "world {k}");
    }
}

/// What breaks on impact, what is lost and where the pieces are is as the reference has it.
pub fn a_breaking_body_equals_the_reference(on: &Subject) {
    let (mut run, mut reference) = (bonded(on, thrown()), bonded(&REFERENCE, thrown()));
    run.steps(300);
    reference.steps(300);
    assert!(run.g.bonds.broken > 0);
    assert_eq!(run.g.bonds, reference.g.bonds);
    let (a, b) = (run.g.ledger.friction, reference.g.ledger.friction);
    assert!((a / b - 1.0).abs() < 1e-3, "{a:e} J instead of {b:e} J");
    for (i, (a, b)) in run.bodies().iter().zip(reference.bodies()).enumerate() {
        assert!(norm(sub(a.x, b.x)) < 1e-5 * RADIUS, "place of {i}: {:?} instead of {:?}", a.x, b.x);
        assert!(norm(sub(a.v, b.v)) < 1e-3, "velocity of {i}: {:?} instead of {:?}", a.v, b.v);
    }
}

/// Only materials whose law of bonds says so are bonded, and only within its gap.
pub fn bonds_are_made_by_pair_within_the_gap(on: &Subject) {
    let mut w = world(LawChoice::named("none"), 1e-6);
    w.materials.push(grain(1.0, 0.0));
    let laws = PairLaws { bond: Some(law(STRONG, STRONG)), ..PairLaws::default() };
    w.pairs.push((1, 1, PairOverride { laws, ..PairOverride::default() }));
    // Of these 0-1 is of one kind, 1-2 of two, 3-4 too far apart, 5-6 bonded.
    let at = [0.0, SPACING, 2.0 * SPACING, 7.0, 9.03, 12.0, 14.01];
    for (k, (x, material)) in at.into_iter().zip([0, 0, 1, 1, 1, 1, 1]).enumerate() {
        let x = if k < 3 { x } else { x * RADIUS };
        w.particles.push([x, 0.0, 0.0], RADIUS, material);
    }
    let mut run = bonded(on, w);
    assert_eq!(run.g.bonds.made, 1);
    run.steps(10);
    let state = run.state();
    let counts = state.bonds_of(&run.c).unwrap();
    let mut with: Vec<_> =
        state.particles.id.iter().zip(counts).filter(|(_, n)| *n > 0).map(|(id, _)| *id).collect();
    with.sort_unstable();
    assert_eq!(with, [5, 6]);
    // Made again, they are made once.
    run.edit(|c, state| state.bond(c));
    assert_eq!(run.g.bonds.made, 1);
}
