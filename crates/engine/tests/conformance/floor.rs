//! A mesh acts as the surface that it stands for, whatever its triangles.

use std::f64::consts::FRAC_PI_6;

use glebe_engine::lattice::{norm, sub};
use glebe_engine::spec::{Domain, Pose, Side, Surface, Vec3, WorldSpec};
use glebe_engine::surface::{quaternion, rotate};
use glebe_physics::{ContactModel, LawChoice};

use crate::support::{Body, Random, Run, Subject, Together, grain, mesh, open_world, plane, rectangle};

const RADIUS: f64 = 2e-3;
const SPEED: f64 = 0.4;

/// A square of ±`half`, cut into n × n cells with jittered corners and random diagonals.
fn crumpled(half: f64, n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut r = Random(11);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let cell = 2.0 * half / f64::from(n);
    for j in 0..=n {
        for i in 0..=n {
            let inside = |k: u32| f64::from(u8::from(k > 0 && k < n)) * 0.4 * cell;
            let (dx, dy) = (inside(i) * (2.0 * r.unit() - 1.0), inside(j) * (2.0 * r.unit() - 1.0));
            vertices.push([f64::from(i) * cell - half + dx, f64::from(j) * cell - half + dy, 0.0]);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
            // Windings differ too: both sides of a triangle act.
            triangles.extend(if r.unit() < 0.5 { [[a, b, c], [a, d, c]] } else { [[a, b, d], [b, c, d]] });
        }
    }
    (vertices, triangles)
}

/// A square of ±`half` whose sides, in `n` parts each, all go to one point.
fn fan(point: [f64; 2], half: f64, n: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |k: u32| [[-half, -half], [half, -half], [half, half], [-half, half]][k as usize % 4];
    let mut vertices = vec![[point[0], point[1], 0.0]];
    for side in 0..4 {
        let (a, b) = (corner(side), corner(side + 1));
        for k in 0..n {
            let t = f64::from(k) / f64::from(n);
            vertices.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), 0.0]);
        }
    }
    let triangles = (0..4 * n).map(|k| [0, 1 + k, 1 + (k + 1) % (4 * n)]).collect();
    (vertices, triangles)
}

/// Three spheres on the floor that `pose` places and `floor` covers: one bounces, one slides into rolling, one
/// rolls. `side` = -1 is under the floor, with gravity upwards.
fn on_floor(floor: Surface, pose: Pose, side: f64) -> WorldSpec {
    let mut w = open_world([0.0; 3], 0.2, 4e-6, grain(0.5, 0.5));
    w.materials[0].youngs_modulus = 2e6;
    w.contact = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    w.gravity = rotate(pose.rotation, [0.3, 0.1, -9.81 * side]);
    let turn = |x: Vec3| rotate(pose.rotation, x);
    for (i, (height, spin)) in [(1.5, 0.0), (1.0, 0.0), (1.0, SPEED / RADIUS)].into_iter().enumerate() {
        let x = pose.apply([-0.01, 0.006 * i as f64 - 0.007, side * height * RADIUS]);
        let v = turn([SPEED, 0.07, 0.0]);
        w.particles.push_moving(x, RADIUS, 0, v, turn([-0.17 * side * spin, side * spin, 0.0]));
    }
    w.surfaces = vec![floor];
    w
}

/// Ten frames of each world.
fn trajectories(on: &Subject, worlds: Vec<WorldSpec>) -> Vec<Vec<Vec<Body>>> {
    let mut all = vec![Vec::new(); worlds.len()];
    let mut batch = Together::new(on, worlds);
    for _ in 0..10 {
        batch.steps(1000);
        all.iter_mut().enumerate().for_each(|(k, frames)| frames.push(batch.bodies(k)));
    }
    all
}

fn assert_same(on: &Subject, what: &str, a: &[Vec<Body>], b: &[Vec<Body>]) {
    let most = &on.bounds.triangulation;
    for (k, (a, b)) in a.iter().flatten().zip(b.iter().flatten()).enumerate() {
        let off =
            [norm(sub(a.x, b.x)) / RADIUS, norm(sub(a.v, b.v)) / SPEED, norm(sub(a.w, b.w)) * RADIUS / SPEED];
        assert!(
            off[0] < most.place && off[1] < most.velocity && off[2] < most.spin,
            "{what}: sphere {} in frame {} is off by {:?} (place, velocity, spin)",
            k % 3,
            k / 3,
            off.map(|x| format!("{x:.1e}"))
        );
    }
}

