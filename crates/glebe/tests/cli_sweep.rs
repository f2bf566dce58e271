//! Sweeps: the same rows however they are run, interrupted or divided, and the same worlds as single runs.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use cli_common::disk::on_disks_that_fill;
use cli_common::{Ended, Place, SCENE, signal};
use serde_json::Value;

/// Four worlds with two settled beds, which end at different times.
const STUDY: &str = r#"title = "Draught over density and speed"
scene = "scene.toml"

[vary.density]
path = "material.soil.density"
values = ["2 t/m^3", 2200]

[vary.speed]
path = "stage.push.move.block.velocity.0"
range = [0.3, 0.45]
count = 2
"#;

/// The scene in a shorter form.
fn place() -> Place {
    let place = Place::new();
    let scene = SCENE.replace("duration = \"0.3 s\"", "duration = \"0.24 s\"");
    place.write("scene.toml", scene).write("study.toml", STUDY);
    place
}

/// Rows of `worlds.csv`, by the names of its header.
fn cells(place: &Place, out: &str) -> Vec<std::collections::BTreeMap<String, String>> {
    let text = fs::read_to_string(place.path(out).join("worlds.csv")).unwrap();
    let split = |line: &str| -> Vec<String> {
        // Only reasons hold commas, and those stand in quotes.
        let parts = line.split('"').enumerate();
        let cells: String = parts
            .map(|(k, part)| if k % 2 == 0 { part.replace(',', "\n") } else { part.to_owned() })
            .collect();
        cells.split('\n').map(str::to_owned).collect()
    };
    let mut lines = text.lines();
    let header = split(lines.next().unwrap());
    lines.map(|line| header.iter().cloned().zip(split(line)).collect()).collect()
}

fn bytes(place: &Place, name: &str) -> Vec<u8> {
    fs::read(place.path(name)).unwrap()
}

fn ended(place: &Place, out: &str) -> usize {
    let journal = fs::read_to_string(place.path(out).join("journal.jsonl"));
    journal.map_or(0, |text| text.lines().count().saturating_sub(1))
}

