//! Tools that scenes name, and a mesh as large as scans are: with the measures that they should have, and in beds of
//! grains.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::convert::Infallible;
use std::path::Path;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Observer, Sample, Status, positions};
use glebe_engine::spec::{Shape, TriMesh, Vec3};
use glebe_engine::surface::Bvh;
use glebe_io::mesh::{StlFormat, write_stl};
use glebe_io::scene::{GeometryShape, Scene};
use glebe_io::tool::{Blade, Mixer, Plough, Tool, Wheel};

/// A box in which 150 grains of 8 mm fall from a region upon a tool that moves.
fn scene(tool: &str, motion: &str, region: [Vec3; 2]) -> String {
    let [min, max] = region;
    format!(
        "[domain]\nmin = [-0.25, -0.2, 0]\nmax = [0.25, 0.2, 0.6]\nmaterial = \"steel\"\n\
         [material.grain]\ndensity = 2500\nyoungs_modulus = \"3 MPa\"\npoissons_ratio = 0.3\nrestitution = 0.4\n\
         friction = 0.5\n[particles.bed]\nmaterial = \"grain\"\ncount = 150\nradius = \"8 mm\"\n\
         velocity = [0, 0, -1]\nregion = {{ min = {min:?}, max = {max:?} }}\n\
         [geometry.tool]\nmaterial = \"steel\"\n{tool}\nmotion = {motion}\n\
         [[stage]]\nname = \"go\"\nduration = 0.3\n[output]\nseries = \"1 ms\"\n"
    )
}

/// What a tool felt: the largest force along each axis [N].
#[derive(Default)]
struct Felt([f64; 3]);

impl Observer for Felt {
    type Error = Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Infallible> {
        for (most, now) in self.0.iter_mut().zip(sample.surfaces[0].force) {
            *most = most.max(now.abs());
        }
        Ok(())
    }
}

/// Runs a scene to its end; returns the tool's mesh where it then is, where the grains are in its frame, and its force.
fn run(text: &str) -> (TriMesh, Vec<Vec3>, [f64; 3]) {
    let scene = Scene::parse("scene.toml", text, &[]).unwrap_or_else(|e| panic!("{:#}\n{text}", e[0]));
    let world = scene.build(Path::new(".")).unwrap_or_else(|e| panic!("{:#}", e[0])).world;
    let mut batch = Batch::new(vec![world], Backend::Cpu).map_err(|e| e.1).unwrap();
    let mut felt = Felt::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut felt);
    }
    assert_eq!(*batch.status(0), Status::Done, "{text}");
    let (c, state) = (batch.constants(0), batch.state(0));
    assert_eq!(c.warnings, [""; 0]);
    let pose = state.progress.surfaces[0].placed(c, 0, &state.progress).pose;
    let Shape::Mesh(mesh) = &c.spec.surfaces[0].shape else { panic!("no mesh") };
    let grains: Vec<Vec3> = positions(c, &state).iter().map(|x| pose.inverse(*x)).collect();
    assert_eq!(grains.len(), 150, "some were lost");
    (TriMesh::clone(mesh), grains, felt.0)
}

#[test]
fn every_tool_moves_in_a_bed_that_stays_outside_of_it() {
    let above = [[-0.1, -0.1, 0.25], [0.1, 0.1, 0.5]];
    for (tool, motion) in [
        (
            "blade = { width = 0.2, height = 0.1, rake_angle = \"60 deg\" }\ntranslate = [-0.05, 0, 0.02]",
            "{ velocity = [0.3, 0, 0] }",
        ),
        (
            "plough = { turn = \"left\" }\nscale = 0.4\ntranslate = [0, -0.07, 0.02]",
            "{ velocity = [0.3, 0, 0] }",
        ),
        (
            "wheel = { radius = 0.08, width = 0.1, grousers = 12 }\ntranslate = [-0.05, 0, 0.11]",
            "{ velocity = [0.24, 0, 0], rotation = { axis = \"y\", rate = 4 } }",
        ),
        (
            "mixer = { radius = 0.12, shaft_length = 0.2, rows = 2, pitch = \"30 deg\" }\ntranslate = [0, 0, 0.02]",
            "{ rotation = { axis = \"z\", rate = 6 } }",
        ),
    ] {
        let (mesh, grains, force) = run(&scene(tool, motion, above));
        assert!(force.iter().all(|f| *f > 0.1), "{tool}: {force:?} N");
        let bvh = Bvh::new(&mesh);
        let inside = grains.iter().filter(|x| bvh.encloses(&mesh, **x)).count();
        assert_eq!(inside, 0, "{tool}");
    }
}

