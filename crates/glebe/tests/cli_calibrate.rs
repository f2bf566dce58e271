//! Calibrations: parameters of a synthetic truth are found again, those that cannot be are told, and a calibration that is
//! interrupted, killed or divided ends with the same bytes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use cli_common::disk::on_disks_that_fill;
use cli_common::{Ended, Place, ball_with, signal};
use serde_json::Value;

/// A ball falls on a floor without gravity: the mean force is (1 + e) m v over the time, the standard deviation tells
/// how long the impact lasts, and so the stiffness.
const IMPACT: &str = r#"[[stage]]
name = "bounce"
duration = "6 ms"
measure.force = { of = "floor.fz" }

[output]
series = "1 ms"
"#;

const TRUTH: [(&str, f64); 2] = [("restitution", 0.6), ("stiffness", 5e6)];

/// The truth's own measures as targets, and its parameters free.
fn place() -> (Place, [f64; 2]) {
    let place = Place::new();
    place.write("scene.toml", ball_with(IMPACT));
    let truth =
        place.glebe(&["run", "scene.toml", "--out", "truth", "--json", "--no-cache"]).expect(0).json();
    let force = &truth["stages"][0]["measures"]["force"];
    let [mean, std] = ["mean", "std"].map(|part| force[part].as_f64().unwrap());
    let study = format!(
        r#"title = "A ball"
scene = "scene.toml"

[free.restitution]
path = "material.ball.restitution"
bounds = [0.1, 0.95]

[free.stiffness]
path = "material.ball.youngs_modulus"
bounds = ["1 MPa", "50 MPa"]
scale = "logarithmic"

[target.mean]
measure = "bounce.force"
value = {mean}
scatter = 0.01

[target.deviation]
measure = "bounce.force"
statistic = "std"
value = {std}
scatter = 0.02
"#
    );
    place.write("study.toml", study);
    (place, [mean, std])
}

fn bytes(place: &Place, name: &str) -> Vec<u8> {
    fs::read(place.path(name)).unwrap()
}

fn calibrate<'a>(out: &'a str, sets: &[&'a str]) -> Vec<&'a str> {
    let mut args = vec!["calibrate", "study.toml", "--no-cache", "--device", "cpu", "--out", out];
    args.extend(sets.iter().flat_map(|set| ["--set", set]));
    args
}

fn of<'a>(summary: &'a Value, name: &str) -> &'a Value {
    let parameters = summary["parameters"].as_array().unwrap();
    parameters.iter().find(|p| p["name"] == name).unwrap()
}

/// Each method finds the parameters of a drop within 2 %, and the best scene is that of the best evaluation.
#[test]
fn the_parameters_of_a_drop_test_are_found_by_every_method() {
    let (place, [mean, _]) = place();
    let methods = [
        ("evolution", "method.differential-evolution={ population = 10, adaptive = true }", "stop.rounds=30"),
        ("cma", "method.cma-es={}", "stop.cost=0.2"),
        ("filter", "method.bayesian-filter={ samples = 64 }", "stop.rounds=7"),
    ];
    for (out, method, stop) in methods {
        let found = place.glebe(&[&calibrate(out, &[method, stop])[..], &["--json"]].concat());
        let summary = found.expect(0).json();
        assert_eq!(summary["status"], "done");
        for (name, truth) in TRUTH {
            let p = of(&summary, name);
            let estimate = if out == "filter" { &p["posterior"]["median"] } else { &p["best"] };
            let ratio = estimate.as_f64().unwrap() / truth;
            assert!((ratio - 1.0).abs() < 0.02, "{out}: {name} is {ratio} of the truth");
            assert_eq!(p["known"]["determined"], true, "{out}: {name}");
            if out == "filter" {
                let interval: Vec<f64> = p["posterior"]["credible_95"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|x| x.as_f64().unwrap())
                    .collect();
                assert!(interval[0] < truth && truth < interval[1], "{interval:?}");
            }
        }
        assert!(summary["warnings"].as_array().unwrap().is_empty(), "{}", summary["warnings"]);
        assert!(place.path(out).join("convergence.svg").exists());
    }
    assert_eq!(place.summary("cma")["ended_by"], "cost");
    assert!(place.path("filter/posterior_restitution_stiffness.svg").exists());
    // The best scene runs, and gives what its evaluation gave, to the bit.
    place.glebe(&["run", "cma/best.toml", "--out", "again", "--no-cache"]).expect(0);
    let summary = place.summary("cma");
    let again = place.summary("again");
    assert_eq!(again["stages"][0]["measures"]["force"]["mean"], summary["best"][0]["targets"]["mean"]);
    assert!((summary["targets"][0]["best"].as_f64().unwrap() / mean - 1.0).abs() < 0.01);
    let table = fs::read_to_string(place.path("cma/evaluations.csv")).unwrap();
    let header = "evaluation,round,restitution,stiffness,mean,deviation,cost,status,reason,state_hash";
    assert_eq!(table.lines().next().unwrap(), header);
    assert!(table.contains(&place.hash("again")));
}

