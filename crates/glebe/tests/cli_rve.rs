//! Periodic samples: the same rows however they are run, interrupted or divided, and honest ends.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::collections::BTreeMap;
use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use cli_common::disk::on_disks_that_fill;
use cli_common::{Ended, Place, SAMPLE, signal};
use serde_json::Value;

/// Two void ratios with two seeds each.
const STUDY: &str = r#"title = "Triaxial tests"
scene = "scene.toml"
seeds = 2

[prepare]
pressure = "100 kPa"
inertial_number = 0.05
void_ratio = 0.6
tolerance = 0.02

[consolidate]
pressure = "100 kPa"
inertial_number = 0.05

[load]
program = "drained-triaxial"
strain = 0.05
inertial_number = 0.02
points = 50

[vary.void_ratio]
path = "prepare.void_ratio"
values = [0.54, 0.62]
"#;

fn place() -> Place {
    let place = Place::new();
    place.write("scene.toml", SAMPLE).write("study.toml", STUDY);
    place
}

fn bytes(place: &Place, name: &str) -> Vec<u8> {
    fs::read(place.path(name)).unwrap()
}

/// Rows of a table without quotes, by the names of its header.
fn table(place: &Place, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(place.path(name)).unwrap();
    let mut lines = text.lines();
    let split = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
    let header = split(lines.next().unwrap());
    lines.map(|line| header.iter().cloned().zip(split(line)).collect()).collect()
}

fn numbers(rows: &[BTreeMap<String, String>], column: &str) -> Vec<f64> {
    rows.iter().map(|row| row[column].parse().unwrap()).collect()
}

#[test]
fn samples_have_their_void_ratios_and_the_same_bits_in_a_batch_alone_and_after_a_kill() {
    let place = place();
    let run = ["rve", "study.toml", "--device", "cpu"];
    let summary = place.glebe(&[&run[..], &["--json"]].concat()).expect(0).json();
    assert_eq!((&summary["status"], &summary["counts"]["done"]), (&"done".into(), &4.into()));
    let rows = table(&place, "out/worlds.csv");
    for (e, target) in numbers(&rows, "prepared.void_ratio").iter().zip([0.54, 0.54, 0.62, 0.62]) {
        assert!((e - target).abs() <= 0.02, "{e} for {target}");
    }
    let frictions = numbers(&rows, "prepared.friction");
    assert!(frictions[0] < frictions[2] && frictions[1] < frictions[3], "{frictions:?}");
    assert_eq!(numbers(&rows, "seed"), [1.0, 2.0, 1.0, 2.0]);
    for p in numbers(&rows, "consolidated.p") {
        assert!((p / 100e3 - 1.0).abs() < 0.01, "{p}");
    }
    // Along the loading the stress across is held, so dq = 3 dp, and the axial strain ends where asked for.
    let curve = table(&place, "out/samples/000000.csv");
    let (p, q, strain) = (numbers(&curve, "p"), numbers(&curve, "q"), numbers(&curve, "strain"));
    assert!((strain.last().unwrap() - 0.05).abs() < 1e-3, "{strain:?}");
    let end = |column: &[f64]| column[column.len() - 10..].iter().sum::<f64>() / 10.0;
    assert!((end(&q) / (end(&p) - 100e3) - 3.0).abs() < 0.4, "{} {}", end(&q), end(&p));
    let all = table(&place, "out/curves.csv");
    assert_eq!(all.iter().filter(|row| row["world"] == "0").count(), curve.len());
    let bands = table(&place, "out/bands.csv");
    assert!(numbers(&bands, "q.std").iter().any(|std| *std > 0.0) && bands[0]["samples"] == "2");
    assert_eq!(table(&place, "out/homogenisation.csv").len(), 2);
    for plot in ["q_over_strain", "volumetric_strain", "void_ratio_over_strain", "q_over_p", "rose_001"] {
        assert!(
            fs::read_to_string(place.path(&format!("out/{plot}.svg"))).unwrap().contains("</svg>"),
            "{plot}"
        );
    }
    assert!(!place.path("out/checkpoint").exists(), "nothing is left to resume");

    // A sample alone: one variant, one seed.
    let one = ["--out", "alone", "--set", "seeds=1", "--set", "vary.void_ratio.values=[0.62]"];
    place.glebe(&[&run[..], &one].concat()).expect(0);
    let alone = table(&place, "alone/worlds.csv");
    assert_eq!(alone[0]["state_hash"], rows[2]["state_hash"]);
    assert_eq!(bytes(&place, "alone/samples/000000.csv"), bytes(&place, "out/samples/000002.csv"));

    // Killed while samples are loaded, then continued in batches on one thread.
    let parts = [&run[..], &["--out", "parts", "--checkpoint-every", "0"]].concat();
    let child = place.command(&parts).spawn().unwrap();
    let started = Instant::now();
    let journal = || fs::read_to_string(place.path("parts/journal.jsonl")).unwrap_or_default();
    while !journal().contains("Consolidated") {
        assert!(started.elapsed() < Duration::from_secs(60), "not after a minute");
        sleep(Duration::from_millis(2));
    }
    // Until then nobody else gets into its folder.
    signal(&child, "-STOP");
    for args in [&parts[..], &[&parts[..], &["--resume"]].concat(), &[&parts[..], &["--force"]].concat()] {
        place.glebe(args).expect(2).says(&["another run is writing", "--out"]);
    }
    signal(&child, "-KILL");
    Ended::of(&child.wait_with_output().unwrap()).expect(-1);
    let tried = journal().matches("Tried").count();
    place.glebe(&[&parts[..], &["--resume", "--batches", "2", "--threads", "1"]].concat()).expect(0);
    assert_eq!(journal().matches("Tried").count(), tried, "no preparation is done again");
    for name in ["worlds.csv", "curves.csv", "bands.csv", "homogenisation.csv"] {
        assert_eq!(bytes(&place, &format!("parts/{name}")), bytes(&place, &format!("out/{name}")), "{name}");
    }
}

