//! The command line: what is refused and how, and the verbs that do not run anything.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;

use cli_common::{Place, SCENE};

/// What a bad scene is made of, and the words by which its user finds the mistake.
struct Bad {
    from: &'static str,
    to: &'static str,
    says: &'static [&'static str],
}

/// One mistake each in a scene that is fine otherwise.
const MISTAKES: &[Bad] = &[
    Bad {
        from: "restitution = 0.5\nfriction = 0.5\nstatic",
        to: "restitution = 1.5\nfriction = 0.5\nstatic",
        says: &["`material.soil.restitution` is 1.5", "allowed is 0 to 1", "^^^"],
    },
    Bad {
        from: "radius = { uniform = [\"6 mm\", \"9 mm\"] }",
        to: "radius = \"-6 mm\"",
        says: &["particles.bed.radius", "allowed is more than 0"],
    },
    Bad {
        from: "material = \"soil\"",
        to: "material = \"sol\"",
        says: &["no material is called `sol`", "did you mean `soil`?"],
    },
    Bad {
        from: "step = \"50 us\"",
        to: "step = \"5 ms\"",
        says: &["of the stable step", "choose at most", "time.force = true", "step = \"5 ms\""],
    },
    Bad { from: "count = 250", to: "conut = 250", says: &["has no key `conut`", "did you mean `count`?"] },
    Bad {
        from: "box = { min = [-0.02, -0.02, 0.02], max = [0, 0.02, 0.2] }",
        to: "file = \"cut.stl\"",
        says: &["cut.stl", "cut short", "file = \"cut.stl\""],
    },
    Bad {
        from: "box = { min = [-0.02, -0.02, 0.02], max = [0, 0.02, 0.2] }",
        to: "file = \"nan.stl\"",
        says: &["nan.stl", "line 4", "finite numbers"],
    },
    Bad {
        from: "count = 250\nradius = { uniform = [\"6 mm\", \"9 mm\"] }\nfill = \"rain\"",
        to: "file = \"nan.csv\"",
        says: &["nan.csv", "line 3, column 2 (y)", "not finite"],
    },
    Bad {
        from: "count = 250\nradius = { uniform = [\"6 mm\", \"9 mm\"] }\nfill = \"rain\"",
        to: "file = \"negative.csv\"",
        says: &["negative.csv", "line 2", "-0.01"],
    },
    Bad {
        from: "count = 250\nradius = { uniform = [\"6 mm\", \"9 mm\"] }\nfill = \"rain\"",
        to: "file = \"inside.csv\"",
        says: &["start inside each other", "number 0 of `bed` and 1 of `bed`"],
    },
];

fn with_bad_files() -> Place {
    let place = Place::new();
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    place
        .write("cut.stl", format!("solid tool\n{facet}facet normal 0 0 1\nouter loop\nvertex 0 0 0\n"))
        .write(
            "nan.stl",
            format!("solid tool\n{}endsolid tool\n", facet.replace("vertex 0 0 0", "vertex 0 nan 0")),
        )
        .write("nan.csv", "x,y,z,R\n0,0,0.1,0.01\n0,NaN,0.2,0.01\n")
        .write("negative.csv", "x,y,z,R\n0,0,0.1,-0.01\n")
        .write("inside.csv", "x,y,z,R\n0,0,0.1,0.01\n0,0,0.105,0.01\n");
    place
}

#[test]
fn bad_scenes_are_refused_with_the_place_and_nothing_is_written() {
    let place = with_bad_files();
    for bad in MISTAKES {
        let text = SCENE.replacen(bad.from, bad.to, 1);
        assert_ne!(text, SCENE, "`{}` is not in the scene", bad.from);
        place.write("scene.toml", &text);
        for verb in ["check", "run"] {
            place.glebe(&[verb, "scene.toml"]).expect(2).says(bad.says).says(&["scene.toml:"]);
        }
        assert!(!place.path("out").exists(), "something was written for `{}`", bad.to);
    }
}

#[test]
fn every_mistake_is_told_at_once() {
    let place = Place::new();
    let text = SCENE
        .replacen("density", "densty", 1)
        .replacen("[domain]", "[domian]", 1)
        .replacen("5 MPa", "5 mm", 1);
    place.write("scene.toml", text);
    let ended = place.glebe(&["check", "scene.toml", "--json"]);
    let errors = ended.expect(2).json();
    assert_eq!(errors["status"], "error");
    assert_eq!(errors["exit_code"], 2);
    let found: Vec<(&str, u64)> = (errors["errors"].as_array().unwrap().iter())
        .map(|e| (e["code"].as_str().unwrap(), e["line"].as_u64().unwrap()))
        .collect();
    for expected in [("unknown-key", 4), ("unknown-key", 14), ("dimension", 15)] {
        assert!(found.contains(&expected), "{expected:?} not in {found:?}");
    }
}

