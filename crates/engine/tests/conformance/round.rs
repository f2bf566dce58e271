//! Cylinders and cones act as what they are: round, on both sides, closed or open.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glebe_engine::lattice::{add, cross, dot, norm, scale, sub};
use glebe_engine::spec::{Domain, Frustum, Pose, Rotation, Side, Vec3};
use glebe_engine::surface::{quaternion, rotate};
use glebe_physics::{ContactModel, LawChoice};

use crate::support::{
    Run, Subject, Together, assert_near, frustum, grain, mesh, open_world, plane, sphere_mass, unit,
};

/// Relative error of a resting overlap, as for planes.
const REST: f64 = 0.01;
const G: f64 = 9.8;

/// A point of the shell at the azimuth of `e`, a vector across the axis, and the unit normal there outwards.
fn place(f: &Frustum, share: f64, e: Vec3) -> (Vec3, Vec3) {
    let [h, r] = [f.ends, f.radii].map(|[a, b]| a + share * (b - a));
    let (dr, dh) = (f.radii[1] - f.radii[0], f.ends[1] - f.ends[0]);
    let normal = unit(sub(scale(e, dh), scale(f.axis, dr)));
    (add(scale(f.axis, h), scale(e, r)), normal)
}

/// Height of a point above the shell, outwards, in the shell's frame.
fn height(f: &Frustum, x: Vec3) -> f64 {
    let h = dot(x, f.axis);
    let rho = norm(sub(x, scale(f.axis, h)));
    let (dr, dh) = (f.radii[1] - f.radii[0], f.ends[1] - f.ends[0]);
    ((rho - f.radii[0]) * dh - (h - f.ends[0]) * dr) / dr.hypot(dh)
}

/// CHRONO's example of the resting overlap, δ = 1.0174e-8 m, on both sides of narrow and wide shells, near the origin
/// and 50 m from it: no digit of the overlap is lost to the size of the shell.
pub fn a_sphere_rests_on_cylinders_and_cones(on: &Subject) {
    const EXPECTED: f64 = 1.0174e-8;
    const RADIUS: f64 = 1e-3;
    let axis = unit([0.3, -0.5, 0.8]);
    let e = unit(cross(axis, [0.2, 1.0, 0.1]));
    let mut worlds = Vec::new();
    let mut cases = Vec::new();
    for (half, size, end, side) in
        [(0.5, 0.02, 1.0, -1.0), (50.0, 20.0, 1.0, 1.0), (0.5, 0.02, 0.6, 1.0), (50.0, 20.0, 0.6, -1.0)]
    {
        let f = Frustum { axis, ends: [-size, 0.5 * size], radii: [size, end * size], closed: false };
        let rotation = quaternion(unit([1.0, 1.0, -0.4]), 0.6);
        let pose = Pose { translation: [0.2 * half, -0.1 * half, 0.3 * half], rotation };
        let (point, normal) = place(&f, 0.4, e);
        let mut w = open_world([0.0; 3], half, 2e-6, grain(1.0, 0.0));
        w.contact = ContactModel {
            normal: LawChoice::named("hertz-stiffness").with("stiffness", 4.472_136e6).with("damping", 2e7),
            tangential: LawChoice::named("none"),
            ..ContactModel::default()
        };
        w.gravity = scale(rotate(rotation, normal), -side * G);
        w.surfaces = vec![frustum(f, pose)];
        // A tenth of the overlap is left to find.
        let height = side * (RADIUS - 0.9 * EXPECTED);
        w.particles.push(pose.apply(add(point, scale(normal, height))), RADIUS, 0);
        worlds.push(w);
        cases.push((f, pose, side));
    }
    let mut batch = Together::new(on, worlds);
    batch.steps(2000);
    for (k, (f, pose, side)) in cases.iter().enumerate() {
        let b = batch.bodies(k)[0];
        let overlap = b.radius - side * height(f, pose.inverse(b.x));
        let error = (overlap / EXPECTED - 1.0).abs();
        assert!(error < REST, "case {k}, side {side} of {f:?}: δ = {overlap:e} m");
    }
}

