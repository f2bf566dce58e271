//! Bad input, word for word: every mistake is answered with its place, before anything is written. And accidents of
//! the system: they are told, and what was written before stays good.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fmt::Write as _;
use std::fs;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use cli_common::{Ended, Place, SCENE};
use sha2::{Digest, Sha256};

/// What is made of the working scene, and what it then needs beside it.
struct Case {
    name: &'static str,
    scene: Vec<u8>,
    files: Vec<(&'static str, Vec<u8>)>,
    args: Vec<&'static str>,
}

impl Case {
    fn text(name: &'static str, scene: impl Into<Vec<u8>>) -> Self {
        Self { name, scene: scene.into(), files: Vec::new(), args: Vec::new() }
    }

    /// With a part of the scene replaced.
    fn edit(name: &'static str, from: &str, to: &str) -> Self {
        assert_eq!(SCENE.matches(from).count(), 1, "`{from}` is not there exactly once");
        Self::text(name, SCENE.replace(from, to))
    }

    /// With a value replaced on the command line.
    fn set(name: &'static str, set: &'static str) -> Self {
        Self { args: vec!["--set", set], ..Self::text(name, SCENE) }
    }

    /// With the particles from a file.
    fn particles(name: &'static str, file: &'static str, content: impl Into<Vec<u8>>) -> Self {
        let from = SCENE.find("material = \"soil\"\ncount").unwrap();
        let to = SCENE.find("[geometry.floor]").unwrap();
        let scene = format!("{}material = \"soil\"\nfile = \"{file}\"\n\n{}", &SCENE[..from], &SCENE[to..]);
        Self { files: vec![(file, content.into())], ..Self::text(name, scene) }
    }

    /// With another shape of the block.
    fn shape(name: &'static str, shape: &str) -> Self {
        Self::edit(name, "box = { min = [-0.02, -0.02, 0.02], max = [0, 0.02, 0.2] }", shape)
    }

