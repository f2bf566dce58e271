//! Calibration files: what they mean, and what people read when one is wrong.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::fs;
use std::path::{Path, PathBuf};

use glebe_io::scene::SceneError;
use glebe_io::study::{Calibration, Method, Quantity, Statistic, Stop, Study, Surrogate, calibration_schema};

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
    let (stage, measure) = ("till".to_owned(), "draught_force".to_owned());
    assert_eq!(t.quantity, Quantity::Measure { stage, measure, statistic: Statistic::Mean });
    assert_eq!((&t.values[..], &t.scatters[..], t.weight, t.unit), (&[309.5][..], &[14.5][..], 1.0, "N"));
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
fn a_surrogate_is_asked_after_ten_evaluations_of_each_parameter() {
    assert_eq!(good(STUDY, &[]).surrogate, None);
    assert_eq!(good(STUDY, &["surrogate={}"]).surrogate, Some(Surrogate { after: 30, spread: 0.1 }));
    let set = good(STUDY, &["surrogate={ after = 12, spread = 0.5 }"]);
    assert_eq!(set.surrogate, Some(Surrogate { after: 12, spread: 0.5 }));
    for (given, told) in [
        ("surrogate.after=1", "`surrogate.after` is 1"),
        ("surrogate.spread=0", "`surrogate.spread` is 0"),
        ("surrogate.sprad=1", "did you mean `spread`?"),
        ("surrogate=true", "`surrogate` is true"),
    ] {
        let errors = all(&read(STUDY, &[given]).unwrap_err());
        assert!(errors.contains(told), "{given}: {errors}");
    }
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

/// Files of a test, in a folder of their own.
struct Files(PathBuf);

impl Files {
    fn new(name: &str, files: &[(&str, &str)]) -> Self {
        let folder = std::env::temp_dir().join(format!("glebe-calibration-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        for (name, text) in files {
            fs::write(folder.join(name), text).unwrap();
        }
        Self(folder)
    }

    fn read(&self, text: &str) -> Result<Calibration, Vec<SceneError>> {
        Calibration::parse("study.toml", text, &self.0, &[])
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

const PUSH: &str = "# displacement [mm], note, Force (kN), sd [N]\n0,a,0,5\n\n100,b,0.2,10\n250,c,0.3,20\n";
const CURVE: &str = r#"[target.push]
file = "push.csv"
stage = "till"
x = "sweep.path"
x_column = "displacement"
y = "sweep.draught"
y_column = "force"
scatter_column = "sd"
"#;

fn with_curve() -> (Files, String) {
    let scene = include_str!("scene_common/example.toml");
    let files = Files::new(
        &format!("{:?}", std::thread::current().id()),
        &[("example.toml", scene), ("push.csv", PUSH)],
    );
    let text = STUDY.split("[target.draught]").next().unwrap().to_owned() + CURVE;
    (files, text)
}

#[test]
fn curves_are_read_with_the_units_of_their_headings() {
    let (files, text) = with_curve();
    let c = files.read(&text).unwrap_or_else(|errors| panic!("{}", all(&errors)));
    let t = &c.targets[0];
    let Quantity::Curve { stage, x, y, at, x_unit } = &t.quantity else { panic!("{t:?}") };
    assert_eq!(
        (stage.as_deref(), x.as_str(), y.as_str(), *x_unit),
        (Some("till"), "sweep.path", "sweep.draught", "m")
    );
    assert_eq!(at, &[0.0, 0.1, 0.25]);
    assert_eq!(
        (&t.values[..], &t.scatters[..], t.unit),
        (&[0.0, 200.0, 300.0][..], &[5.0, 10.0, 20.0][..], "N")
    );
    let constant = text.replace("scatter_column = \"sd\"", "scatter = \"0.01 kN\"\nweight = 3");
    let t = &files.read(&constant).unwrap_or_else(|errors| panic!("{}", all(&errors))).targets[0];
    assert_eq!((&t.scatters[..], t.weight), (&[10.0; 3][..], 3.0));
}

#[test]
fn mistakes_in_curves_are_told_with_their_lines() {
    let (files, text) = with_curve();
    let wrong = |from: &str, to: &str| {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        all(&files.read(&text.replace(from, to)).map(|c| panic!("{c:?}")).unwrap_err())
    };
    for (from, to, parts) in [
        (
            "\"displacement\"",
            "\"path\"",
            &["push.csv", "line 1: no column `path`", "`Force (kN)`", "x_column"][..],
        ),
        ("y = \"sweep.draught\"", "y = \"sweep.path\"", &["column `Force (kN)`", "not a length"]),
        ("sweep.path", "sweep.paht", &["has no column `sweep.paht`", "series.csv"]),
        ("stage = \"till\"", "stage = \"tlil\"", &["no stage `tlil`", "did you mean `till`?"]),
        ("stage = \"till\"\n", "", &["needs `stage`"]),
        ("scatter_column = \"sd\"\n", "", &["needs `scatter` or `scatter_column`"]),
        ("x = \"sweep.path\"\n", "", &["needs `x`"]),
        ("push.csv", "none.csv", &["cannot read the curve", "none.csv"]),
        ("file = \"push.csv\"", "file = \"push.csv\"\nvalue = 3", &["value"]),
        (
            "file = \"push.csv\"",
            "file = \"push.csv\"\nmeasure = \"till.draught_force\"",
            &["exclude each other"],
        ),
    ] {
        let text = wrong(from, to);
        for part in parts {
            assert!(text.contains(part), "no `{part}` for `{to}` in:\n{text}");
        }
    }
    for (file, parts) in [
        (PUSH.replace("250,", "100,"), &["line 5", "0.1 after 0.1", "sort"][..]),
        (PUSH.replace(",20", ",0"), &["line 5", "more than 0"]),
        (PUSH.replace("0.2", "two"), &["line 4, column 3 (y): `two` is not a number"]),
        ("displacement,force,sd\n1,2,3\n".to_owned(), &["has 1 of the two lines"]),
        (String::new(), &["has 0 of the two lines"]),
    ] {
        fs::write(files.0.join("push.csv"), file).unwrap();
        let text = all(&files.read(&text).map(|c| panic!("{c:?}")).unwrap_err());
        for part in parts {
            assert!(text.contains(part), "no `{part}` in:\n{text}");
        }
    }
}

const GRAINS: &str = r#"[domain]
min = [0, 0, 0]
max = [0.1, 0.1, 0.1]
sides = { x = "periodic", y = "periodic", z = "periodic" }
[material.grain]
density = 2650
youngs_modulus = "100 MPa"
poissons_ratio = 0.3
restitution = 0.2
friction = 0.5
[particles.grains]
material = "grain"
count = 100
radius = "1 mm"
fill = "random"
[[stage]]
name = "wait"
duration = 0.001
"#;
const SAMPLES: &str = "scene = \"grains.toml\"\n[consolidate]\npressure = \"100 kPa\"\n\
                       [load]\nprogram = \"drained-triaxial\"\nstrain = 0.1\n";
const TRIAXIAL: &str = r#"study = "samples.toml"
[experiment.low]
[experiment.high]
set = ["consolidate.pressure=200e3"]
[free.friction]
path = "material.grain.friction"
bounds = [0.1, 0.9]
[target.peak]
experiment = "low"
measure = "peak.q_over_p"
value = 1.2
scatter = 0.05
[target.q]
experiment = "high"
file = "q.csv"
x = "strain"
x_column = "eps_a"
y = "q"
scatter = "5 kPa"
"#;

#[test]
fn studies_of_periodic_samples_are_models_too() {
    let files = [
        ("grains.toml", GRAINS),
        ("samples.toml", SAMPLES),
        (
            "vary.toml",
            &(SAMPLES.to_owned() + "[vary.e]\npath = \"material.grain.friction\"\nvalues = [0.1]\n"),
        ),
        ("q.csv", "eps_a [%],q [kPa]\n0,0\n1,50\n10,120\n"),
    ];
    let files = Files::new("samples", &files);
    let c = files.read(TRIAXIAL).unwrap_or_else(|errors| panic!("{}", all(&errors)));
    assert!(c.experiments.iter().all(|e| e.samples.is_some() && e.scene.ends_with("grains.toml")));
    assert_eq!(c.targets[0].quantity, Quantity::Number("peak.q_over_p"));
    let Quantity::Curve { stage: None, at, .. } = &c.targets[1].quantity else { panic!("{c:?}") };
    assert_eq!((&at[..], &c.targets[1].values[..]), (&[0.0, 0.01, 0.1][..], &[0.0, 5e4, 1.2e5][..]));
    for (from, to, part) in [
        ("peak.q_over_p", "peak.q_over", "did you mean `peak.q_over_p`?"),
        ("y = \"q\"", "y = \"qq\"", "no column `qq`"),
        ("\"samples.toml\"", "\"vary.toml\"", "something varies"),
        ("\"samples.toml\"", "\"grains.toml\"", "needs"),
        ("\"samples.toml\"", "\"samples.toml\"\nscene = \"grains.toml\"", "exclude each other"),
        ("measure = ", "statistic = \"std\"\nmeasure = ", "means nothing of periodic samples"),
        ("x_column = ", "stage = \"a\"\nx_column = ", "means nothing of periodic samples"),
    ] {
        assert_eq!(TRIAXIAL.matches(from).count(), 1, "{from}");
        let text = all(&files.read(&TRIAXIAL.replace(from, to)).map(|c| panic!("{c:?}")).unwrap_err());
        assert!(text.contains(part), "no `{part}` for `{to}` in:\n{text}");
    }
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