/// Killed while the states of samples or the results are written, and at times by chance; and on disks that fill.
#[test]
fn a_study_of_samples_that_is_killed_again_and_again_or_lacks_room_ends_with_the_same_bytes() {
    let place = place();
    let sets = ["seeds=1", "load.strain=0.01", "load.points=10"].map(|set| ["--set", set]).concat();
    let rve = |out: &'static str, more: &[&'static str]| {
        [&["rve", "study.toml", "--device", "cpu", "--out", out], &sets[..], more].concat()
    };
    place.glebe(&rve("whole", &[])).expect(0);
    let same = |out: &str| {
        for name in ["worlds.csv", "curves.csv", "homogenisation.csv", "samples/000001.csv"] {
            assert!(
                bytes(&place, &format!("{out}/{name}")) == bytes(&place, &format!("whole/{name}")),
                "{out}/{name}"
            );
        }
        assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
    };
    let every = ["--resume", "--checkpoint-every", "0"];
    fs::create_dir(place.path("killed")).unwrap();
    let torn = place.killed_again_and_again(&rve("killed", &every), &["killed/checkpoint"], 8);
    assert!(torn[0] > 0, "no state was being written");
    same("killed");
    if on_disks_that_fill(&place, &rve("disk/out", &every), &[8, 24, 65536]) {
        same("kept/out");
    }
}

#[test]
fn a_void_ratio_out_of_reach_is_told_with_the_range_and_the_rest_are_done() {
    let place = place();
    let values = "vary.void_ratio.values=[0.3, 0.62]";
    let quick = ["--set", "seeds=1", "--set", "load.strain=0.005", "--set", values];
    let run = place.glebe(&[&["rve", "study.toml"], &quick[..]].concat());
    run.expect(0).says(&["a void ratio of 0.3 is out of reach at 100000 Pa: a friction of 0 gives 0."]);
    assert!(run.stdout.contains("1 of 2 samples done, 1 failed"), "{}", run.stdout);
    let text = fs::read_to_string(place.path("out/worlds.csv")).unwrap();
    assert!(text.contains(",failed,") && text.contains("out of reach"), "{text}");
}

