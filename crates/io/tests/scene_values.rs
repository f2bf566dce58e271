//! What a good scene becomes: values, defaults, overrides, the schema.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod scene_common;

use std::f64::consts::PI;

use glebe_engine::generate::SizeDistribution;
use glebe_engine::spec::{Component, Drive, Rotation, Side, Step, Surveyed, Window};
use glebe_io::scene::{GeometryShape, Origin, Scene, SceneError, schema};
use glebe_io::tool::{Sweep, Tool};
use glebe_physics::{ContactEnd, History, IntegratorKind, LawChoice, MixingRule, PairLaws, ShearModulusRule};
use scene_common::{EXAMPLE, edited, good};
use serde_json::Value as Json;

fn parse(text: &str) -> Scene {
    with(text, &[])
}

fn with(text: &str, sets: &[&str]) -> Scene {
    good(text, &owned(sets))
}

fn owned(sets: &[&str]) -> Vec<String> {
    sets.iter().map(ToString::to_string).collect()
}

fn attempt(text: &str, sets: &[&str]) -> Result<Scene, Vec<SceneError>> {
    Scene::parse("scene.toml", text, &owned(sets))
}

#[test]
fn the_example_of_the_manual_means_what_it_says() {
    let scene = parse(EXAMPLE);
    assert_eq!(scene.title, "A sweep through sandy soil");
    assert_eq!(scene.gravity, [0.0, 0.0, -9.81]);
    assert_eq!((scene.domain.min, scene.domain.max), ([-0.35, -0.30, 0.0], [0.35, 0.30, 1.2]));
    assert_eq!(scene.domain.sides, [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]]);
    assert_eq!((scene.time.step, scene.time.integrator), (Step::Auto, IntegratorKind::Euler));
    assert_eq!((scene.guards.overlap_limit, scene.guards.overlap_stops), (0.3, true));
    let soil = &scene.materials[0];
    assert_eq!((soil.density, soil.youngs_modulus, soil.static_friction), (1850.0, 2e6, 0.7));
    assert_eq!(scene.pairs[0].materials, ["soil", "steel"]);
    assert_eq!((scene.pairs[0].values.friction, scene.pairs[0].values.restitution), (Some(0.5), None));
    assert_eq!(scene.contact.rolling, LawChoice::named("constant-torque"));
    let Origin::Generated { count, sizes, fill, .. } = &scene.particles[0].origin else {
        panic!("not generated")
    };
    assert_eq!((*count, fill.as_str()), (38912, "rain"));
    assert_eq!(*sizes, SizeDistribution::Uniform { min: 0.007, max: 0.01 });
    assert_eq!(scene.geometry[0].shape.value, GeometryShape::File("sweep.stl".into()));
    assert_eq!(scene.geometry[0].translate, [-0.62, 0.0, 0.15]);
    let [settle, trim, till] = &scene.stages[..] else { panic!("not three stages") };
    assert_eq!((settle.until.kinetic_energy_below, settle.until.at_most), (Some(0.1), Some(2.0)));
    assert_eq!(trim.remove, Some(([0.0, 0.0, 1.0], 0.3)));
    assert_eq!((till.until.at_most, till.moves[0].1.motion.velocity), (Some(0.8), [0.7, 0.0, 0.0]));
    assert_eq!(
        (till.measures[0].surface.as_str(), till.measures[0].component),
        ("sweep", Component::Force(0))
    );
    assert_eq!(till.measures[0].window, Window::Displacement(0.28, 0.56));
    assert_eq!((scene.sampling.frames, scene.sampling.series), (Some(0.02), 0.001));
    assert!(scene.warnings.is_empty());
    // Steel is nowhere defined, and the log says what was taken.
    assert_eq!(scene.materials[1].name, "steel");
    assert!(scene.notes[0].starts_with("material `steel` is built in"), "{:?}", scene.notes);
}