#[test]
fn a_drum_with_lifters_keeps_its_grains_and_carries_them_up() {
    let highest = |lifters: &str| {
        let tool = format!("drum = {{ radius = 0.15, length = 0.2{lifters} }}\ntranslate = [0, 0, 0.2]");
        let region = [[-0.09, -0.08, 0.12], [0.09, 0.08, 0.3]];
        let (mesh, grains, force) = run(&scene(&tool, "{ rotation = { axis = \"y\", rate = 5 } }", region)
            .replace("0.3\n[out", "0.6\n[out"));
        assert!(force[2] > 1.0, "{force:?} N");
        let bvh = Bvh::new(&mesh);
        assert!(grains.iter().all(|x| bvh.encloses(&mesh, *x)), "{tool}");
        // Far round with the shell: the angle from the bottom that a tenth of the grains has passed.
        let mut angles: Vec<f64> = grains.iter().map(|x| x[0].hypot(x[2])).collect();
        angles.sort_by(f64::total_cmp);
        angles[angles.len() / 10]
    };
    // Grains fall off the lifters through the middle, which they leave empty in a smooth drum.
    let (smooth, lifted) =
        (highest(""), highest(", lifters = 6, lifter_height = 0.04, lifter_thickness = 0.01"));
    assert!(lifted < 0.9 * smooth, "{lifted} m from the axis with lifters, {smooth} m without");
}

#[test]
fn tools_without_parameters_are_those_of_the_library() {
    let tools = [
        ("blade", Tool::Blade(Blade::default())),
        ("plough", Tool::Plough(Plough::default())),
        ("wheel", Tool::Wheel(Wheel::default())),
        ("mixer", Tool::Mixer(Mixer::default())),
    ];
    for (key, expected) in tools {
        let text = scene(&format!("{key} = {{}}"), "{}", [[-0.1; 3], [0.1; 3]]);
        let scene = Scene::parse("scene.toml", &text, &[]).unwrap();
        let GeometryShape::Tool(tool) = scene.geometry[0].shape.value else { panic!("{key} is no tool") };
        let (found, expected) = (tool.mesh().unwrap(), expected.mesh().unwrap());
        assert_eq!(found.triangles, expected.triangles, "{key}");
        // Angles go through radians.
        let far = |(a, b): (&Vec3, &Vec3)| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
        assert!(found.vertices.iter().zip(&expected.vertices).map(far).fold(0.0, f64::max) < 1e-12, "{key}");
    }
}

/// Scans of ground have a million triangles and more.
#[test]
fn a_million_triangles_are_read_and_grains_lie_on_them() {
    const N: [u32; 2] = [1000, 500];
    let height = |x: f64, y: f64| 0.05 + 0.01 * (40.0 * x).sin() * (30.0 * y).cos();
    let mut ground = TriMesh::default();
    for (i, j) in (0..=N[0]).flat_map(|i| (0..=N[1]).map(move |j| (i, j))) {
        let [x, y] =
            [(i, N[0], 0.5), (j, N[1], 0.4)].map(|(k, n, size)| size * (f64::from(k) / f64::from(n) - 0.5));
        ground.vertices.push([x, y, height(x, y)]);
    }
    for (i, j) in (0..N[0]).flat_map(|i| (0..N[1]).map(move |j| (i, j))) {
        let [a, b] = [i * (N[1] + 1) + j, (i + 1) * (N[1] + 1) + j];
        ground.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    write_stl(&folder.join("ground.stl"), &ground, "ground", StlFormat::Binary).unwrap();
    let text = scene("file = \"ground.stl\"", "{}", [[-0.2, -0.15, 0.08], [0.2, 0.15, 0.2]])
        .replace("count = 150", "count = 20");
    let scene = Scene::parse("scene.toml", &text, &[]).unwrap();
    let built = scene.build(folder).unwrap_or_else(|e| panic!("{:#}", e[0]));
    let report = &built.meshes[0].report;
    assert_eq!((report.triangles, report.degenerate, report.duplicates), (1_000_000, 0, 0));
    assert_eq!(report.open_edges, 2 * (1000 + 500));
    let mut batch = Batch::new(vec![built.world], Backend::Cpu).map_err(|e| e.1).unwrap();
    let mut felt = Felt::default();
    while batch.running() {
        let Ok(()) = batch.advance(&mut felt);
    }
    assert_eq!(*batch.status(0), Status::Done);
    // They fell on it, and none is lower than it.
    assert!(felt.0[2] > 1.0, "{:?} N", felt.0);
    let clearance = |x: &Vec3| x[2] - height(x[0], x[1]);
    let lowest =
        positions(batch.constants(0), &batch.state(0)).iter().map(clearance).fold(f64::INFINITY, f64::min);
    assert!((0.006..0.009).contains(&lowest), "{lowest} m");
}
