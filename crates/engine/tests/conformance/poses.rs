//! A surface that moves by a table acts as one that moves by the closed form which the table samples.

use std::f64::consts::TAU;
use std::sync::Arc;

use glebe_engine::lattice::{add, norm, sub};
use glebe_engine::poses::{PoseTable, TimedPose};
use glebe_engine::spec::{Motion, Oscillation, Pose, Rotation, WorldSpec};
use glebe_engine::surface::quaternion;

use crate::support::{Subject, Together, grain, mesh, open_world, rectangle, unit};

const RADIUS: f64 = 2e-3;

/// The motion sampled at `times` \[s\].
fn sampled(motion: &Motion, base: &Pose, times: &[f64]) -> Motion {
    let rows: Vec<_> =
        times.iter().map(|&time| TimedPose { time, pose: motion.at(base, time).pose }).collect();
    Motion { poses: Some(Arc::new(PoseTable::new(&rows).unwrap())), ..Motion::default() }
}

/// A plate that moves and turns throws up spheres, once by its closed form and once by rows at odd times, of which
/// some have the quaternion of the other sign. What differs is rounding: the poses by some 1e-16 m.
pub fn a_table_of_a_steady_motion_is_that_motion(on: &Subject) {
    let base = Pose { translation: [0.01, -0.02, 0.03], rotation: quaternion(unit([1.0, 2.0, -1.0]), 0.7) };
    let axis = unit([0.2, 1.0, 0.3]);
    let rotation = Some(Rotation { axis, center: base.translation, rate: 300.0 });
    let steady = Motion { velocity: [0.3, -0.1, 0.5], rotation, ..Motion::default() };
    let mut times: Vec<f64> =
        (0..40).map(|k| 1e-3 * (f64::from(k) + 0.3 * f64::from(k * k % 7) / 7.0)).collect();
    times[0] = 0.0;
    let mut table = sampled(&steady, &base, &times);
    let rows: Vec<_> = times
        .iter()
        .enumerate()
        .map(|(k, &time)| {
            let sign = if k % 3 == 1 { -2.0 } else { 1.0 };
            let pose = steady.at(&base, time).pose;
            TimedPose { time, pose: Pose { rotation: pose.rotation.map(|q| sign * q), ..pose } }
        })
        .collect();
    table.poses = Some(Arc::new(PoseTable::new(&rows).unwrap()));
    let worlds = [steady, table].map(|motion| {
        let mut w = open_world([0.0; 3], 0.3, 4e-6, grain(0.6, 0.4));
        let (vertices, triangles) = rectangle([-0.02; 2], [0.02; 2]);
        w.surfaces = vec![mesh(vertices, triangles, base)];
        w.surfaces[0].motion = motion;
        for (i, [x, y, side]) in
            [[0.008, 0.004, 1.0], [-0.009, 0.006, -1.0], [0.0, -0.01, 1.0], [0.012, -0.008, -1.0]]
                .into_iter()
                .enumerate()
        {
            let at = base.apply([x, y, side * (0.999 + 0.1 * i as f64) * RADIUS]);
            w.particles.push(at, RADIUS, 0);
        }
        w
    });
    let mut both = Together::new(on, worlds.to_vec());
    both.steps(1500);
    let fastest = both.bodies(0).iter().map(|b| norm(b.v)).fold(0.0, f64::max);
    assert!(fastest > 1.0, "the plate throws nothing: {fastest} m/s");
    let most = &on.bounds.triangulation;
    for (a, b) in both.bodies(0).iter().zip(both.bodies(1)) {
        let off = [norm(sub(a.x, b.x)) / RADIUS, norm(sub(a.v, b.v)) / fastest];
        assert!(off[0] <= most.place && off[1] <= most.velocity, "{a:?} and {b:?} are {off:?} apart");
    }
    let [a, b] = [0, 1].map(|w| both.worlds[w].1.impulse[0]);
    let (force, off) = (norm([a[0], a[1], a[2]]), norm([0, 1, 2].map(|k| a[k] - b[k])));
    assert!(force > 0.0 && off <= most.velocity * force, "impulses {a:?} and {b:?}");
}

/// A sphere rests on a plate that swings up and down, too gently to throw it. A table with rows h apart
/// is off by at most A (2πf)² h²/8 in place and A (2πf)² h/2 in speed, and so is what rests on it, whose spring answers
/// a jump of speed by overshooting: with e = 0.3 by less than twice.
pub fn a_table_of_an_oscillation_follows_it(on: &Subject) {
    const ROWS: f64 = 250.0;
    const FREQUENCY: f64 = 25.0;
    let amplitude = [0.0, 0.0, 2e-4];
    let oscillation = Oscillation { amplitude, frequency: FREQUENCY, phase: 0.4 };
    let swing = Motion { oscillation: Some(oscillation), ..Motion::default() };
    let h = 1.0 / (FREQUENCY * ROWS);
    // Sampled beyond the end of the run.
    let times: Vec<f64> = (0..(1.5 * ROWS) as u32).map(|k| h * f64::from(k)).collect();
    let table = sampled(&swing, &Pose::default(), &times);
    let world = |motion: Motion| -> WorldSpec {
        let mut material = grain(0.3, 0.9);
        material.youngs_modulus = 1e6;
        let mut w = open_world([0.0; 3], 0.1, 1e-5, material);
        w.gravity = [0.0, 0.0, -9.81];
        let (vertices, triangles) = rectangle([-0.02; 2], [0.02; 2]);
        w.surfaces = vec![mesh(vertices, triangles, Pose::default())];
        w.surfaces[0].motion = motion;
        let start = swing.at(&Pose::default(), 0.0).velocity;
        w.particles.push_moving([0.001, 0.002, RADIUS - 3e-6], RADIUS, 0, start, [0.0; 3]);
        w
    };
    let mut both = Together::new(on, vec![world(swing.clone()), world(table)]);
    let (rate, size) = (TAU * FREQUENCY, norm(amplitude));
    let most = [2.0 * size * rate * rate * h * h / 8.0 + 1e-6 * RADIUS, 2.0 * size * rate * rate * h / 2.0];
    for _ in 0..20 {
        both.steps(200);
        let (a, b) = (both.bodies(0)[0], both.bodies(1)[0]);
        let off = [norm(sub(a.x, b.x)), norm(sub(a.v, b.v))];
        assert!(off[0] <= most[0] && off[1] <= most[1], "{off:?} m, m/s apart, more than {most:?}");
        assert_eq!([both.moment(0).surface_contacts, both.moment(1).surface_contacts], [1, 1]);
    }
    // It went along: up by most of what the plate went.
    let path = swing.at(&Pose::default(), 0.04).pose.translation;
    let sunk = sub(both.bodies(0)[0].x, add([0.001, 0.002, RADIUS], path));
    assert!(sunk[2].abs() < 2e-5, "it left the plate: {sunk:?}");
}