/// Uses every table and most keys.
const EVERYTHING: &str = r#"
    title = "all"
    gravity = ["0 m/s^2", 0, -1.62]
    seed = 7
    mixing = { friction = "min", shear_modulus = "gpudem" }
    [domain]
    min = [0, 0, 0]
    max = ["1 m", "100 cm", 2]
    sides = { x = "periodic", y = ["open", "wall"] }
    material = "hard-steel"
    [time]
    step = "2 us"
    integrator = "velocity-verlet"
    overlap_limit = "warn"
    force = true
    [material]
    sand = { density = "2650 kg/m^3", youngs_modulus = "50 MPa", poissons_ratio = 0.2, restitution = "30 %", friction = 0.4 }
    hard-steel = { youngs_modulus = "200 GPa", poissons_ratio = 0.3, restitution = 0.5, friction = 0.3 }
    [pair."hard-steel-sand"]
    rolling_friction = 0.1
    cohesion = 0.5
    [pair."sand-sand".contact]
    rolling = "epsd"
    cohesion = { jkr = { work_of_adhesion = "50 mJ/m^2" } }
    [contact]
    end = "no-tension"
    history = "unbounded"
    local_damping = 0.2
    [contact.normal.linear]
    stiffness = "100 kN/m"
    [particles.grains]
    material = "sand"
    count = 10
    radius = { normal = { mean = "5 mm", std = "1 mm" } }
    region = { min = [0, 0, 1], max = [1, 1, 2] }
    fill = "lattice"
    solid_fraction = 0.1
    velocity = [0, 0, "-1 m/s"]
    [particles.dust]
    material = "sand"
    count = 5
    radius = { log_normal = { median = 0.003, sigma = 0.2, max = 0.004 } }
    [geometry.tool]
    sweep = { width = "30 cm", lift_angle = "20 deg" }
    material = "hard-steel"
    rotate = [{ axis = "z", angle = "90 deg" }, { axis = [0, 3, 4], angle = -0.1 }]
    scale = [1, 2, 1]
    translate = [0.5, 0.5, "30 cm"]
    [geometry.drum]
    drum = { radius = 0.4, length = 1 }
    material = "hard-steel"
    motion.rotation = { axis = "y", rate = "60 rpm" }
    [geometry.floor]
    plane = { point = [0, 0, 0.1], normal = [0, 0, 2] }
    material = "sand"
    [[stage]]
    name = "shake"
    duration = 1
    insert = ["tool"]
    remove.beyond = { axis = "-x", limit = 0 }
    move.floor.oscillation = { direction = "z", amplitude = "1 mm", frequency = "50 Hz", phase = "90 deg" }
    move.tool = { rotation = { axis = "z", rate = 1 } }
    measure.torque = { of = "drum.ty", over_time = ["0.5 s", 1] }
    measure.pull = { of = "floor.draught" }
    [output]
    energy_ledger = false
    checkpoint = "0.5 s"
    checkpoint_history = false
"#;

