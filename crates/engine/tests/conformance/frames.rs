//! The same motion seen from a frame that moves, is turned or stands elsewhere.

use std::f64::consts::{FRAC_PI_2, PI};

use glebe_engine::lattice::{add, norm, scale, sub};
use glebe_engine::spec::{Domain, Pose, Rotation, Shape, Side, Vec3, WorldSpec};
use glebe_engine::surface::quaternion;
use glebe_physics::{ContactModel, IntegratorKind, LawChoice};

use crate::packing::nearest;
use crate::support::{
    Body, Random, Run, Subject, Together, grain, mesh, open_world, plane, rectangle, turned, unit,
};

const RADIUS: f64 = 2e-3;
const STEPS: u64 = 100;

/// A frame: turned by `angle` about `axis`, then moved to `origin`, moving with `velocity`.
#[derive(Clone, Copy)]
struct Frame {
    axis: Vec3,
    angle: f64,
    origin: Vec3,
    velocity: Vec3,
}

const HOME: Frame = Frame { axis: [0.0, 0.0, 1.0], angle: 0.0, origin: [0.0; 3], velocity: [0.0; 3] };

impl Frame {
    fn turn(&self, x: Vec3) -> Vec3 {
        turned(x, self.axis, self.angle)
    }
    fn place(&self, x: Vec3) -> Vec3 {
        add(self.origin, self.turn(x))
    }

    /// 27 spheres falling on a plane and between a turning and an oscillating mesh, seen from this frame.
    fn world(&self, integrator: IntegratorKind) -> WorldSpec {
        let mut w = open_world([0.0; 3], 200.0, 5e-6, grain(0.6, 0.4));
        w.time.integrator = integrator;
        w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
        w.gravity = self.turn([0.0, 0.0, -9.81]);
        let mut r = Random(7);
        for i in 0..27 {
            let at = [i % 3, i / 3 % 3, i / 9].map(|k| 1.97 * RADIUS * f64::from(k));
            let v = add(self.turn(r.vector(0.3)), self.velocity);
            let x = self.place(add(add(at, [0.0, 0.0, 0.99 * RADIUS]), r.vector(2e-5)));
            w.particles.push_moving(x, RADIUS, 0, v, self.turn(r.vector(50.0)));
        }
        let (vertices, triangles) = rectangle([-0.02; 2], [0.02; 2]);
        let wall = |from: f64, tilt: f64| {
            let pose = Pose { translation: [from, 0.0, 0.0], rotation: quaternion([0.0, 1.0, 0.0], tilt) };
            mesh(vertices.clone(), triangles.clone(), pose)
        };
        w.surfaces = vec![
            plane([0.0, 0.0, 1.0], [0.0; 3]),
            wall(-0.98 * RADIUS, FRAC_PI_2 + 0.02),
            wall(4.92 * RADIUS, FRAC_PI_2 - 0.01),
        ];
        w.surfaces[1].motion.velocity = [0.05, 0.0, 0.0];
        w.surfaces[2].motion.rotation =
            Some(Rotation { axis: [0.0, 0.0, 1.0], center: [4.92 * RADIUS, 0.0, 0.0], rate: 3.0 });
        for s in &mut w.surfaces {
            if let Shape::Plane { normal } = &mut s.shape {
                *normal = self.turn(*normal);
            } else {
                s.pose.rotation = compose(quaternion(self.axis, self.angle), s.pose.rotation);
            }
            s.pose.translation = self.place(s.pose.translation);
            s.motion.velocity = add(self.turn(s.motion.velocity), self.velocity);
            if let Some(r) = &mut s.motion.rotation {
                (r.axis, r.center) = (self.turn(r.axis), self.place(r.center));
            }
        }
        w
    }

    /// What home sees, seen from here.
    fn sees(&self, b: &Body, time: f64) -> Body {
        let v = add(self.turn(b.v), self.velocity);
        let x = add(self.place(b.x), self.velocity.map(|v| v * time));
        Body { x, v, w: self.turn(b.w), ..*b }
    }
}

