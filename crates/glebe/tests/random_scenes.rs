//! Scenes by chance: whatever a scene may say, it runs, and momentum and energy are what they must be.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::convert::Infallible;
use std::path::Path;

use glebe::engine::backend::Backend;
use glebe::engine::batch::{Batch, Observer, Sample, Status};
use glebe::engine::prepare;
use glebe::engine::spec::Step;
use glebe::engine::state::State;
use glebe::io::scene::{Scene, SceneError};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

const CASES: u32 = 40;
const STEPS: u64 = 400;
/// The advised step over the step that is taken.
const FINER: f64 = 8.0;
/// Change of momentum as a share of the sum of its parts: what rounding to f32 makes of so many steps.
const MOMENTUM: f64 = 2e-6;
/// Open balance as a share of the energy in play, at 200 steps and more for each collision.
const CLOSURE: f64 = 0.005;

#[derive(Default)]
struct Last(Option<Sample>);

impl Observer for Last {
    type Error = Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Infallible> {
        self.0 = Some(sample.clone());
        Ok(())
    }
}

/// A material that is like none in particular.
fn material(name: &'static str) -> impl Strategy<Value = String> {
    let elastic = (500.0..5000.0, 5.5..8.5, -0.2..0.49, 0.2..1.0);
    let rough = (0.0..1.0, 0.0..0.5, 0.0..0.1);
    (elastic, rough).prop_map(move |((density, log_e, nu, restitution), (friction, more, rolling))| {
        format!(
            "[material.{name}]\ndensity = {density}\nyoungs_modulus = {}\n\
             poissons_ratio = {nu}\nrestitution = {restitution}\n\
             friction = {friction}\nstatic_friction = {}\nrolling_friction = {rolling}\n",
            10f64.powf(log_e),
            friction + more
        )
    })
}

fn word(words: &'static [&'static str]) -> impl Strategy<Value = &'static str> {
    prop::sample::select(words)
}

/// The laws and how they are used; of the integrators those that keep energies at the step that is advised.
fn physics() -> impl Strategy<Value = String> {
    let laws = (word(&["hertz"]), word(&["mindlin", "none"]), word(&["constant-torque", "none"]));
    let ways = (word(&["tension", "no-tension"]), word(&["truncated", "unbounded", "none"]));
    let mixed = (word(&["min", "max", "mean", "harmonic", "geometric"]), word(&["mindlin", "gpudem"]));
    let time = word(&["euler", "velocity-verlet"]);
    (laws, ways, mixed, time, 0.0..2e-3).prop_map(
        |((normal, tangential, rolling), (end, history), (rule, shear), integrator, force)| {
            format!(
                "[time]\nintegrator = \"{integrator}\"\n[mixing]\nfriction = \"{rule}\"\nshear_modulus = \"{shear}\"\n\
                 [contact]\nnormal = \"{normal}\"\n\
                 tangential = \"{tangential}\"\nrolling = \"{rolling}\"\nend = \"{end}\"\n\
                 history = \"{history}\"\n[contact.cohesion.constant]\nforce = {force}\n"
            )
        },
    )
}

/// Laws of every slot with parameters, in all combinations that there are.
fn laws() -> impl Strategy<Value = String> {
    let stiffness = || (4.0..6.0).prop_map(|log: f64| 10f64.powf(log));
    let share = || 0.0..0.8;
    let normal = (stiffness(), 1.0..3.0, share(), share()).prop_flat_map(|(k, ratio, yields, pulls)| {
        prop::sample::select(vec![
            ("hertz", "[contact.normal.hertz]\n".to_owned()),
            ("rve", "[contact.normal.rve]\n".to_owned()),
            ("linear", format!("[contact.normal.linear]\nstiffness = {k}\n")),
            ("hertz-stiffness", format!("[contact.normal.hertz-stiffness]\nstiffness = {k}\ndamping = 100\n")),
            (
                "luding",
                format!(
                    "[contact.normal.luding]\nstiffness = {k}\nunloading_stiffness = {}\nadhesion_stiffness = {}\n",
                    k * ratio,
                    k * pulls
                ),
            ),
            ("eepa", format!("[contact.normal.eepa]\nplasticity = {yields}\nadhesion = {pulls}\n")),
        ])
    });
    let tangential = stiffness().prop_flat_map(|k| {
        prop::sample::select(vec![
            "[contact.tangential.mindlin]\n".to_owned(),
            "[contact.tangential.rve]\n".to_owned(),
            "[contact.tangential.none]\n".to_owned(),
            format!("[contact.tangential.linear]\nstiffness = {}\n", 0.5 * k),
            format!("[contact.tangential.hertz-stiffness]\nstiffness = {}\ndamping = 50\n", 0.5 * k),
        ])
    });
    let rolling = word(&["none", "constant-torque", "chrono", "gpudem", "epsd", "moment-rotation"]);
    let cohesion = share().prop_flat_map(|x| {
        prop::sample::select(vec![
            "[contact.cohesion.none]\n".to_owned(),
            format!("[contact.cohesion.constant]\nforce = {}\n", 1e-3 * x),
            format!("[contact.cohesion.sjkr]\nenergy_density = {}\n", 1e4 * x),
            format!("[contact.cohesion.dmt]\nwork_of_adhesion = {}\n", 0.1 * x),
            format!("[contact.cohesion.jkr]\nwork_of_adhesion = {}\n", 0.1 * x),
            format!(
                "[contact.cohesion.capillary]\nsurface_tension = 0.07\nliquid_content = {}\ncontact_angle = {x}\n",
                0.001 + 0.05 * x
            ),
        ])
    });
    (normal, tangential, rolling, cohesion).prop_map(|((name, normal), tangential, rolling, cohesion)| {
        // JKR stands on Hertz.
        let cohesion = if name != "hertz" && cohesion.contains("jkr]") && !cohesion.contains("sjkr") {
            ""
        } else {
            &cohesion
        };
        // Soft ones meet deeply.
        format!(
            "[time]\noverlap_limit = \"warn\"\n{normal}{tangential}[contact.rolling.{rolling}]\n{cohesion}"
        )
    })
}

