//! `glebe bench` on beds so small that they settle in a second.

#![allow(clippy::unwrap_used, reason = "a failed unwrap fails the test")]

use std::f64::consts::PI;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};
use tempfile::TempDir;

fn bench(cache: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glebe"))
        .arg("bench")
        .args(args)
        .env("GLEBE_CACHE", cache)
        .output()
        .unwrap()
}

/// The result of a run that must succeed.
fn measured(cache: &Path, args: &[&str]) -> Value {
    let run = bench(cache, &[args, &["--json"]].concat());
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    serde_json::from_slice(&run.stdout).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn a_tiny_bed_gives_rates_as_json_and_is_kept() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("bench.json");
    let args = ["--sizes", "300,600", "--beds", "mono,poly", "--flowing", "none", "--steps", "50"];
    let more = ["--repeat", "2", "--threads", "1", "--out", file.to_str().unwrap()];
    let result = measured(folder.path(), &[&args[..], &more].concat());
    assert_eq!(result["settings"]["threads"], 1);
    let beds = result["beds"].as_array().unwrap();
    assert_eq!(beds.len(), 4);
    for bed in beds {
        let rate = |key: &str| number(&bed["particle_steps_per_second"][key]);
        assert!(
            0.0 < rate("min") && rate("min") <= rate("median") && rate("median") <= rate("max"),
            "{bed:#}"
        );
        assert_eq!(bed["particle_steps_per_second"]["all"].as_array().unwrap().len(), 2);
        assert!(number(&bed["bytes_per_particle"]) > 0.0);
        // A bed, not a gas.
        assert!(number(&bed["coordination"]) > 3.0, "{bed:#}");
        let shares: f64 = bed["phases"].as_object().unwrap().values().map(number).sum();
        assert!(0.0 < shares && shares <= 1.0, "{bed:#}");
        assert_eq!(bed["bed_from_cache"], false);
        assert_eq!((&bed["mode"], &bed["rate_over_settled"]), (&json!("settled"), &Value::Null));
    }
    assert_eq!(serde_json::from_slice::<Value>(&std::fs::read(&file).unwrap()).unwrap(), result);
    assert!(result["cost_exponent"]["grid"]["settled"]["mono"].is_number());

    // Several worlds of a bed, the first as it was.
    let together =
        measured(folder.path(), &["--sizes", "300", "--beds", "mono", "--flowing", "none", "--worlds", "3"]);
    let bed = &together["beds"][0];
    assert_eq!((&bed["worlds"], &bed["lost"], &bed["bed_from_cache"]), (&json!(3), &json!(0), &json!(true)));
    assert!(number(&bed["particle_steps_per_second"]["median"]) > 0.0);

    // Every search in turn, with the same contacts.
    let searches = ["--beds", "mono", "--flowing", "none", "--search", "grid,bvh,all-pairs", "--repeat", "1"];
    let found = measured(folder.path(), &[&["--sizes", "300"][..], &searches].concat());
    let beds = found["beds"].as_array().unwrap();
    assert_eq!(beds.iter().map(|bed| &bed["search"]).collect::<Vec<_>>(), ["grid", "bvh", "all-pairs"]);
    for bed in beds {
        assert!(number(&bed["particle_steps_per_second"]["median"]) > 0.0);
        assert!((number(&bed["coordination"]) - number(&beds[0]["coordination"])).abs() < 0.05, "{bed:#}");
        assert_eq!(bed["time_per_contact_over_mono"], 1.0);
    }

    let settled = ["--sizes", "300", "--beds", "poly", "--flowing", "none", "--steps", "10"];
    let written = folder.path().join("written");
    std::fs::create_dir(&written).unwrap();
    let write = ["--write-beds", written.to_str().unwrap()];
    let again = measured(folder.path(), &[&settled[..], &write].concat());
    assert_eq!(again["beds"][0]["bed_from_cache"], true);
    let text = std::fs::read_to_string(written.join("poly-settled-300.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        text.lines().skip(1).map(|row| row.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 300);
    // In metres, on the floor or higher.
    assert!(rows.iter().all(|r| r.len() == 7 && r[2] > 0.9 * r[3] && (1.59e-3..2.41e-3).contains(&r[3])));
    let table = bench(folder.path(), &settled);
    let text = String::from_utf8_lossy(&table.stdout);
    assert!(text.contains("poly") && text.contains("million particle-steps/s"), "{text}");
}

#[test]
fn a_flowing_bed_stands_below_its_settled_one_and_rebuilds_its_lists() {
    let folder = TempDir::new().unwrap();
    let args = ["--sizes", "100", "--beds", "mono,poly", "--flowing", "poly", "--steps", "300"];
    let result = measured(folder.path(), &args);
    let beds = result["beds"].as_array().unwrap();
    let named: Vec<_> = beds.iter().map(|b| (b["bed"].as_str(), b["mode"].as_str())).collect();
    let (mono, poly) = (Some("mono"), Some("poly"));
    assert_eq!(named, [(mono, Some("settled")), (poly, Some("settled")), (poly, Some("flowing"))]);
    let [settled, flowing] = [&beds[1], &beds[2]];
    let rates = |bed: &Value| bed["particle_steps_per_second"]["all"].as_array().unwrap().clone();
    let turns = rates(flowing).into_iter().zip(rates(settled));
    let mut over: Vec<f64> = turns.map(|(flowing, settled)| number(&flowing) / number(&settled)).collect();
    over.sort_by(f64::total_cmp);
    assert_eq!(over.len(), 3);
    assert!((number(&flowing["rate_over_settled"]) - over[1]).abs() < 1e-9, "{over:?}");
    assert_eq!(flowing["lost"], 0);
    // What the flowing row is for.
    assert!(number(&flowing["steps_per_rebuild"]) <= 100.0, "{flowing:#}");
    assert_eq!(flowing["radii_m"], settled["radii_m"]);
    let drum = &flowing["drum"];
    let (radius, rate) = (number(&drum["radius_m"]), number(&drum["rate_rad_per_s"]));
    assert!((rate * rate * radius / 9.81 - 0.1).abs() < 1e-12, "{drum:#}");
    // The same spheres fill about half of it, if their solid fraction is 0.57.
    let solid = |r: f64| 4.0 / 3.0 * PI * r.powi(3);
    let spheres = 100.0 * (solid(2.4e-3) + solid(1.6e-3)) / 2.0;
    let filled = spheres / 0.57 / (PI * radius * radius * number(&drum["length_m"]));
    assert!((0.4..0.6).contains(&filled), "{filled}");

    let table = bench(folder.path(), &args);
    let text = String::from_utf8_lossy(&table.stdout);
    let row = text.lines().find(|l| l.contains("flowing")).unwrap();
    assert!(text.contains("of settled") && row.contains('%'), "{text}");
}

#[test]
fn beds_of_wide_gradings_tell_the_time_of_a_contact_beside_the_mono_beds() {
    let folder = TempDir::new().unwrap();
    let args = ["--sizes", "300", "--beds", "1:10,mono,1:3,1:20", "--flowing", "none", "--steps", "50"];
    let result = measured(folder.path(), &[&args[..], &["--repeat", "1"]].concat());
    let beds = result["beds"].as_array().unwrap();
    let time = |bed: &Value| number(&bed["ns_per_contact"]);
    let mono = &beds[1];
    let named = [("1:10", 10.0), ("mono", 1.0), ("1:3", 3.0), ("1:20", 20.0)];
    assert_eq!(beds.len(), named.len());
    for (bed, (name, ratio)) in beds.iter().zip(named) {
        assert_eq!(bed["bed"], name);
        let radii = &bed["radii_m"];
        assert!((number(&radii[1]) / number(&radii[0]) - ratio).abs() < 1e-12);
        assert!(time(bed) > 0.0 && number(&bed["coordination"]) > 3.0, "{bed:#}");
        let over = number(&bed["time_per_contact_over_mono"]);
        assert!((over - time(bed) / time(mono)).abs() < 1e-12, "{bed:#}");
    }
}

#[test]
fn tools_move_in_beds_of_their_own_and_the_first_step_is_timed() {
    let folder = TempDir::new().unwrap();
    let tools = ["sweep", "fine-sweep", "rotor"];
    let args = ["--sizes", "none", "--tools", "sweep,fine-sweep,rotor", "--tool-sizes", "300"];
    let more = ["--steps", "50", "--repeat", "1", "--device", "cpu"];
    let result = measured(folder.path(), &[&args[..], &more].concat());
    let beds = result["beds"].as_array().unwrap();
    let named: Vec<_> = beds.iter().map(|b| b["mode"].as_str().unwrap()).collect();
    assert_eq!(named, tools);
    for (bed, triangles) in beds.iter().zip([452, 16_432, 2892]) {
        assert_eq!(
            (&bed["tool"]["triangles"], &bed["particles"]),
            (&json!(triangles), &json!(300)),
            "{bed:#}"
        );
        assert_eq!(bed["lost"], 0, "{bed:#}");
        // Beds, be they stirred; and the first step is timed with what precedes it.
        assert!(number(&bed["coordination"]) > 0.5, "{bed:#}");
        assert!(number(&bed["first_step_s"]) > 0.0, "{bed:#}");
    }
    // The same soil, the same box, the same way.
    assert_eq!(beds[0]["step_s"], beds[1]["step_s"]);
    let wrong = bench(folder.path(), &["--tools", "spade"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("fine-sweep"));
}

#[test]
fn rates_are_told_beside_those_of_an_earlier_run_of_the_same() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (first, odd) = (path("first.json"), path("odd.json"));
    let args = |sizes, steps| {
        let args =
            ["--sizes", sizes, "--beds", "mono", "--flowing", "none", "--steps", steps, "--repeat", "2"];
        [&args[..], &["--threads", "1", "--device", "cpu"]].concat()
    };
    let before = measured(folder.path(), &[&args("300", "50")[..], &["--out", &first]].concat());
    let now = measured(folder.path(), &[&args("300,400", "50")[..], &["--compare", &first]].concat());
    let rate = |result: &Value, key: &str| number(&result["beds"][0]["particle_steps_per_second"][key]);
    let over = |key: &str| number(&now["beds"][0]["rate_over_earlier"][key]);
    assert!((over("median") - rate(&now, "median") / rate(&before, "median")).abs() < 1e-12);
    assert!((over("min") - rate(&now, "min") / rate(&before, "max")).abs() < 1e-12);
    assert!((over("max") - rate(&now, "max") / rate(&before, "min")).abs() < 1e-12);
    assert_eq!(now["beds"][1]["rate_over_earlier"], Value::Null);
    let table = bench(folder.path(), &[&args("300,400", "50")[..], &["--compare", &first]].concat());
    let text = String::from_utf8_lossy(&table.stdout);
    for part in [
        "rates over those in",
        "settled mono bed of 300 particles, grid: ",
        "of 400 particles, grid: not timed then",
    ] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }

    // What is not the same is refused before anything is timed.
    let mut material = before.clone();
    material["beds"][0]["material"]["youngs_modulus"] = json!(1e7);
    let spoils = [
        (before.to_string(), args("300", "60"), "steps is 60 now and 50 there"),
        (
            before.to_string(),
            args("400", "50"),
            "has none of the beds asked for; it has: settled mono bed of 300",
        ),
        (
            before.to_string(),
            [&args("300", "50")[..], &["--ledger"]].concat(),
            "energy_ledger is true now and false",
        ),
        (material.to_string(), args("300", "50"), "settled mono bed of 300 particles, grid: material is {"),
        ("rates".to_owned(), args("300", "50"), "is not what `glebe bench --out` writes"),
        ("{}".to_owned(), args("300", "50"), "it has no `settings`"),
    ];
    for (content, args, why) in spoils {
        std::fs::write(&odd, content).unwrap();
        let run = bench(folder.path(), &[&args[..], &["--compare", &odd]].concat());
        let told = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{told}");
        assert!(told.contains(why) && told.contains("odd.json") && !told.contains("timing"), "{told}");
    }
    let run = bench(folder.path(), &["--compare", &path("nowhere.json")]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("cannot be read"));
}

#[test]
fn periodic_samples_are_dense_and_run_together() {
    let folder = TempDir::new().unwrap();
    let args = ["--sizes", "none", "--samples", "150", "--steps", "50", "--repeat", "1", "--worlds", "3"];
    let result = measured(folder.path(), &args);
    let bed = &result["beds"][0];
    let as_asked = (&bed["bed"], &bed["mode"], &bed["particles"], &bed["worlds"], &bed["lost"]);
    assert_eq!(as_asked, (&json!("mono"), &json!("loaded"), &json!(150), &json!(3), &json!(0)));
    // Held at a pressure with friction: between the isostatic 4 of much friction and the 6 of none.
    assert!((4.0..6.5).contains(&number(&bed["coordination"])), "{bed:#}");
    assert!(number(&bed["particle_steps_per_second"]["median"]) > 0.0);
}

#[test]
fn beds_that_are_not_there_exit_with_2_and_a_list() {
    let folder = TempDir::new().unwrap();
    for option in ["--beds=1:4", "--flowing=slowly"] {
        let run = bench(folder.path(), &[option]);
        assert_eq!(run.status.code(), Some(2), "{option}");
        assert!(String::from_utf8_lossy(&run.stderr).contains("1:10"), "{option}");
    }
}

#[test]
fn sizes_that_make_no_sense_exit_with_2() {
    let folder = TempDir::new().unwrap();
    for size in ["ten", "-5", "10", "1e12M"] {
        let run = bench(folder.path(), &[&format!("--sizes={size}")]);
        assert_eq!(run.status.code(), Some(2), "{size}");
        assert!(String::from_utf8_lossy(&run.stderr).contains("10k"), "{size}");
    }
}
