//! `glebe bench` on beds so small that they settle in a second.

#![allow(clippy::unwrap_used, reason = "a failed unwrap fails the test")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

fn bench(cache: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glebe"))
        .arg("bench")
        .args(args)
        .env("GLEBE_CACHE", cache)
        .output()
        .unwrap()
}

#[test]
fn a_tiny_bed_gives_rates_as_json_and_is_kept() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("bench.json");
    let args =
        ["--sizes", "300,600", "--beds", "mono,poly", "--steps", "50", "--repeat", "2", "--threads", "1"];
    let run = bench(folder.path(), &[&args[..], &["--json", "--out", file.to_str().unwrap()]].concat());
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let result: Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!(result["threads"], 1);
    let beds = result["beds"].as_array().unwrap();
    assert_eq!(beds.len(), 4);
    for bed in beds {
        let rate = |key: &str| bed["particle_steps_per_second"][key].as_f64().unwrap();
        assert!(
            0.0 < rate("min") && rate("min") <= rate("median") && rate("median") <= rate("max"),
            "{bed:#}"
        );
        assert_eq!(bed["particle_steps_per_second"]["all"].as_array().unwrap().len(), 2);
        assert!(bed["bytes_per_particle"].as_f64().unwrap() > 0.0);
        // A bed, not a gas.
        assert!(bed["coordination"].as_f64().unwrap() > 3.0, "{bed:#}");
        let shares: f64 = bed["phases"].as_object().unwrap().values().map(|v| v.as_f64().unwrap()).sum();
        assert!(0.0 < shares && shares <= 1.0, "{bed:#}");
        assert_eq!(bed["bed_from_cache"], false);
    }
    assert_eq!(serde_json::from_slice::<Value>(&std::fs::read(&file).unwrap()).unwrap(), result);

    let again = bench(
        folder.path(),
        &["--sizes", "300", "--beds", "poly", "--steps", "10", "--repeat", "1", "--json"],
    );
    let result: Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!(result["beds"][0]["bed_from_cache"], true);
    let table = bench(folder.path(), &["--sizes", "300", "--beds", "poly", "--steps", "10"]);
    let text = String::from_utf8_lossy(&table.stdout);
    assert!(text.contains("poly") && text.contains("million particle-steps/s"), "{text}");
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
