//! Study files: what they mean, and what people read when one is wrong.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::path::Path;

use glebe_io::scene::SceneError;
use glebe_io::study::{Sampler, Study, Value, Values, schema};

/// A study of the example scene that is right.
const STUDY: &str = r#"title = "Draught over the soil"
scene = "example.toml"
sampler = "grid"

[vary.density]
path = "material.soil.density"
range = ["1.5 t/m^3", 2000]
count = 3

[vary.stiffness]
path = "material.soil.youngs_modulus"
values = ["1 MPa", 2e6]

[follow.static]
path = "material.soil.static_friction"
of = "density"
factor = 1e-3
"#;

fn read(text: &str, sets: &[&str]) -> Result<Study, Vec<SceneError>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scene_common");
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    Study::parse("study.toml", text, &folder, &sets)
}

fn good(text: &str, sets: &[&str]) -> Study {
    read(text, sets).unwrap_or_else(|errors| panic!("{}", all(&errors)))
}

fn all(errors: &[SceneError]) -> String {
    errors.iter().map(|error| format!("{error:#}")).collect::<Vec<_>>().concat()
}

fn edited(from: &str, to: &str) -> String {
    assert_eq!(STUDY.matches(from).count(), 1, "`{from}` is not there exactly once");
    STUDY.replace(from, to)
}

/// The errors of the study with `from` replaced, as a user reads them.
fn wrong(from: &str, to: &str) -> String {
    match read(&edited(from, to), &[]) {
        Ok(study) => panic!("nothing was found wrong with {study:?}"),
        Err(errors) => all(&errors),
    }
}

#[test]
fn values_are_read_with_the_units_of_the_scene() {
    let study = good(STUDY, &[]);
    assert_eq!(
        (study.title.as_str(), study.sampler, study.seed),
        ("Draught over the soil", Sampler::Grid, 1)
    );
    assert!(study.scene.ends_with("scene_common/example.toml"));
    let [density, stiffness] = &study.parameters[..] else { panic!("{:?}", study.parameters) };
    assert_eq!((density.name.as_str(), density.unit), ("density", "kg/m^3"));
    let expected = Values::Range { range: [1500.0, 2000.0], count: 3, logarithmic: false, whole: false };
    assert_eq!(density.values, expected);
    assert_eq!(stiffness.values, Values::Listed(vec![Value::Number(1e6), Value::Number(2e6)]));
    let follower = &study.followers[0];
    assert_eq!((follower.of, follower.factor, follower.whole), (0, 1e-3, false));
}

#[test]
fn anything_that_set_reaches_may_vary() {
    let one = |path: &str, values: &str| {
        let text = format!("scene = \"example.toml\"\n[vary.it]\npath = '{path}'\nvalues = {values}\n");
        let Values::Listed(values) = good(&text, &[]).parameters.remove(0).values else { panic!("no list") };
        values
    };
    let text = |t: &str| Value::Text(t.to_owned());
    assert_eq!(one("stage.till.duration", "[\"200 ms\"]"), [Value::Number(0.2)]);
    assert_eq!(one("stage.till.move.sweep.velocity.0", "[\"36 km/h\"]"), [Value::Number(10.0)]);
    assert_eq!(one("stage.till.move.sweep.velocity", "[[0.5, 0, 0]]"), [text("[0.5, 0, 0]")]);
    assert_eq!(one("geometry.sweep.translate.2", "[\"-5 cm\"]"), [Value::Number(-0.05)]);
    assert_eq!(one("particles.bed.count", "[100, 200]"), [Value::Whole(100), Value::Whole(200)]);
    assert_eq!(one("particles.bed.radius", "[0.01]"), [Value::Number(0.01)]);
    let sizes = "{ uniform = [\"7 mm\", \"9 mm\"] }";
    assert_eq!(one("particles.bed.radius", &format!("[{sizes}]")), [text(sizes)]);
    assert_eq!(one("particles.bed.seed", "[3]"), [Value::Whole(3)]);
    assert_eq!(one("seed", "[3]"), [Value::Whole(3)]);
    assert_eq!(one("time.step", "[\"auto\", \"20 us\"]"), [text("\"auto\""), Value::Number(2e-5)]);
    assert_eq!(one("contact.normal", "[\"hertz\", \"linear\"]"), [text("\"hertz\""), text("\"linear\"")]);
    assert_eq!(one("contact.normal.linear.stiffness", "[\"10 kN/m\"]"), [Value::Number(1e4)]);
}

#[test]
fn texts_are_shown_without_their_quotes() {
    let shown = |text: &str| Value::Text(text.to_owned()).shown();
    assert_eq!([shown("\"hertz\""), shown("'hertz'")], ["hertz", "hertz"]);
    assert_eq!(shown("[\"7 mm\", \"9 mm\"]"), "[\"7 mm\", \"9 mm\"]");
    assert_eq!([Value::Whole(3).shown(), Value::Number(2e6).shown()], ["3", "2000000.0"]);
}

#[test]
fn set_changes_a_study() {
    let study = good(STUDY, &["vary.density.count=8", "title=Finer"]);
    assert_eq!(study.title, "Finer");
    assert!(matches!(study.parameters[0].values, Values::Range { count: 8, .. }));
    let errors = read(STUDY, &["vary.densty.count=8"]).unwrap_err();
    assert!(all(&errors).contains("did you mean `density`?"), "{}", all(&errors));
}