/// A sphere that rolls to and fro at the bottom of a cylinder r swings as a pendulum of the length 7/5 (r - R): the
/// tangential spring is kept from step to step and from list to list.
pub fn a_sphere_swings_in_a_cylinder(on: &Subject) {
    const RADIUS: f64 = 2e-3;
    const R: f64 = 0.03;
    const PULL: f64 = 400.0;
    let mut w = open_world([0.0; 3], 0.1, 1e-5, grain(0.3, 0.9));
    w.gravity = [0.0, 0.0, -PULL];
    let axis = [0.0, 1.0, 0.0];
    let f = Frustum { axis, ends: [-0.05, 0.05], radii: [R; 2], closed: false };
    w.surfaces = vec![frustum(f, Pose { translation: [0.01, 0.0, 0.02], ..Pose::default() })];
    let (swing, arm) = (0.2_f64, R - RADIUS + 2e-5);
    let at = |angle: f64| add([0.01, 0.0, 0.02], scale([angle.sin(), 0.0, -angle.cos()], arm));
    w.particles.push(at(swing), RADIUS, 0);
    let mut run = Run::new(on, w);
    let rate = (5.0 * PULL / (7.0 * arm)).sqrt();
    // The period of a pendulum that swings wider grows by a sixteenth of the square.
    let quarter = FRAC_PI_2 / rate * (1.0 + swing * swing / 16.0);
    let steps = (quarter / 1e-5).round() as u64;
    run.steps(steps);
    let b = run.bodies()[0];
    let angle = ((b.x[0] - 0.01) / arm).asin();
    assert!(angle.abs() < 0.01 * swing, "after a quarter of a swing at {angle:.5} rad");
    let speed = rate * arm * swing;
    assert!((b.v[0] / -speed - 1.0).abs() < 0.02, "{b:?} instead of {speed} m/s");
    assert!((b.w[1] * RADIUS / b.v[0] - 1.0).abs() < 0.02, "it slides: {b:?}");
    run.steps(steps);
    let b = run.bodies()[0];
    let angle = ((b.x[0] - 0.01) / arm).asin();
    assert!((angle / -swing - 1.0).abs() < 0.02, "after half a swing at {angle:.5} rad");
    assert!(b.x[1].abs() < 1e-7 && run.moment().surface_contacts == 1, "{b:?}");
}

/// A drum that turns about its own axis drags a sphere at its bottom by sliding friction, with the force μ m g along the
/// wall's velocity, and feels its torque.
pub fn a_turning_drum_drags(on: &Subject) {
    const RADIUS: f64 = 2e-3;
    const R: f64 = 0.05;
    let mut w = open_world([0.0; 3], 0.2, 1e-5, grain(0.2, 0.3));
    w.gravity = [0.0, 0.0, -G];
    let (axis, center) = ([0.0, 1.0, 0.0], [0.03, 0.0, 0.01]);
    let f = Frustum { axis, ends: [-0.02, 0.02], radii: [R; 2], closed: true };
    w.surfaces = vec![frustum(f, Pose { translation: center, ..Pose::default() })];
    w.surfaces[0].motion.rotation = Some(Rotation { axis, center, rate: 30.0 });
    let sunk = 2e-6;
    w.particles.push(add(center, [0.0, 0.003, -(R - RADIUS + sunk)]), RADIUS, 0);
    let weight = G * sphere_mass(RADIUS, &w.materials[0]);
    let mut run = Run::new(on, w);
    run.steps(300);
    let before = (run.bodies()[0], run.g.impulse[0]);
    run.steps(300);
    let after = (run.bodies()[0], run.g.impulse[0]);
    let time = 300.0 * run.c.dt;
    // At the bottom the wall goes towards -x: ω × arm = y × -z.
    let gained = (after.0.v[0] - before.0.v[0]) / time;
    assert!((gained / (-0.3 * G) - 1.0).abs() < 0.03, "accelerated by {gained} m/s²");
    let mean: Vec<f64> = (0..6).map(|k| (after.1[k] - before.1[k]) / 300.0).collect();
    assert!((mean[0] / (0.3 * weight) - 1.0).abs() < 0.03, "the wall feels {mean:?} N, N m");
    assert!((mean[2] / -weight - 1.0).abs() < 0.03, "the wall feels {mean:?} N, N m");
    // About the axis the wall's own force counts, at the wall's radius: y · (arm × F) = -z × x.
    assert!((mean[4] / (-mean[0] * R) - 1.0).abs() < 0.01, "the wall feels {mean:?} N, N m");
    // It turns in its place, so that lists hold.
    if on.exact_reach {
        assert!(run.g.rebuilds < 6, "{} rebuilds", run.g.rebuilds);
    }
}

