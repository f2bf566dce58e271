//! Wear of surfaces: a load that slides a path wears `k F s`, where it slides, and what rolls wears nothing.

use std::sync::Arc;

use glebe_engine::backend::Backend;
use glebe_engine::batch::Batch;
use glebe_engine::prepare;
use glebe_engine::spec::{Motion, Sampling, Until, Vec3, WorldSpec};
use glebe_engine::state::State;

use crate::support::{
    Last, Run, Subject, e_star, frustum, grain, mesh, open_world, plane, rectangle, sphere_mass,
};

/// Coefficient over hardness \[1/Pa\].
const K: f64 = 2.5e-13;
const RADIUS: f64 = 0.005;
const SPEED: f64 = 0.4;
const DT: f64 = 1e-5;
const STEPS: u64 = 4000;

/// A sphere at rest under its weight on a surface of two triangles that wears; `friction` between them.
fn world(friction: f64, v: Vec3, w: Vec3) -> WorldSpec {
    let material = grain(0.5, friction);
    let weight = sphere_mass(RADIUS, &material) * 9.81;
    // Hertz: F = 4/3 E* √R δ^1.5.
    let depth = (0.75 * weight / (e_star(&material) * RADIUS.sqrt())).powf(2.0 / 3.0);
    let mut world = open_world([0.0; 3], 0.1, DT, material);
    world.gravity = [0.0, 0.0, -9.81];
    world.wear = vec![K];
    let (vertices, triangles) = rectangle([-0.02, -0.02], [0.02, 0.02]);
    world.surfaces.push(mesh(vertices, triangles, glebe_engine::spec::Pose::default()));
    world.particles.push_moving([-0.008, -0.003, RADIUS - depth], RADIUS, 0, v, w);
    world
}

fn load() -> f64 {
    sphere_mass(RADIUS, &grain(0.5, 0.0)) * 9.81
}

/// The volume that each triangle has lost.
fn worn(run: &Run) -> Vec<f64> {
    run.state().progress.worn(&run.c, 0).unwrap()
}

/// A sphere without friction slides under its weight from one triangle of a floor to the other: the volumes are k F s with
/// the paths on each, whether the sphere moves or the floor under it.
pub fn a_sliding_sphere_wears_as_archard_says(on: &Subject) {
    let moving = world(0.0, [SPEED, 0.0, 0.0], [0.0; 3]);
    let mut drawn = world(0.0, [0.0; 3], [0.0; 3]);
    drawn.surfaces[0].motion = Motion { velocity: [-SPEED, 0.0, 0.0], ..Motion::default() };
    for w in [moving, drawn] {
        let mut run = Run::new(on, w);
        run.steps(STEPS);
        let path = SPEED * DT * STEPS as f64;
        let lost = worn(&run);
        let expected = K * load() * path;
        let total: f64 = lost.iter().sum();
        assert!((total / expected - 1.0).abs() < 1e-4, "{total:e} instead of {expected:e}");
        // It crosses the diagonal at x = y = -0.003, after 0.005 m of 0.016; known to two steps.
        let first = K * load() * 0.005;
        let slack = 2.0 * K * load() * SPEED * DT;
        assert!((lost[1] - first).abs() < slack, "{:e} instead of {first:e}", lost[1]);
    }
}

/// A sphere that rolls with friction and without slip wears nothing; one that starts without spin slips over v²/(7 μ g)
/// until it rolls.
pub fn rolling_wears_nothing(on: &Subject) {
    let mut rolling = world(0.5, [SPEED, 0.0, 0.0], [0.0, SPEED / RADIUS, 0.0]);
    // The arm is shorter by the overlap.
    let arm = rolling.particles.position[0][2];
    rolling.particles.spin[0][1] = SPEED / arm;
    let mut run = Run::new(on, rolling);
    run.steps(STEPS);
    let path = SPEED * DT * STEPS as f64;
    let total: f64 = worn(&run).iter().sum();
    assert!(total < 1e-4 * K * load() * path, "{total:e}");

    // Sliding from rest of spin: v falls by μ g t, the slip v - ω R by 3.5 μ g t, so it slips over v²/(7 μ g).
    let friction = 0.5;
    let mut run = Run::new(on, world(friction, [0.2, 0.0, 0.0], [0.0; 3]));
    run.steps(STEPS);
    let total: f64 = worn(&run).iter().sum();
    let expected = K * load() * 0.2 * 0.2 / (7.0 * friction * 9.81);
    assert!((total / expected - 1.0).abs() < 0.02, "{total:e} instead of {expected:e}");
}