#[test]
fn every_key_arrives() {
    let scene = parse(EVERYTHING);
    assert_eq!((scene.seed, scene.gravity), (7, [0.0, 0.0, -1.62]));
    assert_eq!(scene.domain.sides, [[Side::Periodic; 2], [Side::Open, Side::Wall], [Side::Wall; 2]]);
    assert_eq!((scene.time.step, scene.time.force), (Step::Fixed(2e-6), true));
    assert_eq!(scene.time.integrator, IntegratorKind::VelocityVerlet);
    assert_eq!((scene.guards.overlap_stops, scene.guards.overlap_limit), (false, 0.3));
    assert_eq!((scene.mixing.friction, scene.mixing.restitution), (MixingRule::Min, MixingRule::Mean));
    assert_eq!(scene.shear_modulus, ShearModulusRule::Gpudem);
    let [sand, steel] = &scene.materials[..] else { panic!("not two materials") };
    assert_eq!((sand.restitution, sand.static_friction, sand.rolling_friction), (0.3, 0.4, 0.0));
    assert_eq!((steel.name.as_str(), steel.density), ("hard-steel", 0.0));
    assert_eq!(scene.pairs[0].materials, ["hard-steel", "sand"]);
    assert_eq!(
        (scene.pairs[0].values.rolling_friction, scene.pairs[0].values.cohesion),
        (Some(0.1), Some(0.5))
    );
    assert_eq!(scene.pairs[0].values.laws, PairLaws::default());
    let jkr = LawChoice::named("jkr").with("work_of_adhesion", 0.05);
    let laws =
        PairLaws { rolling: Some(LawChoice::named("epsd")), cohesion: Some(jkr), ..PairLaws::default() };
    assert_eq!(scene.pairs[1].values.laws, laws);
    assert_eq!(scene.contact.normal, LawChoice::named("linear").with("stiffness", 1e5));
    assert_eq!((scene.contact.end, scene.contact.history), (ContactEnd::NoTension, History::Unbounded));
    assert_eq!(scene.local_damping, 0.2);
    assert_eq!(scene.particles[0].velocity, [0.0, 0.0, -1.0]);
    let sizes = |i: usize| match &scene.particles[i].origin {
        Origin::Generated { sizes, .. } => sizes.clone(),
        _ => panic!("not generated"),
    };
    let SizeDistribution::Normal { min, max, .. } = sizes(0) else { panic!("not normal") };
    assert!((min - 0.002).abs() < 1e-15 && (max - 0.008).abs() < 1e-15, "{min} {max}");
    let SizeDistribution::LogNormal { min, max, .. } = sizes(1) else { panic!("not log-normal") };
    assert_eq!((min, max), (0.003 * (-0.6_f64).exp(), 0.004));
    let tool = &scene.geometry[0];
    let GeometryShape::Tool(Tool::Sweep(sweep)) = tool.shape.value else { panic!("not a sweep") };
    assert!((sweep.lift_angle - 20.0).abs() < 1e-12 && sweep.width == 0.3, "{sweep:?}");
    assert_eq!((tool.scale, tool.translate), ([1.0, 2.0, 1.0], [0.5, 0.5, 0.3]));
    assert_eq!(tool.rotate, [([0.0, 0.0, 1.0], PI / 2.0), ([0.0, 0.6, 0.8], -0.1)]);
    let turning = Rotation { axis: [0.0, 1.0, 0.0], center: [0.0; 3], rate: 2.0 * PI };
    assert!(scene.geometry[1].motion.about_origin && scene.geometry[1].motion.poses.is_none());
    assert_eq!(scene.geometry[1].motion.motion.rotation, Some(turning));
    let plane = GeometryShape::Plane { point: [0.0, 0.0, 0.1], normal: [0.0, 0.0, 1.0] };
    assert_eq!(scene.geometry[2].shape.value, plane);
    let stage = &scene.stages[0];
    assert_eq!(stage.remove, Some(([-1.0, 0.0, 0.0], 0.0)));
    assert_eq!(stage.insert, ["tool"]);
    let shaking = stage.moves[0].1.motion.oscillation.unwrap();
    assert_eq!((shaking.amplitude, shaking.frequency, shaking.phase), ([0.0, 0.0, 0.001], 50.0, PI / 2.0));
    assert_eq!(
        (stage.measures[0].component, stage.measures[0].window),
        (Component::Torque(1), Window::Time(0.5, 1.0))
    );
    assert_eq!((stage.measures[1].component, stage.measures[1].window), (Component::Draught, Window::Stage));
    assert_eq!((scene.sampling.energy_ledger, scene.checkpoint), (false, Some(0.5)));
    assert!(!scene.checkpoint_history);
}

#[test]
fn a_cell_deforms_at_rates() {
    let rate = |set| with(EXAMPLE, &[set]).stages[0].deformation.map(|d| d.drive);
    let drive = [0.5, 0.0, 0.0, 0.0, 0.0, -2.0].map(Drive::Rate);
    assert_eq!(rate("stage.settle.cell={ rate = { xx = \"0.5 1/s\", xy = -2 } }"), Some(drive));
    assert_eq!(rate("stage.settle.cell={}"), Some([Drive::Rate(0.0); 6]));
    assert_eq!(rate("seed=1"), None);
}