    /// With the block from a mesh file.
    fn mesh(name: &'static str, file: &'static str, content: impl Into<Vec<u8>>) -> Self {
        let case = Self::shape(name, &format!("file = \"{file}\""));
        Self { files: vec![(file, content.into())], ..case }
    }
}

impl Case {
    /// With the block moved by a table.
    fn moved(name: &'static str, content: impl Into<Vec<u8>>) -> Self {
        let case = Self::edit(name, "velocity = [0.5, 0, 0]", "poses = \"path.csv\"");
        Self { files: vec![("path.csv", content.into())], ..case }
    }
}

/// A checkpoint of a format to come, whole and signed.
fn later_checkpoint() -> Vec<u8> {
    let content = [b"glebe\r\n\x1a\x63\0\0\0", &[0; 100][..]].concat();
    [&content[..], &Sha256::digest(&content)].concat()
}
/// Of a field, its grid left out.
const FIELD: &str = "[[output.field]]\nname = \"heap\"\nevery = \"10 ms\"\n";
/// Of an inlet, what comes left out.
const INLET: &str =
    "[inlet.feed]\nregion = { box = { min = [-0.05, -0.04, 0.3], max = [0.05, 0.04, 0.33] } }\n";
/// Of what comes.
const GRAINS: &str = "material = \"soil\"\nradius = \"5 mm\"\n";

fn cases() -> Vec<Case> {
    let vtu = |points: &str, radius: &str| {
        format!(
            "<VTKFile type=\"UnstructuredGrid\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"2\">\n<Points>\n\
             <DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">{points}</DataArray>\n</Points>\n\
             <PointData>\n<DataArray type=\"Float32\" Name=\"Radius\" format=\"ascii\">{radius}</DataArray>\n\
             </PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
        )
    };
    let many_keys = (0..300).fold(String::new(), |mut text, k| {
        let _ = writeln!(text, "key{k} = 1");
        text
    });
    let ply = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000000000\nproperty double x\n\
               property double y\nproperty double z\nend_header\n";
    vec![
        Case::text("an empty scene", ""),
        Case::text("a scene that is no text", [0xff, 0xfe, 0, 1]),
        Case::text("a scene that is no TOML", "[domain\nmin = 1"),
        Case::text("a scene nested too deeply", format!("x = {}", "[".repeat(300))),
        Case::text("a scene that is too large", "#".repeat(2 << 20)),
        Case::text("more mistakes than people read", many_keys),
        Case::edit("a key written twice", "density = 2000", "density = 2000\ndensity = 2100"),
        Case::edit("an unknown key", "density = 2000", "densty = 2000"),
        Case::edit(
            "keys that contradict each other",
            "duration = \"0.3 s\"",
            "duration = \"0.3 s\"\nuntil = { at_most = 1 }",
        ),
        Case::edit("an unknown material", "material = \"soil\"", "material = \"sail\""),
        Case::edit("a stage without an end", "duration = \"0.3 s\"", ""),
        Case::set("a negative density", "material.soil.density=-1"),
        Case::set("a Poisson's ratio beyond 0.5", "material.soil.poissons_ratio=0.7"),
        Case::set("a restitution beyond 1", "material.soil.restitution=2"),
        Case::set("a number that is none", "material.soil.friction=nan"),
        Case::set("a number beyond all bounds", "particles.bed.velocity=[0,0,-1e300]"),
        Case::set("a step beyond all bounds", "time.step=1e-300"),
        Case::set("a step that is not stable", "time.step=5 ms"),
        Case::set("a domain inside out", "domain.max=[-1,1,1]"),
        Case::set("a unit of something else", "domain.max.2=4 kg"),
        Case::set("a path that leads nowhere", "particle.bed.count=5"),
        Case::set("more particles than there is room", "particles.bed.count=1000000"),
        Case {
            args: vec!["--set", "particles.bed.count=4000000000", "--set", "particles.bed.radius=1 um"],
            ..Case::text("more particles than memory holds", SCENE)
        },
        Case::edit("a tool that starts in the bed", "translate = [-0.11, 0, 0]", "").inserted(),
        Case::particles("particles inside each other", "p.csv", "x,y,z,R\n0,0,0.1,0.01\n0,0.001,0.1,0.01\n"),
        Case::particles("particles outside of the domain", "p.csv", "x,y,z,R\n0,0,0.1,0.01\n0,0,100,0.01\n"),
        Case::particles("particles in another unit", "p.csv", "x,y,z,R [kg]\n0,0,0.1,0.01\n"),
        Case::particles("an empty CSV file", "p.csv", ""),
        Case::particles("a ragged CSV file", "p.csv", "x,y,z,R\n0,0,0.1\n"),
        Case::particles("a CSV file with a word for a number", "p.csv", "x,y,z,R\n0,0,high,0.01\n"),
        Case::particles(
            "a VTU file that is no XML",
            "p.vtu",
            "<VTKFile type=\"UnstructuredGrid\"><Piece></VTKFile>",
        ),
        Case::particles("a VTU file with too few numbers", "p.vtu", vtu("0 0 0.1 0.05 0", "0.01 0.01")),
        Case::particles(
            "a VTU file that claims more than it has",
            "p.vtu",
            vtu("0 0 0.1 0.05 0 0.1", "0.01 0.01").replace("Points=\"2\"", "Points=\"1000000000000000000\""),
        ),
        Case::particles(
            "a VTU file without a radius",
            "p.vtu",
            vtu("0 0 0.1 0.05 0 0.1", "").replace("\"Radius\"", "\"size\""),
        ),
        Case::particles(
            "a PLY file of particles without a radius",
            "p.ply",
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n",
        ),
        Case { files: Vec::new(), ..Case::particles("particles that are not there", "nowhere.csv", "") },
        Case { files: Vec::new(), ..Case::mesh("a mesh that is not there", "nowhere.stl", "") },
        Case::mesh("a mesh of an unknown format", "tool.step", "ISO-10303-21;"),
        Case::mesh(
            "an STL file cut short",
            "tool.stl",
            "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0",
        ),
        Case::mesh("a binary STL file cut short", "tool.stl", [vec![0; 80], vec![9, 0, 0, 0, 1, 2]].concat()),
        Case::mesh("an OBJ file with a wrong index", "tool.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"),
        Case::mesh("an OBJ file with a word for a number", "tool.obj", "v 0 0 zero\nf 1 2 3\n"),
        Case::mesh("a PLY file that claims more than it has", "tool.ply", ply),
        Case::mesh("a mesh without an area", "tool.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"),
        Case::shape("a blade that lies flat", "blade = { rake_angle = \"5 deg\" }"),
        Case::shape(
            "a plough that does not rise",
            "plough = { lift_angle = \"30 deg\", curl_angle = \"30 deg\" }",
        ),
        Case::shape("a wheel of grousers alone", "wheel = { grousers = 60, grouser_thickness = \"2 cm\" }"),
        Case::shape("half a grouser", "wheel = { grousers = 2.5 }"),
        Case::shape("lifters without a size", "drum = { radius = 0.02, length = 0.04, lifters = 4 }"),
        Case::shape(
            "lifters that meet",
            "drum = { radius = 0.02, length = 0.04, lifters = 4, lifter_height = 0.015, lifter_thickness = 0.01 }",
        ),
        Case::shape("a mixer with rows above its shaft", "mixer = { rows = 4, row_spacing = \"10 cm\" }"),
        Case::shape("two shapes of one tool", "blade = {}\nwheel = {}"),
        Case::text(
            "a field coarser than its kernel",
            format!("{SCENE}{FIELD}spacing = \"1 cm\"\nwidth = 0.001\n"),
        ),
        Case::text("a field of too many cells", format!("{SCENE}{FIELD}spacing = 1e-5\nwidth = 0.01\n")),
        Case::text(
            "fields that share a file, and a window that is too long",
            format!(
                "{SCENE}{FIELD}spacing = 0.01\nwidth = 0.01\n{FIELD}spacing = 0.01\nwidth = 0.01\nwindow = 0.1\n"
            ),
        ),
        Case::text("an inlet without a rate", format!("{SCENE}{INLET}")),
        Case::text(
            "an inlet of what nobody takes",
            format!("{SCENE}{INLET}from = \"drian\"\n[outlet.drain]\n"),
        ),
        Case::text(
            "an inlet in a stage that is not there",
            format!("{SCENE}{INLET}{GRAINS}rate = 100\nstages = [\"psh\"]\n"),
        ),
        Case::text(
            "an inlet for too large grains",
            format!("{SCENE}{INLET}material = \"soil\"\nradius = 0.02\nmass_rate = \"1 kg/s\"\n"),
        ),
        Case::text(
            "an outlet inside out",
            format!(
                "{SCENE}[outlet.drain]\nregion = {{ box = {{ min = [0, 0, 0], max = [0.1, 0, 0.1] }} }}\n"
            ),
        ),
        Case::set("a tool that moves too far in a step", "stage.push.move.block.velocity=[200,0,0]"),
        Case::moved("a motion whose times go back", "time,x,y,z\n0,0,0,0\n0.2,0.1,0,0\n0.1,0.2,0,0\n"),
        Case::moved("a motion of one row", "time,x,y,z\n0,0,0,0\n"),
        Case { files: Vec::new(), ..Case::moved("a motion that is not there", "") },
        Case { args: vec!["--out", "scene.toml"], ..Case::text("a file where results should go", SCENE) },
        Case {
            files: vec![("full/thesis.txt", Vec::new())],
            args: vec!["--out", "full"],
            ..Case::text("a folder with other files", SCENE)
        },
        Case { args: vec!["--resume"], ..Case::text("nothing to resume", SCENE) },
        Case {
            files: vec![
                ("old/checkpoint/000001.glebe", b"glebe\r\n\x1a\x01".to_vec()),
                ("old/checkpoint/000002.glebe", b"time,step".to_vec()),
            ],
            args: vec!["--resume", "--out", "old"],
            ..Case::text("checkpoints that are none", SCENE)
        },
        Case {
            files: vec![("old/checkpoint/000001.glebe", later_checkpoint())],
            args: vec!["--resume", "--out", "old"],
            ..Case::text("a checkpoint of a later version", SCENE)
        },
    ]
}

impl Case {
    /// With the block there from the beginning.
    fn inserted(self) -> Self {
        let text = String::from_utf8(self.scene).unwrap();
        Self { scene: text.replace("insert = [\"block\"]\n", "").into(), ..self }
    }
}

/// The message, without what differs from machine to machine; of a long one the ends.
fn shown(stderr: &str, place: &Place) -> String {
    let text = stderr.replace(&place.path("").display().to_string(), "PLACE/");
    let lines: Vec<String> = text
        .lines()
        .filter(|line| {
            !line.starts_with("geometry `")
                && !line.starts_with("particles `")
                && !line.starts_with("device: ")
        })
        .map(|line| match line.rfind("of memory; ") {
            Some(at) => format!("{}of memory; … are free", &line[..at]),
            None => line.chars().take(300).collect(),
        })
        .collect();
    if lines.len() <= 16 {
        return lines.join("\n");
    }
    let gap = format!("…{} lines…", lines.len() - 10);
    [&lines[..4], &[gap], &lines[lines.len() - 6..]].concat().join("\n")
}

/// A study over the working scene.
fn study(name: &'static str, study: impl Into<Vec<u8>>) -> Case {
    Case { files: vec![("study.toml", study.into())], ..Case::text(name, SCENE) }
}

fn studies() -> Vec<Case> {
    let over = |path: &str, values: &str| {
        format!("scene = \"scene.toml\"\n[vary.it]\npath = \"{path}\"\nvalues = {values}\n")
    };
    let density = "material.soil.density";
    vec![
        study("an empty study", ""),
        study("a study that is no TOML", "scene = scene.toml"),
        study("a study that is no text", [0xff, 0xfe, 0, 1]),
        study("a study nested too deeply", format!("x = {}", "[".repeat(300))),
        study(
            "a study of a scene that is not there",
            over(density, "[1]").replace("scene.toml", "nowhere.toml"),
        ),
        study("a study of another study", over(density, "[1]").replace("scene.toml", "study.toml")),
        study("a path of a study that leads nowhere", over("material.soil.densty", "[2000]")),
        study("a value in another unit", over(density, "[\"2 MPa\"]")),
        study("a study of nothing", over(density, "[]")),
        study("a study whose worlds are all wrong", over(density, "[-1, 0]")),
        study(
            "more worlds than a study has",
            over(density, "1").replace("values = 1", "range = [1, 2]\ncount = 1000000000"),
        ),
    ]
}

/// Twenty grains without walls.
const SAMPLE: &str = include_str!("../../../fuzz/seeds/scene/sample.toml");

fn samples() -> Vec<Case> {
    let with = |name: &'static str, more: &str| {
        let files = vec![("study.toml", format!("scene = \"scene.toml\"\n{more}\n").into())];
        Case { files, ..Case::text(name, SAMPLE) }
    };
    let consolidate = "[consolidate]\npressure = \"100 kPa\"\n";
    let and = |name: &'static str, more: &str| with(name, &format!("{consolidate}{more}"));
    let walls = SAMPLE.replace("z = \"periodic\"", "z = \"open\"");
    vec![
        with("a study that brings samples to no stress", "[load]\nprogram = \"scene\""),
        with("a stress below none", "[consolidate]\npressure = -1"),
        with("a stress in another unit", "[consolidate]\npressure = \"100 kN\""),
        and("an unknown program", "[load]\nprogram = \"triaxal\""),
        and("a program without its strain", "[load]\nprogram = \"simple-shear\""),
        and("a preparation with two aims", "[prepare]\nvoid_ratio = 0.6\nfriction = 0.2"),
        and("a preparation without an aim", "[prepare]\npressure = 100"),
        and("no samples at all", "[vary.e]\npath = \"prepare.void_ratio\"\nvalues = []"),
        Case { scene: walls.into(), ..and("a sample with an open side", "") },
        Case {
            args: vec!["--set", "seeds=1000000000"],
            ..and("more samples than a study has", "[prepare]\nvoid_ratio = 0.6")
        },
        study("a study of samples of a bed in a box", format!("scene = \"scene.toml\"\n{consolidate}")),
    ]
}

