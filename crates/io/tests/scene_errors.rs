//! What people read when a scene is wrong: every kind of mistake, word for word.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod scene_common;

use glebe_engine::generate::SizeDistribution;
use glebe_io::scene::{Origin, Scene, SceneError};
use scene_common::{EXAMPLE, all, edited, full_text, good, only, report};

#[test]
fn an_unknown_key_is_told_with_the_nearest_one() {
    assert_eq!(
        full_text(&edited("density = 1850  ", "densty = 1850   "), "unknown-key"),
        "\
scene.toml:16:1: error: `material.soil` has no key `densty`
16 | densty = 1850                     # kg/m³
   | ^^^^^^ unknown key
  help: did you mean `density`? Allowed: `density`, `youngs_modulus`, `poissons_ratio`, `restitution`, `friction`, \
`static_friction`, `rolling_friction`, `wear`
"
    );
}

#[test]
fn a_value_out_of_range_is_told_with_the_range() {
    assert_eq!(
        full_text(&edited("restitution = 0.5", "restitution = 1.5"), "range"),
        "\
scene.toml:19:15: error: `material.soil.restitution` is 1.5
19 | restitution = 1.5
   |               ^^^ out of range
  help: allowed is 0 to 1
"
    );
}

#[test]
fn a_wrong_dimension_is_told_with_the_right_one() {
    assert_eq!(
        full_text(&edited("\"2 MPa\"", "\"2 mm\""), "dimension"),
        "\
scene.toml:17:18: error: `material.soil.youngs_modulus`: `2 mm` is a length, not a pressure
17 | youngs_modulus = \"2 mm\"
   |                  ^^^^^^ wrong dimension
  help: expected is a pressure, such as 2e6 or \"2 MPa\"
"
    );
}

#[test]
fn a_law_that_is_not_known_is_told_with_all_that_are() {
    let text = full_text(&edited("normal = \"hertz\"", "normal = \"herz\""), "unknown-word");
    assert!(
        text.starts_with(
            "\
scene.toml:28:10: error: `herz` is not a law for `contact.normal`
28 | normal = \"herz\"
   |          ^^^^^^ unknown
  help: did you mean `hertz`? Allowed: `hertz`, "
        ),
        "{text}"
    );
}