#[test]
fn an_output_folder_that_exists_is_refused_and_kept() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    fs::create_dir(place.path("out")).unwrap();
    place.write("out/mine.txt", "precious");
    place.glebe(&["run", "scene.toml"]).expect(2).says(&[
        "not empty",
        "mine.txt",
        "--out",
        "--resume",
        "--force",
    ]);
    assert_eq!(fs::read_dir(place.path("out")).unwrap().count(), 1);
    place.glebe(&["run", "scene.toml", "--resume"]).expect(2).says(&["no run to resume"]);
}

#[test]
fn set_is_checked_like_the_file() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    place
        .glebe(&["check", "scene.toml", "--set", "material.soil.restitution=1.5"])
        .expect(2)
        .says(&["--set:1:", "allowed is 0 to 1"]);
    place
        .glebe(&["check", "scene.toml", "--set", "stage.psh.duration=1"])
        .expect(2)
        .says(&["leads nowhere", "did you mean `push`?"]);
    let sets = ["--set", "particles.bed.count=123", "--set", "stage.push.duration=0.1"];
    let found = place.glebe(&[&["check", "scene.toml", "--json"], &sets[..]].concat());
    let found = found.expect(0).json();
    assert_eq!(found["particles"], 123);
    assert!((found["most_time_s"].as_f64().unwrap() - 0.6).abs() < 1e-12, "{found}");
}

#[test]
fn check_tells_what_would_be_run() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let found = place.glebe(&["check", "scene.toml", "--json"]).expect(0).json();
    assert_eq!(found["status"], "ok");
    assert_eq!(found["particles"], 250);
    assert_eq!(found["triangles"], 12);
    assert_eq!(found["surfaces"], 7, "floor, block and five sides");
    assert_eq!(found["step_s"], 5e-5);
    assert!((found["most_steps"].as_f64().unwrap() - 16000.0).abs() < 2.0, "{found}");
    let text = place.glebe(&["check", "scene.toml"]);
    assert!(text.expect(0).stdout.contains("settle, trim, push"), "{}", text.stdout);
}

#[test]
fn a_device_that_is_not_there_is_refused_by_every_verb() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    place.write("study.toml", "scene = \"scene.toml\"\n[vary.seed]\npath = \"seed\"\nvalues = [1]\n");
    let verbs: [&[&str]; 6] = [
        &["run", "scene.toml"],
        &["sweep", "study.toml"],
        &["check", "study.toml"],
        &["check", "scene.toml"],
        &["validate", "B11", "--out", "out"],
        &["bench", "--sizes", "300", "--beds", "mono"],
    ];
    for verb in verbs {
        let on = |device: &str| place.glebe(&[verb, &["--device", device]].concat());
        on("abacus").expect(2).says(&["abacus", "auto, cpu, gpu, gpu:NUMBER or cuda:NUMBER"]);
        on("gpu:1000").expect(2).says(&["cannot be used", "What to do:"]);
        on("cuda:1000").expect(2).says(&["cannot be used", "What to do:"]);
        if cfg!(not(feature = "gpu")) {
            on("gpu").expect(2).says(&["no GPU backend", "--device cpu"]);
        }
    }
    assert!(!place.path("out").exists());
    let wrong = place.glebe(&["run", "scene.toml", "--device", "gpu:1000", "--json"]);
    assert_eq!(wrong.expect(2).json()["errors"][0]["code"], "input");
}

#[test]
fn devices_are_listed_with_what_is_missing_and_how_to_get_it() {
    let place = Place::new();
    let listing = place.glebe(&["devices", "--json"]).expect(0).json();
    let devices = listing["devices"].as_array().unwrap();
    assert_eq!((&devices[0]["name"], &devices[0]["usable"]), (&"cpu".into(), &true.into()));
    let auto = devices.iter().find(|d| d["name"] == listing["auto"]).unwrap();
    assert_eq!(auto["usable"], true);
    assert_ne!(auto["kind"], "software", "auto never takes a program that acts as a graphics processor");
    for missing in listing["unavailable"].as_array().unwrap() {
        for part in ["what", "why", "remedy"] {
            assert!(!missing[part].as_str().unwrap().is_empty(), "{missing}");
        }
    }
    let hardware = devices.iter().any(|d| !["cpu", "software"].contains(&d["kind"].as_str().unwrap()));
    assert!(hardware || listing["auto"] == "cpu", "{listing:#}");
    assert!(hardware || !listing["unavailable"].as_array().unwrap().is_empty(), "{listing:#}");
    let text = place.glebe(&["devices"]);
    for device in devices {
        assert!(text.expect(0).stdout.contains(device["name"].as_str().unwrap()), "{}", text.stdout);
    }
}