/// With one target, what the restitution takes away a larger density brings back; friction does nothing at all.
#[test]
fn parameters_that_a_target_cannot_tell_apart_are_told() {
    let (place, _) = place();
    let study = fs::read_to_string(place.path("study.toml")).unwrap();
    let study = study.split("[free.stiffness]").next().unwrap().to_owned()
        + "[free.density]\npath = \"material.ball.density\"\nbounds = [2000, 3000]\n\
           [free.friction]\npath = \"material.ball.friction\"\nbounds = [0.1, 0.9]\n\
           [target.mean]"
        + study.split("[target.mean]").nth(1).unwrap().split("[target.deviation]").next().unwrap();
    place.write("study.toml", study);
    let sets = ["method.cma-es.population=10", "stop.cost=0.1", "stop.rounds=60"];
    let found = place.glebe(&calibrate("out", &sets));
    found.expect(0).says(&[
        "1 target cannot tell 3 free parameters apart",
        "do not determine `restitution`",
        "apart from `density` (-1.00)",
        "do not determine `friction`: its uncertainty is 100",
    ]);
    let summary = place.summary("out");
    let determined = |name: &str| of(&summary, name)["known"]["determined"].clone();
    assert_eq!(
        [determined("restitution"), determined("density"), determined("friction")],
        [false, false, false]
    );
    assert_eq!(of(&summary, "friction")["sensitivity"]["mean"], 0.0);
}

fn ended(place: &Place, out: &str) -> usize {
    let journal = fs::read_to_string(place.path(out).join("journal.jsonl"));
    journal.map_or(0, |text| text.lines().count().saturating_sub(1))
}