/// Each row: what is replaced in the example, by what, the kind of the only error, its message, and what
/// its help begins with.
const MISTAKES: &[(&str, &str, &str, &str, &str)] = &[
    // Keys and words.
    ("[domain]", "[domian]", "unknown-key", "the file has no key `domian`", "did you mean `domain`?"),
    (
        "translate =",
        "colour =",
        "unknown-key",
        "`geometry.sweep` has no key `colour`",
        "allowed: `material`, `file`",
    ),
    (
        "integrator = \"euler\"",
        "integrator = \"eulr\"",
        "unknown-word",
        "`eulr` is not a value of `time.integrator`",
        "did you mean `euler`? Allowed: `euler`, `exact`, `adams`, `velocity-verlet`",
    ),
    (
        "fill = \"rain\"",
        "fill = \"rian\"",
        "unknown-word",
        "`rian` is not a value of `particles.bed.fill`",
        "did you mean `rain`?",
    ),
    (
        "x = \"wall\"",
        "x = \"walls\"",
        "unknown-word",
        "`walls` is not a value of `domain.sides.x`",
        "did you mean `wall`?",
    ),
    (
        "[\"wall\", \"open\"]",
        "[\"wall\", \"opne\"]",
        "unknown-word",
        "`opne` is not a value of `domain.sides.z`",
        "did you mean `open`?",
    ),
    (
        "step = \"auto\"",
        "step = \"atuo\"",
        "unknown-word",
        "`atuo` is not a value of `time.step`",
        "did you mean `auto`? Allowed: `auto`",
    ),
    (
        "sweep.fx",
        "sweep.fw",
        "unknown-word",
        "`fw` is not a component of a force or torque",
        "did you mean `fx`?",
    ),
    // References.
    (
        "material = \"soil\"",
        "material = \"sol\"",
        "undefined",
        "no material is called `sol`",
        "did you mean `soil`? Allowed: `soil`, `steel`, or define [material.sol]",
    ),
    (
        "[pair.soil-steel]",
        "[pair.soil-stel]",
        "undefined",
        "`soil-stel` is not two materials with a dash between",
        "did you mean `soil-steel`? Materials: `soil`, `steel`",
    ),
    ("\"sweep.fx\"", "\"swep.fx\"", "undefined", "no surface is called `swep`", "did you mean `sweep`?"),
    ("move.sweep", "move.swepe", "undefined", "no surface is called `swepe`", "did you mean `sweep`?"),
    (
        "[pair.soil-steel]",
        "[pair.soil-soil.contact]\nnormal = \"herz\"\n[pair.soil-steel]",
        "unknown-word",
        "`herz` is not a law for `pair.soil-soil.contact.normal`",
        "did you mean `hertz`?",
    ),
    (
        "[pair.soil-steel]",
        "[pair.soil-soil]\ncontact.cohesion = \"jkr\"\n[pair.soil-steel]",
        "missing",
        "the law `jkr` needs its parameter `work_of_adhesion`",
        "energy w to part a unit of area; times the cohesion of the pair Write a table \
         [pair.soil-soil.contact.cohesion.jkr] with",
    ),
    (
        "[pair.soil-steel]",
        "[pair.soil-soil.contact]\nnormel = \"hertz\"\n[pair.soil-steel]",
        "unknown-key",
        "`pair.soil-soil.contact` has no key `normel`",
        "did you mean `normal`?",
    ),
    // Numbers and units.
    (
        "count = 38912",
        "count = -1",
        "range",
        "`particles.bed.count` is -1",
        "allowed are whole numbers, 1 to 4000000000",
    ),
    (
        "count = 38912",
        "count = 1e4",
        "wrong-kind",
        "`particles.bed.count` is a number",
        "expected is a whole number",
    ),
    (
        "\"7 mm\"",
        "\"-7 mm\"",
        "range",
        "`particles.bed.radius.uniform` is \"-7 mm\"",
        "allowed is more than 0 m",
    ),
    ("density = 1850", "density = nan ", "range", "`material.soil.density` is not a finite number", ""),
    (
        "poissons_ratio = 0.38",
        "poissons_ratio = 0.7",
        "range",
        "`material.soil.poissons_ratio` is 0.7",
        "allowed is more than -1, up to 0.5",
    ),
    (
        "\"2 MPa\"",
        "\"2 MPsi\"",
        "unit",
        "`material.soil.youngs_modulus`: `MPsi` is not a known unit",
        "expected is a pressure",
    ),
    (
        "\"0.8 s\"",
        "\"0.8\"",
        "unit",
        "`stage.till.duration`: `0.8` has no unit",
        "expected is a time, such as 0.001 or \"1 ms\"",
    ),
    (
        "\"20 ms\"",
        "\"often\"",
        "wrong-kind",
        "`output.frames`: `often` does not begin with a number",
        "expected is a time",
    ),
    (
        "[0.7, 0, 0]",
        "[0.7, 0]",
        "wrong-kind",
        "`stage.till.move.sweep.velocity` is a list of 2",
        "expected is [x, y, z], each a velocity",
    ),
    (
        "[0.28, 0.56]",
        "[0.56, 0.28]",
        "order",
        "`stage.till.measure.draught_force.over_displacement` goes from 0.56 to 0.28; the second must be larger",
        "",
    ),
    (
        "title = \"A sweep through sandy soil\"",
        "title = 5",
        "wrong-kind",
        "`title` is a whole number",
        "expected is a text in quotes",
    ),
    (
        "seed = 1",
        "seed = \"one\"",
        "wrong-kind",
        "`particles.bed.seed` is a text",
        "expected is a whole number",
    ),
    (
        "translate = [-0.62, 0, 0.15]",
        "rotate = [{ axis = [0, 0, 0], angle = \"30 deg\" }]",
        "range",
        "`geometry.sweep.rotate.axis` has no direction",
        "",
    ),
    // What is missing, and what is too much.
    ("name = \"settle\"", "", "missing", "`stage` needs `name`", "Its name, each once."),
    (
        "file = \"sweep.stl\"",
        "",
        "missing",
        "`geometry.sweep` needs one of `file`, `box`, `plane`, `sweep`, `blade`, `plough`, `wheel`, `drum`, `mixer`, \
         `cylinder`, `cone`, `hopper`",
        "",
    ),
    (
        "count = 38912",
        "count = 38912\nfile = \"bed.csv\"",
        "conflict",
        "`particles.bed` has both `file` and `count`, which exclude each other",
        "",
    ),
    (
        "file = \"sweep.stl\"",
        "plane = { point = [0, 0, 0], normal = \"z\" }\nscale = 2",
        "conflict",
        "`scale` of `geometry.sweep` means nothing together with `plane`",
        "take away `scale` or `plane`",
    ),
    ("duration = \"0.8 s\"", "", "missing", "the stage `till` has no end", "write duration"),
    (
        "duration = \"0.8 s\"",
        "duration = \"0.8 s\"\nuntil = { at_most = 1 }",
        "conflict",
        "`stage.till` has both `until` and `duration`, which exclude each other",
        "keep one of",
    ),
    (
        "duration = \"0.8 s\"",
        "duration = \"0.8 s\"\ncell = { rate = { xx = 1 }, stress = { xx = 1e3 } }",
        "conflict",
        "the component xx of the cell has a rate and a stress",
        "leave one of them out",
    ),
    (
        "density = 1850  ",
        "",
        "missing",
        "`soil` is a material of particles and has no density",
        "write density = … in [material.soil]",
    ),
    (
        "material = \"steel\"\n\n[time]",
        "\n[time]",
        "missing",
        "the walls of the domain have no material",
        "write material",
    ),
    // Values that contradict each other.
    (
        "max = [ 0.35,",
        "max = [-0.35,",
        "order",
        "`domain` has no extent along x: min is -0.35 m, max is -0.35 m",
        "each component",
    ),
    (
        "[\"wall\", \"open\"]",
        "[\"wall\", \"periodic\"]",
        "conflict",
        "only one side across z is periodic",
        "what leaves one side",
    ),
    (
        "static_friction = 0.7",
        "static_friction = 0.5",
        "order",
        "static friction 0.5 is below sliding friction 0.6",
        "give `static_friction` 0.6 or more",
    ),
    (
        "name = \"trim\"",
        "name = \"settle\"",
        "duplicate",
        "two stages are called `settle`",
        "results and --set",
    ),
    (
        "[contact] ",
        "[pair.steel-soil]\nfriction = 0.4\n[contact] ",
        "duplicate",
        "the pair of `steel` and `soil` is given twice",
        "",
    ),
    // Laws.
    (
        "normal = \"hertz\"",
        "normal = \"linear\"",
        "missing",
        "the law `linear` needs its parameter `stiffness`",
        "",
    ),
    (
        "normal = \"hertz\"",
        "normal.linear = { stifness = 1e5, stiffness = 1e5 }",
        "unknown-key",
        "the law `linear` has no parameter `stifness`",
        "did you mean `stiffness`?",
    ),
    (
        "normal = \"hertz\"",
        "normal.linear.stiffness = \"10 N\"",
        "dimension",
        "`contact.normal.linear.stiffness`: `10 N` is a force, not a stiffness",
        "expected is a stiffness",
    ),
    (
        "normal = \"hertz\"",
        "normal.linear.stiffness = 0",
        "range",
        "`contact.normal.linear.stiffness` is 0",
        "allowed is more than 0 N/m",
    ),
    (
        "normal = \"hertz\"",
        "normal = { hertz = {}, linear = {} }",
        "wrong-kind",
        "`contact.normal` must name one law",
        "write contact.normal = \"name\"",
    ),
];

