//! Identities that every registered law of a slot keeps; a test for each slot, since many laws take long on a device.

use std::f64::consts::TAU;

use glebe_engine::lattice::{add, cross, dot, norm, scale, sub};
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_engine::state::State;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, LawInfo, Slot, laws};

use crate::support::{
    Run, Subject, USUAL, YIELDING, assert_near, choice, each_law_of, grain, has_spring, label, open_world,
    plane, turned, unit,
};

/// Relative error of the first step's stretch.
const BIRTH: f64 = 1e-3;
/// Most energy that may come from nowhere in a step, as a share of the kinetic energy.
const GAIN: f64 = 1e-6;
/// Relative error of the tangential force of a contact turned rigidly once around, as a vector: projecting the spring
/// turns it by half the square of the step's angle, 2π/1000 here.
const TURN_VECTOR: f64 = 1e-2;

const RADIUS: f64 = 2e-3;

/// A sphere above a plane, and beside it another above a third, all thrown obliquely; ten times the weight of Earth
/// brings them back soon.
fn impacts(contact: ContactModel, e: f64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 2e-6, grain(e, 0.4));
    w.contact = contact;
    w.gravity = [0.0, 0.0, -98.1];
    let top = [0.02, 0.0, 1.999 * RADIUS + RADIUS];
    w.particles.push_moving([0.0, 0.0, 1.01 * RADIUS], RADIUS, 0, [0.1, 0.03, -0.05], [5.0, 20.0, 9.0]);
    w.particles.push([0.02, 0.0, 0.999 * RADIUS], RADIUS, 0);
    w.particles.push_moving(
        add(top, [0.0, 0.0, 0.02 * RADIUS]),
        RADIUS,
        0,
        [0.05, 0.02, -0.05],
        [9.0, -20.0, 4.0],
    );
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    w
}

/// Speed of two bodies' surfaces past each other.
fn sliding_speed(v: [Vec3; 2], w: [Vec3; 2], n: Vec3, arm: [f64; 2]) -> f64 {
    let turning = cross(add(scale(w[0], arm[0]), scale(w[1], arm[1])), n);
    let u = add(sub(v[0], v[1]), turning);
    norm(sub(u, scale(n, dot(u, n))))
}

/// Tests of all laws of a slot.
macro_rules! by_slot {
    ($($slot:expr => $born:ident, $dissipates:ident, $turns:ident;)*) => {$(
        pub fn $born(on: &Subject) {
            contacts_are_born_without_memory(on, $slot);
        }
        pub fn $dissipates(on: &Subject) {
            dissipation_is_not_negative(on, $slot);
        }
        pub fn $turns(on: &Subject) {
            contacts_that_turn_keep_their_force(on, $slot);
        }
    )*};
}

by_slot! {
    Slot::Normal => contacts_of_normal_laws_are_born_without_memory, normal_laws_do_not_give_energy,
        contacts_of_normal_laws_that_turn_keep_their_force;
    Slot::Tangential => contacts_of_tangential_laws_are_born_without_memory, tangential_laws_do_not_give_energy,
        contacts_of_tangential_laws_that_turn_keep_their_force;
    Slot::Rolling => contacts_of_rolling_laws_are_born_without_memory, rolling_laws_do_not_give_energy,
        contacts_of_rolling_laws_that_turn_keep_their_force;
    Slot::Cohesion => contacts_of_cohesive_laws_are_born_without_memory, cohesive_laws_do_not_give_energy,
        contacts_of_cohesive_laws_that_turn_keep_their_force;
}