#[test]
fn a_calibration_that_is_killed_or_divided_ends_with_the_same_bytes() {
    let (place, _) = place();
    let sets = ["method.differential-evolution={ population = 8 }", "stop.rounds=12"];
    place.glebe(&calibrate("whole", &sets)).expect(0);
    let parts = calibrate("parts", &sets);
    let resume = [&parts[..], &["--resume"]].concat();
    let wait_for = |count: usize| {
        let started = Instant::now();
        while ended(&place, "parts") < count {
            assert!(started.elapsed() < Duration::from_secs(60), "not after a minute");
            sleep(Duration::from_millis(2));
        }
    };
    let child = place.command(&[&parts[..], &["--threads", "1", "--batches", "3"]].concat()).spawn().unwrap();
    wait_for(20);
    // Until then nobody else gets into its folder.
    signal(&child, "-STOP");
    for args in [&parts[..], &[&parts[..], &["--resume"]].concat(), &[&parts[..], &["--force"]].concat()] {
        place.glebe(args).expect(2).says(&["another run is writing", "--out"]);
    }
    signal(&child, "-KILL");
    Ended::of(&child.wait_with_output().unwrap()).expect(-1);
    assert!(ended(&place, "parts") < 100, "it was not killed on the way");
    // With a line that was not finished.
    let mut journal = fs::read_to_string(place.path("parts/journal.jsonl")).unwrap();
    journal.push_str("{\"world\":99,\"sta");
    place.write("parts/journal.jsonl", journal);
    let child = place.command(&resume).spawn().unwrap();
    wait_for(50);
    signal(&child, "-INT");
    let stopped = Ended::of(&child.wait_with_output().unwrap());
    if ended(&place, "parts") < 100 {
        stopped.expect(130).says(&["To go on: glebe calibrate study.toml --out parts --resume"]);
        assert_eq!(place.summary("parts")["status"], "interrupted");
    }
    let other = [&resume[..], &["--set", "free.restitution.bounds=[0, 1]"]].concat();
    place.glebe(&other).expect(2).says(&["belong to another study"]);
    place.glebe(&resume).expect(0).says(&["worlds have ended already"]);
    for name in ["evaluations.csv", "best.toml", "convergence.svg"] {
        assert_eq!(
            bytes(&place, &format!("parts/{name}")),
            bytes(&place, &format!("whole/{name}")),
            "{name}"
        );
    }
    // More rounds go on where it ended, and end where a longer search ends that was never stopped.
    let longer = [sets[0], "stop.rounds=14"];
    place.glebe(&[&calibrate("parts", &longer)[..], &["--resume"]].concat()).expect(0);
    place.glebe(&[&calibrate("whole", &longer)[..], &["--force"]].concat()).expect(0);
    assert_eq!(bytes(&place, "parts/evaluations.csv"), bytes(&place, "whole/evaluations.csv"));
    assert_eq!(place.summary("parts")["best"], place.summary("whole")["best"]);
}

/// Killed while results are written, and at times by chance; and on disks that fill.
#[test]
fn a_calibration_that_is_killed_again_and_again_or_lacks_room_ends_with_the_same_bytes() {
    let (place, _) = place();
    let sets = ["method.differential-evolution={ population = 8 }", "stop.rounds=12"];
    place.glebe(&calibrate("whole", &sets)).expect(0);
    let same = |out: &str| {
        for name in ["evaluations.csv", "best.toml", "convergence.svg"] {
            assert!(
                bytes(&place, &format!("{out}/{name}")) == bytes(&place, &format!("whole/{name}")),
                "{out}/{name}"
            );
        }
        assert!(!place.listing().iter().any(|name| name.contains("partial")), "{:?}", place.listing());
    };
    let more = ["--resume", "--checkpoint-every", "0", "--threads", "1"];
    fs::create_dir(place.path("killed")).unwrap();
    place.killed_again_and_again(
        &[&calibrate("killed", &sets)[..], &more].concat(),
        &["killed/checkpoint"],
        10,
    );
    same("killed");
    if on_disks_that_fill(&place, &[&calibrate("disk/out", &sets)[..], &more].concat(), &[8, 24, 40, 65536]) {
        same("kept/out");
    }
}

