//! How fast the integrators' errors fall with the step, on one impact.

use glebe_engine::backend::Backend;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, hertz_collision_time};

use crate::support::{Run, e_star, grain, open_world, plane, sphere_mass};

const RADIUS: f64 = 5e-3;
const SPEED: f64 = 1.0;
/// Spheres that meet the wall at different fractions of a step.
const PHASES: usize = 32;

/// Root mean square error of the rebound speed over the phases of impact, `steps` to a collision.
fn error(backend: Backend, integrator: IntegratorKind, e: f64, steps: f64) -> f64 {
    let mut m = grain(e, 0.0);
    m.youngs_modulus = 1e8;
    // A driven wall has no mass.
    let dt = hertz_collision_time(sphere_mass(RADIUS, &m), RADIUS, e_star(&m), SPEED) / steps;
    let mut w = open_world([0.0; 3], 1.0, dt, m);
    w.time.integrator = integrator;
    w.contact = ContactModel { tangential: LawChoice::named("none"), ..ContactModel::default() };
    for k in 0..PHASES {
        let gap = (k as f64 + 0.5) / PHASES as f64 * SPEED * dt;
        w.particles.push_moving(
            [0.02 * k as f64, 0.0, RADIUS + gap],
            RADIUS,
            0,
            [0.0, 0.0, -SPEED],
            [0.0; 3],
        );
    }
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    let mut run = Run::new(backend, w);
    run.steps(2 * steps as u64);
    assert_eq!(run.moment().surface_contacts, 0);
    let squares: f64 = run.bodies().iter().map(|b| (b.v[2] / SPEED - e).powi(2)).sum();
    (squares / PHASES as f64).sqrt()
}

/// Halving the step of an elastic impact from 1/200 to 1/400 of it divides the error by 5.7 (euler, verlet), 6
/// (adams) and 2 (exact, which is anti-damped); at e = 0.5 the end of the contact makes all of order 1 to 1.4.
/// In f32 the elastic error at 1/400 drowns in rounding: there the step before is taken.
pub fn orders_of_the_integrators(backend: Backend) {
    let steps = if backend == Backend::Reference { 200.0 } else { 100.0 };
    for (integrator, low, high) in [
        (IntegratorKind::Euler, 4.8, 6.4),
        (IntegratorKind::VelocityVerlet, 4.8, 6.4),
        (IntegratorKind::Adams, 5.0, 7.5),
        (IntegratorKind::Exact, 1.9, 2.1),
    ] {
        let falls = |e: f64, from: f64, halvings: i32| {
            let to = from * 2_f64.powi(halvings);
            let ratio = error(backend, integrator, e, from) / error(backend, integrator, e, to);
            ratio.powf(1.0 / f64::from(halvings))
        };
        let name = integrator.name();
        let elastic = falls(1.0, steps, 1);
        assert!((low..high).contains(&elastic), "{name}: the elastic error falls by {elastic:.2} a halving");
        // Order 1 to 1.4; over five halvings, because single ones scatter with the phase of the end.
        let damped = falls(0.5, 50.0, 5);
        assert!(
            (1.95..2.65).contains(&damped),
            "{name}: at e = 0.5 the error falls by {damped:.2} a halving"
        );
    }
}
