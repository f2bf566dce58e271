//! Runs that are interrupted, killed, resumed, and that share settled beds: always the same bits.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use glebe::engine::state::State;
use glebe::io::checkpoint;

use cli_common::disk::on_disks_that_fill;
use cli_common::{Ended, Place, SCENE, series, signal, some_number};

/// What makes the push last long enough that a signal comes before its end, whatever the machine.
const SLOW: [&str; 4] =
    ["--set", "stage.push.duration=1.5", "--set", "stage.push.move.block.velocity=[0.1, 0, 0]"];

/// Waits until the run has written so many rows of its series.
fn wait_for_rows(place: &Place, out: &str, rows: usize) {
    let started = Instant::now();
    let file = place.path(out).join("series.csv");
    while fs::read_to_string(&file).map_or(0, |t| t.lines().count()) <= rows {
        assert!(started.elapsed() < Duration::from_secs(60), "no rows after a minute");
        sleep(Duration::from_millis(5));
    }
}

/// A field whose windows are longer than the time between two checkpoints.
const FIELD: &str = r#"
[[output.field]]
name = "heap"
spacing = "8 mm"
width = "8 mm"
every = "16 ms"
window = "10 ms"
profile = "z"
"#;

/// Grains that rain on the bed while the block is pushed through it, and a hole at its end.
const DOORS: &str = r#"
[inlet.rain]
region = { box = { min = [-0.09, -0.04, 0.3], max = [0.09, 0.04, 0.39] } }
material = "soil"
radius = { sieve = { opening = ["10 mm", "16 mm"], passing = [0, 1] } }
mass_rate = "2 kg/s"
velocity = [0, 0, -2]
stages = ["push"]

[outlet.hole]
region = { box = { min = [0.04, -0.05, 0], max = [0.1, 0.05, 0.03] } }
stages = ["push"]
"#;

#[test]
fn a_run_that_is_interrupted_and_resumed_ends_with_the_same_bits() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let run = |out: &'static str| [&["run", "scene.toml", "--no-cache", "--out", out], &SLOW[..]].concat();
    let whole = place.glebe(&[&run("whole")[..], &["--json"]].concat());
    let whole = whole.expect(0).json();
    assert_eq!(whole["status"], "done");

    let mut args = run("parts");
    for name in ["-INT", "-TERM"] {
        let rows = fs::read_to_string(place.path("parts/series.csv")).map_or(0, |t| t.lines().count());
        let child = place.command(&args).spawn().unwrap();
        wait_for_rows(&place, "parts", rows + 20 + some_number(300) as usize);
        signal(&child, name);
        let ended = Ended::of(&child.wait_with_output().unwrap());
        ended.expect(130).says(&["--resume"]);
        assert_eq!(place.summary("parts")["status"], "interrupted");
        args = [&run("parts")[..], &["--resume"]].concat();
    }
    place
        .glebe(&[&args[..], &["--set", "material.soil.density=2100"]].concat())
        .expect(2)
        .says(&["belongs to another scene"]);
    place.glebe(&args).expect(0).says(&["resumed at"]);

    assert_eq!(place.hash("parts"), whole["state_hash"].as_str().unwrap());
    let bytes = |name: &str| fs::read(place.path(name)).unwrap();
    assert_eq!(bytes("parts/series.csv"), bytes("whole/series.csv"), "the series has a seam");
    assert_eq!(bytes("parts/frames.pvd"), bytes("whole/frames.pvd"), "the frames have a seam");
    let measures = |out: &str| place.summary(out)["stages"][2]["measures"].clone();
    assert_eq!(measures("parts"), measures("whole"));
    assert!(measures("whole")["draught_force"]["mean"].as_f64().unwrap() > 0.0);
    // Once done there is nothing to resume, and nothing is spoilt.
    place.glebe(&args).expect(0).says(&["nothing was left to do"]);
    assert_eq!(place.hash("parts"), whole["state_hash"].as_str().unwrap());
}

