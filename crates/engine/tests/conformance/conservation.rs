//! Momentum and angular momentum of an isolated cloud, for every registered law.

use glebe_engine::lattice::{add, cross, norm, scale, sub};
use glebe_engine::spec::{Vec3, WorldSpec};
use glebe_physics::ContactModel;

use crate::support::{Body, Random, Run, Subject, each_law_for, grain, label, open_world};

/// Laws whose torques are not equal and opposite, as their papers have them.
const NOT_CONSERVING: [&str; 2] = ["chrono", "gpudem"];

/// 64 spheres of 1-2 mm on a jittered grid, overlapping by some percent, moving and spinning.
pub fn cloud(contact: ContactModel) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 5e-6, grain(0.5, 0.5));
    w.contact = contact;
    let mut r = Random(1);
    for i in 0..64 {
        let at = [i % 4, i / 4 % 4, i / 16].map(|k| 2.7e-3 * f64::from(k));
        let radius = 1e-3 * (1.2 + 0.4 * r.unit());
        w.particles.push_moving(add(at, r.vector(2e-4)), radius, 0, r.vector(0.5), r.vector(300.0));
    }
    w
}

/// Momentum, angular momentum about `center`, and the sums of their parts' sizes.
fn momenta(bodies: &[Body], center: Vec3) -> ([Vec3; 2], [f64; 2]) {
    let (mut sums, mut sizes) = ([[0.0; 3]; 2], [0.0; 2]);
    for b in bodies {
        let p = scale(b.v, b.mass);
        let l = [cross(sub(b.x, center), p), scale(b.w, 0.4 * b.mass * b.radius * b.radius)];
        sums = [add(sums[0], p), add(sums[1], add(l[0], l[1]))];
        sizes = [sizes[0] + norm(p), sizes[1] + norm(l[0]) + norm(l[1])];
    }
    (sums, sizes)
}

pub fn momentum_of_an_isolated_cloud(on: &Subject) {
    for contact in each_law_for(on) {
        let name = label(&contact);
        let conserving = !NOT_CONSERVING.contains(&contact.rolling.law.as_str());
        let mut run = Run::new(on, cloud(contact));
        assert!(run.moment().contacts > 60, "{name}: {} contacts", run.moment().contacts);
        let center = [4e-3; 3];
        let (before, size) = momenta(&run.bodies(), center);
        run.steps(200);
        let (after, _) = momenta(&run.bodies(), center);
        let change = [0, 1].map(|k| norm(sub(after[k], before[k])) / size[k]);
        assert!(change[0] < on.bounds.momentum, "{name}: momentum changed by {:.2e}", change[0]);
        if conserving {
            assert!(
                change[1] < on.bounds.angular_momentum,
                "{name}: angular momentum changed by {:.2e}",
                change[1]
            );
        }
    }
}