fn calibrations() -> Vec<Case> {
    let free = "[free.friction]\npath = \"material.soil.friction\"\nbounds = [0.2, 0.6]\n";
    let target = "[target.force]\nmeasure = \"push.draught_force\"\nvalue = \"12 N\"\nscatter = 1\n";
    let with = |name: &'static str, parts: &[&str]| {
        study(name, format!("scene = \"scene.toml\"\n{}", parts.concat()))
    };
    let edit = |name: &'static str, from: &str, to: &str| {
        let text = format!("{free}{target}");
        assert_eq!(text.matches(from).count(), 1, "`{from}` is not there exactly once");
        with(name, &[&text.replace(from, to)])
    };
    vec![
        with("a calibration towards nothing", &[free]),
        with("a calibration of nothing", &[target]),
        edit("bounds the wrong way round", "[0.2, 0.6]", "[0.6, 0.2]"),
        edit("bounds in another unit", "[0.2, 0.6]", "[\"2 MPa\", 0.6]"),
        edit("a free parameter that leads nowhere", "soil.friction", "soil.fricton"),
        edit("a measure that the scene has not", "push.draught_force", "push.draught"),
        edit("a target in another unit", "\"12 N\"", "\"12 kPa\""),
        edit("a target without a scatter", "scatter = 1", "scatter = 0"),
        edit("an experiment that is not there", "measure =", "experiment = \"slow\"\nmeasure ="),
        with("two methods", &[free, target, "[method.cma-es]\n[method.bayesian-filter]\n"]),
        with("too few agents", &[free, target, "[method.differential-evolution]\npopulation = 2\n"]),
        with(
            "more agents than there is reason for",
            &[free, target, "[method.cma-es]\npopulation = 1000000000000\n"],
        ),
        edit("a range whose middle cannot be set up", "[0.2, 0.6]", "[0.9, 5]"),
    ]
}

