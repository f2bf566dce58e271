//! Scenes with the files that they name: what becomes a world, and what is refused.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod scene_common;

use std::f64::consts::FRAC_PI_2;
use std::fs;
use std::path::PathBuf;

use glebe_engine::SetupError;
use glebe_engine::spec::{Action, Measure, Shape, Window};
use glebe_io::mesh::{StlFormat, write_stl};
use glebe_io::scene::{BuiltScene, SceneError};
use glebe_io::tool::Sweep;
use scene_common::{EXAMPLE, edited, good, only, single};

/// A folder of its own that goes away with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("glebe-scene-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
    fn file(self, name: &str, text: &str) -> Self {
        fs::write(self.0.join(name), text).unwrap();
        self
    }
    fn build(&self, text: &str) -> Result<BuiltScene, Vec<SceneError>> {
        good(text, &[]).build(&self.0)
    }
    fn only_error(&self, text: &str) -> SceneError {
        single(&self.build(text).unwrap_err())
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The example with particles from a file.
fn with_csv() -> String {
    let from = EXAMPLE.find("count = 38912").unwrap();
    let to = EXAMPLE.find("[geometry.sweep]").unwrap();
    format!("{}file = \"bed.csv\"\n\n{}", &EXAMPLE[..from], &EXAMPLE[to..])
}

fn with_sweep(folder: Folder) -> Folder {
    write_stl(&folder.0.join("sweep.stl"), &Sweep::default().mesh().unwrap(), "sweep", StlFormat::Binary)
        .unwrap();
    folder
}

#[test]
fn the_example_becomes_a_world() {
    let folder = with_sweep(Folder::new("example"));
    let built = folder.build(&edited("count = 38912", "count = 500")).unwrap();
    let world = &built.world;
    assert_eq!((world.particles.len(), world.materials.len(), world.stages.len()), (500, 2, 3));
    assert!(world.particles.radius.iter().all(|r| (0.007..0.010).contains(r)));
    assert!(world.particles.position.iter().all(|x| x[0].abs() < 0.35 && x[1].abs() < 0.30 && x[2] > 0.0));
    assert_eq!(world.domain.material, Some(1));
    assert_eq!(world.domain.cell[2][2], 1.2);
    assert_eq!((world.pairs[0].0, world.pairs[0].1, world.pairs[0].2.friction), (0, 1, Some(0.5)));
    let tool = &world.surfaces[0];
    assert_eq!((tool.name.as_str(), tool.material, tool.absent), ("sweep", 1, false));
    assert_eq!(tool.pose.translation, [-0.62, 0.0, 0.15]);
    assert!(matches!(&tool.shape, Shape::Mesh(mesh) if mesh.triangles.len() > 100));
    assert_eq!(world.stages[1].actions, [Action::RemoveBeyond { axis: [0.0, 0.0, 1.0], limit: 0.3 }]);
    assert_eq!((world.stages[2].moves[0].0, world.stages[2].moves[0].1.velocity), (0, [0.7, 0.0, 0.0]));
    let [Measure { name, surface: 0, window: Window::Displacement(0.28, 0.56), .. }] =
        &world.stages[2].measures[..]
    else {
        panic!("{:?}", world.stages[2].measures)
    };
    assert_eq!(name, "draught_force");
    // The mesh as it stands: the nose is the origin, wings go to -x.
    let mesh = &built.meshes[0];
    assert!((mesh.max[0] + 0.62).abs() < 1e-6 && (mesh.min[2] - 0.15).abs() < 1e-6, "{mesh:?}");
    assert!(built.notes.iter().any(|n| n.contains("500 generated (`rain`, seed 1)")), "{:?}", built.notes);
}

#[test]
fn a_turned_and_scaled_shape_stands_where_it_should() {
    let folder = Folder::new("turned");
    let from = EXAMPLE.find("file = \"sweep.stl\"").unwrap();
    let to = EXAMPLE.find("material = \"steel\"\ntranslate").unwrap();
    let text = format!(
        "{}box = {{ min = [0, 0, 0], max = [100, 200, 300] }}\nscale = 0.001\nrotate = [{{ axis = \"z\", angle = \"90 deg\" }}]\n{}",
        &EXAMPLE[..from],
        &EXAMPLE[to..]
    );
    let built = folder.build(&text.replace("count = 38912", "count = 10")).unwrap();
    let mesh = &built.meshes[0];
    let expected = ([-0.62 - 0.2, 0.0, 0.15], [-0.62, 0.1, 0.45]);
    for k in 0..3 {
        assert!(
            (mesh.min[k] - expected.0[k]).abs() < 1e-12 && (mesh.max[k] - expected.1[k]).abs() < 1e-12,
            "{mesh:?}"
        );
    }
    assert!((mesh.report.volume.unwrap() - 0.006).abs() < 1e-12);
}

#[test]
fn a_file_in_another_unit_is_read_in_it() {
    let folder = with_sweep(Folder::new("unit"));
    let few = EXAMPLE.replace("count = 38912", "count = 10");
    let size = |more: &str| {
        let text = few.replace("file = \"sweep.stl\"", &format!("file = \"sweep.stl\"\n{more}"));
        folder.build(&text).unwrap().meshes[0].report.size()
    };
    let metres = size("");
    for (more, factor) in
        [("unit = \"mm\"", 1e-3), ("unit = \"in\"", 0.0254), ("unit = \"cm\"\nscale = 2", 0.02)]
    {
        for (k, length) in size(more).into_iter().enumerate() {
            assert!((length / (factor * metres[k]) - 1.0).abs() < 1e-12, "{more}: {length}");
        }
    }
    let error = only(&few.replace("file = \"sweep.stl\"", "sweep = {}\nunit = \"mm\""));
    assert!(error.message().contains("with `unit` needs `file`"), "{error}");
}

#[test]
fn a_tool_that_a_stage_inserts_is_absent_before() {
    let folder = with_sweep(Folder::new("insert"));
    let text =
        edited("duration = \"0.8 s\"", "duration = \"0.8 s\"\ninsert = [\"sweep\"]").replace("38912", "10");
    let world = folder.build(&text).unwrap().world;
    assert!(world.surfaces[0].absent);
    assert_eq!(world.stages[2].actions, [Action::Insert(0)]);
    let text = edited("remove = { above = 0.30 }", "withdraw = [\"sweep\"]").replace("38912", "10");
    assert!(!folder.build(&text).unwrap().world.surfaces[0].absent);
}

#[test]
fn particles_come_from_a_file() {
    let folder = with_sweep(Folder::new("csv")).file("bed.csv", "x,y,z,R\n0,0,0.1,0.01\n0.1,0,0.1,0.02\n");
    let world = folder.build(&with_csv()).unwrap().world;
    assert_eq!(world.particles.position, [[0.0, 0.0, 0.1], [0.1, 0.0, 0.1]]);
    assert_eq!((world.particles.radius, world.particles.material), (vec![0.01, 0.02], vec![0, 0]));
}

#[test]
fn files_that_are_missing_or_broken_are_told_at_the_line_that_names_them() {
    let folder = Folder::new("broken")
        .file("sweep.stl", "solid tool\n facet normal 0 0 1\n  outer loop\n   vertex 0 0")
        .file("bed.csv", "x,y,z,R\n0,0,nan,0.01\n");
    let errors = folder.build(&with_csv()).unwrap_err();
    let told: Vec<_> =
        errors.iter().map(|e| (e.kind(), e.place().text(), e.place().line_column().0)).collect();
    assert_eq!(told, [("file", "\"sweep.stl\"", 37), ("file", "\"bed.csv\"", 34)]);
    assert!(errors[1].message().contains("line 2"), "{}", errors[1]);

    let error = Folder::new("missing").only_error(&edited("38912", "10"));
    assert_eq!((error.kind(), error.place().text()), ("file", "\"sweep.stl\""));
    assert!(error.message().contains("sweep.stl"), "{error}");
}

#[test]
fn particles_that_start_wrong_are_told() {
    let folder = with_sweep(Folder::new("start"))
        .file("bed.csv", "x,y,z,R\n0,0,0.1,0.01\n0.005,0,0.1,0.01\n9,0,0.1,0.01\n");
    let errors = folder.build(&with_csv()).unwrap_err();
    assert_eq!(errors.iter().map(SceneError::kind).collect::<Vec<_>>(), ["outside", "overlap"]);
    assert_eq!(
        errors[0].message(),
        "1 of 3 particles start outside of the domain; the first is number 2 at [9.0, 0.0, 0.1] m"
    );
    assert_eq!(
        errors[1].message(),
        "particles start inside each other: number 0 of `bed` and 1 of `bed` by 150 % of the smaller radius"
    );
    assert_eq!(errors[1].place().text(), "\"bed.csv\"");

    let folder = with_sweep(Folder::new("wall")).file("bed.csv", "x,y,z,R\n0,0,0.004,0.01\n");
    let error = folder.only_error(&with_csv());
    assert_eq!(
        error.message(),
        "1 of 1 particles start inside a wall of the domain; the first is number 0 at [0.0, 0.0, 0.004] m"
    );

    let folder = with_sweep(Folder::new("warn")).file("bed.csv", "x,y,z,R\n0,0,0.1,0.01\n0.005,0,0.1,0.01\n");
    let text = with_csv().replace("overlap_limit = 0.3", "overlap_limit = \"warn\"");
    let built = folder.build(&text).unwrap();
    assert_eq!(built.warnings.iter().map(SceneError::kind).collect::<Vec<_>>(), ["overlap"]);
}

#[test]
fn particles_that_do_not_fit_are_told() {
    let folder = with_sweep(Folder::new("room"));
    let error = folder.only_error(&edited("38912", "10000000"));
    assert_eq!((error.kind(), error.place().text()), ("generate", "10000000"));
    assert!(error.message().starts_with("particles `bed` cannot be generated: "), "{error}");
}

#[test]
fn materials_named_by_a_file_need_a_density() {
    let csv = "x,y,z,R,material\n0,0,0.1,0.01,wood\n";
    let folder = with_sweep(Folder::new("density")).file("bed.csv", csv);
    let wood = "[material.wood]\nyoungs_modulus = 1e9\npoissons_ratio = 0.3\nrestitution = 0.5\nfriction = 0.5\n[contact]";
    let text = with_csv().replace("[contact]", wood);
    let error = folder.only_error(&text);
    assert_eq!(error.message(), "particles are made of `wood`, which has no density");
    let error = folder.only_error(&with_csv());
    assert!(error.message().contains("`wood` is not defined"), "{error}");
    let world =
        folder.build(&text.replace("[material.wood]", "[material.wood]\ndensity = 700")).unwrap().world;
    assert_eq!(world.materials[world.particles.material[0]].name, "wood");
}

#[test]
fn what_the_engine_refuses_is_told_at_its_place() {
    let folder = with_sweep(Folder::new("refused"));
    let built = folder.build(&edited("step = \"auto\"", "step = 0.01  ").replace("38912", "10")).unwrap();
    let too_large = SetupError::StepTooLarge {
        step: 0.01,
        stable: 1e-3,
        share: 1000.0,
        limit: "the Rayleigh time",
        advised: 1e-4,
    };
    let error = built.locate(&too_large);
    assert_eq!((error.place().text(), error.message()), ("0.01", too_large.to_string().as_str()));
    let particle = SetupError::Particle { id: 3, at: [0.0; 3], why: "is too large".to_owned() };
    assert_eq!(built.locate(&particle).place().text(), "10");
}

#[test]
fn a_tool_that_cannot_be_made_is_told() {
    let text = edited("file = \"sweep.stl\"", "sweep = { width = \"30 m\" }").replace("38912", "10");
    let error = Folder::new("tool").only_error(&text);
    assert_eq!((error.kind(), error.place().text()), ("shape", "{ width = \"30 m\" }"));
    assert!(error.message().contains("width = 30 m is not allowed"), "{error}");
}

#[test]
fn a_motion_comes_from_a_table() {
    let folder = with_sweep(Folder::new("poses"))
        .file("path.csv", "time [ms],x [mm],y,z\n0,0,0,0\n100,70,0,0\n")
        .file("turn.csv", "time,x,y,z,rz [deg]\n0,0,0,0,0\n")
        .file("swing.csv", "time,x,y,z,rx,ry,rz [deg]\n0,0,0,0,0,0,0\n1,0,0,0,0,0,90\n");
    let few = EXAMPLE.replace("count = 38912", "count = 10");
    let moved = |motion: &str| few.replace("velocity = [0.7, 0, 0]", motion);
    let world = folder.build(&moved("poses = \"path.csv\"")).unwrap().world;
    let motion = &world.stages[2].moves[0].1;
    let at = motion.at(&world.surfaces[0].pose, 0.05);
    assert!((at.pose.translation[0] - (-0.62 + 0.035)).abs() < 1e-12 && at.pose.translation[2] == 0.15);
    assert!((at.velocity[0] - 0.7).abs() < 1e-12, "{at:?}");
    // Sums with the other parts, but for a second rotation.
    let both = "poses = \"path.csv\", rotation = { axis = \"y\", rate = 1 }";
    assert!(folder.build(&moved(both)).is_ok());
    let error = folder.only_error(&moved("poses = \"swing.csv\", rotation = { axis = \"y\", rate = 1 }"));
    assert_eq!((error.kind(), error.place().text()), ("conflict", "\"swing.csv\""));
    let error = folder.only_error(&moved("poses = \"turn.csv\""));
    assert_eq!((error.kind(), error.place().text()), ("file", "\"turn.csv\""));
    assert!(error.message().contains("turn.csv`, line 1: no column `rx` among"), "{error}");
    // Of the surface itself.
    let own = few.replace("[geometry.sweep]", "[geometry.sweep]\nmotion.poses = \"swing.csv\"");
    let world = folder.build(&own).unwrap().world;
    assert!((world.surfaces[0].motion.poses.as_ref().unwrap().at(0.5).spin[2] - FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn round_shapes_stand_where_they_should() {
    let folder = Folder::new("round");
    let few = EXAMPLE.replace("count = 38912", "count = 10");
    let with = |shape: &str| few.replace("file = \"sweep.stl\"", shape);
    let built = folder
        .build(&with(
            "cylinder = { radius = \"5 cm\", length = 0.2, axis = [0, 0, 3], ends = true }\n\
             rotate = [{ axis = \"x\", angle = \"90 deg\" }]",
        ))
        .unwrap();
    let surface = &built.world.surfaces[0];
    let Shape::Frustum(f) = surface.shape else { panic!("{:?}", surface.shape) };
    assert_eq!((f.axis, f.ends, f.radii, f.closed), ([0.0, 0.0, 1.0], [-0.1, 0.1], [0.05; 2], true));
    assert_eq!(surface.pose.translation, [-0.62, 0.0, 0.15]);
    let end = surface.pose.apply([0.0, 0.0, 0.1]);
    assert!((end[1] + 0.1).abs() < 1e-12 && (end[2] - 0.15).abs() < 1e-12, "{end:?}");
    let note = "geometry `sweep`: cylinder of radius 0.05 m, closed, from (-0.6200, 0.1000, 0.1500) to (-0.6200, -0.1000, \
                0.1500) m";
    assert!(built.notes.iter().any(|n| n == note), "{:?}", built.notes);
    let cone = "cone = { start_radius = 0.01, end_radius = 0.03, length = 0.1, axis = \"-z\" }";
    let world = folder.build(&with(cone)).unwrap().world;
    let Shape::Frustum(f) = world.surfaces[0].shape else { panic!("{:?}", world.surfaces[0].shape) };
    assert_eq!((f.axis, f.ends, f.radii, f.closed), ([0.0, 0.0, -1.0], [0.0, 0.1], [0.01, 0.03], false));
    let error = only(&with(&format!("{cone}\nscale = 2")));
    assert!(error.message().contains("`scale`") && error.message().contains("`cone`"), "{error}");
    let error = only(&with("cone = { start_radius = 0, end_radius = 0.03, length = 0.1 }"));
    assert_eq!(error.place().text(), "0");
}