fn contacts_are_born_without_memory(on: &Subject, slot: Slot) {
    /// Steps from look to look, a tenth of an impact.
    const LOOK: u64 = 50;
    for contact in each_law_of(slot).into_iter().filter(has_spring) {
        let name = label(&contact);
        let bridges = contact.cohesion.law == "capillary";
        let mut run = Run::new(on, impacts(contact, 1.0));
        let mut born = [0, 0];
        for _ in 0..2500 / LOOK {
            let before = run.state();
            run.steps(LOOK);
            if !newborn(&before, &run.state()).contains(&true) {
                continue;
            }
            // Back, and step by step to where it is born.
            run.load(before);
            for _ in 0..LOOK {
                let (before, bodies) = (run.state(), run.bodies());
                run.steps(1);
                let state = run.state();
                let is_new = newborn(&before, &state);
                let stretch = |h: &[f32]| norm([h[0], h[1], h[2]].map(f64::from));
                let floor = state.surface_contacts.iter().find(|m| m.id == 0);
                if let Some(m) = floor.filter(|_| is_new[0]) {
                    let b = bodies[0];
                    let speed =
                        sliding_speed([b.v, [0.0; 3]], [b.w, [0.0; 3]], [0.0, 0.0, -1.0], [b.x[2], 0.0]);
                    let most = speed * run.c.dt;
                    assert!(
                        stretch(&m.history) <= most * (1.0 + BIRTH),
                        "{name}: {:?}, not {most:e}",
                        m.history
                    );
                    born[0] += 1;
                }
                let sphere = state.contacts.iter().find(|m| m.id == [1, 2]);
                if let Some(m) = sphere.filter(|_| is_new[1]) {
                    let (a, b) = (bodies[1], bodies[2]);
                    let d = sub(b.x, a.x);
                    let speed = sliding_speed([a.v, b.v], [a.w, b.w], unit(d), [0.5 * norm(d); 2]);
                    let most = speed * run.c.dt;
                    assert!(
                        stretch(&m.history) <= most * (1.0 + BIRTH),
                        "{name}: {:?}, not {most:e}",
                        m.history
                    );
                    born[1] += 1;
                }
            }
        }
        // Bridges do not let go of what they have caught.
        assert!(
            born[0] >= if bridges { 1 } else { 2 } && born[1] >= 1,
            "{name}: {born:?} contacts were born"
        );
    }
}

/// Whether sphere 0 has come to touch the plane, and sphere 2 sphere 1.
fn newborn(before: &State, now: &State) -> [bool; 2] {
    let touch =
        |s: &State| [s.surface_contacts.iter().any(|m| m.id == 0), s.contacts.iter().any(|m| m.id == [1, 2])];
    let (was, is) = (touch(before), touch(now));
    [0, 1].map(|k| is[k] && !was[k])
}

pub fn force_is_the_slope_of_energy(on: &Subject) {
    let told = |law: &&LawInfo| on.every_law || USUAL.contains(&law.name);
    let elastic = |law: &&LawInfo| !YIELDING.contains(&law.name);
    for normal in laws(Slot::Normal).iter().filter(elastic).filter(told) {
        for cohesion in laws(Slot::Cohesion).iter().filter(told) {
            for overlap in [1e-3, 1e-2, 0.1] {
                let contact = ContactModel {
                    normal: choice(normal),
                    cohesion: choice(cohesion),
                    tangential: LawChoice::named("none"),
                    ..ContactModel::default()
                };
                let name = format!("{} at δ = {overlap} R", label(&contact));
                // Energy and force of the pair and of the sphere on the plane, one at a time.
                let look = |contact: &ContactModel, overlap: f64, pair: bool| {
                    let mut w = open_world([0.0; 3], 0.1, 1e-9, grain(1.0, 0.0));
                    w.contact = contact.clone();
                    let toward = unit([0.3, -0.5, 0.8]);
                    let distance = if pair { 2.0 * RADIUS } else { RADIUS } - overlap;
                    w.particles.push(scale(toward, distance), RADIUS, 0);
                    if pair {
                        w.particles.push([0.0; 3], RADIUS, 0);
                    } else {
                        w.surfaces = vec![plane(toward, [0.0; 3])];
                    }
                    let mut run = Run::new(on, w);
                    let energy = run.moment().elastic_normal;
                    run.steps(1);
                    (energy, dot(run.bodies()[0].force, toward))
                };
                for pair in [true, false] {
                    let (delta, h) = (overlap * RADIUS, 0.005 * overlap * RADIUS);
                    let slope =
                        (look(&contact, delta + h, pair).0 - look(&contact, delta - h, pair).0) / (2.0 * h);
                    let force = look(&contact, delta, pair).1;
                    // Spring and cohesion may nearly cancel.
                    let dry = ContactModel { cohesion: LawChoice::named("none"), ..contact.clone() };
                    let spring = look(&dry, delta, pair).1;
                    let error = (force - slope).abs() / (force.abs() + (spring - force).abs());
                    assert!(
                        error < on.bounds.slope,
                        "{name}: force {force:e}, slope {slope:e}, pair: {pair}"
                    );
                }
            }
        }
    }
}