#[test]
fn every_mistake_has_its_message_and_its_advice() {
    for (from, to, kind, message, help) in MISTAKES {
        let error = only(&edited(from, to));
        assert_eq!((error.kind(), error.message()), (*kind, *message));
        assert!(error.advice().unwrap_or_default().starts_with(help), "{message}: {:?}", error.advice());
        assert!(!error.is_warning());
    }
}

#[test]
fn the_underline_stands_below_the_text_that_is_meant() {
    for (from, to, underlined) in [
        ("restitution = 0.5", "restitution = 1.5", "1.5"),
        ("\"7 mm\"", "\"-7 mm\"", "\"-7 mm\""),
        ("material = \"soil\"", "material = \"sol\"", "\"sol\""),
        ("[domain]", "[domian]", "domian"),
        ("name = \"settle\"", "", "[[stage]]"),
        ("move.sweep", "move.swepe", "swepe"),
    ] {
        assert_eq!(only(&edited(from, to)).place().text(), underlined);
    }
}

#[test]
fn all_mistakes_are_told_at_once_in_the_order_of_the_file() {
    let mut text = EXAMPLE.to_owned();
    for (from, to) in [
        ("gravity = [0, 0, -9.81]", "gravity = [0, \"1 mm\", inf]"),
        ("max = [ 0.35,", "max = [-0.45,"),
        ("restitution = 0.5", "restitution = -0.5"),
        ("tangential = \"mindlin\"", "tangential = \"midlin\""),
        ("file = \"sweep.stl\"", "fil = \"sweep.stl\""),
        ("\"2 s\"", "\"2 m\""),
        ("series = \"1 ms\"", "serie = \"1 ms\""),
    ] {
        text = text.replace(from, to);
    }
    let kinds: Vec<_> = report(&text).iter().map(|e| (e.place().line_column().0, e.kind())).collect();
    let expected = [
        (2, "dimension"),
        (2, "range"),
        (6, "order"),
        (19, "range"),
        (29, "unknown-word"),
        (40, "unknown-key"),
        (46, "dimension"),
        (60, "unknown-key"),
    ];
    assert_eq!(kinds, expected);
}