/// Two experiments at different speeds share the parameters; those that are refused or fail have no cost.
#[test]
fn failures_cost_nothing_but_themselves_and_experiments_share_parameters() {
    let (place, _) = place();
    let faster = ball_with(IMPACT).replace("velocity = [0, 0, -1]", "velocity = [0, 0, -2]");
    place.write("fast.toml", faster);
    let truth = place.glebe(&["run", "fast.toml", "--out", "fast", "--json", "--no-cache"]).expect(0).json();
    let fast = truth["stages"][0]["measures"]["force"]["mean"].as_f64().unwrap();
    let study = fs::read_to_string(place.path("study.toml")).unwrap();
    let study = study
        .replace("scene = \"scene.toml\"", "[experiment.slow]\nscene = \"scene.toml\"\n[experiment.fast]\nscene = \"scene.toml\"\nset = [\"particles.ball.velocity.2=-2\"]\n")
        .replace("measure =", "experiment = \"slow\"\nmeasure =")
        // Below 20 kPa the ball goes too deep into the floor.
        .replace("\"1 MPa\"", "\"1 kPa\"")
        + &format!("[target.fast]\nexperiment = \"fast\"\nmeasure = \"bounce.force\"\nvalue = {fast}\nscatter = 0.02\n");
    place.write("study.toml", study);
    let sets = ["method.cma-es.population=12", "stop.rounds=8"];
    let found = place.glebe(&[&calibrate("out", &sets)[..], &["--json"]].concat());
    let summary = found.expect(0).json();
    assert_eq!(summary["status"], "done");
    let counts = &summary["counts"];
    assert!(counts["failed"].as_u64().unwrap() > 0 && counts["done"].as_u64().unwrap() > 50, "{counts}");
    let table = fs::read_to_string(place.path("out/evaluations.csv")).unwrap();
    assert!(table.lines().any(|line| line.contains("failed") && line.contains("overlap")), "{table}");
    for name in ["best_slow.toml", "best_fast.toml"] {
        place.glebe(&["run", &format!("out/{name}"), "--out", name, "--no-cache"]).expect(0);
    }
    let again = place.summary("best_fast.toml");
    assert_eq!(again["stages"][0]["measures"]["force"]["mean"], summary["best"][0]["targets"]["fast"]);
    // Nothing left that could have a cost: the reasons are told.
    let soft = ["free.stiffness.bounds=[1e3, 2e3]", "method.cma-es.population=4", "stop.rounds=1"];
    let none = place.glebe(&calibrate("none", &soft));
    none.expect(1).says(&["no evaluation has a cost", "evaluations.csv"]);
}

#[test]
fn check_schema_and_new_know_calibrations() {
    let (place, _) = place();
    let found = place.glebe(&["check", "study.toml", "--json"]).expect(0).json();
    assert_eq!((&found["evaluations_of_a_round"], &found["most_evaluations"]), (&60.into(), &2712.into()));
    assert_eq!(found["free"], serde_json::json!(["restitution", "stiffness"]));
    let wrong =
        place.glebe(&["calibrate", "study.toml", "--set", "free.stiffness.path=material.bal.density"]);
    wrong.expect(2).says(&["did you mean `ball`?", "nothing was run"]);
    assert!(!place.path("out").exists());
    place.glebe(&["calibrate", "none.toml"]).expect(2).says(&["cannot read", "--template calibration"]);
    // In the middle of the ranges the scene cannot be set up.
    let refused = place.glebe(&["calibrate", "study.toml", "--set", "free.restitution.bounds=[1, 9]"]);
    refused.expect(2).says(&["in the middle of its range", "restitution"]);
    let schema: Value = place.glebe(&["schema", "calibration"]).expect(0).json();
    assert!(schema["properties"]["free"].is_object());
    for (folder, size) in [("quick", &["--quick"][..]), ("full", &[])] {
        let made = place.glebe(&[&["new", folder, "--template", "calibration"], size].concat());
        assert!(
            made.expect(0).stdout.contains(&format!("glebe calibrate {folder}/study.toml")),
            "{}",
            made.stdout
        );
        place.glebe(&["check", &format!("{folder}/study.toml")]).expect(0);
    }
}