pub fn any_triangulation_is_one_plane(on: &Subject) {
    let (two, many) = (rectangle([-0.03; 2], [0.03; 2]), crumpled(0.03, 40));
    let mut worlds = Vec::new();
    let cases = [(0.0, 1.0), (0.0, -1.0), (FRAC_PI_6, 1.0), (FRAC_PI_6, -1.0)];
    for (tilt, side) in cases {
        let pose = Pose { translation: [0.003, 0.001, -0.002], rotation: quaternion([0.6, 0.8, 0.0], tilt) };
        let normal = rotate(pose.rotation, [0.0, 0.0, side]);
        worlds.push(on_floor(plane(normal, pose.translation), pose, side));
        for (vertices, triangles) in [&two, &many] {
            worlds.push(on_floor(mesh(vertices.clone(), triangles.clone(), pose), pose, side));
        }
    }
    let found = trajectories(on, worlds);
    for ((tilt, side), found) in cases.iter().zip(found.chunks(3)) {
        let flat = &found[0];
        assert!(flat[9][2].x[0] - flat[0][2].x[0] > 2.0 * RADIUS, "the test has no way to roll");
        for (what, found) in ["two triangles", "many triangles"].iter().zip(&found[1..]) {
            assert_same(on, &format!("{what}, side {side}, tilt {tilt:.2}"), found, flat);
        }
    }
}

/// A sphere that rolls over a point where more triangles meet than a device compares at once rolls on one plane.
pub fn many_triangles_meet_at_a_point(on: &Subject) {
    let (vertices, triangles) = fan([-0.0099, -0.001], 0.03, 24);
    let floors = [plane([0.0, 0.0, 1.0], [0.0; 3]), mesh(vertices, triangles, Pose::default())];
    let mut batch =
        Together::new(on, floors.into_iter().map(|f| on_floor(f, Pose::default(), 1.0)).collect());
    let mut found = vec![Vec::new(); 2];
    for _ in 0..10 {
        batch.steps(20);
        found.iter_mut().enumerate().for_each(|(k, frames)| frames.push(batch.bodies(k)));
    }
    // The second sphere presses on the point and leaves it.
    assert!(found[0][0][1].x[0] < -0.0099 && found[0][9][1].x[0] > -0.0099 && batch.moment(0).overlap > 0.0);
    assert_same(on, "triangles that meet at a point", &found[1], &found[0]);
}

/// Worlds whose spheres come near to many triangles at once, so that the lists of all lack room in the same step, go on as
/// each does alone.
pub fn worlds_that_lack_room_at_once_keep_their_bits(on: &Subject) {
    // The first lists are made ahead of the point, those after [`PERIOD`] steps of a device around it.
    let worlds: Vec<_> = [(0.0, 1.0), (0.3, 1.0), (0.0, -1.0), (0.3, -1.0)]
        .into_iter()
        .map(|(tilt, side)| {
            let pose = Pose { translation: [0.0; 3], rotation: quaternion([0.6, 0.8, 0.0], tilt) };
            let (vertices, triangles) = fan([-0.0073, -0.001], 0.03, 24);
            on_floor(mesh(vertices, triangles, pose), pose, side)
        })
        .collect();
    let mut batch = Together::new(on, worlds.clone());
    batch.steps(700);
    for (w, world) in worlds.into_iter().enumerate().skip(2) {
        let mut alone = Together::new(on, vec![world]);
        alone.steps(700);
        let (a, b) = (alone.state(0), batch.state(w));
        assert_eq!(a.surface_contacts, b.surface_contacts, "what world {w} remembers");
        assert_eq!(a.progress.ledger, b.progress.ledger, "the ledger of world {w}");
        assert_eq!(a.hash(), b.hash(), "world {w}");
    }
}

/// A mesh that spans one period of the cell has no edge where the next period begins.
pub fn a_floor_of_one_period_is_a_plane(on: &Subject) {
    let world = |floor: Surface| {
        let mut w = on_floor(floor, Pose::default(), 1.0);
        let sides = [[Side::Periodic; 2], [Side::Periodic; 2], [Side::Open; 2]];
        w.domain = Domain::aligned([-0.015; 3], [0.015; 3], sides, None);
        w
    };
    let meshes = [
        ("two triangles", rectangle([-0.015; 2], [0.015; 2])),
        ("many triangles", crumpled(0.015, 20)),
        ("more than a period", rectangle([-0.04; 2], [0.04; 2])),
    ];
    let mut worlds = vec![world(plane([0.0, 0.0, 1.0], [0.0; 3]))];
    for (_, (vertices, triangles)) in &meshes {
        worlds.push(world(mesh(vertices.clone(), triangles.clone(), Pose::default())));
    }
    let found = trajectories(on, worlds);
    let flat = &found[0];
    assert!(flat.iter().any(|b| b[2].x[0] < -0.005), "no sphere came around");
    for ((what, _), found) in meshes.iter().zip(&found[1..]) {
        assert_same(on, what, found, flat);
    }
}