#[test]
fn a_run_names_its_device() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let short = ["--set", "stage.push.duration=0.001", "--set", "stage.settle.until.at_most=0.001"];
    let on = |device: &str, out: &str| {
        place.glebe(&[&["run", "scene.toml", "--device", device, "--out", out], &short[..]].concat())
    };
    on("cpu", "cpu").expect(0);
    assert!(place.summary("cpu")["device"].as_str().unwrap().starts_with("cpu ("));
    // One line says what `auto` took.
    let auto = on("auto", "auto");
    assert_eq!(auto.expect(0).stderr.lines().filter(|l| l.starts_with("device: ")).count(), 1, "{auto:?}");
    assert!(auto.stderr.contains(place.summary("auto")["device"].as_str().unwrap()), "{auto:?}");

    let listing = place.glebe(&["devices", "--json"]).json();
    if !listing["devices"].as_array().unwrap().iter().any(|d| d["name"] == "gpu:0") {
        let needed = cfg!(feature = "gpu") && std::env::var_os("CI").is_some();
        assert!(!needed, "{listing:#}");
        return;
    }
    on("gpu:0", "gpu").expect(0);
    assert!(place.summary("gpu")["device"].as_str().unwrap().starts_with("gpu:0 ("));
    // A graphics processor has to be one unless it is named.
    let kind = |d: &serde_json::Value| d["kind"] == "software";
    if listing["devices"].as_array().unwrap()[1..].iter().all(kind) {
        on("gpu", "other").expect(2).says(&["no graphics processor was found", "--device gpu:0 forces"]);
    }
}

#[test]
fn the_schema_is_json_and_knows_the_scene() {
    let schema = Place::new().glebe(&["schema"]).expect(0).json();
    assert!(schema["$schema"].as_str().unwrap().contains("json-schema.org"));
    for key in ["domain", "material", "particles", "geometry", "stage", "output"] {
        assert!(schema["properties"].get(key).is_some(), "no `{key}`");
    }
}

#[test]
fn completions_name_the_verbs() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let place = Place::new();
        let ended = place.glebe(&["completions", shell]);
        for verb in
            ["new", "check", "run", "sweep", "rve", "calibrate", "validate", "bench", "devices", "schema"]
        {
            assert!(ended.expect(0).stdout.contains(verb), "{shell} does not complete `{verb}`");
        }
    }
}

#[test]
fn help_comes_with_examples_on_every_verb() {
    let place = Place::new();
    for verb in [
        "new",
        "check",
        "run",
        "sweep",
        "rve",
        "calibrate",
        "validate",
        "bench",
        "devices",
        "schema",
        "completions",
    ] {
        let ended = place.glebe(&[verb, "--help"]);
        assert!(ended.expect(0).stdout.contains(&format!("glebe {verb}")), "{verb}");
        assert!(ended.stdout.contains("Example"), "{verb}:\n{}", ended.stdout);
    }
    let wrong = place.glebe(&["rnu", "scene.toml", "--json"]);
    assert_eq!(wrong.expect(2).json()["errors"][0]["severity"], "error");
}

#[test]
fn new_makes_scenes_that_check_and_overwrites_nothing() {
    let place = Place::new();
    for template in [
        "tillage",
        "drum",
        "silo",
        "conveyor",
        "plate",
        "deposition",
        "triaxial",
        "sweep",
        "rve",
        "calibration",
    ] {
        for (quick, most) in [(false, 40_000), (true, 6_000)] {
            let name = format!("{template}{most}");
            let args = ["new", &name, "--template", template, "--quick"];
            place.glebe(&args[..if quick { 5 } else { 4 }]).expect(0);
            let scene = format!("{name}/scene.toml");
            let ended = place.glebe(&["check", &scene, "--json"]);
            let found = ended.expect(0).json();
            assert_eq!(found["warnings"], serde_json::json!([]), "{name}");
            assert!(found["particles"].as_u64().unwrap() <= most, "{found}");
            place.glebe(&args[..4]).expect(2).says(&["exists already"]);
        }
    }
}