#[test]
fn a_servo_goes_for_stresses() {
    let scene = with(
        EXAMPLE,
        &[
            "stage.settle.cell={ stress = { xx = \"100 kPa\", yy = 1e5 }, rate = { zz = 0.1 }, control_steps = 7 }",
            "stage.settle.until.stress_within=1 %",
        ],
    );
    let held = Drive::Stress(1e5);
    let [free, moved] = [0.0, 0.1].map(Drive::Rate);
    let d = scene.stages[0].deformation.unwrap();
    assert_eq!(d.drive, [held, held, moved, free, free, free]);
    assert_eq!((d.inertial_number, d.control_steps), (1e-3, Some(7)));
    assert_eq!(scene.stages[0].until.stress_within, Some(0.01));
}

#[test]
fn laws_take_units_of_adhesion() {
    let choice = |sets: &[&str]| with(EXAMPLE, sets).contact.cohesion;
    let jkr = choice(&["contact.cohesion.jkr.work_of_adhesion='50 mJ/m^2'"]);
    assert_eq!(jkr, LawChoice::named("jkr").with("work_of_adhesion", 0.05));
    let sjkr = choice(&["contact.cohesion.sjkr.energy_density='20 kJ/m^3'"]);
    assert_eq!(sjkr, LawChoice::named("sjkr").with("energy_density", 2e4));
}

/// A law of bonds, for all pairs but one, and the stage that makes them.
#[test]
fn bonds_have_a_law_and_a_stage() {
    let text = edited("[pair.soil-steel]", "[pair.soil-steel]\ncontact.bond = \"none\"");
    let scene = with(
        &text,
        &[
            "contact.bond.parallel.normal_stiffness='10 GN/m^3'",
            "contact.bond.parallel.shear_stiffness='4 GN/m^3'",
            "contact.bond.parallel.tensile_strength='100 kPa'",
            "contact.bond.parallel.shear_strength=2e5",
            "contact.bond.parallel.gap='0.1 mm'",
            "stage.till.bond=true",
        ],
    );
    let law = LawChoice::named("parallel").with("normal_stiffness", 1e10).with("shear_stiffness", 4e9);
    let law = law.with("tensile_strength", 1e5).with("shear_strength", 2e5).with("gap", 1e-4);
    assert_eq!(scene.contact.bond, law);
    assert_eq!(scene.pairs[0].values.laws.bond, Some(LawChoice::named("none")));
    let bonding: Vec<_> = scene.stages.iter().filter(|s| s.bond).map(|s| s.name.value.as_str()).collect();
    assert_eq!(bonding, ["till"]);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let law = "parallel = { normal_stiffness = 1e10, shear_stiffness = 1e9, tensile_strength = 1e5, shear_strength = 1e5 }";
    let unmade =
        parse(&edited("[pair.soil-steel]", &format!("[pair.soil-steel]\ncontact.bond = {{ {law} }}")));
    let [warning] = &unmade.warnings[..] else { panic!("{:?}", unmade.warnings) };
    assert_eq!(warning.message(), "a law of bonds is chosen, but no stage bonds particles");
}

#[test]
fn pairs_of_names_with_dashes_are_told_apart() {
    let text = edited(
        "[pair.soil-steel]",
        "[material.wet-soil-a]\nyoungs_modulus = 1e6\npoissons_ratio = 0.3\nrestitution = 0.1\nfriction = 0.3\n[pair.steel-wet-soil-a]",
    );
    assert_eq!(parse(&text).pairs[0].materials, ["steel", "wet-soil-a"]);
}