fn wait_until(what: impl Fn() -> bool) {
    let started = Instant::now();
    while !what() {
        assert!(started.elapsed() < Duration::from_secs(60), "not after a minute");
        sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_sweep_that_was_killed_before_its_journal_begins_again() {
    let place = Place::new();
    let short = SCENE.replace("\"0.5 s\"", "0.01").replace("\"0.3 s\"", "0.01");
    let study = "scene = \"scene.toml\"\n[vary.seed]\npath = \"seed\"\nvalues = [1, 2]\n";
    place.write("scene.toml", short).write("study.toml", study);
    fs::create_dir_all(place.path("out/checkpoint")).unwrap();
    place.write("out/study.toml", "# copied by glebe\n").write("out/.glebe-partial-7-0", "half");
    let sweep = ["sweep", "study.toml", "--no-cache", "--device", "cpu"];
    place.glebe(&[&sweep[..], &["--resume"]].concat()).expect(0).says(&["begins again"]);
    place.glebe(&[&sweep[..], &["--out", "whole"]].concat()).expect(0);
    for name in ["worlds.csv", "study.toml"] {
        assert_eq!(bytes(&place, &format!("out/{name}")), bytes(&place, &format!("whole/{name}")), "{name}");
    }
    assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
}

#[test]
fn worlds_of_a_sweep_are_those_of_single_runs() {
    let place = place();
    let sweep = place.glebe(&["sweep", "study.toml", "--no-cache", "--json"]);
    let summary = sweep.expect(0).json();
    assert_eq!(summary["status"], "done");
    assert_eq!(summary["counts"]["done"], 4);
    let worlds = summary["worlds"].as_array().unwrap();
    for (w, world) in worlds.iter().enumerate() {
        let mut args = vec!["run", "scene.toml", "--no-cache", "--force"];
        let sets: Vec<&str> = world["set"].as_array().unwrap().iter().map(|s| s.as_str().unwrap()).collect();
        for set in &sets {
            args.extend(["--set", set]);
        }
        let out = format!("alone{w}");
        args.extend(["--out", &out]);
        place.glebe(&args).expect(0);
        let alone = place.summary(&out);
        assert_eq!(alone["state_hash"], world["state_hash"], "{sets:?}");
        assert_eq!(alone["stages"], world["stages"], "{sets:?}");
    }
    assert_eq!(worlds[3]["set"][0], "material.soil.density=2200.0");
    assert_eq!(worlds[3]["set"][1], "stage.push.move.block.velocity.0=0.45");

    // Divided, on one thread, with beds that are kept: not a byte differs.
    place.glebe(&["sweep", "study.toml", "--out", "two", "--batches", "2", "--threads", "1"]).expect(0);
    let cached = place.glebe(&["sweep", "study.toml", "--out", "three", "--batches", "3"]);
    cached.expect(0).says(&["settled beds of earlier runs", "4 worlds in 2 batches"]);
    assert_eq!(bytes(&place, "out/worlds.csv"), bytes(&place, "two/worlds.csv"));
    assert_eq!(bytes(&place, "out/worlds.csv"), bytes(&place, "three/worlds.csv"));
    for plot in ["push_draught-force_over_density.svg", "push_draught-force_over_speed.svg"] {
        assert_eq!(bytes(&place, &format!("out/{plot}")), bytes(&place, &format!("two/{plot}")));
        assert!(String::from_utf8(bytes(&place, &format!("out/{plot}"))).unwrap().contains("R²"));
    }

    let rows = cells(&place, "out");
    let column = |name: &str| rows.iter().map(|row| row[name].clone()).collect::<Vec<_>>();
    assert_eq!(column("density"), ["2000", "2000", "2200", "2200"]);
    assert_eq!(column("speed"), ["0.3", "0.45", "0.3", "0.45"]);
    assert_eq!(column("status"), ["done"; 4]);
    let measured = &worlds[1]["stages"][2]["measures"]["draught_force"];
    for part in ["mean", "std", "n"] {
        let cell: f64 = rows[1][&format!("push.draught_force.{part}")].parse().unwrap();
        assert_eq!(cell, measured[part].as_f64().unwrap());
    }
    assert_eq!(fs::read_to_string(place.path("out/study.toml")).unwrap().split_once('\n').unwrap().1, STUDY);
}

/// Worlds that share their first stages settle once, and end as if each had settled by itself.
#[test]
fn a_bed_is_settled_once_for_all_worlds_that_share_it() {
    let place = place();
    let one = ["--set", "vary.density.values=[2000]"];
    let shared = place.glebe(&[&["sweep", "study.toml", "--no-cache"], &one[..]].concat());
    shared.expect(0).says(&["1 of 2 worlds began from the settled bed of another"]);
    let apart = ["sweep", "study.toml", "--no-cache", "--out", "apart", "--batches", "2"];
    place.glebe(&[&apart[..], &one[..]].concat()).expect(0);
    assert_eq!(bytes(&place, "out/worlds.csv"), bytes(&place, "apart/worlds.csv"));
    let copy = fs::read_to_string(place.path("out/study.toml")).unwrap();
    assert!(copy.contains("# --set vary.density.values=[2000]"), "{copy}");
}

#[test]
fn a_sweep_that_is_interrupted_or_killed_ends_with_the_same_bytes() {
    let place = place();
    place.glebe(&["sweep", "study.toml", "--no-cache", "--out", "whole"]).expect(0);
    let parts = ["sweep", "study.toml", "--no-cache", "--out", "parts"];
    let resume = [&parts[..], &["--resume"]].concat();
    // Killed after the first of two batches, with a line that was not finished.
    let child = place.command(&[&parts[..], &["--batches", "2"]].concat()).spawn().unwrap();
    wait_until(|| ended(&place, "parts") >= 2);
    // Until then nobody else gets into its folder.
    signal(&child, "-STOP");
    for args in [&parts[..], &resume, &[&parts[..], &["--force"]].concat()] {
        place.glebe(args).expect(2).says(&["another run is writing", "--out"]);
    }
    signal(&child, "-KILL");
    Ended::of(&child.wait_with_output().unwrap()).expect(-1);
    let journal = place.path("parts/journal.jsonl");
    let mut text = fs::read_to_string(&journal).unwrap();
    text.push_str("{\"world\":3,\"sta");
    fs::write(&journal, text).unwrap();

    // Interrupted with worlds under way, which leave their states.
    let child = place.command(&[&resume[..], &["--checkpoint-every", "0"]].concat()).spawn().unwrap();
    let saved = || fs::read_dir(place.path("parts/checkpoint")).map_or(0, Iterator::count);
    wait_until(|| saved() > 0 || ended(&place, "parts") == 4);
    signal(&child, "-INT");
    let stopped = Ended::of(&child.wait_with_output().unwrap());
    if ended(&place, "parts") < 4 {
        stopped.expect(130).says(&["To go on: glebe sweep study.toml --out parts --resume"]);
        let statuses: Vec<String> =
            cells(&place, "parts").into_iter().map(|row| row["status"].clone()).collect();
        assert!(statuses.contains(&"interrupted".to_owned()), "{statuses:?}");
        assert!(saved() > 0);
    }
    let other = [&resume[..], &["--set", "vary.speed.count=3"]].concat();
    place.glebe(&other).expect(2).says(&["belong to another study"]);
    place.glebe(&resume).expect(0).says(&["of 4 worlds have ended already"]);
    assert_eq!(bytes(&place, "parts/worlds.csv"), bytes(&place, "whole/worlds.csv"));
    assert!(!place.path("parts/checkpoint").exists(), "nothing is left to resume");
    let worlds = |out: &str| place.summary(out)["worlds"].clone();
    assert_eq!(worlds("parts"), worlds("whole"));
    // Once done there is nothing to do, and nothing is spoilt.
    place.glebe(&resume).expect(0);
    assert_eq!(bytes(&place, "parts/worlds.csv"), bytes(&place, "whole/worlds.csv"));
}

/// Killed while the states of worlds or the results are written, and at times by chance; and on disks that fill.
#[test]
fn a_sweep_that_is_killed_again_and_again_or_lacks_room_ends_with_the_same_bytes() {
    let place = place();
    let scene = fs::read_to_string(place.path("scene.toml")).unwrap();
    place.write("scene.toml", scene.replace("\"0.24 s\"", "\"0.08 s\"").replace("\"0.5 s\"", "\"0.05 s\""));
    let sweep = |out: &'static str, more: &[&'static str]| {
        [&["sweep", "study.toml", "--no-cache", "--device", "cpu", "--out", out], more].concat()
    };
    place.glebe(&sweep("whole", &[])).expect(0);
    let same = |out: &str| {
        assert_eq!(bytes(&place, &format!("{out}/worlds.csv")), bytes(&place, "whole/worlds.csv"), "{out}");
        assert_eq!(place.summary(out)["worlds"], place.summary("whole")["worlds"], "{out}");
        assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
    };
    let every = ["--resume", "--checkpoint-every", "0"];
    fs::create_dir(place.path("killed")).unwrap();
    let torn = place.killed_again_and_again(&sweep("killed", &every), &["killed/checkpoint"], 10);
    assert!(torn[0] > 0, "no state was being written");
    same("killed");
    if on_disks_that_fill(&place, &sweep("disk/out", &every), &[8, 40, 60, 65536]) {
        same("kept/out");
    }
}

#[test]
fn a_world_that_goes_wrong_is_a_row_and_the_rest_finish() {
    let place = place();
    // The first is refused, the second is too soft for its fall, the third is fine.
    let study = "scene = \"scene.toml\"\nsampler = \"list\"\n\
                 [vary.friction]\npath = \"material.soil.friction\"\nvalues = [0.7, 0.5, 0.5]\n\
                 [vary.stiffness]\npath = \"material.soil.youngs_modulus\"\nvalues = [\"5 MPa\", \"5 kPa\", \"5 MPa\"]\n";
    place.write("study.toml", study);
    let sweep = place.glebe(&["sweep", "study.toml", "--no-cache"]);
    sweep
        .expect(0)
        .says(&["world 0 is refused: static friction 0.6 is below sliding friction 0.7", "world 1: at t ="]);
    assert!(sweep.stdout.contains("1 of 3 worlds done, 1 failed, 1 refused"), "{}", sweep.stdout);
    let rows = cells(&place, "out");
    let status: Vec<&str> = rows.iter().map(|row| row["status"].as_str()).collect();
    assert_eq!(status, ["refused", "failed", "done"]);
    assert!(rows[0]["reason"].contains("give `static_friction` 0.7 or more"), "{:?}", rows[0]);
    assert!(rows[1]["reason"].contains("overlap") && rows[1]["push.draught_force.n"] == "0", "{:?}", rows[1]);
    assert!(rows[2]["push.draught_force.mean"].parse::<f64>().unwrap() > 0.0);
    place.glebe(&["run", "scene.toml", "--no-cache", "--out", "alone"]).expect(0);
    assert_eq!(rows[2]["state_hash"], place.hash("alone"));

    let alone = ["sweep", "study.toml", "--no-cache", "--out", "none", "--set"];
    let soft = "vary.stiffness.values=[\"5 kPa\"]";
    // Whoever waits for a bed that fails finds out by itself.
    let twice = "vary.stiffness.values=[\"5 kPa\", \"5 kPa\"]";
    let none = [&alone[..], &[twice, "--set", "vary.friction.values=[0.5, 0.5]"]].concat();
    place.glebe(&none).expect(1).says(&["no world is done"]);
    let failed = cells(&place, "none");
    assert_eq!(failed[0]["status"], "failed");
    assert_eq!(
        (&failed[0]["reason"], &failed[0]["state_hash"]),
        (&failed[1]["reason"], &failed[1]["state_hash"])
    );
    let refused = [&alone[..], &[soft, "--set", "vary.friction.values=[0.7]", "--force"]].concat();
    place.glebe(&refused).expect(2).says(&["every world is refused", "friction"]);
    assert_eq!(place.summary("none")["status"], "failed", "nothing was written");
}

#[test]
fn a_study_is_refused_before_anything_is_written() {
    let place = place();
    place.write("bad.toml", STUDY.replace("soil.density", "soil.densty"));
    let bad = place.glebe(&["sweep", "bad.toml"]);
    bad.expect(2).says(&["bad.toml:5:23", "did you mean `density`?", "1 error; nothing was run"]);
    let json = place.glebe(&["sweep", "bad.toml", "--json"]).expect(2).json();
    assert_eq!((&json["errors"][0]["code"], &json["errors"][0]["line"]), (&"set".into(), &5.into()));
    place.glebe(&["sweep", "none.toml"]).expect(2).says(&["cannot read", "--template sweep"]);
    place
        .glebe(&["sweep", "study.toml", "--set", "vary.sped.count=3"])
        .expect(2)
        .says(&["did you mean `speed`?"]);
    place.glebe(&["sweep", "study.toml", "--resume"]).expect(2).says(&["no run to resume"]);
    assert!(!place.path("out").exists());
    // Somebody else's files stay, with --force too.
    place.glebe(&["sweep", "study.toml", "--out", "."]).expect(2).says(&["not empty"]);
    place
        .glebe(&["sweep", "study.toml", "--out", ".", "--force"])
        .expect(2)
        .says(&["is not a file that glebe made"]);
    assert_eq!(fs::read_to_string(place.path("study.toml")).unwrap(), STUDY);
}

#[test]
fn check_and_schema_know_studies() {
    let place = place();
    let found = place.glebe(&["check", "study.toml", "--json"]).expect(0).json();
    assert_eq!((found["worlds"].as_array().unwrap().len(), &found["refused"]), (4, &0.into()));
    assert_eq!((&found["particles"], &found["measures"][0]), (&1000.into(), &"push.draught_force".into()));
    let fewer = place.glebe(&["check", "study.toml", "--set", "vary.density.values=[-1, 2000]"]);
    assert!(fewer.expect(0).stdout.contains("4, 2 refused"), "{}", fewer.stdout);
    fewer.says(&["world 0 is refused", "more than 0"]);
    place.glebe(&["check", "study.toml", "--set", "sampler=sobol"]).expect(2).says(&["needs `points`"]);
    let schema: Value = place.glebe(&["schema", "study"]).expect(0).json();
    assert!(schema["properties"]["vary"].is_object());
}

#[test]
fn new_makes_a_study_that_checks() {
    let place = Place::new();
    let made = place.glebe(&["new", "field", "--template", "sweep", "--quick"]);
    assert!(made.expect(0).stdout.contains("glebe sweep field/study.toml"), "{}", made.stdout);
    let found = place.glebe(&["check", "field/study.toml", "--json"]).expect(0).json();
    assert_eq!((&found["refused"], &found["warnings"]), (&0.into(), &serde_json::json!([])));
    place.glebe(&["new", "full", "--template", "sweep"]).expect(0);
    let full = place.glebe(&["check", "full/study.toml", "--json"]).expect(0).json();
    assert!(full["worlds"].as_array().unwrap().len() > found["worlds"].as_array().unwrap().len());
}