#[test]
fn broken_toml_is_told_with_its_place() {
    let errors = report(&edited("restitution = 0.5", "restitution = = 0.5").replace("[output]", "[output"));
    assert_eq!(
        errors.iter().map(|e| (e.kind(), e.place().line_column().0)).collect::<Vec<_>>(),
        [("syntax", 19), ("syntax", 58)]
    );
    assert!(errors[0].message().starts_with("this is not TOML: "), "{}", errors[0].message());
    let twice = only(&edited("friction = 0.5", "friction = 0.5\nfriction = 0.6"));
    assert_eq!((twice.kind(), twice.message()), ("syntax", "this is not TOML: duplicate key"));
}

#[test]
fn a_file_that_is_not_there_is_told() {
    let errors = Scene::load("nowhere/scene.toml".as_ref(), &[]).unwrap_err();
    assert!(errors[0].message().starts_with("cannot read `nowhere/scene.toml`: "), "{}", errors[0]);
    assert_eq!(errors[0].kind(), "unreadable");
}

#[test]
fn an_empty_file_says_what_a_scene_needs() {
    let messages: Vec<String> = report("").iter().map(ToString::to_string).collect();
    assert_eq!(messages, ["the file needs `domain`", "the file needs `stage`"]);
    assert!(report("stage = []\n").iter().any(|e| e.message() == "the scene has no stage"));
}

#[test]
fn slips_of_a_unit_are_warnings() {
    for (from, to, message) in [
        ("\"2 MPa\"", "2", "`material.soil.youngs_modulus` is 2 Pa, which is unusual"),
        ("density = 1850", "density = 1.85", "`material.soil.density` is 1.85 kg/m^3, which is unusual"),
        ("[\"7 mm\", \"10 mm\"]", "[7, 10]", "particles of `bed` are wider than the domain"),
        (
            "[\"7 mm\", \"10 mm\"]",
            "[\"7 um\", \"10 um\"]",
            "particles of `bed` are less than a ten-thousandth of the domain's width",
        ),
        ("[0.7, 0, 0]", "[0, 0, 0]", "`sweep` does not move in this stage, so nothing is measured"),
        (
            "translate = [-0.62, 0, 0.15]",
            "rotate = [{ axis = \"z\", angle = 30 }]",
            "`geometry.sweep.rotate.angle` is 30 rad, which is unusual",
        ),
    ] {
        let scene = good(&edited(from, to), &[]);
        assert_eq!(scene.warnings.iter().map(SceneError::message).collect::<Vec<_>>(), [message]);
        assert!(scene.warnings[0].is_warning());
    }
}

