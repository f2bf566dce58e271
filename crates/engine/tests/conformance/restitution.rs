//! Impacts leave with the speed that the coefficient of restitution says.

use glebe_engine::backend::Backend;
use glebe_engine::lattice::dot;
use glebe_physics::{ContactEnd, ContactModel, LawChoice, hertz_collision_time, linear_collision_time};

use crate::support::{Run, e_star, grain, open_world, plane, sphere_mass, unit};

/// Largest relative error of the restitution.
const ERROR: f64 = 5e-3;
/// Steps per collision.
const STEPS: f64 = 2000.0;

const RADIUS: f64 = 5e-3;
const STIFFNESS: f64 = 1e6;

/// Restitution of a pair and of a sphere on a wall, both thrown along an axis that is not the grid's.
fn measured(backend: Backend, e: f64, speed: f64, end: ContactEnd, normal: &str) -> [f64; 2] {
    let mut m = grain(e, 0.0);
    m.youngs_modulus = 4e9;
    let mass = sphere_mass(RADIUS, &m);
    let linear = normal == "linear";
    let time = if linear {
        linear_collision_time(0.5 * mass, STIFFNESS)
    } else {
        hertz_collision_time(0.5 * mass, 0.5 * RADIUS, e_star(&m), speed)
    };
    let dt = time / STEPS;
    let mut w = open_world([0.0; 3], 1.0, dt, m);
    let law = LawChoice::named(normal);
    w.contact = ContactModel {
        normal: if linear { law.with("stiffness", STIFFNESS) } else { law },
        tangential: LawChoice::named("none"),
        end,
        ..ContactModel::default()
    };
    let n = unit([1.0, 2.0, -1.5]);
    let at = |center: f64, s: f64| [center + n[0] * s, n[1] * s, n[2] * s];
    let gap = 0.3 * speed * dt;
    w.particles.push_moving(at(0.0, -RADIUS - gap), RADIUS, 0, n.map(|n| 0.5 * speed * n), [0.0; 3]);
    w.particles.push_moving(at(0.0, RADIUS), RADIUS, 0, n.map(|n| -0.5 * speed * n), [0.0; 3]);
    w.particles.push_moving(at(0.1, RADIUS + gap), RADIUS, 0, n.map(|n| -speed * n), [0.0; 3]);
    w.surfaces = vec![plane(n, [0.1, 0.0, 0.0])];
    let mut run = Run::new(backend, w);
    let mut deepest = 0.0_f64;
    for _ in 0..100 {
        run.steps(500);
        let b = run.bodies();
        let out = [dot(b[1].v, n) - dot(b[0].v, n), dot(b[2].v, n)];
        let m = run.moment();
        deepest = deepest.max(m.overlap);
        if m.contacts + m.surface_contacts == 0 && out[0] > 0.0 && out[1] > 0.0 {
            assert!(deepest < 0.1, "the spheres are too soft for this test: δ = {deepest} R");
            return out.map(|v| v / speed);
        }
    }
    panic!("{normal}, e = {e} at {speed} m/s: the spheres do not part");
}

pub fn restitution_equals_e(backend: Backend) {
    for end in [ContactEnd::Tension, ContactEnd::NoTension] {
        for e in [0.05, 0.1, 0.3, 0.5, 0.8, 0.95] {
            let linear = measured(backend, e, 1.0, end, "linear");
            let hertz = [0.01, 0.1, 1.0, 10.0].map(|v| (v, measured(backend, e, v, end, "hertz")));
            for (speed, [pair, wall]) in hertz.into_iter().chain([(1.0, linear)]) {
                for (what, found) in [("pair", pair), ("wall", wall)] {
                    let error = (found / e - 1.0).abs();
                    assert!(error < ERROR, "{what}, {end:?}, {speed} m/s: e = {found:.5} instead of {e}");
                }
            }
        }
    }
}