#[test]
fn every_program_runs_and_its_stress_and_strain_are_those_asked_for() {
    let place = place();
    let study = STUDY.split("[vary").next().unwrap().replace("seeds = 2", "seeds = 1");
    let study = study.replace("void_ratio = 0.6\ntolerance = 0.02\n", "friction = 0.3\n");
    // One sample of each program, all in one batch.
    let varied =
        "[vary.program]\npath = \"load.program\"\nvalues = [\"undrained-triaxial\", \"simple-shear\"]\n";
    place.write("study.toml", format!("{study}{varied}"));
    place.glebe(&["rve", "study.toml", "--set", "load.cycles=1", "--set", "load.strain=0.02"]).expect(0);
    let undrained = table(&place, "out/samples/000000.csv");
    let e = numbers(&undrained, "void_ratio");
    let loaded: Vec<usize> = (0..e.len()).filter(|k| undrained[*k]["stage"] != "0").collect();
    for k in &loaded {
        assert!((e[*k] - e[loaded[0]]).abs() < 1e-4, "the volume stays: {e:?}");
    }
    let strain = numbers(&undrained, "strain");
    let most = strain.iter().copied().fold(f64::MIN, f64::max);
    let least = strain[loaded[0]..].iter().copied().fold(f64::MAX, f64::min);
    assert!((most - 0.02).abs() < 1e-3 && (least + 0.02).abs() < 1e-3, "{least} {most}");
    assert!(strain.last().unwrap().abs() < 1e-3, "a cycle ends where it began");
    let sheared = table(&place, "out/samples/000001.csv");
    let gamma = numbers(&sheared, "eps_xz").iter().copied().fold(f64::MIN, f64::max);
    assert!((2.0 * gamma - 0.02).abs() < 1e-3, "{gamma}");
    assert!(numbers(&sheared, "eps_xx").last().unwrap().abs() < 1e-12);

    let steps = ["--set", "load.program=isotropic-compression", "--set", "load.points=2"];
    let isotropic = study.replace("strain = 0.05\n", "pressure = \"400 kPa\"\n");
    place.write("study.toml", isotropic);
    place.glebe(&[&["rve", "study.toml", "--force"], &steps[..]].concat()).expect(0);
    let curve = table(&place, "out/samples/000000.csv");
    for (p, expected) in numbers(&curve, "p").iter().zip([100e3, 200e3, 400e3]) {
        assert!((p / expected - 1.0).abs() < 0.01, "{p} for {expected}");
    }
    let e = numbers(&curve, "void_ratio");
    assert!(e[0] > e[1] && e[1] > e[2], "{e:?}");

    place.write("study.toml", study.replace("strain = 0.05\n", ""));
    place.glebe(&["rve", "study.toml", "--force", "--set", "load.program=scene"]).expect(0);
    let own = table(&place, "out/samples/000000.csv");
    assert_eq!(own.last().unwrap()["stage"], "1", "the stage of the scene");
}

#[test]
fn a_study_of_samples_is_refused_before_anything_is_written() {
    let place = place();
    let says = |sets: &[&str], words: &[&str]| {
        let mut args = vec!["rve", "study.toml"];
        for set in sets {
            args.extend(["--set", set]);
        }
        place.glebe(&args).expect(2).says(words);
    };
    says(&["load.program=triaxal"], &["triaxal", "drained-triaxial"]);
    says(&["load.program=isotropic-compression"], &["needs `pressure`"]);
    says(&["prepare.friction=0.3"], &["exclude each other"]);
    says(&["vary.void_ratio.path=prepare.void_rato"], &["did you mean `void_ratio`?"]);
    says(&["vary.void_ratio.values=[-1]"], &["more than 0"]);
    place.write("seeds.toml", STUDY.replace("vary.void_ratio", "vary.seed"));
    place.glebe(&["rve", "seeds.toml"]).expect(2).says(&["`seed` cannot be the name of a parameter"]);
    place.write(
        "walls.toml",
        SAMPLE
            .replace("z = \"periodic\"", "z = \"wall\"")
            .replace("[domain]", "[domain]\nmaterial = \"steel\""),
    );
    says(&["scene=walls.toml"], &["periodic"]);
    let fixed = SAMPLE.replace("fill = \"dense\"", "fill = \"dense\"\nseed = 3");
    place.write("fixed.toml", fixed);
    says(&["scene=fixed.toml"], &["the same sample again"]);
    place.glebe(&["sweep", "study.toml"]).expect(2).says(&["glebe rve"]);
    let sweep = "scene = \"scene.toml\"\n[vary.seed]\npath = \"seed\"\nvalues = [1, 2]\n";
    place.write("sweep.toml", sweep);
    place.glebe(&["rve", "sweep.toml"]).expect(2).says(&["no study of periodic samples", "[consolidate]"]);
    place.write("bare.toml", "scene = \"scene.toml\"\n");
    place.glebe(&["sweep", "bare.toml"]).expect(2).says(&["nothing varies"]);
    place.write("half.toml", format!("{sweep}[load]\nprogram = \"scene\"\n"));
    place.glebe(&["rve", "half.toml"]).expect(2).says(&["needs `consolidate`"]);
    assert!(!place.path("out").exists());
}

#[test]
fn check_schema_and_new_know_studies_of_samples() {
    let place = place();
    let found = place.glebe(&["check", "study.toml", "--json"]).expect(0).json();
    assert_eq!(
        (&found["variants"], &found["prepared"], &found["refused"]),
        (&2.into(), &4.into(), &0.into())
    );
    let schema: Value = place.glebe(&["schema", "study"]).expect(0).json();
    for part in ["prepare", "consolidate", "load"] {
        assert!(schema["properties"][part].is_object(), "{part}");
    }
    for (name, size) in [("sand", "--quick"), ("full", "--json")] {
        place.glebe(&["new", name, "--template", "rve", size]).expect(0);
        let study = format!("{name}/study.toml");
        let found = place.glebe(&["check", &study, "--json"]).expect(0).json();
        assert_eq!((&found["refused"], &found["warnings"]), (&0.into(), &serde_json::json!([])), "{name}");
    }
}