#[test]
fn overrides_reach_every_kind_of_place() {
    let scene = with(
        EXAMPLE,
        &[
            "material.soil.density=2000",
            "material.soil.youngs_modulus = 5 MPa",
            "stage.till.duration=0.2",
            "stage.till.move.sweep.velocity=[2, 0, 0]",
            "stage.till.measure.draught_force.over_displacement.1=0.4",
            "geometry.sweep.translate.2=\"20 cm\"",
            "geometry.sweep.rotate=[{ axis = \"z\", angle = \"5 deg\" }]",
            "particles.bed.radius=8.5 mm",
            "time.force=true",
            "time.overlap_limit=warn",
            "mixing.friction=harmonic",
            "pair.soil-soil.rolling_friction=0.1",
            "domain.sides.z=open",
            "contact.normal.linear.stiffness=\"1 kN/m\"",
            "output.frames='1 s'",
        ],
    );
    assert_eq!((scene.materials[0].density, scene.materials[0].youngs_modulus), (2000.0, 5e6));
    let till = &scene.stages[2];
    assert_eq!((till.until.at_most, till.moves[0].1.motion.velocity), (Some(0.2), [2.0, 0.0, 0.0]));
    assert_eq!(till.measures[0].window, Window::Displacement(0.28, 0.4));
    assert_eq!(scene.geometry[0].translate, [-0.62, 0.0, 0.2]);
    assert_eq!(scene.geometry[0].rotate, [([0.0, 0.0, 1.0], 5f64.to_radians())]);
    let Origin::Generated { sizes, .. } = &scene.particles[0].origin else { panic!("not generated") };
    assert_eq!(*sizes, SizeDistribution::Constant(0.0085));
    assert!(scene.time.force && !scene.guards.overlap_stops);
    assert_eq!(scene.mixing.friction, MixingRule::Harmonic);
    assert_eq!(scene.pairs[1].materials, ["soil", "soil"]);
    assert_eq!(scene.domain.sides[2], [Side::Open; 2]);
    assert_eq!(scene.contact.normal, LawChoice::named("linear").with("stiffness", 1000.0));
    assert_eq!(scene.sampling.frames, Some(1.0));
}

#[test]
fn later_overrides_win() {
    let sets = [
        "seed=3",
        "particles.bed.count=5",
        "seed=4",
        "particles.bed.radius.normal.mean=0.01",
        "particles.bed.radius={ uniform = [0.01, 0.02] }",
    ];
    let scene = with(EXAMPLE, &sets);
    assert_eq!(scene.seed, 4);
    let Origin::Generated { sizes, count, .. } = &scene.particles[0].origin else { panic!("not generated") };
    assert_eq!((*count, sizes.clone()), (5, SizeDistribution::Uniform { min: 0.01, max: 0.02 }));
}

#[test]
fn overrides_that_lead_nowhere_are_told() {
    for (set, kind, message, help) in [
        (
            "material.sol.density=1",
            "set",
            "`material.sol.density` leads nowhere",
            "did you mean `soil`? Allowed: `soil`",
        ),
        ("material.soil.densty=1", "set", "`material.soil.densty` leads nowhere", "did you mean `density`?"),
        (
            "stage.tll.duration=1",
            "set",
            "`stage.tll.duration` leads nowhere",
            "did you mean `till`? Allowed: `settle`, `trim`, `till`",
        ),
        ("tme.step=1", "set", "`tme.step` leads nowhere", "did you mean `time`?"),
        ("title.x=1", "set", "`title.x` leads nowhere", "the value before it has no parts"),
        (
            "geometry.sweep.translate.5=1",
            "set",
            "`geometry.sweep.translate.5` leads nowhere",
            "there are 3, counted from 0",
        ),
        ("contact.normal.herz.x=1", "set", "`contact.normal.herz.x` leads nowhere", "did you mean `hertz`?"),
        ("material.soil.density", "set", "`material.soil.density` sets nothing", "write path=value"),
        ("..=1", "set", "`..` is not a path", "write names with dots"),
        ("gravity=[1, 2", "syntax", "this is not TOML", ""),
        // These lead somewhere, and the value is wrong: the same errors as in the file.
        ("material.soil.restitution=1.5", "range", "`material.soil.restitution` is 1.5", "allowed is 0 to 1"),
        (
            "time.integrator=exat",
            "unknown-word",
            "`exat` is not a value of `time.integrator`",
            "did you mean `exact`?",
        ),
        (
            "pair.soil-stel.friction=1",
            "undefined",
            "`soil-stel` is not two materials",
            "did you mean `soil-steel`?",
        ),
    ] {
        let errors = attempt(EXAMPLE, &[set]).unwrap_err();
        let [error] = &errors[..] else { panic!("{set}: {errors:?}") };
        assert_eq!((error.kind(), error.place().source().name()), (kind, "--set"), "{set}");
        assert!(error.message().starts_with(message), "{set}: {error}");
        assert!(error.advice().unwrap_or_default().starts_with(help), "{set}: {:?}", error.advice());
    }
    let errors = attempt(EXAMPLE, &["material.soil.restitution=1.5", "tme.step=1"]).unwrap_err();
    assert_eq!(errors.len(), 2);
    assert_eq!(
        format!("{:#}", errors.iter().find(|e| e.kind() == "range").unwrap()),
        "\
--set:1:27: error: `material.soil.restitution` is 1.5
1 | material.soil.restitution=1.5
  |                           ^^^ out of range
  help: allowed is 0 to 1
"
    );
}