fn dissipation_is_not_negative(on: &Subject, slot: Slot) {
    for contact in each_law_of(slot) {
        let name = label(&contact);
        let mut run = Run::new(on, impacts(contact, 0.3));
        let energy = run.moment().kinetic();
        let mut before = run.g.ledger;
        for step in 0..1500 {
            run.steps(1);
            let now = run.g.ledger;
            let rows = [
                ("friction", now.friction - before.friction),
                ("dashpots", now.dashpots - before.dashpots),
                ("rolling", now.rolling - before.rolling),
            ];
            for (row, lost) in rows {
                assert!(lost >= -GAIN * energy, "{name}: {row} gave {:.2e} in step {step}", -lost / energy);
            }
            before = now;
        }
        assert!(before.dissipated() > 0.1 * energy, "{name}: {before:?}");
    }
}

/// Two touching spheres, their spring stretched, turned as one rigid body, once around where a backend can afford it, about
/// three axes: across the contact, along it (twist), and neither. Velocities are those that the integrator has there: of the same
/// instant, or of the chord from the place before.
fn contacts_that_turn_keep_their_force(on: &Subject, slot: Slot) {
    /// Of a turn.
    const STEPS: u64 = 1000;
    let (dt, overlap) = (1e-5, 1e-2 * RADIUS);
    let rate = TAU / (STEPS as f64 * dt);
    let every =
        each_law_of(slot).into_iter().filter(has_spring).map(|contact| (contact, IntegratorKind::Euler));
    let other = (slot == Slot::Tangential).then(|| (ContactModel::default(), IntegratorKind::Exact));
    for (contact, integrator) in every.chain(other) {
        for axis in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], unit([0.5, 0.3, 0.9])] {
            let name = format!("{} about {axis:?}, {}", label(&contact), integrator.name());
            let mut w = open_world([0.0; 3], 0.1, dt, grain(0.5, 100.0));
            w.contact = contact.clone();
            w.time.integrator = integrator;
            let arm = RADIUS - 0.5 * overlap;
            w.particles.push([-arm, 0.0, 0.0], RADIUS, 0);
            w.particles.push([arm, 0.0, 0.0], RADIUS, 0);
            let mut run = Run::new(on, w);
            run.steps(1);
            run.edit(|_, state| {
                state.contacts[0].history[..4].copy_from_slice(&[0.0, 1e-5, 5e-6, 0.0]);
            });
            let mut first = [0.0; 3];
            for step in 0..=on.budget.turning {
                let angle = TAU * step as f64 / STEPS as f64;
                let x = turned([arm, 0.0, 0.0], axis, angle);
                let half = 0.5 * rate * dt;
                let (v, rate) = if integrator.lags() {
                    let before = turned([arm, 0.0, 0.0], axis, angle - 2.0 * half);
                    (scale(sub(x, before), 1.0 / dt), rate * half.tan() / half)
                } else {
                    (scale(cross(axis, x), rate), rate)
                };
                run.edit(|c, state| {
                    let p = &mut state.particles;
                    for i in 0..2 {
                        let sign = if p.id[i] == 0 { -1.0 } else { 1.0 };
                        let e = c.lattice.encode(scale(x, sign));
                        (p.hi[i], p.place[i].lo, p.rest[i]) = (e.hi, e.lo, e.rest);
                        p.velocity[i].v = scale(v, sign).map(|x| x as f32);
                        p.spin[i].w = scale(axis, rate).map(|x| x as f32);
                    }
                });
                run.steps(1);
                let n = unit(x);
                let force = run.bodies()[0].force;
                let tangential = sub(force, scale(n, dot(force, n)));
                if step == 0 {
                    first = tangential;
                    assert!(norm(first) > 1e-4, "{name}: no force to keep");
                }
                assert_near(&name, tangential, turned(first, axis, angle), TURN_VECTOR * norm(first));
                assert_near(
                    &name,
                    [norm(tangential), 0.0, 0.0],
                    [norm(first), 0.0, 0.0],
                    on.bounds.turn * norm(first),
                );
            }
        }
    }
}