fn sizes() -> impl Strategy<Value = String> {
    (word(&["same", "uniform", "normal", "log_normal", "sieve"]), 1e-3..8e-3, 1.05..2.0).prop_map(
        |(kind, r, ratio)| {
            let most = r * ratio;
            match kind {
                "uniform" => format!("{{ uniform = [{r}, {most}] }}"),
                "normal" => format!("{{ normal = {{ mean = {r}, std = {} }} }}", 0.1 * (most - r)),
                "log_normal" => format!("{{ log_normal = {{ median = {r}, sigma = {} }} }}", 0.1 * ratio),
                "sieve" => format!(
                    "{{ sieve = {{ opening = [{}, {}, {}], passing = [0, 0.4, 1] }} }}",
                    2.0 * r,
                    r + most,
                    2.0 * most
                ),
                _ => format!("{r}"),
            }
        },
    )
}

/// A scene: 60 spheres of two materials in a cube just large enough, and how fast they move \[m/s\].
fn scene(
    sides: &'static str,
    gravity: f64,
    physics: BoxedStrategy<String>,
) -> impl Strategy<Value = (String, f64)> {
    let materials = (material("one"), material("two"));
    let fill = word(&["random", "dense", "lattice", "rain"]);
    (materials, physics, sizes(), fill, 0.2..1.0, any::<u32>(), -1.0..1.0).prop_map(
        move |((one, two), physics, sizes, fill, speed, seed, shift)| {
            // The densest lattice of spheres of many sizes is loose already.
            let share = if fill == "lattice" { "" } else { "solid_fraction = 0.3\n" };
            let group = |name: &str, low: f64, high: f64| {
                format!(
                    "[particles.{name}]\nmaterial = \"{name}\"\ncount = 30\n\
                     radius = {sizes}\nfill = \"{fill}\"\n{share}\
                     region = {{ min = [{shift}, 0, {low}], max = [{}, 0.1, {high}] }}\n",
                    shift + 0.1
                )
            };
            let text = format!(
                "seed = {seed}\ngravity = [0, 0, {gravity}]\n{physics}{one}{two}\
                 [domain]\nmin = [{shift}, 0, 0]\nmax = [{}, 0.1, 0.4]\nmaterial = \"two\"\nsides = {sides}\n{}{}\
                 [[stage]]\nname = \"go\"\nduration = 1\n",
                shift + 0.1,
                group("one", 0.0, 0.2),
                group("two", 0.2, 0.4),
            );
            (text, speed)
        },
    )
}

/// What came of a scene: sums of momentum before and after, the sum of its parts' sizes, and the last sample.
struct Outcome {
    before: [f64; 3],
    after: [f64; 3],
    size: f64,
    sample: Sample,
}

fn momentum(state: &State) -> ([f64; 3], f64) {
    let p = &state.particles;
    p.velocity.iter().fold(([0.0; 3], 0.0), |(sum, size), v| {
        let part = v.v.map(|c| f64::from(c) / f64::from(v.inv_mass));
        (std::array::from_fn(|k| sum[k] + part[k]), size + part.iter().map(|c| c * c).sum::<f64>().sqrt())
    })
}