/// Has each table once and no more than it must.
const LEAST: &str = r#"
    [domain]
    min = [0, 0, 0]
    max = [1, 1, 1]
    material = "m"
    [material.m]
    density = 1000
    youngs_modulus = 1e6
    poissons_ratio = 0.3
    restitution = 0.5
    friction = 0.5
    [particles.p]
    material = "m"
    count = 1
    radius = 0.1
    [geometry.sweep]
    sweep = {}
    material = "m"
    [geometry.drum]
    drum = { radius = 1, length = 1 }
    material = "m"
    [[stage]]
    name = "s"
    duration = 1
    measure.f = { of = "drum.fx" }
    move.drum.oscillation = { direction = "x", amplitude = 1, frequency = 1 }
"#;

/// Collects `path=default` for every default of the schema that a value of LEAST has a place for.
fn defaults(schema: &Json, value: &Json, path: &str, out: &mut Vec<String>) {
    let join = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    for choice in schema["anyOf"].as_array().into_iter().flatten() {
        if choice["type"] == "object" && value.is_object() {
            defaults(choice, value, path, out);
        }
    }
    for (key, property) in schema["properties"].as_object().into_iter().flatten() {
        let default = &property["default"];
        let inner = value.get(key).or_else(|| default.as_object().map(|_| default));
        if let Some(inner) = inner {
            defaults(property, inner, &join(key), out);
        } else if !default.is_null() {
            out.push(format!("{}={default}", join(key)));
        }
    }
    if let Some(each) = schema["additionalProperties"].as_object().map(|o| Json::Object(o.clone())) {
        for (key, inner) in value.as_object().into_iter().flatten() {
            defaults(&each, inner, &join(key), out);
        }
    }
    if let (Some(items), true) = (schema.get("items"), value.is_array()) {
        for inner in value.as_array().into_iter().flatten() {
            let name = inner["name"].as_str().unwrap_or_default();
            defaults(items, inner, &join(name), out);
        }
    }
}

/// All values of a scene, without their places.
fn values(s: &Scene) -> String {
    format!(
        "{:#?}",
        (
            (&s.title, s.seed, s.gravity, &s.domain, s.time, s.guards, &s.materials, &s.pairs, s.mixing),
            (s.shear_modulus, &s.contact, s.local_damping, &s.particles, &s.geometry, &s.stages, s.sampling),
        )
    )
}