#[test]
fn a_run_that_is_killed_goes_on_from_its_last_checkpoint() {
    let place = Place::new();
    place.write("scene.toml", format!("{SCENE}{FIELD}{DOORS}"));
    let sets = ["--set", "stage.push.duration=0.1", "--set", "stage.settle.until.at_most=0.1"];
    let run = |out: &'static str| [&["run", "scene.toml", "--out", out, "--no-cache"], &sets[..]].concat();
    place.glebe(&run("whole")).expect(0);

    let child = place.command(&[&run("killed")[..], &["--checkpoint-every", "0"]].concat()).spawn().unwrap();
    wait_for_rows(&place, "killed", 60);
    // Nobody else gets into its folder while it lives, and what is in it stays as it is.
    signal(&child, "-STOP");
    let before = place.listing();
    for more in [&[][..], &["--force"], &["--resume"]] {
        place
            .glebe(&[&run("killed")[..], more].concat())
            .expect(2)
            .says(&["another run is writing", "--out"]);
    }
    assert_eq!(place.listing(), before);
    signal(&child, "-KILL");
    Ended::of(&child.wait_with_output().unwrap()).expect(-1);
    assert!(fs::read_dir(place.path("killed/checkpoint")).unwrap().count() <= 3, "old checkpoints pile up");
    place.glebe(&[&run("killed")[..], &["--resume"]].concat()).expect(0);
    assert_eq!(place.hash("killed"), place.hash("whole"));
    assert_eq!(
        fs::read(place.path("killed/series.csv")).unwrap(),
        fs::read(place.path("whole/series.csv")).unwrap()
    );
    // Every grain is inside, or came through one and went through the other.
    let rows = series(&place.path("whole"));
    let count = |row: usize, name: &str| rows.column(name).unwrap()[row];
    let last = rows.column("time").unwrap().len() - 1;
    let balance = |row| count(row, "particles") - count(row, "rain.particles") + count(row, "hole.particles");
    assert!(count(last, "rain.particles") > 50.0 && count(last, "hole.particles") > 5.0);
    assert_eq!(balance(last), balance(3 * last / 4));
    let came = count(last, "rain.mass");
    assert!(count(last, "time") > 0.1 && (0.15..=0.2).contains(&came), "{came} kg");
    assert!(count(last, "entered") > 0.5 * came * 4.0);
    // Means over a window that a checkpoint was written in have no seam either.
    let files = |out: &str| {
        let all = fs::read_dir(place.path(out).join("fields")).unwrap().map(|entry| entry.unwrap().path());
        let mut all: Vec<_> =
            all.map(|path| (path.file_name().unwrap().to_owned(), fs::read(path).unwrap())).collect();
        all.sort();
        all
    };
    let (killed, whole) = (files("killed"), files("whole"));
    let names: Vec<_> = whole.iter().map(|(name, _)| name.to_str().unwrap()).collect();
    assert!(names.starts_with(&["000000_heap.csv", "000000_heap.vti", "000001_heap.csv"]), "{names:?}");
    assert!(killed == whole, "the fields have a seam: {names:?}");
    // The mass of the profile is that of the grains: solid fraction times volume, in the last result.
    let (_, last) =
        whole.iter().rfind(|(name, _)| Path::new(name).extension().is_some_and(|e| e == "csv")).unwrap();
    let rows: Vec<Vec<f64>> = String::from_utf8_lossy(last)
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect();
    assert!(rows.windows(2).all(|pair| pair[0][0] < pair[1][0]));
    assert!(rows.iter().all(|row| row[1] >= 0.0 && row[1] < 0.8), "{rows:?}");
    let (solid, density): (f64, f64) = (rows.iter().map(|r| r[1]).sum(), rows.iter().map(|r| r[2]).sum());
    assert!(solid > 0.5 && (density / solid / 2000.0 - 1.0).abs() < 1e-3, "{density} {solid}");
}

/// A state whose contacts all remember as much as the first.
fn even(mut state: State) -> State {
    let length = state.contacts[0].history.len();
    let contacts = state.contacts.iter_mut().map(|m| &mut m.history);
    contacts
        .chain(state.surface_contacts.iter_mut().map(|m| &mut m.history))
        .for_each(|h| h.resize(length, 0.0));
    state
}

#[test]
fn a_run_that_is_killed_again_and_again_ends_with_the_same_bits() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let sets = ["stage.push.duration=0.04", "stage.settle.until.at_most=0.04", "output.frames=1 ms"];
    let sets = sets.map(|set| ["--set", set]).concat();
    let run = |out: &'static str, more: &[&'static str]| {
        [&["run", "scene.toml", "--no-cache", "--device", "cpu", "--out", out], &sets[..], more].concat()
    };
    place.glebe(&run("whole", &[])).expect(0);

    // Begun with --resume where there is nothing: every start is the same command.
    fs::create_dir(place.path("killed")).unwrap();
    let folders = ["killed/checkpoint", "killed/frames"];
    let torn =
        place.killed_again_and_again(&run("killed", &["--resume", "--checkpoint-every", "0"]), &folders, 15);
    assert!(torn.iter().all(|n| *n > 0), "half-written checkpoints and frames: {torn:?}");
    assert_eq!(place.hash("killed"), place.hash("whole"));
    let bytes = |name: &str| fs::read(place.path(name)).unwrap();
    for file in ["series.csv", "frames.pvd", "frames/000070_particles.vtp"] {
        assert!(bytes(&format!("killed/{file}")) == bytes(&format!("whole/{file}")), "{file} differs");
    }
    assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
}