/// With a surrogate fewer evaluations are simulated; what it says is marked, and what is answered was simulated. Killed and
/// resumed, it decides as if it had never been stopped.
#[test]
fn a_surrogate_saves_simulations_and_what_it_says_is_marked() {
    let (place, _) = place();
    let sets = ["method.differential-evolution={ population = 16 }", "stop.cost=0.5", "stop.rounds=60"];
    let plain = place.glebe(&[&calibrate("plain", &sets)[..], &["--json"]].concat()).expect(0).json();
    let sets = [&sets[..], &["surrogate={}"]].concat();
    let found = place.glebe(&calibrate("out", &sets));
    found.expect(0).says(&["by the surrogate"]);
    assert!(found.stdout.contains("the surrogate stood for"), "{}", found.stdout);
    let summary = place.summary("out");
    assert_eq!((&plain["ended_by"], &summary["ended_by"]), (&"cost".into(), &"cost".into()));
    for (name, truth) in TRUTH {
        let ratio = of(&summary, name)["best"].as_f64().unwrap() / truth;
        assert!((ratio - 1.0).abs() < 0.02, "{name} is {ratio} of the truth");
    }
    let report = &summary["surrogate"];
    let count = |key: &str| report[key].as_u64().unwrap();
    let all = plain["counts"]["evaluations"].as_u64().unwrap();
    assert!(4 * count("simulated") < 3 * all, "{report} instead of {all}");
    assert_eq!(count("predicted"), summary["counts"]["predicted"].as_u64().unwrap());
    assert!(count("checked") >= count("predicted") / 10, "{report}");
    assert_eq!(report["targets"].as_array().unwrap().len(), 2);
    let table = fs::read_to_string(place.path("out/evaluations.csv")).unwrap();
    let predicted: Vec<Vec<&str>> = table
        .lines()
        .filter(|line| line.contains("predicted"))
        .map(|line| line.split(',').collect())
        .collect();
    assert_eq!(predicted.len() as u64, count("predicted"));
    let best = summary["best"][0]["cost"].as_f64().unwrap();
    for row in &predicted {
        // Without a state, since nothing was run; and never the best.
        assert!(row[8].starts_with("cost within") && row[9].is_empty(), "{row:?}");
        assert!(row[6].parse::<f64>().unwrap() > best, "{row:?}");
    }
    for agent in summary["best"].as_array().unwrap() {
        let row = table.lines().nth(1 + agent["evaluation"].as_u64().unwrap() as usize).unwrap();
        assert!(row.contains(",done,"), "{row}");
    }
    assert_eq!(ended(&place, "out") as u64, count("simulated"));
    // Stopped after it was first asked.
    let parts = calibrate("parts", &sets);
    let child = place.command(&[&parts[..], &["--threads", "1"]].concat()).spawn().unwrap();
    let started = Instant::now();
    while ended(&place, "parts") < 40 {
        assert!(started.elapsed() < Duration::from_secs(60), "not after a minute");
        sleep(Duration::from_millis(1));
    }
    signal(&child, "-KILL");
    Ended::of(&child.wait_with_output().unwrap()).expect(-1);
    place.glebe(&[&parts[..], &["--resume"]].concat()).expect(0);
    assert_eq!(bytes(&place, "parts/evaluations.csv"), bytes(&place, "out/evaluations.csv"));
    assert_eq!(place.summary("parts")["surrogate"], *report);
    // It is part of what makes the results.
    let other = [&parts[..], &["--resume", "--set", "surrogate.spread=0.2"]].concat();
    place.glebe(&other).expect(2).says(&["belong to another study"]);
    place
        .glebe(&[&parts[..], &["--set", "surrogate.spread=0"]].concat())
        .expect(2)
        .says(&["surrogate.spread"]);
}

/// The intervals of a filter tell how much of them stands on predictions.
#[test]
fn intervals_that_stand_on_a_surrogate_are_marked() {
    let (place, _) = place();
    let sets = ["method.bayesian-filter={ samples = 64 }", "stop.rounds=7", "surrogate.after=64"];
    let summary = place.glebe(&[&calibrate("out", &sets)[..], &["--json"]].concat()).expect(0).json();
    let share = summary["surrogate"]["posterior"].as_f64().unwrap();
    assert!(
        share > 0.0 && share < 1.0 && summary["surrogate"]["saved"].as_f64().unwrap() > 0.25,
        "{summary:#}"
    );
    for (name, truth) in TRUTH {
        let posterior = &of(&summary, name)["posterior"];
        assert_eq!(posterior["predicted"].as_f64().unwrap(), share);
        let interval = [0, 1].map(|k| posterior["credible_95"][k].as_f64().unwrap());
        assert!(interval[0] < truth && truth < interval[1], "{name}: {interval:?}");
        assert!((posterior["median"].as_f64().unwrap() / truth - 1.0).abs() < 0.02, "{name}: {posterior}");
    }
}