#[test]
fn every_mistake_of_a_study_of_samples_is_told_before_anything_is_written() {
    insta::assert_snapshot!(told(&["rve", "study.toml"], samples()));
}

#[test]
fn every_mistake_of_a_calibration_is_told_before_anything_is_written() {
    insta::assert_snapshot!(told(&["calibrate", "study.toml"], calibrations()));
}

#[test]
fn every_mistake_is_told_before_anything_is_written() {
    insta::assert_snapshot!(told(&["run", "scene.toml"], cases()));
}

#[test]
fn every_mistake_of_a_study_is_told_before_anything_is_written() {
    insta::assert_snapshot!(told(&["sweep", "study.toml"], studies()));
}

/// The messages of all cases, none of which leaves anything behind.
fn told(verb: &[&str], cases: Vec<Case>) -> String {
    let mut table = String::new();
    for case in cases {
        let place = Place::new();
        place.write("scene.toml", &case.scene);
        for (name, content) in &case.files {
            fs::create_dir_all(place.path(name).parent().unwrap()).unwrap();
            place.write(name, content);
        }
        let before = place.listing();
        let begun = Instant::now();
        let ended = place.glebe(&[verb, &["--no-cache", "--device", "cpu"], &case.args[..]].concat());
        assert_eq!(ended.code, 2, "{}: {}", case.name, ended.stderr);
        assert!(begun.elapsed() < Duration::from_secs(20), "{} takes long to be refused", case.name);
        assert_eq!(place.listing(), before, "{} leaves something behind", case.name);
        writeln!(table, "## {}\n{}\n", case.name, shown(&ended.stderr, &place)).unwrap();
    }
    table
}