/// A sphere that slides over a ridge touches it once all the way, and leaves it with its energy.
pub fn a_convex_edge_acts_once(on: &Subject) {
    for split in [1, 7] {
        let mut w = open_world([0.0; 3], 0.2, 2e-6, grain(1.0, 0.0));
        w.gravity = [0.0, 0.0, -9.81];
        // Falls by 1 in 4 on both sides of the ridge at x = 0, which `split` parts.
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for k in 0..=split {
            let y = -0.03 + 0.06 * f64::from(k) / f64::from(split);
            vertices.extend([[-0.04, y, -0.01], [0.0, y, 0.0], [0.04, y, -0.01]]);
        }
        for k in 0..split as u32 {
            for side in [0, 1] {
                let (a, b) = (3 * k + side, 3 * k + side + 1);
                triangles.extend([[a, b, b + 3], [a, b + 3, a + 3]]);
            }
        }
        w.surfaces = vec![mesh(vertices, triangles, Pose::default())];
        let slope = 1.0 / 17_f64.sqrt();
        let (sin, cos) = (slope, 4.0 * slope);
        let up = 0.9995 * RADIUS;
        let at = [-0.006 - sin * up, 0.001, -0.0015 + cos * up];
        w.particles.push_moving(at, RADIUS, 0, [0.3 * cos, 0.02, 0.3 * sin], [0.0; 3]);
        let mut run = Run::new(on, w);
        let energy = |run: &mut Run| {
            let m = run.moment();
            m.kinetic() + m.potential + m.elastic_normal
        };
        let (before, mut touched) = (energy(&mut run), 0);
        for _ in 0..600 {
            let contacts = run.steps(40).moment().surface_contacts;
            assert!(contacts <= 1, "{contacts} contacts at {:?}", run.bodies()[0].x);
            touched += contacts;
        }
        let b = run.bodies()[0];
        assert!(b.x[0] > 0.002, "it did not come over the ridge: {b:?}");
        assert!(touched > 150, "{touched} frames in contact");
        let gained = energy(&mut run) - before;
        assert!(gained.abs() < 1e-3 * 0.5 * b.mass * 0.09, "energy changed by {gained:e} J");
    }
}

pub fn concave_corners_act_on_each_side(on: &Subject) {
    let (vertices, triangles) = crumpled(0.02, 30);
    let floor =
        |rotation| mesh(vertices.clone(), triangles.clone(), Pose { translation: [0.0; 3], rotation });
    let quarter = std::f64::consts::FRAC_PI_2;
    let sides = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|axis| quaternion(axis, quarter));
    let near = 0.99 * RADIUS;
    for (walls, at, count) in
        [(1, [0.004, near, near], 2), (2, [near; 3], 3), (2, [near, near, 0.01], 2), (2, [0.01; 3], 0)]
    {
        // One mesh of all sides, and each side a mesh of its own, mean the same.
        let mut w = open_world([0.0; 3], 0.2, 1e-6, grain(1.0, 0.0));
        w.particles.push(at, RADIUS, 0);
        w.surfaces =
            std::iter::once(floor([1.0, 0.0, 0.0, 0.0])).chain(sides.map(floor)).take(walls + 1).collect();
        let mut apart = Run::new(on, w.clone());
        let (mut all, mut faces) = (Vec::new(), Vec::new());
        for s in &w.surfaces {
            let from = all.len() as u32;
            all.extend(vertices.iter().map(|x| s.pose.apply(*x)));
            faces.extend(triangles.iter().map(|t| t.map(|v| v + from)));
        }
        w.surfaces = vec![mesh(all, faces, Pose::default())];
        let mut together = Run::new(on, w);
        assert_eq!(apart.moment().surface_contacts, count, "{walls} walls at {at:?}");
        assert_eq!(together.moment().surface_contacts, count, "{walls} walls in one mesh at {at:?}");
        let forces = [apart.steps(1).bodies()[0].force, together.steps(1).bodies()[0].force];
        assert!(norm(sub(forces[0], forces[1])) <= 1e-5 * norm(forces[0]), "{forces:?}");
        let triangles = together.detail().on_triangles;
        let sum = triangles[0].iter().fold([0.0; 3], |s, f| sub(s, *f));
        let next = together.steps(1).bodies()[0].force;
        assert!(norm(sub(sum, next)) <= 1e-5 * norm(next), "on triangles {sum:?}, on the sphere {next:?}");
    }
}

/// A plane acts on what touches it, from either side, and on nothing far behind it.
pub fn a_plane_ends_where_it_ends(on: &Subject) {
    let mut w = open_world([0.0; 3], 0.2, 1e-6, grain(1.0, 0.0));
    for (i, height) in [0.99, -0.99, -10.0, 10.0].into_iter().enumerate() {
        w.particles.push([0.02 * i as f64, 0.0, height * RADIUS], RADIUS, 0);
    }
    w.surfaces = vec![plane([0.0, 0.0, 1.0], [0.0; 3])];
    let forces: Vec<f64> = Run::new(on, w).steps(1).bodies().iter().map(|b| b.force[2]).collect();
    assert!(forces[0] > 0.0 && (forces[0] + forces[1]).abs() < 1e-5 * forces[0], "{forces:?}");
    assert_eq!(forces[2..], [0.0, 0.0]);
}
