//! Calibration files: what they mean, and what people read when one is wrong.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::path::Path;

use glebe_io::scene::SceneError;
use glebe_io::study::{Calibration, Method, Statistic, Stop, Study, calibration_schema};

/// A calibration of the example scene that is right.
const STUDY: &str = r#"title = "Soil"
scene = "example.toml"

[free.density]
path = "material.soil.density"
bounds = ["1.5 t/m^3", 2000]

[free.stiffness]
path = "material.soil.youngs_modulus"
bounds = ["50 kPa", 1e7]
scale = "logarithmic"

[free.sliding]
path = "material.soil.friction"
bounds = [0.05, 0.7]

[follow.static]
path = "material.soil.static_friction"
of = "sliding"
factor = 1.1

[target.draught]
measure = "till.draught_force"
value = "0.3095 kN"
scatter = 14.5
"#;

fn read(text: &str, sets: &[&str]) -> Result<Calibration, Vec<SceneError>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene_common");
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    Calibration::parse("study.toml", text, &folder, &sets)
}

fn all(errors: &[SceneError]) -> String {
    errors.iter().map(|error| format!("{error:#}")).collect::<Vec<_>>().concat()
}

fn good(text: &str, sets: &[&str]) -> Calibration {
    read(text, sets).unwrap_or_else(|errors| panic!("{}", all(&errors)))
}

fn edited(from: &str, to: &str) -> String {
    assert_eq!(STUDY.matches(from).count(), 1, "`{from}` is not there exactly once");
    STUDY.replace(from, to)
}

/// The errors of the calibration with `from` replaced, as a user reads them.
fn wrong(from: &str, to: &str) -> String {
    match read(&edited(from, to), &[]) {
        Ok(calibration) => panic!("nothing was found wrong with {calibration:?}"),
        Err(errors) => all(&errors),
    }
}

#[test]
fn values_are_read_with_the_units_of_the_scene() {
    let c = good(STUDY, &[]);
    let free: Vec<_> = c.free.iter().map(|f| (f.name.as_str(), f.unit, f.bounds, f.logarithmic)).collect();
    assert_eq!(
        free,
        [
            ("density", "kg/m^3", [1500.0, 2000.0], false),
            ("stiffness", "Pa", [5e4, 1e7], true),
            ("sliding", "", [0.05, 0.7], false)
        ]
    );
    assert_eq!((c.followers[0].of, c.followers[0].factor), (2, 1.1));
    let t = &c.targets[0];
    assert_eq!((t.stage.as_str(), t.measure.as_str(), t.unit), ("till", "draught_force", "N"));
    assert_eq!((t.value, t.scatter, t.weight, t.statistic), (309.5, 14.5, 1.0, Statistic::Mean));
    assert_eq!((c.experiments.len(), c.experiments[0].name.as_str(), c.seed), (1, "", 1));
}

/// The settings of Nagy et al. 2024, section 4.3.1.
#[test]
fn the_defaults_are_the_papers() {
    let c = good(STUDY, &[]);
    let paper =
        Method::DifferentialEvolution { population: 60, weight: 0.8, crossover: 0.5, adaptive: false };
    assert_eq!(c.method, paper);
    assert_eq!(c.stop, Stop { rounds: 45, evaluations: None, cost: None, stagnation: None });
    let set = good(STUDY, &["method.cma-es.population=12", "stop.cost=0.1", "stop.stagnation=5"]);
    assert_eq!(set.method, Method::CmaEs { population: Some(12) });
    assert_eq!((set.stop.rounds, set.stop.cost, set.stop.stagnation), (100, Some(0.1), Some(5)));
    let filter = good(STUDY, &["method.bayesian-filter.samples=64"]);
    assert_eq!(filter.method, Method::BayesianFilter { samples: 64, effective: 0.3 });
}