/// A frictionless sphere slides on a slanting way around the inside of a cylinder and a cone, and of their meshes. On
/// the mesh it is off by no more than a few times what the facets are: r (1 - cos(π/n)).
pub fn a_fine_mesh_acts_alike(on: &Subject) {
    const RADIUS: f64 = 2e-3;
    const PIECES: u32 = 720;
    let shapes = [[0.02, 0.02], [0.025, 0.015]];
    let mut worlds = Vec::new();
    for radii in shapes {
        let f = Frustum { axis: [0.0, 0.0, 1.0], ends: [-0.02, 0.02], radii, closed: false };
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for k in 0..PIECES {
            let (s, c) = (TAU * f64::from(k) / f64::from(PIECES)).sin_cos();
            vertices.extend([0, 1].map(|e| [radii[e] * c, radii[e] * s, f.ends[e]]));
            let [a, b] = [2 * k, 2 * ((k + 1) % PIECES)];
            triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
        }
        for surface in [frustum(f, Pose::default()), mesh(vertices, triangles, Pose::default())] {
            let mut w = open_world([0.0; 3], 0.1, 4e-6, grain(1.0, 0.0));
            w.contact.tangential = LawChoice::named("none");
            let (point, normal) = place(&f, 0.4, unit([1.0, 0.3, 0.0]));
            let start = sub(point, scale(normal, RADIUS));
            w.particles.push_moving(start, RADIUS, 0, [-0.3, 1.0, 0.3], [0.0; 3]);
            w.surfaces = vec![surface];
            worlds.push(w);
        }
    }
    let mut batch = Together::new(on, worlds);
    for _ in 0..8 {
        batch.steps(500);
        for (k, radii) in shapes.into_iter().enumerate() {
            let facets = radii[0] * (1.0 - (PI / f64::from(PIECES)).cos());
            let [round, flat] = [2 * k, 2 * k + 1].map(|w| batch.bodies(w)[0]);
            assert_near("the sphere", flat.x, round.x, 100.0 * facets);
        }
    }
    for k in 0..2 {
        let b = batch.bodies(2 * k)[0];
        assert!((norm(b.v) - (0.09_f64 + 1.0 + 0.09).sqrt()).abs() < 0.02, "it loses energy: {b:?}");
    }
}

