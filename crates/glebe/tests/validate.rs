//! `glebe validate`: every case passes in its quick size, and the program says so as it promises to.

#![allow(clippy::unwrap_used, reason = "a failed unwrap fails the test")]

use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

fn glebe(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_glebe")).args(args).output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Those that run here. The others take up to a minute each on two cores; `glebe validate --quick` runs them too.
const CASES: [&str; 11] = ["A1", "A2", "A3", "A4", "A7", "B1", "B10", "B11", "C4", "C5", "P1"];
const LONG: [&str; 13] = ["A5", "A6", "B2", "B3", "B4", "B5", "B6", "B7", "B8", "C1", "C2", "C3", "C6"];

#[test]
fn cases_pass_in_quick_size() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("figures");
    let run =
        glebe(&[&["validate", "--quick", "--json", "--out", out.to_str().unwrap()], &CASES[..]].concat());
    let all: Vec<&str> = glebe::validate::cases().iter().map(|c| c.id).collect();
    assert_eq!(all.into_iter().filter(|id| !CASES.contains(id)).collect::<Vec<_>>(), LONG);
    let result = json(&run);
    let cases = result["cases"].as_array().unwrap();
    let ids: Vec<_> = cases.iter().map(|c| c["id"].as_str().unwrap()).collect();
    assert_eq!(ids, CASES);
    for case in cases {
        let metrics = case["metrics"].as_object().unwrap();
        assert!(!metrics.is_empty(), "{case:#}");
        // The verdict follows from the numbers.
        let passes = |m: &Value| {
            let [value, reference, tolerance] =
                ["value", "reference", "tolerance"].map(|key| m[key].as_f64().unwrap_or(f64::NAN));
            (value - reference).abs() <= tolerance
        };
        assert!(metrics.values().all(passes), "{case:#}");
        assert_eq!(case["pass"], true, "{case:#}");
    }
    assert_eq!(run.status.code(), Some(0));

    let figures: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "svg"))
        .collect();
    for id in ids {
        let has = figures.iter().any(|f| {
            f.file_name().unwrap().to_str().unwrap().starts_with(&format!("{id}-"))
                && std::fs::read_to_string(f).unwrap().contains("</svg>")
        });
        assert!(has, "{id} has no figure in {figures:?}");
    }
    let kept: Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("results.json")).unwrap()).unwrap();
    assert_eq!(kept, result);
}

#[test]
fn a_case_is_found_by_id_and_by_name_and_prints_a_table() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().to_str().unwrap();
    let run = glebe(&["validate", "b11", "Resting-Sphere", "--quick", "--out", out]);
    let text = String::from_utf8_lossy(&run.stdout);
    assert_eq!(run.status.code(), Some(0), "{text}");
    assert!(text.contains("B11 resting-sphere") && text.contains("1 of 1 cases passed"), "{text}");
    // Again into the same folder: own figures are replaced.
    assert_eq!(glebe(&["validate", "B11", "--out", out]).status.code(), Some(0));
}

#[test]
fn an_unknown_case_exits_with_2_and_the_nearest_name() {
    let run = glebe(&["validate", "oblique-inpact"]);
    let text = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{text}");
    assert!(text.contains("'oblique-impact'") && text.contains("B10"), "{text}");
}

#[test]
fn a_figure_of_someone_else_is_not_replaced() {
    let folder = TempDir::new().unwrap();
    let theirs = folder.path().join("B11-resting-sphere-approach.svg");
    std::fs::write(&theirs, "<svg><!-- drawn by hand --></svg>").unwrap();
    let run = glebe(&["validate", "B11", "--out", folder.path().to_str().unwrap()]);
    let text = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{text}");
    assert!(text.contains("B11-resting-sphere-approach.svg") && text.contains("--out"), "{text}");
    assert!(std::fs::read_to_string(&theirs).unwrap().contains("by hand"));
}