/// The series tells the volume of all facets, of surfaces that wear only; wear goes on from a checkpoint with the same bits,
/// and a state with facets of another surface is refused.
pub fn wear_is_told_and_kept(on: &Subject) {
    let mut w = world(0.3, [SPEED, 0.0, 0.0], [0.0; 3]);
    w.materials.push(grain(0.5, 0.3));
    let mut still = plane([0.0, 0.0, 1.0], [0.0, 0.0, -0.05]);
    still.material = 1;
    w.surfaces.push(still);
    w.sampling = Sampling { series: 1e-3, ..Sampling::default() };
    w.stages[0].until = Until { at_most: Some(0.01), ..Until::default() };
    let (c, state) = prepare(w.clone()).unwrap();
    assert_eq!([c.wear_of(0), c.wear_of(1)], [Some(K), None]);
    let mut batch = Batch::new(vec![w.clone()], on.backend).unwrap();
    let mut last = Last::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut last);
    }
    let sample = last.0.unwrap();
    let end = batch.state(0);
    let lost: f64 = end.progress.worn(&c, 0).unwrap().iter().sum();
    assert_eq!((sample.surfaces[0].wear, sample.surfaces[1].wear), (Some(lost), None));
    assert!(lost > 0.0);

    let mut whole = Run::resume(on, c.clone(), state.clone());
    whole.steps(600);
    let mut first = Run::resume(on, c.clone(), state);
    first.steps(250);
    let kept = State::from_bytes(&first.state().to_bytes()).unwrap();
    kept.belongs_to(&c).unwrap();
    let mut second = Run::resume(on, c.clone(), kept.clone());
    second.steps(350);
    if on.exact_states {
        assert_eq!(second.state().progress.wear, whole.state().progress.wear);
    }
    let mut foreign = kept;
    foreign.progress.wear[0].pop();
    assert!(foreign.belongs_to(&c).unwrap_err().to_string().contains("its wear"));
}

/// Round surfaces wear on the pieces that show them.
pub fn a_cylinder_wears_under_the_sphere(on: &Subject) {
    let mut w = world(0.0, [0.0, SPEED, 0.0], [0.0; 3]);
    let shell = glebe_engine::spec::Frustum {
        axis: [0.0, 1.0, 0.0],
        ends: [-0.05, 0.05],
        radii: [0.02, 0.02],
        closed: false,
    };
    w.surfaces = vec![frustum(shell, glebe_engine::spec::Pose::default())];
    let depth = RADIUS - w.particles.position[0][2];
    w.particles.position[0] = [0.0, -0.01, RADIUS - depth - 0.02];
    let mut run = Run::new(on, w);
    run.steps(1000);
    let lost = worn(&run);
    let total: f64 = lost.iter().sum();
    let expected = K * load() * SPEED * DT * 1000.0;
    assert!((total / expected - 1.0).abs() < 1e-3, "{total:e} instead of {expected:e}");
    // They lie under its path from y = -0.01 to -0.006, to the width of a piece.
    let shown = shell.mesh();
    let width = 2.0 * std::f64::consts::PI * 0.02 / 72.0;
    for (piece, _) in lost.iter().enumerate().filter(|(_, lost)| **lost > 0.0) {
        let corners = shown.triangles[piece].map(|v| shown.vertices[v as usize]);
        let at = [0, 1, 2].map(|k| corners.iter().map(|x| x[k]).sum::<f64>() / 3.0);
        let along = (-0.01 - width..-0.006 + width).contains(&at[1]);
        assert!(along && at[0].abs() < width && at[2] < -0.0198, "piece {piece} at {at:?}");
    }
}

/// Devices say that they cannot, and never leave it out.
#[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "there is no device"))]
pub fn a_device_refuses_wear(on: &Subject) {
    let wears = prepare(world(0.3, [0.0; 3], [0.0; 3])).unwrap().0;
    let mut spared = world(0.3, [0.0; 3], [0.0; 3]);
    spared.wear.clear();
    let spared = prepare(spared).unwrap().0;
    assert!(!matches!(on.backend, Backend::Cpu | Backend::Reference));
    assert_eq!(on.backend.refusal(&[spared]), None);
    let why = on.backend.refusal(&[Arc::clone(&wears)]).unwrap();
    assert!(why.contains("wear of surfaces"), "{why}");
}