#[test]
fn standard_output_that_is_full_is_an_error() {
    if !fs::exists("/dev/full").unwrap() {
        return;
    }
    let place = Place::new();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = place.command(&["schema"]).stdout(Stdio::from(full)).output().unwrap();
    Ended::of(&output).expect(1).says(&["standard output cannot be written"]);
}

/// A run that cannot be written further ends with a message, leaves nothing half-written, and goes on later.
#[cfg(target_os = "linux")]
#[test]
fn a_limit_on_the_size_of_files_is_an_error_and_the_run_can_be_resumed() {
    let place = Place::new();
    place.write("scene.toml", SCENE.replace("\"0.5 s\"", "\"0.1 s\"").replace("\"0.3 s\"", "\"0.05 s\""));
    place.glebe(&["run", "scene.toml", "--out", "whole", "--no-cache"]).expect(0);
    let run = "ulimit -f 64; exec \"$0\" run scene.toml --out cut --no-cache --checkpoint-every 0";
    let mut shell = std::process::Command::new("sh");
    let output =
        shell.args(["-c", run, env!("CARGO_BIN_EXE_glebe")]).current_dir(place.path("")).output().unwrap();
    Ended::of(&output).expect(1).says(&["series.csv: cannot append to this file", "ulimit -f"]);
    assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
    place
        .glebe(&["run", "scene.toml", "--out", "cut", "--no-cache", "--resume"])
        .expect(0)
        .says(&["resumed at"]);
    assert_eq!(place.hash("cut"), place.hash("whole"));
    let series = |out: &str| fs::read(place.path(out).join("series.csv")).unwrap();
    assert!(series("cut") == series("whole"), "the series has a seam");
}

#[cfg(target_os = "linux")]
#[test]
fn a_place_that_cannot_be_written_to_and_one_that_vanishes() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    place
        .glebe(&["run", "scene.toml", "--no-cache", "--out", "/proc/glebe-out"])
        .expect(1)
        .says(&["/proc/glebe-out: cannot make this folder"]);
    let child = place.command(&["run", "scene.toml", "--no-cache"]).spawn().unwrap();
    let begun = Instant::now();
    while !place.path("out/frames/000001_particles.vtp").exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no frames");
        sleep(Duration::from_millis(2));
    }
    // Frames may be written meanwhile.
    while place.path("out").exists() {
        let _ = fs::remove_dir_all(place.path("out"));
    }
    let ended = Ended::of(&child.wait_with_output().unwrap());
    ended.expect(1).says(&["out/", "cannot", "does not exist (any more)"]);
    assert!(!place.path("out").exists(), "{:?}", place.listing());
}
