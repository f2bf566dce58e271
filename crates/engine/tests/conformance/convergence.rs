//! How fast the integrators' errors fall with the step, on one impact.

use glebe_physics::{ContactModel, IntegratorKind, LawChoice, hertz_collision_time};

use crate::support::{Subject, Together, e_star, grain, open_world, plane, sphere_mass};

const RADIUS: f64 = 5e-3;
const SPEED: f64 = 1.0;
/// Spheres that meet the wall at different fractions of a step.
const PHASES: usize = 32;

/// Root mean square error of the rebound speed over the phases of impact, `steps` to a collision. Each sphere is
/// a world of its own, so that its speed is read from its energy, which the reference has in f64.
fn error(on: &Subject, integrator: IntegratorKind, e: f64, steps: f64) -> f64 {
    let mut m = grain(e, 0.0);
    m.youngs_modulus = 1e8;
    // A driven wall has no mass.
    let dt = hertz_collision_time(sphere_mass(RADIUS, &m), RADIUS, e_star(&m), SPEED) / steps;
    let mut w = open_world([0.0; 3], 1.0, dt, m);
    w.time.integrator = integrator;
    w.contact = ContactModel { tangential: LawChoice::named("none"), ..ContactModel::default() };
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    let worlds = (0..PHASES).map(|k| {
        let gap = (k as f64 + 0.5) / PHASES as f64 * SPEED * dt;
        let mut w = w.clone();
        w.particles.push_moving([0.0, 0.0, RADIUS + gap], RADIUS, 0, [0.0, 0.0, -SPEED], [0.0; 3]);
        w
    });
    let mut batch = Together::new(on, worlds.collect());
    let before: Vec<f64> = (0..PHASES).map(|k| batch.moment(k).translation).collect();
    batch.steps(2 * steps as u64);
    let square = |k: usize| {
        let after = batch.moment(k);
        assert_eq!(after.surface_contacts, 0);
        ((after.translation / before[k]).sqrt() - e).powi(2)
    };
    ((0..PHASES).map(square).sum::<f64>() / PHASES as f64).sqrt()
}

/// Halving the step of an elastic impact from 1/200 to 1/400 of it divides the error by 5.7 = 2^2.5 (euler,
/// verlet), by 6 to 8 (adams) and by 2 (exact, which is anti-damped); the same holds on average from 1/25 to the
/// finest step that the number format can tell. In f32 that is 1/200: there the error of the first two is 1e-6 of
/// the speed, at 1/400 it would be 2e-7, and the rounding of some hundred additions to a velocity leaves 3e-7 at
/// any step. So the halving to 1/400 is judged where its error can be seen: on the reference for all, in f32 for
/// `exact`, whose error there is 7e-3. At e = 0.5 the jump of the force at the end of the contact makes all of
/// order 1 to 1.4: errors above 1e-5, far above rounding.
pub fn orders_of_the_integrators(on: &Subject) {
    for (integrator, low, high) in [
        (IntegratorKind::Euler, 5.1, 6.3),
        (IntegratorKind::VelocityVerlet, 5.1, 6.3),
        (IntegratorKind::Adams, 6.0, 8.0),
        (IntegratorKind::Exact, 1.95, 2.1),
    ] {
        // By which factor the error falls a halving.
        let falls = |e: f64, from: f64, to: f64| {
            let ratio = error(on, integrator, e, from) / error(on, integrator, e, to);
            ratio.powf(1.0 / (to / from).log2())
        };
        let name = integrator.name();
        let seen = integrator == IntegratorKind::Exact || on.bounds.finest_impact >= 400.0;
        for (from, to) in
            [(25.0, on.bounds.finest_impact), (200.0, 400.0)].into_iter().take(1 + usize::from(seen))
        {
            let elastic = falls(1.0, from, to);
            assert!(
                (low..high).contains(&elastic),
                "{name}: the elastic error falls by {elastic:.2} a halving from {from} to {to} steps"
            );
        }
        // Over five halvings, because single ones scatter with the phase of the end.
        let damped = falls(0.5, 50.0, 1600.0);
        assert!(
            (1.95..2.65).contains(&damped),
            "{name}: at e = 0.5 the error falls by {damped:.2} a halving"
        );
    }
}