#[test]
fn a_path_that_leads_nowhere_is_told_with_the_nearest() {
    assert_eq!(
        wrong("\"material.soil.density\"", "\"material.soil.densty\""),
        "\
study.toml:6:23: error: `material.soil.densty` leads nowhere
6 | path = \"material.soil.densty\"
  |                       ^^^^^^ no `densty` here
  help: did you mean `density`? Allowed: `density`, `youngs_modulus`, `poissons_ratio`, `restitution`, `friction`, \
`static_friction`, `rolling_friction`, `wear`
"
    );
}

#[test]
fn a_wrong_unit_is_told_with_the_right_one() {
    assert_eq!(
        wrong("\"1 MPa\"", "\"1 mm\""),
        "\
study.toml:12:11: error: `vary.stiffness.values`: `1 mm` is a length, not a pressure
12 | values = [\"1 mm\", 2e6]
   |           ^^^^^^ wrong dimension
  help: expected is a pressure, such as 2e6 or \"2 MPa\"
"
    );
}

#[test]
fn every_mistake_is_told_at_once_in_the_order_of_the_file() {
    let text =
        edited("count = 3", "cuont = 3").replace("\"grid\"", "\"gird\"").replace("of = \"d", "of = \"r");
    let errors = read(&text, &[]).unwrap_err();
    let found: Vec<_> = errors.iter().map(|e| (e.place().line_column().0, e.kind())).collect();
    assert_eq!(found, [(3, "unknown-word"), (8, "unknown-key"), (16, "undefined")], "{}", all(&errors));
    assert!(
        all(&errors).contains("did you mean `grid`?") && all(&errors).contains("did you mean `density`?")
    );
}

/// Each row: what is replaced, by what, and the beginnings of what is said.
const MISTAKES: &[(&str, &str, &[&str])] = &[
    ("\"example.toml\"", "\"exmple.toml\"", &["study.toml:2:9", "cannot read", "exmple.toml"]),
    ("count = 3", "", &["`vary.density` needs `count`", "how many?"]),
    ("count = 3", "count = 1", &["`vary.density.count` is 1", "allowed are whole numbers, 2 to"]),
    ("count = 3", "count = 90000", &["the grid has 180000 worlds", "sobol"]),
    ("[\"1.5 t/m^3\", 2000]", "[2000, 1500]", &["goes from 2000 to 1500", "not ascending"]),
    ("[\"1.5 t/m^3\", 2000]", "[1500, 1700, 2000]", &["`vary.density.range` is a list of 3", "[from, to]"]),
    (
        "range = [\"1.5 t/m^3\", 2000]",
        "spacing = \"logarithmic\"\nrange = [0, 1]",
        &["begins at 0", "not above 0"],
    ),
    ("[\"1 MPa\", 2e6]", "\"1 MPa\"", &["`vary.stiffness.values` is a text", "not a list"]),
    ("[\"1 MPa\", 2e6]", "[]", &["`vary.stiffness.values` is empty"]),
    ("[\"1 MPa\", 2e6]", "[[1, 2]]", &["study.toml:12:11", "is a list of 2", "a pressure"]),
    ("values = [\"1 MPa\", 2e6]", "", &["`vary.stiffness` needs one of `values`, `range`"]),
    ("values = [", "range = [1e6, 2e6]\ncount = 2\nvalues = [", &["which exclude each other"]),
    ("\"grid\"", "\"sobol\"", &["needs `points`", "`count` means nothing together with the sampler `sobol`"]),
    ("\"grid\"", "\"grid\"\npoints = 8", &["`points` means nothing together with the sampler `grid`"]),
    ("\"grid\"", "\"list\"", &["`vary.density` has a range, and the sampler `list`"]),
    ("[vary.density]", "[vary.status]", &["`status` cannot be the name of a parameter", "`state_hash`"]),
    ("[follow.static]", "[follow.stiffness]", &["`stiffness` cannot be the name of a parameter"]),
    (
        "\"material.soil.static_friction\"",
        "\"contact.normal\"",
        &["multiplies a number, and `contact.normal`"],
    ),
    ("\"material.soil.density\"", "\"contact.normal\"", &["what it varies is no number", "write values"]),
    (
        "\"material.soil.static_friction\"",
        "\"material.soil.density\"",
        &["which another sets already", "again"],
    ),
    ("\"material.soil.density\"", "\"a b\"", &["`a b` is not a path", "dots between"]),
    ("path = \"material.soil.density\"", "", &["`vary.density` needs `path`"]),
    ("scene = \"example.toml\"", "", &["the file needs `scene`"]),
];

#[test]
fn mistakes_are_told_where_they_are() {
    for (from, to, says) in MISTAKES {
        let text = wrong(from, to);
        for part in *says {
            assert!(text.contains(part), "{from} → {to}: no `{part}` in\n{text}");
        }
    }
}

#[test]
fn lists_take_one_value_of_each() {
    let text = edited("\"grid\"", "\"list\"")
        .replace("range = [\"1.5 t/m^3\", 2000]\ncount = 3", "values = [1, 2, 3]");
    let errors = all(&read(&text, &[]).unwrap_err());
    assert!(errors.contains("`vary.stiffness` has 2 values, `vary.density` has 3"), "{errors}");
    assert!(read(&text.replace("2, 3]", "2]"), &[]).is_ok());
}

#[test]
fn a_study_is_told_from_a_scene() {
    assert!(Study::is_meant(STUDY));
    assert!(!Study::is_meant(include_str!("scene_common/example.toml")));
}

#[test]
fn the_schema_knows_the_study() {
    let schema = schema();
    for key in ["scene", "sampler", "points", "vary", "follow"] {
        assert!(schema["properties"].get(key).is_some(), "no `{key}`");
    }
    let path = &schema["properties"]["vary"]["additionalProperties"]["properties"]["path"];
    assert_eq!(path["type"], "string", "{schema:#}");
}