/// Discs act as planes, corners on each side, convex rims once, and a sphere wider than an outlet sits on its rim.
pub fn ends_rims_and_seams(on: &Subject) {
    const RADIUS: f64 = 2e-3;
    let can = Frustum { axis: [0.0, 0.0, 1.0], ends: [0.0, 0.02], radii: [0.01; 2], closed: true };
    let near = 0.99 * RADIUS;
    let run = |f: Frustum, x: Vec3| {
        let mut w = open_world([0.0; 3], 0.1, 1e-6, grain(1.0, 0.0));
        w.surfaces = vec![frustum(f, Pose::default())];
        w.particles.push(x, RADIUS, 0);
        let mut run = Run::new(on, w);
        let contacts = run.moment().surface_contacts;
        let shown = run.detail().on_triangles;
        let sum = shown[0].iter().fold([0.0; 3], |s, f| sub(s, *f));
        let force = run.steps(1).bodies()[0].force;
        assert_near("on the triangles that show it", sum, force, 1e-5 * norm(force) + 1e-12);
        (contacts, force)
    };
    let flat = {
        let mut w = open_world([0.0; 3], 0.1, 1e-6, grain(1.0, 0.0));
        w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
        w.particles.push([0.0, 0.0, near], RADIUS, 0);
        Run::new(on, w).steps(1).bodies()[0].force[2]
    };
    let close = 2e-6 * flat;
    // On the bottom from inside and from outside, on the axis and off it.
    for x in [0.0, 0.004] {
        for side in [1.0, -1.0] {
            let (contacts, force) = run(can, [x, 0.0, side * near]);
            assert_eq!(contacts, 1, "at x = {x}, side {side}");
            assert_near("on the bottom", force, [0.0, 0.0, side * flat], close);
        }
    }
    // In the corner and against the wall, from inside and from outside.
    let (contacts, force) = run(can, [0.01 - near, 0.0, near]);
    assert_eq!(contacts, 2);
    assert_near("in the corner", force, [-flat, 0.0, flat], 2.0 * close);
    for side in [1.0, -1.0] {
        let (contacts, force) = run(can, [0.0, 0.01 + side * near, 0.009]);
        assert_eq!(contacts, 1);
        assert_near("on the wall", force, [0.0, side * flat, 0.0], close);
    }
    // Over the rim, where shell and disc meet at their edges.
    let along = unit([1.0, 0.0, 1.0]);
    let (contacts, force) = run(can, add([0.01, 0.0, 0.02], scale(along, near)));
    assert_eq!(contacts, 1);
    assert_near("on the rim", force, scale(along, flat), close);
    // A funnel whose outlet is narrower than the sphere: held on both sides of the axis, pushed up.
    let funnel = Frustum { axis: [0.0, 0.0, 1.0], ends: [0.0, 0.02], radii: [1.5e-3, 0.0115], closed: false };
    for x in [0.0, 1e-6] {
        // The centre whose distance from the wall of slope 1:2 is `near`: (h/2 + 1.5 mm) cos 26.57° = near.
        let h = 2.0 * (near * 1.25_f64.sqrt() - funnel.radii[0]);
        let (contacts, force) = run(funnel, [x, 0.0, h]);
        assert_eq!(contacts, 2, "at x = {x}");
        let up = 2.0 * flat / 5.0_f64.sqrt();
        assert!((force[2] / up - 1.0).abs() < 1e-3 && force[0] * x <= 0.0, "{force:?} instead of {up} up");
    }
    // A tube of one period is the same at its seam.
    let mut w = open_world([0.0; 3], 0.1, 1e-6, grain(1.0, 0.0));
    let sides = [[Side::Open; 2], [Side::Periodic; 2], [Side::Open; 2]];
    w.domain = Domain::aligned([-0.05, 0.0, -0.05], [0.05, 0.04, 0.05], sides, None);
    let tube = Frustum { axis: [0.0, 1.0, 0.0], ends: [-0.02, 0.02], radii: [0.01; 2], closed: false };
    w.surfaces = vec![frustum(tube, Pose { translation: [0.0, 0.02, 0.0], ..Pose::default() })];
    for (k, y) in [0.02, 0.0, 0.0399].into_iter().enumerate() {
        let angle = 2.0 * k as f64;
        let at = scale([angle.cos(), 0.0, angle.sin()], 0.01 - near);
        w.particles.push(add(at, [0.0, y, 0.0]), RADIUS, 0);
    }
    let mut run = Run::new(on, w);
    assert_eq!(run.moment().surface_contacts, 3);
    for b in run.steps(1).bodies() {
        let inwards = scale(unit([b.x[0], 0.0, b.x[2]]), -flat);
        assert_near("at the seam", b.force, inwards, close);
    }
}