#[test]
fn every_default_of_the_schema_is_the_one_that_is_used() {
    let document = toml_to_json(LEAST);
    let mut sets = Vec::new();
    defaults(&schema(), &document, "", &mut sets);
    assert!(sets.len() > 50, "only {sets:#?}");
    for expected in [
        "time.step=\"auto\"",
        "geometry.sweep.sweep.lift_angle=\"25 deg\"",
        "stage.s.insert=[]",
        "material.m.rolling_friction=0.0",
    ] {
        assert!(sets.iter().any(|s| s == expected), "{expected} is not in {sets:#?}");
    }
    let plain = with(LEAST, &[]);
    for set in &sets {
        assert_eq!(values(&with(LEAST, &[set])), values(&plain), "{set}");
    }
}

#[test]
fn the_default_sweep_is_that_of_the_tool() {
    let scene = parse(LEAST);
    let GeometryShape::Tool(Tool::Sweep(sweep)) = scene.geometry[0].shape.value else {
        panic!("not a sweep")
    };
    let rounded =
        Sweep { sweep_angle: sweep.sweep_angle.round(), lift_angle: sweep.lift_angle.round(), ..sweep };
    assert_eq!(rounded, Sweep::default());
    assert!(
        (sweep.sweep_angle - rounded.sweep_angle).abs() + (sweep.lift_angle - rounded.lift_angle).abs()
            < 1e-12
    );
}

fn toml_to_json(text: &str) -> Json {
    fn convert(value: &toml::de::DeValue<'_>) -> Json {
        use toml::de::DeValue;
        match value {
            DeValue::String(s) => Json::from(s.as_ref()),
            DeValue::Integer(i) => Json::from(i.as_str().parse::<i64>().unwrap()),
            DeValue::Float(f) => Json::from(f.as_str().parse::<f64>().unwrap()),
            DeValue::Boolean(b) => Json::from(*b),
            DeValue::Array(items) => items.iter().map(|i| convert(i.get_ref())).collect(),
            DeValue::Table(t) => {
                t.iter().map(|(k, v)| (k.get_ref().to_string(), convert(v.get_ref()))).collect()
            }
            DeValue::Datetime(_) => panic!("no dates in scenes"),
        }
    }
    convert(&toml::de::DeValue::Table(toml::de::DeTable::parse(text).unwrap().into_inner()))
}

/// Whether `value` obeys `schema`: the keywords that the schema uses, except `pattern`.
fn obeys(root: &Json, schema: &Json, value: &Json) -> bool {
    let all = |key: &str, value: &Json| {
        schema[key].as_array().into_iter().flatten().filter(|s| obeys(root, s, value)).count()
    };
    schema.as_object().unwrap().iter().all(|(keyword, s)| match keyword.as_str() {
        "$ref" => obeys(root, root.pointer(s.as_str().unwrap().trim_start_matches('#')).unwrap(), value),
        "type" => match s.as_str().unwrap() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "number" => value.is_number(),
            "integer" => value.is_i64(),
            "boolean" => value.is_boolean(),
            other => panic!("type {other}"),
        },
        "enum" => s.as_array().unwrap().contains(value),
        "const" => s == value,
        "required" => s.as_array().unwrap().iter().all(|k| value.get(k.as_str().unwrap()).is_some()),
        "properties" => {
            s.as_object().unwrap().iter().all(|(k, s)| value.get(k).is_none_or(|v| obeys(root, s, v)))
        }
        "additionalProperties" => value
            .as_object()
            .into_iter()
            .flatten()
            .all(|(k, v)| schema["properties"].get(k).is_some() || s.is_object() && obeys(root, s, v)),
        "items" => value.as_array().into_iter().flatten().all(|v| obeys(root, s, v)),
        "minItems" => value.as_array().is_none_or(|a| a.len() as u64 >= s.as_u64().unwrap()),
        "maxItems" => value.as_array().is_none_or(|a| a.len() as u64 <= s.as_u64().unwrap()),
        "minProperties" => value.as_object().is_none_or(|a| a.len() as u64 >= s.as_u64().unwrap()),
        "maxProperties" => value.as_object().is_none_or(|a| a.len() as u64 <= s.as_u64().unwrap()),
        "minimum" => value.as_f64().is_none_or(|x| x >= s.as_f64().unwrap()),
        "exclusiveMinimum" => value.as_f64().is_none_or(|x| x > s.as_f64().unwrap()),
        "maximum" => value.as_f64().is_none_or(|x| x <= s.as_f64().unwrap()),
        "anyOf" => all("anyOf", value) > 0,
        "oneOf" => all("oneOf", value) == 1,
        "allOf" => all("allOf", value) == s.as_array().unwrap().len(),
        "not" => !obeys(root, s, value),
        "$schema" | "$defs" | "title" | "description" | "default" | "examples" | "pattern" => true,
        other => panic!("the schema uses `{other}`, which this check does not know"),
    })
}