#[test]
fn experiments_share_the_parameters() {
    let two = "[experiment.slow]\n[experiment.fast]\nset = [\"stage.till.duration=0.3\"]\n\n\
               [target.draught]\nexperiment = \"fast\"\n";
    let c = good(&edited("[target.draught]\n", two), &[]);
    let names: Vec<&str> = c.experiments.iter().map(|e| e.name.as_str()).collect();
    assert_eq!((names, c.targets[0].experiment), (vec!["slow", "fast"], 1));
    assert_eq!(c.experiments[1].sets, ["stage.till.duration=0.3"]);
    assert_eq!(c.experiments[0].scene, c.experiments[1].scene);
    let wrong = |to: &str| {
        wrong(
            "[target.draught]\n",
            &format!("[experiment.slow]\n[experiment.fast]\n\n[target.draught]\n{to}"),
        )
    };
    assert!(wrong("").contains("needs `experiment`: there are 2"));
    assert!(wrong("experiment = \"fats\"\n").contains("did you mean `fast`?"));
    let list =
        edited("[target.draught]\n", "[experiment.a]\nset = \"x=1\"\n[target.draught]\nexperiment = \"a\"\n");
    assert!(all(&read(&list, &[]).unwrap_err()).contains("not a list of texts"));
}

#[test]
fn mistakes_are_told_with_their_places_and_what_to_do() {
    for (from, to, parts) in [
        ("soil.density", "soil.densty", &["study.toml:5:23", "did you mean `density`?"][..]),
        ("[\"1.5 t/m^3\", 2000]", "[2500, 2000]", &["from 2500 to 2000", "write [least, largest]"]),
        ("[\"1.5 t/m^3\", 2000]", "2000", &["`free.density.bounds`", "[from, to]"]),
        ("[\"50 kPa\", 1e7]", "[0, 1e7]", &["equal ratios need numbers above 0", "scale = \"linear\""]),
        ("[\"50 kPa\", 1e7]", "[\"50 kg\", 1e7]", &["free.stiffness.bounds", "pressure"]),
        ("\"logarithmic\"", "\"log\"", &["logarithmic"]),
        ("material.soil.youngs_modulus", "particles.bed.fill", &["is no number", "glebe sweep"]),
        ("of = \"sliding\"", "of = \"sldiing\"", &["did you mean `sliding`?"]),
        ("till.draught_force", "till.draft", &["the scene measures no `till.draft`", "till.draught_force"]),
        ("scatter = 14.5", "scatter = 0", &["target.draught.scatter", "more than 0"]),
        ("scatter = 14.5\n", "", &["needs `scatter`"]),
        ("\"0.3095 kN\"", "\"0.3095 kg\"", &["target.draught.value", "force"]),
        ("[target.draught]", "[target.density]", &["cannot be the name", "each once"]),
        ("material.soil.static_friction", "material.soil.friction", &["which another sets already"]),
        ("scene = \"example.toml\"\n", "", &["the calibration needs `scene`", "[experiment.NAME]"]),
        ("example.toml", "none.toml", &["cannot read", "none.toml"]),
        (
            "[target.draught]",
            "[method.cma-es]\n[method.bayesian-filter]\n[target.draught]",
            &["exclude each other"],
        ),
        (
            "[target.draught]",
            "[method.bayesian-filter]\n[stop]\ncost = 1\n[target.draught]",
            &["means nothing together with `bayesian-filter`", "take `rounds`"],
        ),
        (
            "[target.draught]",
            "[method.differential-evolution]\npopulation = 3\n[target.draught]",
            &["population", "4"],
        ),
    ] {
        let text = wrong(from, to);
        for part in parts {
            assert!(text.contains(part), "no `{part}` for `{to}` in:\n{text}");
        }
    }
    let empty = all(&read("scene = \"example.toml\"\nfree = {}\ntarget = {}\n", &[]).unwrap_err());
    assert!(empty.contains("nothing is free") && empty.contains("has no target"), "{empty}");
}

#[test]
fn calibrations_are_told_from_studies_and_scenes() {
    assert!(Calibration::is_meant(STUDY));
    assert!(!Calibration::is_meant("scene = \"s.toml\"\n[vary.a]\npath = \"seed\"\n"));
    assert!(
        Study::is_meant(STUDY),
        "it names a scene, so whoever can tell both apart asks for calibrations first"
    );
    let schema = calibration_schema();
    for key in ["free", "target", "method", "stop", "experiment"] {
        assert!(schema["properties"][key].is_object(), "{key}");
    }
}