fn compose(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let (u, v) = ([a[1], a[2], a[3]], [b[1], b[2], b[3]]);
    let w = glebe_engine::lattice::cross(u, v);
    let d = glebe_engine::lattice::dot(u, v);
    [
        a[0] * b[0] - d,
        a[0] * v[0] + b[0] * u[0] + w[0],
        a[0] * v[1] + b[0] * u[1] + w[1],
        a[0] * v[2] + b[0] * u[2] + w[2],
    ]
}

fn compare(on: &Subject, frame: Frame, integrator: IntegratorKind) {
    let mut home = Run::new(on, HOME.world(integrator));
    let mut away = Run::new(on, frame.world(integrator));
    assert!(home.moment().contacts > 30 && home.moment().surface_contacts > 15);
    home.steps(STEPS);
    away.steps(STEPS);
    let seen: Vec<Body> = home.bodies().iter().map(|b| frame.sees(b, STEPS as f64 * home.c.dt)).collect();
    assert_equal(on, integrator.name(), &away.bodies(), &seen);
}

/// Asserts that `a` and `b` differ by no more than rounding makes of equal motions.
fn assert_equal(on: &Subject, what: &str, a: &[Body], b: &[Body]) {
    let most = &on.bounds.frame;
    let mean = scale(b.iter().fold([0.0; 3], |sum, b| add(sum, b.v)), 1.0 / b.len() as f64);
    let v = b.iter().map(|b| norm(sub(b.v, mean))).fold(0.0, f64::max);
    let w = b.iter().map(|b| norm(b.w)).fold(0.0, f64::max);
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        let off = [norm(sub(a.x, b.x)) / RADIUS, norm(sub(a.v, b.v)) / v, norm(sub(a.w, b.w)) / w];
        assert!(
            off[0] < most.place && off[1] < most.velocity && off[2] < most.spin,
            "{what}: particle {i} is off by {off:.2?} (place in radii, velocity, spin)"
        );
    }
}

pub fn a_boost_changes_nothing(on: &Subject) {
    for integrator in IntegratorKind::ALL {
        compare(on, Frame { velocity: [0.5, -0.3, 0.2], ..HOME }, integrator);
    }
}

pub fn a_rotation_changes_nothing(on: &Subject) {
    compare(on, Frame { axis: [1.0, 0.0, 0.0], angle: FRAC_PI_2, ..HOME }, IntegratorKind::Euler);
    compare(on, Frame { axis: [0.0, 1.0, 0.0], angle: PI, ..HOME }, IntegratorKind::Euler);
    compare(on, Frame { axis: unit([1.0, -2.0, 0.7]), angle: 1.1, ..HOME }, IntegratorKind::Euler);
}

pub fn a_translation_changes_nothing(on: &Subject) {
    compare(on, Frame { origin: [100.0, -100.0, 100.0], ..HOME }, IntegratorKind::Euler);
}

/// A cube that repeats and a sheared cell of the same lattice of images hold the same packing.
pub fn a_sheared_cell_changes_nothing(on: &Subject) {
    const SIDE: f64 = 6.0 * 1.35 * RADIUS;
    let world = |shear: f64| {
        let mut w = open_world([0.0; 3], 0.1, 5e-6, grain(0.6, 0.4));
        w.contact.rolling = LawChoice::named("constant-torque");
        w.domain = Domain::aligned([0.0; 3], [SIDE; 3], [[Side::Periodic; 2]; 3], None);
        w.domain.cell[0][1] = shear;
        let mut r = Random(8);
        for i in 0..216 {
            let at = [i % 6, i / 6 % 6, i / 36].map(|k| 1.35 * RADIUS * f64::from(k));
            let radius = RADIUS * (0.6 + 0.2 * r.unit());
            w.particles.push_moving(add(at, r.vector(1e-4)), radius, 0, r.vector(0.5), r.vector(50.0));
        }
        w
    };
    let mut batch = Together::new(on, vec![world(0.0), world(SIDE)]);
    assert!(batch.moment(0).contacts > 300 && batch.moment(0).contacts == batch.moment(1).contacts);
    batch.steps(STEPS);
    let [cube, mut sheared] = [0, 1].map(|k| batch.bodies(k));
    for (a, b) in sheared.iter_mut().zip(&cube) {
        a.x = add(b.x, nearest(sub(a.x, b.x), SIDE));
    }
    assert_equal(on, "a sheared cell", &sheared, &cube);
}
