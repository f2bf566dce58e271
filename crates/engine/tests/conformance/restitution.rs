//! Impacts leave with the speed that the coefficient of restitution says.

use glebe_engine::lattice::{dot, scale};
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_physics::{ContactEnd, ContactModel, LawChoice, hertz_collision_time, linear_collision_time};

use crate::support::{Body, Subject, Together, e_star, grain, open_world, plane, sphere_mass, unit};

/// Largest relative error of the restitution.
const ERROR: f64 = 5e-3;
/// Steps per collision.
const STEPS: f64 = 2000.0;

const RADIUS: f64 = 5e-3;
const STIFFNESS: f64 = 1e6;

/// A pair and a sphere on a wall, thrown along an axis that is not the grid's.
#[derive(Clone, Copy, Debug)]
struct Impact {
    normal: &'static str,
    end: ContactEnd,
    e: f64,
    speed: f64,
}

impl Impact {
    fn along() -> Vec3 {
        unit([1.0, 2.0, -1.5])
    }

    fn world(self) -> WorldSpec {
        let Self { normal, end, e, speed } = self;
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
        let n = Self::along();
        let at = |center: f64, s: f64| [center + n[0] * s, n[1] * s, n[2] * s];
        let gap = 0.3 * speed * dt;
        w.particles.push_moving(at(0.0, -RADIUS - gap), RADIUS, 0, scale(n, 0.5 * speed), [0.0; 3]);
        w.particles.push_moving(at(0.0, RADIUS), RADIUS, 0, scale(n, -0.5 * speed), [0.0; 3]);
        w.particles.push_moving(at(0.1, RADIUS + gap), RADIUS, 0, scale(n, -speed), [0.0; 3]);
        w.surfaces = vec![plane(n, [0.1, 0.0, 0.0])];
        w
    }

    /// Restitution of the pair and of the sphere on the wall.
    fn found(self, b: &[Body]) -> [f64; 2] {
        let out = |b: &Body| dot(b.v, Self::along()) / self.speed;
        [out(&b[1]) - out(&b[0]), out(&b[2])]
    }
}

/// Coefficients of 0.05 to 0.95, speeds of 0.01 to 10 m/s, both ends of a contact.
pub fn restitution_equals_e(on: &Subject) {
    let mut impacts = Vec::new();
    for end in [ContactEnd::Tension, ContactEnd::NoTension] {
        for e in (1..20).map(|k| 0.05 * f64::from(k)) {
            impacts.extend([0.01, 0.1, 1.0, 10.0].map(|speed| Impact { normal: "hertz", end, e, speed }));
            impacts.push(Impact { normal: "linear", end, e, speed: 1.0 });
        }
    }
    let mut batch = Together::new(on, impacts.iter().map(|i| i.world()).collect());
    let mut steps = vec![500; impacts.len()];
    for _ in 0..100 {
        batch.advance(&steps);
        for (k, (impact, steps)) in impacts.iter().zip(&mut steps).enumerate() {
            if *steps == 0 {
                continue;
            }
            let m = batch.moment(k);
            assert!(m.overlap < 0.1, "the spheres are too soft for this test: δ = {} R", m.overlap);
            if m.contacts + m.surface_contacts == 0 && impact.found(&batch.bodies(k)).iter().all(|e| *e > 0.0)
            {
                *steps = 0;
            }
        }
        if steps.iter().all(|n| *n == 0) {
            break;
        }
    }
    for (k, impact) in impacts.iter().enumerate() {
        assert_eq!(steps[k], 0, "{impact:?}: the spheres do not part");
        for (what, found) in ["pair", "wall"].iter().zip(impact.found(&batch.bodies(k))) {
            let error = (found / impact.e - 1.0).abs();
            assert!(error < ERROR, "{what}, {impact:?}: e = {found:.5}");
        }
    }
}