/// On disks that fill earlier and later, until there is room: as if there had been room from the beginning.
#[test]
fn a_run_on_a_disk_that_fills_goes_on_when_there_is_room() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let sets = ["stage.push.duration=0.03", "stage.settle.until.at_most=0.03", "output.frames=2 ms"];
    let sets = sets.map(|set| ["--set", set]).concat();
    let run = |out: &'static str, more: &[&'static str]| {
        [&["run", "scene.toml", "--no-cache", "--device", "cpu", "--out", out], &sets[..], more].concat()
    };
    let again = run("disk/out", &["--resume", "--checkpoint-every", "0"]);
    if !on_disks_that_fill(&place, &again, &[20, 100, 300, 310, 65536]) {
        return;
    }
    place.glebe(&run("whole", &[])).expect(0);
    assert_eq!(place.hash("kept/out"), place.hash("whole"));
    let bytes = |name: String| fs::read(place.path(&name)).unwrap();
    let mut frames: Vec<_> =
        fs::read_dir(place.path("whole/frames")).unwrap().map(|e| e.unwrap().file_name()).collect();
    frames.sort();
    assert!(frames.len() > 30, "{frames:?}");
    let frames = frames.iter().map(|name| format!("frames/{}", name.display()));
    for file in frames.chain(["series.csv".to_owned(), "frames.pvd".to_owned()]) {
        assert!(bytes(format!("kept/out/{file}")) == bytes(format!("whole/{file}")), "{file} differs");
    }
}

#[test]
fn what_is_wrong_with_a_checkpoint_is_told_and_the_one_before_continued() {
    let place = Place::new();
    let short = SCENE.replace("\"0.5 s\"", "\"0.05 s\"").replace("\"0.3 s\"", "\"0.05 s\"");
    place.write("scene.toml", short.replace("[output]", "[output]\ncheckpoint_wall = 0"));
    let run = ["run", "scene.toml", "--no-cache", "--device", "cpu"];
    place.glebe(&run).expect(0);
    let whole = place.hash("out");

    let mut files: Vec<_> =
        fs::read_dir(place.path("out/checkpoint")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 2, "the last two are kept");
    fs::write(&files[1], &fs::read(&files[1]).unwrap()[..1000]).unwrap();
    let resume = [&run[..], &["--resume"]].concat();
    place.glebe(&resume).expect(0).says(&["warning: ", "is cut short: it has 1000 of", "resumed at"]);
    assert_eq!(place.hash("out"), whole);
    assert!(place.summary("out")["warnings"][0].as_str().unwrap().contains("cut short"));

    // One that is whole and of this scene, but not a state that its world can have.
    let newest =
        || fs::read_dir(place.path("out/checkpoint")).unwrap().map(|e| e.unwrap().path()).max().unwrap();
    let good = checkpoint::read(&newest()).unwrap();
    let state = State::from_bytes(&good.state).unwrap();
    type Spoil = fn(&mut State);
    let spoils: [(Spoil, &str); 6] = [
        (|s| s.particles.spin[0].material = 9, "a material"),
        (|s| s.particles.id[0] = s.particles.id[1], "or there twice"),
        (|s| s.particles.velocity[3].v[1] = f32::NAN, "a velocity"),
        (|s| s.surface_contacts[0].surface = 99, "a contact with a surface"),
        (|s| s.contacts[0].history.push(0.0), "a contact"),
        (|s| s.progress.surfaces.clear(), "its surfaces"),
    ];
    for (spoil, what) in spoils {
        let mut bad = state.clone();
        spoil(&mut bad);
        // Files have histories of one length.
        checkpoint::write(&newest(), &good.header, &even(bad).to_bytes()).unwrap();
        place.glebe(&resume).expect(2).says(&["the state is not one of this world: ", what]);
    }
    checkpoint::write(&newest(), &good.header, &good.state).unwrap();

    // A state that another device computed is continued, and said to be one.
    let found = good;
    assert_eq!(found.header.device, "cpu");
    let header = checkpoint::Header { device: "gpu:0 (A card, vulkan)".to_owned(), ..found.header };
    checkpoint::write(&newest(), &header, &found.state).unwrap();
    fs::remove_file(place.path("out/summary.json")).unwrap();
    place
        .glebe(&resume)
        .expect(0)
        .says(&["written on gpu:0 (A card, vulkan) and is continued on cpu", "the bits differ"]);
    assert!(place.summary("out")["warnings"][0].as_str().unwrap().contains("written on gpu:0"));
}