#[test]
fn programs_get_the_same_as_json() {
    let error = only(&edited("restitution = 0.5", "restitution = 1.5"));
    let json = serde_json::to_value(&error).unwrap();
    assert_eq!(
        json,
        serde_json::json!({
            "severity": "error", "code": "range", "file": "scene.toml", "line": 19, "column": 15, "text": "1.5",
            "message": "`material.soil.restitution` is 1.5", "help": "allowed is 0 to 1",
        })
    );
}

#[test]
fn miette_gets_the_place_and_the_words() {
    use miette::Diagnostic;
    let error = only(&edited("restitution = 0.5", "restitution = 1.5"));
    let label = error.labels().unwrap().next().unwrap();
    assert_eq!(label.label(), Some("out of range"));
    let contents = error.source_code().unwrap().read_span(label.inner(), 0, 0).unwrap();
    assert_eq!((contents.name(), contents.line()), (Some("scene.toml"), 18));
    assert_eq!(error.help().unwrap().to_string(), "allowed is 0 to 1");
    assert_eq!(error.code().unwrap().to_string(), "range");
}

/// Whatever is typed gets an answer: the example cut off anywhere, and with every character lost or doubled.
#[test]
fn no_text_makes_the_reader_panic() {
    let mut refused = 0;
    for (at, c) in EXAMPLE.char_indices() {
        let after = &EXAMPLE[at + c.len_utf8()..];
        for text in [
            EXAMPLE[..at].to_owned(),
            format!("{}{after}", &EXAMPLE[..at]),
            format!("{}{c}{c}{after}", &EXAMPLE[..at]),
        ] {
            if let Err(errors) = Scene::parse("scene.toml", &text, &[]) {
                assert!(!errors.is_empty() && !all(&errors).is_empty());
                refused += 1;
            }
        }
    }
    assert!(refused > EXAMPLE.len(), "only {refused} were refused");
}

#[test]
fn sieve_curves_are_read_and_their_mistakes_named() {
    let with = |opening: &str, passing: &str| {
        let curve = format!("radius = {{ sieve = {{ opening = {opening}, passing = {passing} }} }}");
        edited("radius = { uniform = [\"7 mm\", \"10 mm\"] }", &curve)
    };
    let scene = good(&with("[\"4 mm\", \"8 mm\", 0.016]", "[0, \"30 %\", 1]"), &[]);
    let Origin::Generated { sizes, .. } = &scene.particles[0].origin else { panic!("generated") };
    assert_eq!(*sizes, SizeDistribution::Sieve(vec![(0.002, 0.0), (0.004, 0.3), (0.008, 1.0)]));
    for (opening, passing, message) in [
        ("[0.004, 0.008, 0.016]", "[0, 1]", "a sieve curve of 3 openings and 2 shares"),
        ("[0.008, 0.004]", "[0, 1]", "the opening 0.004 m follows 0.008 m"),
        ("[0.004, 0.006, 0.008, 0.01]", "[0, 0.5, 0.4, 1]", "the share 0.4 follows 0.5"),
        ("[0.004, 0.008]", "[\"10 %\", 1]", "the shares go from 0.1 to 1"),
        ("[0.004]", "[0, 1]", "`particles.bed.radius.sieve.opening` is a list of 1"),
        ("[0.004, \"8 kg\"]", "[0, 1]", "`8 kg` is a mass, not a length"),
        ("[0.004, 0.008]", "[0, 2]", "`particles.bed.radius.sieve.passing` is 2"),
    ] {
        let error = only(&with(opening, passing));
        assert!(error.message().contains(message), "{error:#}");
    }
}
