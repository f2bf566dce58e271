//! Bodies that meet because a law of cohesion acts beyond touch, but do not touch.

use std::sync::Arc;

use glebe_engine::lattice::{norm, sub};
use glebe_engine::prepare;
use glebe_engine::spec::{Pose, Vec3, WorldSpec};
use glebe_physics::{ContactEnd, ContactModel, History};

use crate::support::{Random, Run, Subject, each_law, grain, label, mesh, open_world, plane, rectangle};

const RADIUS: f64 = 1e-3;
/// What the order of sums may change, as a share of places, velocities, spins and forces.
const ORDER: f64 = 1e-5;
/// Impacts drive apart what roundings have parted. This often the distance to where one rounding of each starting
/// velocity leads is allowed besides, since every step rounds.
const GROWN: f64 = 4.0;

/// Grains that bounce on each other, on a plane and on a mesh; their velocities a share `nudge` off.
fn bouncing(contact: ContactModel, nudge: f64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.1, 5e-6, grain(0.7, 0.4));
    w.contact = contact;
    w.gravity = [0.0, 0.0, -9.81];
    let mut r = Random(17);
    for i in 0..27 {
        let at = [i % 3, i / 3 % 3, i / 9].map(|k| (2.05 * f64::from(k) + 1.02) * RADIUS);
        let radius = RADIUS * (0.9 + 0.1 * r.unit());
        let (v, spin) = (r.vector(0.5), r.vector(200.0));
        w.particles.push_moving(at, radius, 0, v.map(|x| x * (1.0 + nudge)), spin);
    }
    let (vertices, triangles) = rectangle([-0.05; 2], [0.05; 2]);
    let wall = Pose { translation: [0.0; 3], rotation: [0.5, 0.5, 0.5, 0.5] };
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3]), mesh(vertices, triangles, wall)];
    w
}

/// Springs, dashpots, friction and rolling resistance act in touch only, and cohesion as far as its own range:
/// where another pair of materials reaches farther, the motion stays the same, bit for bit where the lists' reach does
/// not change the order of sums.
pub fn what_does_not_touch_does_not_press(subject: &Subject) {
    for mut contact in each_law() {
        for (end, history) in
            [(ContactEnd::Tension, History::Truncated), (ContactEnd::NoTension, History::Unbounded)]
        {
            (contact.end, contact.history) = (end, history);
            let name = label(&contact);
            let motion = |farther: f64, nudge: f64| {
                let (mut c, state) = prepare(bouncing(contact.clone(), nudge)).unwrap();
                Arc::get_mut(&mut c).unwrap().range += farther;
                let mut run = Run::resume(subject, c, state);
                let mut met = 0;
                for _ in 0..12 {
                    let m = run.steps(50).moment();
                    met += m.contacts + m.surface_contacts;
                }
                let bodies: Vec<_> = run.bodies().iter().map(|b| [b.x, b.v, b.w, b.force]).collect();
                (bodies, met, run.g.ledger.dissipated())
            };
            let (near, met, lost) = motion(0.0, 0.0);
            let (far, met_afar, lost_afar) = motion(0.3 * RADIUS, 0.0);
            // Bridges reach far themselves, and hold a grain at many contacts at once, whose sum has an order.
            let bridges = contact.cohesion.law == "capillary";
            let exact_reach = subject.exact_reach && !bridges;
            let more = if bridges { met } else { 2 * met };
            assert!(met > 10 && met_afar > more, "{name}: {met} and {met_afar} contacts");
            if exact_reach {
                let bits = |bodies: &[[Vec3; 4]]| -> Vec<_> {
                    bodies.iter().map(|b| b.map(|x| x.map(f64::to_bits))).collect()
                };
                assert_eq!(bits(&near), bits(&far), "{name}");
            } else {
                let (nudged, ..) = motion(0.0, f64::from(f32::EPSILON));
                for k in 0..4 {
                    let apart = |a: &[Vec3; 4], b: &[Vec3; 4]| norm(sub(a[k], b[k]));
                    let grown = near.iter().zip(&nudged).map(|(a, b)| apart(a, b)).fold(0.0, f64::max);
                    for (a, b) in near.iter().zip(&far) {
                        assert!(
                            apart(a, b) <= ORDER * norm(a[k]) + GROWN * grown,
                            "{name}: {:?} and {:?}, a nudge leads {grown:e} away",
                            a[k],
                            b[k]
                        );
                    }
                }
            }
            // What adhesion takes is not seen of bodies that part beyond all reach within a step.
            let parts = contact.cohesion.law == "jkr";
            let exact = if exact_reach { 1e-9 } else { ORDER };
            assert!(
                (lost_afar / lost - 1.0).abs() < if parts { 1e-3 } else { exact },
                "{name}: {lost:e} and {lost_afar:e} J dissipated"
            );
        }
    }
}