#[test]
fn checkpoints_may_leave_out_what_contacts_remember_and_then_say_so() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let run = |out: &'static str, more: &[&'static str]| {
        [&["run", "scene.toml", "--no-cache", "--device", "cpu", "--out", out], &SLOW[..], more].concat()
    };
    place.glebe(&run("whole", &[])).expect(0);
    let small = ["--set", "output.checkpoint_history=false"];
    let child = place.command(&run("parts", &small)).spawn().unwrap();
    wait_for_rows(&place, "parts", 210);
    signal(&child, "-TERM");
    Ended::of(&child.wait_with_output().unwrap()).expect(130);

    let folder = place.path("parts/checkpoint");
    let newest = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).max().unwrap();
    let found = checkpoint::read(&newest).unwrap();
    let state = State::from_bytes(&found.state).unwrap();
    assert!(found.header.forgetful && state.contacts.is_empty() && state.surface_contacts.is_empty());
    assert!(!state.particles.id.is_empty());
    let again = run("parts", &["--set", "output.checkpoint_history=false", "--resume"]);
    place.glebe(&again).expect(0).says(&["leaves out what contacts remember", "resumed at"]);
    assert_ne!(place.hash("parts"), place.hash("whole"), "the contacts remembered nothing");

    // A run that is not stopped knows nothing of it, and is complete when it is.
    place.glebe(&run("quiet", &small)).expect(0);
    assert_eq!(place.hash("quiet"), place.hash("whole"));
    let again = run("quiet", &["--set", "output.checkpoint_history=false", "--resume"]);
    place.glebe(&again).expect(0).says(&["nothing was left to do"]);
}

#[test]
fn a_settled_bed_is_reused_without_changing_a_bit() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let run = |out: &str, more: &[&str]| {
        let args = [&["run", "scene.toml", "--out", out][..], more].concat();
        let ended = place.glebe(&args);
        ended.expect(0);
        let notes = place.summary(out)["notes"].to_string();
        assert_eq!(
            notes.contains("taken from an earlier run"),
            ended.stderr.contains("taken from an earlier run")
        );
        (place.hash(out), notes.contains("after `settle` was taken from an earlier run"))
    };
    let (first, reused) = run("first", &[]);
    assert!(!reused, "there was nothing to reuse");
    let (second, reused) = run("second", &[]);
    assert!(reused);
    assert_eq!(first, second);
    assert!(series(&place.path("second")).column("time").unwrap()[0] > 0.1, "the series begins at the bed");
    assert_eq!(place.summary("first")["stages"], place.summary("second")["stages"]);

    // Another tool, in another place of the list of surfaces, finds the same bed; other soil does not.
    let taller = ["--set", "geometry.block.box.max=[0, 0.03, 0.2]", "--set", "stage.push.duration=0.1"];
    let (with_bed, reused) = run("taller", &taller);
    assert!(reused);
    let (without, reused) = run("taller2", &[&taller[..], &["--no-cache"]].concat());
    assert!(!reused);
    assert_eq!(with_bed, without);
    assert_ne!(with_bed, first);
    let denser = ["--set", "material.soil.density=2100", "--set", "stage.push.duration=0.1"];
    let (_, reused) = run("denser", &denser);
    assert!(!reused);

    // A damaged bed is no bed.
    for entry in fs::read_dir(place.path("cache")).unwrap() {
        let path = entry.unwrap().path();
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    }
    let (again, reused) = run("again", &[]);
    assert!(!reused);
    assert_eq!(again, first);
}

#[test]
fn a_tool_more_in_the_list_finds_the_same_bed() {
    let place = Place::new();
    let second = "[geometry.aaa]\nbox = { min = [-0.02, -0.02, 0.02], max = [0, 0.02, 0.2] }\nmaterial = \"wall\"\n\
                  translate = [-0.3, 0, 0]\n\n[geometry.floor]";
    let more = SCENE.replace("[geometry.floor]", second).replace("[\"block\"]", "[\"aaa\", \"block\"]");
    place.write("one.toml", SCENE).write("two.toml", more);
    place.glebe(&["run", "one.toml", "--out", "one"]).expect(0);
    place.glebe(&["run", "two.toml", "--out", "two"]).expect(0).says(&["taken from an earlier run"]);
    place.glebe(&["run", "two.toml", "--out", "alone", "--no-cache"]).expect(0);
    assert_eq!(place.hash("two"), place.hash("alone"));
    assert_ne!(place.hash("two"), place.hash("one"), "the state holds the surfaces too");
}