fn run(text: &str, speed: f64) -> Result<Outcome, TestCaseError> {
    let fail = |what: String| TestCaseError::fail(format!("{what}\n{text}"));
    let told = |errors: Vec<SceneError>| match errors[0].kind() {
        // A generator may find no room, as long as it says so.
        "generate" => TestCaseError::reject("no room"),
        _ => fail(format!("{:#}", errors[0])),
    };
    let scene = Scene::parse("scene.toml", text, &[]).map_err(told)?;
    let mut world = scene.build(Path::new(".")).map_err(told)?.world;
    // Towards the middle, so that they meet; with some spin.
    for i in 0..world.particles.len() {
        let x = world.particles.position[i];
        let middle: [f64; 3] =
            std::array::from_fn(|k| 0.5 * (world.domain.origin[k] * 2.0 + world.domain.cell[k][k]));
        let way: [f64; 3] = std::array::from_fn(|k| middle[k] - x[k]);
        let length = way.iter().map(|c| c * c).sum::<f64>().sqrt().max(1e-9);
        world.particles.velocity[i] = way.map(|c| c / length * speed * (1.0 + 0.5 * (i % 3) as f64));
        world.particles.spin[i] = [0.0, speed / 0.01, (i % 5) as f64];
    }
    // At the step that is advised, energies sway by ω dt, which is a third for the stiffest tangential springs.
    let dt = prepare(world.clone()).map_err(|e| fail(e.to_string()))?.0.dt / FINER;
    world.time.step = Step::Fixed(dt);
    world.sampling.series = 20.0 * dt;
    let mut batch = Batch::new(vec![world], Backend::Cpu).map_err(|e| fail(e.1.to_string()))?;
    let (before, size) = momentum(&batch.state(0));
    let mut last = Last::default();
    while batch.running() && batch.progress(0).step < STEPS {
        let Ok(()) = batch.advance(&mut last);
    }
    if let Status::Failed(why) = batch.status(0) {
        return Err(fail(why.to_string()));
    }
    let (after, size_after) = momentum(&batch.state(0));
    let sample = last.0.ok_or_else(|| fail("no sample".to_owned()))?;
    Ok(Outcome { before, after, size: size.max(size_after), sample })
}

fn check(
    sides: &'static str,
    gravity: f64,
    physics: BoxedStrategy<String>,
    judge: impl Fn(&Outcome) -> Result<(), String>,
) {
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let config =
        Config { cases: CASES, failure_persistence: None, max_shrink_iters: 50, ..Config::default() };
    let touching = std::cell::Cell::new(0_u32);
    let outcome =
        TestRunner::new_with_rng(config, rng).run(&scene(sides, gravity, physics), |(text, speed)| {
            let outcome = run(&text, speed)?;
            touching.set(
                touching.get()
                    + u32::from(outcome.sample.contacts > 0 || outcome.sample.ledger.dissipated() > 0.0),
            );
            judge(&outcome).map_err(|what| TestCaseError::fail(format!("{what}\n{text}")))
        });
    outcome.unwrap_or_else(|e| panic!("{e}"));
    assert!(touching.get() > CASES / 2, "particles met in {} of {CASES} scenes only", touching.get());
}

/// Energy that the accounts leave open, as a share of what is in play.
fn open(outcome: &Outcome) -> f64 {
    let l = &outcome.sample.ledger;
    let play = l.translation + l.rotation + l.elastic_normal.abs() + l.elastic_tangential + l.dissipated();
    l.integrator().abs() / play
}

/// Nothing is lost, no cause takes less than nothing, and the accounts close.
fn accounts(outcome: &Outcome) -> Result<(), String> {
    let l = &outcome.sample.ledger;
    let share = open(outcome);
    if outcome.sample.particles != 60 {
        return Err(format!("{} of 60 particles are left", outcome.sample.particles));
    }
    let least = -1e-9 * (l.translation + l.rotation);
    if [l.friction, l.dashpots, l.rolling].iter().any(|x| *x < least) {
        return Err(format!("energy is won where it can only be lost: {l:?}"));
    }
    if share > CLOSURE {
        Err(format!("{:.2} % of the energy is not accounted for: {l:?}", 100.0 * share))
    } else {
        Ok(())
    }
}

/// Without walls.
const PERIODIC: &str = "{ x = \"periodic\", y = \"periodic\", z = \"periodic\" }";

fn momentum_is_kept(outcome: &Outcome) -> Result<(), String> {
    let change: f64 = (0..3).map(|k| (outcome.after[k] - outcome.before[k]).powi(2)).sum::<f64>().sqrt();
    let share = change / outcome.size;
    if share > MOMENTUM { Err(format!("momentum changed by {share:.2e} of its parts")) } else { Ok(()) }
}

#[test]
fn momentum_is_conserved_where_nothing_acts_from_outside() {
    check(PERIODIC, 0.0, physics().boxed(), |outcome| {
        momentum_is_kept(outcome).and_then(|()| accounts(outcome))
    });
}

/// Whatever the laws are, what a body gains another one loses.
#[test]
fn every_law_conserves_momentum() {
    check(PERIODIC, 0.0, laws().boxed(), momentum_is_kept);
}

#[test]
fn energy_is_accounted_for_in_a_box() {
    check("{ x = \"wall\", y = \"periodic\", z = \"wall\" }", -9.81, physics().boxed(), accounts);
}
