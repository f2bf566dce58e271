//! What a validation prints and leaves on disk.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use glebe_io::output::{OutputError, SVG_MARK, write_atomic};
use serde_json::{Value, json};

use super::case::{Case, Outcome};

/// First key of `results.json`, by which glebe knows its own file again.
const OWN_RESULTS: &str = "\"cases\"";

/// Makes the folder, and refuses files in it that have the names of results but come from elsewhere.
pub fn claim(folder: &Path, cases: &[&Case]) -> Result<(), OutputError> {
    let refused = |path: &Path, action, source| OutputError::Io { path: path.to_owned(), action, source };
    fs::create_dir_all(folder).map_err(|e| refused(folder, "make this folder", e))?;
    let foreign = |path: &Path, mark: &str| {
        fs::read_to_string(path).is_ok_and(|text| !text.lines().take(4).any(|line| line.contains(mark)))
    };
    let malformed = |path: PathBuf| OutputError::Malformed {
        path,
        what: "was not written by glebe and would be replaced; give another folder with --out".to_owned(),
    };
    let results = folder.join("results.json");
    if foreign(&results, OWN_RESULTS) {
        return Err(malformed(results));
    }
    for entry in fs::read_dir(folder).map_err(|e| refused(folder, "read this folder", e))?.flatten() {
        let path = entry.path();
        let figure = path.extension().is_some_and(|e| e == "svg");
        let named = |case: &&Case| entry.file_name().to_string_lossy().starts_with(&stem(case));
        if figure && cases.iter().any(named) && foreign(&path, SVG_MARK) {
            return Err(malformed(path));
        }
    }
    Ok(())
}

fn stem(case: &Case) -> String {
    format!("{}-{}", case.id, case.name)
}

fn figure_path(folder: &Path, case: &Case, figure: &str) -> PathBuf {
    folder.join(format!("{}-{figure}.svg", stem(case)))
}

pub fn write_figures(folder: &Path, outcome: &Outcome) -> Result<(), OutputError> {
    outcome.findings.figures.iter().try_for_each(|(name, svg)| {
        write_atomic(&figure_path(folder, outcome.case, name), |out| out.write_all(svg.as_bytes()))
    })
}

pub fn write_results(folder: &Path, json: &Value) -> Result<(), OutputError> {
    write_atomic(&folder.join("results.json"), |out| writeln!(out, "{json:#}"))
}

/// `{"cases": [{"id", "name", "pass", "metrics": {name: {"value", "reference", "tolerance"}}, …}]}`
pub fn json(outcomes: &[Outcome], quick: bool, device: &str) -> Value {
    let case = |o: &Outcome| -> Value {
        json!({
            "id": o.case.id,
            "name": o.case.name,
            "pass": o.passed(),
            "metrics": o.findings.metrics,
            "reported": o.findings.reported,
            "seconds": o.seconds,
        })
    };
    json!({ "cases": outcomes.iter().map(case).collect::<Vec<_>>(), "quick": quick, "device": device })
}

/// One case as a table.
pub fn table(outcome: &Outcome, folder: &Path) -> String {
    let case = outcome.case;
    let mut text = format!("{} {} [{:.1} s]: ", case.id, case.name, outcome.seconds);
    text += verdict(outcome.passed());
    // Writing to a string does not fail.
    let mut line = |l: std::fmt::Arguments<'_>| {
        let _ = write!(text, "\n  {l}");
    };
    line(format_args!("{}", case.shows));
    line(format_args!("{}", case.source));
    line(format_args!("{:<48} {:>12} {:>12} {:>12}", "", "value", "reference", "tolerance"));
    for (name, m) in &outcome.findings.metrics {
        let [value, reference, tolerance] = [m.value, m.reference, m.tolerance].map(number);
        let verdict = verdict(m.passed());
        line(format_args!("{name:<48} {value:>12} {reference:>12} {tolerance:>12}  {verdict}"));
    }
    for (name, value) in &outcome.findings.reported {
        line(format_args!("{name:<48} {:>12} {:>12} {:>12}", number(*value), "-", "-"));
    }
    for (figure, _) in &outcome.findings.figures {
        line(format_args!("{}", figure_path(folder, case, figure).display()));
    }
    text
}

/// The last line.
pub fn verdict_of(outcomes: &[Outcome]) -> String {
    let passed = outcomes.iter().filter(|o| o.passed()).count();
    format!("{passed} of {} cases passed", outcomes.len())
}

fn verdict(passed: bool) -> &'static str {
    if passed { "pass" } else { "FAIL" }
}

/// Five significant digits, plain where that is short.
fn number(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let decade = x.abs().log10().floor();
    if (-3.0..6.0).contains(&decade) {
        let decimals = (4.0 - decade).max(0.0) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.4e}")
    }
}