/// A surface that is there already begins its next motion when the bed is settled, which the state tells.
#[test]
fn a_bed_under_a_surface_that_then_moves_is_another() {
    let place = Place::new();
    let still = SCENE.replace("[[stage]]\nname = \"trim\"\nremove = { above = 0.08 }\n", "");
    let moving = still.replace("move.block", "move.floor = { velocity = [0, 0, 0.01] }\nmove.block");
    place.write("still.toml", still).write("moving.toml", moving);
    let short = ["--set", "stage.settle.until.at_most=0.05", "--set", "stage.push.duration=0.02"];
    let run = |scene: &str, out: &str, more: &[&str]| {
        place.glebe(&[&["run", scene, "--out", out], &short[..], more].concat()).expect(0);
        place.hash(out)
    };
    run("moving.toml", "moving", &[]);
    assert_eq!(run("still.toml", "still", &[]), run("still.toml", "alone", &["--no-cache"]));
}

#[test]
fn threads_change_no_bit_and_force_replaces() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let short =
        ["--no-cache", "--set", "stage.settle.until.at_most=0.1", "--set", "stage.push.duration=0.05"];
    let run = |threads| [&["run", "scene.toml", "--threads", threads][..], &short].concat();
    place.glebe(&run("1")).expect(0);
    let one = place.hash("out");
    place.glebe(&run("3")).expect(2).says(&["--force"]);
    let json = place.glebe(&[&run("3")[..], &["--force", "--json"]].concat());
    assert_eq!(json.expect(0).json()["state_hash"], one.as_str());
    assert_eq!(json.json()["device"], "cpu (3 threads)");
    assert_eq!(json.stderr, "", "--json leaves standard error to the system");
}

#[test]
fn a_world_that_fails_says_why_and_keeps_its_results() {
    let place = Place::new();
    // Soft grains that land fast.
    let scene = SCENE.replacen("\"5 MPa\"", "\"20 kPa\"", 1);
    place.write("scene.toml", scene);
    let sets = ["--set", "particles.bed.velocity=[0,0,-3]", "--no-cache"];
    let ended = place.glebe(&[&["run", "scene.toml"], &sets[..]].concat());
    ended.expect(1).says(&["particle", "overlap", "raise youngs_modulus", "series, frames and checkpoints"]);
    let summary = place.summary("out");
    assert_eq!(summary["status"], "failed");
    assert!(summary["reason"].as_str().unwrap().contains("particle"));
    assert!(series(&place.path("out")).rows() >= 1, "at least the start");
    let json = place.glebe(&[&["run", "scene.toml", "--force", "--json"], &sets[..]].concat());
    assert_eq!(json.expect(1).json()["errors"][0]["code"], "failed");
}

/// A tool that a table moves inside a round vessel: the path is the table's, the vessel is shown, and both are told.
#[test]
fn a_table_moves_a_tool_in_a_round_vessel() {
    let place = Place::new();
    let scene = SCENE
        .replace("velocity = [0.5, 0, 0]", "poses = \"path.csv\"")
        .replace("duration = \"0.3 s\"", "duration = \"0.1 s\"")
        .replace("at_most = \"0.5 s\"", "at_most = \"0.05 s\"")
        .replace(
            "[[stage]]\nname = \"settle\"",
            "[geometry.vessel]\ncylinder = { radius = 0.13, length = 0.5, axis = \"z\" }\nmaterial = \"wall\"\n\
             translate = [0, 0, 0.2]\n\n[[stage]]\nname = \"settle\"",
        );
    place
        .write("scene.toml", scene)
        .write("path.csv", "time [ms],x [mm],y,z\n0,0,0,0\n50,30,0,0\n80,30,0,0.01\n");
    place.glebe(&["check", "scene.toml", "--device", "cpu"]).expect(0).says(&[
        "geometry `vessel`: cylinder of radius 0.13 m, open, from (0.0000, 0.0000, -0.0500) to (0.0000, 0.0000, 0.4500) m",
    ]);
    place.glebe(&["run", "scene.toml", "--no-cache", "--device", "cpu"]).expect(0);
    let rows = series(&place.path("out"));
    let path = rows.column("block.path").unwrap().last().copied().unwrap();
    assert!((path - 0.04).abs() < 1e-4, "the block went {path} m");
    let shown = fs::read(place.path("out/frames/000000_vessel.vtp")).unwrap();
    let head = String::from_utf8_lossy(&shown[..shown.len().min(2000)]).into_owned();
    // 44 rings of 72 pieces of two triangles each: pieces as long as wide.
    assert!(head.contains("NumberOfPolys=\"6336\""), "{head}");
}