#[test]
fn the_schema_accepts_what_the_parser_accepts_and_refuses_mistakes() {
    let schema = schema();
    for text in [EXAMPLE, EVERYTHING, LEAST] {
        assert!(obeys(&schema, &schema, &toml_to_json(text)));
    }
    for (from, to) in [
        ("restitution = 0.5", "restitution = 1.5"),
        ("density = 1850  ", "densty = 1850   "),
        ("normal = \"hertz\"", "normal = \"herz\""),
        ("normal = \"hertz\"", "normal = \"linear\""),
        ("x = \"wall\"", "x = \"walls\""),
        ("count = 38912", "count = 38912\nfile = \"bed.csv\""),
        ("file = \"sweep.stl\"", ""),
        ("name = \"settle\"", ""),
        ("duration = \"0.8 s\"", "duration = \"0.8 s\"\nuntil = { at_most = 1 }"),
        ("[0.7, 0, 0]", "[0.7, 0]"),
    ] {
        assert!(!obeys(&schema, &schema, &toml_to_json(&edited(from, to))), "{to}");
    }
}

#[test]
fn the_schema_documents_every_key() {
    fn check(schema: &Json, path: &str) {
        for (key, property) in schema["properties"].as_object().into_iter().flatten() {
            let doc = property["description"].as_str().unwrap_or_default();
            assert!(doc.len() > 5, "{path}.{key} has no documentation");
            check(property, &format!("{path}.{key}"));
            check(&property["additionalProperties"], key);
            check(&property["items"], key);
        }
    }
    check(&schema(), "");
}

#[test]
fn surveys_are_of_particles_at_the_end_of_a_stage() {
    let box_ = "{ min = [0, 0, 0], max = [\"10 cm\", 0.2, 0.3] }";
    let density = format!("density = {{ of = \"bulk-density\", region = {box_} }}");
    let survey = |what: &str| format!("stage.settle.survey={{ {what} }}");
    let scene = with(EXAMPLE, &[&survey(&format!("slope = {{ of = \"angle-of-repose\" }}, {density}"))]);
    let found: Vec<_> = scene.stages[0].surveys.iter().map(|s| (s.name.as_str(), s.of)).collect();
    let region = Surveyed::BulkDensity { min: [0.0; 3], max: [0.1, 0.2, 0.3] };
    assert_eq!(found, [("slope", Surveyed::AngleOfRepose), ("density", region)]);
    let wrong = |set: &str| {
        let errors = attempt(EXAMPLE, &[set]).map(|scene| panic!("{scene:?}")).unwrap_err();
        errors.iter().map(|error| format!("{error:#}")).collect::<Vec<_>>().concat()
    };
    for (set, part) in [
        (survey("a = { of = \"angle-of-rest\" }"), "angle-of-repose"),
        (survey("a = { of = \"bulk-density\" }"), "`survey.a` needs `region`"),
        (survey(&density.replace("0.3]", "-0.3]")), "no extent along z"),
        (survey(&density.replace("bulk-density", "angle-of-repose")), "means nothing of an angle of repose"),
        (
            survey("draught_force = { of = \"angle-of-repose\" }").replace("settle", "till"),
            "the name of a measure of this stage already",
        ),
    ] {
        assert!(wrong(&set).contains(part), "no `{part}` for {set} in {}", wrong(&set));
    }
}
