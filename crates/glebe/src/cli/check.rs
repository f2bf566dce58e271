//! `glebe check`: everything about a scene, a study or a calibration that can be known without running it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glebe_engine::backend::BYTES_PER_PARTICLE;
use glebe_engine::spec::Until;
use glebe_engine::state::State;
use glebe_engine::{Constants, prepare};
use glebe_io::scene::{BuiltScene, Scene};
use glebe_io::study::{Calibration, Study};
use glebe_study::sweep::Measure;
use serde_json::json;

use super::{Ended, Problem, Ui};
use crate::device::Device;

/// Rate that run times are estimated with \[particle-steps/s per core\]: a settled bed with friction and
/// energy ledger. Machines differ by a factor of two either way.
const RATE: f64 = 4e6;

/// Checks a scene, a study or a calibration without running it: all errors at once, counts, memory, run time
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe check field/scene.toml
  glebe check field/scene.toml --set material.soil.density=2000
  glebe check field/scene.toml --device gpu
  glebe check field/scene.toml --json
  glebe check field/study.toml                  each world of a study, or a calibration")]
pub(super) struct Args {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Where it is to compute: auto, cpu, gpu, gpu:N or cuda:N, as `glebe devices` lists them
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    device: Device,
}

/// The scene, for every verb that reads one.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct SceneArgs {
    /// The scene file
    pub scene: PathBuf,
    /// Replaces a value of the scene: keys joined by dots, stages by their name
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub sets: Vec<String>,
}

impl SceneArgs {
    /// Reads the scene.
    pub(super) fn load(&self) -> Result<Scene, Problem> {
        Scene::load(&self.scene, &self.sets).map_err(Problem::Scene)
    }

    /// Builds the scene, and says what was found.
    pub(super) fn build(&self, scene: &Scene, ui: &Ui) -> Result<BuiltScene, Problem> {
        let built = scene.build(self.folder()).map_err(Problem::Scene)?;
        ui.scene(&built.warnings);
        for mesh in &built.meshes {
            let span = |k: usize| format!("{:.4} … {:.4}", mesh.min[k], mesh.max[k]);
            let report = mesh.report.to_string().replace('\n', "; ");
            let placed = format!("placed at x {}, y {}, z {} m", span(0), span(1), span(2));
            ui.note(&format!("geometry `{}`: {report}; {placed}", mesh.name));
        }
        built.notes.iter().for_each(|line| ui.note(line));
        Ok(built)
    }

    /// The folder that the scene's files are relative to.
    pub(super) fn folder(&self) -> &Path {
        folder_of(&self.scene)
    }
}

/// The folder of a file.
pub(super) fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Has the engine look at the world as well; its refusals point into the scene.
pub(super) fn prepared(built: &BuiltScene) -> Result<(Arc<Constants>, State), Problem> {
    prepare(built.world.clone()).map_err(|e| Problem::Scene(vec![built.locate(&e)]))
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    if Calibration::is_at(&args.scene.scene) {
        return calibration(args, ui);
    }
    if Study::is_at(&args.scene.scene) {
        return study(args, ui);
    }
    let scene = args.scene.load()?;
    let device = args.device.open(scene.generated())?;
    let built = args.scene.build(&scene, ui)?;
    let (constants, _) = prepared(&built)?;
    let chosen = device.admit(std::slice::from_ref(&constants))?;
    chosen.note.iter().for_each(|line| ui.note(line));
    constants.warnings.iter().for_each(|w| ui.warn(w));
    let particles = constants.count;
    let to_come = constants.most_to_come();
    let most = particles as u64 + to_come.unwrap_or(0);
    let triangles: usize = built.meshes.iter().map(|m| m.report.triangles).sum();
    let stages = &constants.spec.stages;
    let longest = |u: &Until| {
        if u.at_most.is_none() && u.kinetic_energy_below.is_some() {
            None
        } else {
            Some(u.at_most.unwrap_or(0.0))
        }
    };
    let time: Option<f64> = stages.iter().map(|s| longest(&s.until)).sum();
    let steps = time.map(|t| (t / constants.dt).ceil());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let seconds = steps.map(|s| s * most as f64 / (RATE * cores as f64));
    let memory = chosen.backend.memory(std::slice::from_ref(&constants));
    let of_host = BYTES_PER_PARTICLE * most as f64;
    // A device was asked about what is there at the start.
    let bytes = memory
        .map_or(of_host, |m| if to_come == Some(0) { m.needed as f64 } else { of_host.max(m.needed as f64) });
    let of_device = memory.and_then(|m| m.device);
    let limits = constants.limits;
    let warnings: Vec<serde_json::Value> = built
        .warnings
        .iter()
        .map(|w| json!(w))
        .chain(constants.warnings.iter().map(|w| json!({ "severity": "warning", "message": w })))
        .collect();
    let value = json!({
        "status": "ok",
        "particles": particles,
        "most_particles": to_come.map(|_| most),
        "surfaces": constants.boundaries.len(),
        "triangles": triangles,
        "stages": stages.iter().map(|s| &s.name).collect::<Vec<_>>(),
        "step_s": constants.dt,
        "stable_step_s": finite(limits.rayleigh),
        "collision_s": finite(limits.collision),
        "most_time_s": time,
        "most_steps": steps,
        "memory_bytes": bytes,
        "device_memory_bytes": of_device,
        "device": chosen.backend.device(),
        "devices": [{ "name": "cpu", "threads": cores, "most_wall_s": seconds }],
        "warnings": warnings,
    });
    let unknown = "not known: a stage waits for its energy without at_most";
    let text = format!(
        "{} is fine.\n\
         particles  {particles}{}\n\
         surfaces   {} with {triangles} triangles, domain sides included\n\
         stages     {}\n\
         step       {:.3e} s ({:.0} % of the Rayleigh time, 1/{:.0} of the shortest impact)\n\
         length     {}\n\
         memory     {}\n\
         run time   {} on the CPU with {cores} threads\n\
         device     {}",
        args.scene.scene.display(),
        through_inlets(to_come),
        constants.boundaries.len(),
        stages.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", "),
        constants.dt,
        100.0 * constants.dt / limits.rayleigh,
        limits.collision / constants.dt,
        match (time, steps) {
            (Some(t), Some(n)) => format!("at most {t} s, {n:.2e} steps"),
            _ => unknown.to_owned(),
        },
        needed(bytes, memory.is_some(), of_device),
        seconds.map_or(unknown.to_owned(), |s| format!("at most about {}", duration(s))),
        chosen.backend.device(),
    );
    ui.result(&value, &text);
    Ok(Ended::Done)
}

/// What inlets add to the particles at the start.
fn through_inlets(to_come: Option<u64>) -> String {
    match to_come {
        Some(0) => String::new(),
        Some(more) => format!(" at the start, at most {more} more through inlets"),
        None => " at the start; no end of what inlets bring is known, memory and run time are without it"
            .to_owned(),
    }
}

/// How much memory it takes, and of how much. What a device will need at first is known; dense beds make it grow.
fn needed(bytes: f64, known: bool, of_device: Option<u64>) -> String {
    let least = if known { "at least" } else { "about" };
    let of = of_device.map_or_else(String::new, |all| format!(" of the device's {:.0} MB", all as f64 / 1e6));
    format!("{least} {:.0} MB{of}", (bytes / 1e6).max(1.0))
}

/// What the worlds of a study come to.
struct Estimate {
    particles: usize,
    steps: f64,
    particle_steps: f64,
}

impl Estimate {
    /// Of worlds with so many particles and steps.
    fn of(worlds: impl Iterator<Item = (usize, u64)>) -> Self {
        let mut all = Self { particles: 0, steps: 0.0, particle_steps: 0.0 };
        for (particles, steps) in worlds {
            all.particles += particles;
            all.steps += steps as f64;
            all.particle_steps += steps as f64 * particles as f64;
        }
        all
    }

    fn bytes(&self) -> f64 {
        BYTES_PER_PARTICLE * self.particles as f64
    }

    /// Wall time \[s\] on cores.
    fn seconds(&self, cores: usize) -> f64 {
        self.particle_steps / (RATE * cores as f64)
    }
}

fn study(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let file = &args.scene.scene;
    if Study::load(file, &args.scene.sets).is_ok_and(|study| study.rve.is_some()) {
        return samples(args, ui);
    }
    let device = args.device.open(0)?;
    let Some(plan) = super::sweep::plan(file, &args.scene.sets, ui)? else {
        return Ok(Ended::Interrupted);
    };
    let chosen = device.admit(plan.first())?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let facts = plan.worlds.iter().filter_map(|w| w.fate.as_ref().ok());
    let all = Estimate::of(facts.map(|f| (f.particles, f.steps)));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let measures: Vec<String> = plan.measures.iter().map(Measure::full_name).collect();
    let worlds = plan.worlds.iter().map(|w| {
        let refused = w.fate.as_ref().err();
        json!({ "set": w.world.sets, "errors": refused })
    });
    let value = json!({
        "status": "ok",
        "worlds": worlds.collect::<Vec<_>>(),
        "refused": plan.refused(),
        "particles": all.particles,
        "measures": measures,
        "most_steps": all.steps,
        "memory_bytes": all.bytes(),
        "device": chosen.backend.device(),
        "devices": [{ "name": "cpu", "threads": cores, "most_wall_s": all.seconds(cores) }],
        "warnings": plan.warnings,
    });
    let text = format!(
        "{} is fine.\n\
         worlds     {}{}\n\
         particles  {} in all worlds\n\
         measures   {}\n\
         length     at most {:.2e} steps in all worlds\n\
         memory     about {:.0} MB in one batch\n\
         run time   at most about {} on the CPU with {cores} threads, without settled beds\n\
         device     {}",
        file.display(),
        plan.worlds.len(),
        refusals(plan.refused()),
        all.particles,
        measures.join(", "),
        all.steps,
        (all.bytes() / 1e6).max(1.0),
        duration(all.seconds(cores)),
        chosen.backend.device(),
    );
    ui.result(&value, &text);
    Ok(Ended::Done)
}

fn refusals(refused: usize) -> String {
    if refused > 0 { format!(", {refused} refused") } else { String::new() }
}

/// A study of periodic samples. How long they take to come to rest is not known before.
fn samples(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let file = &args.scene.scene;
    let device = args.device.open(0)?;
    let Some(plan) = super::rve::plan(file, &args.scene.sets, ui)? else { return Ok(Ended::Interrupted) };
    let chosen = device.admit(plan.first())?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let facts = || plan.samples.iter().filter_map(|sample| sample.fate.as_ref().ok());
    let all = Estimate::of(facts().map(|f| (f.particles, f.steps)));
    let prepared = facts().filter(|f| f.rve.prepare.is_some()).count();
    let seeds = plan.study.rve.as_ref().map_or(1, |rve| rve.seeds);
    let worlds = plan.samples.iter().map(|sample| {
        let set = &plan.variants[sample.variant].sets;
        json!({ "variant": sample.variant, "set": set, "errors": sample.fate.as_ref().err() })
    });
    let value = json!({
        "status": "ok",
        "worlds": worlds.collect::<Vec<_>>(),
        "variants": plan.variants.len(),
        "refused": plan.refused(),
        "prepared": prepared,
        "particles": all.particles,
        "memory_bytes": all.bytes(),
        "device": chosen.backend.device(),
        "warnings": plan.warnings,
    });
    let text = format!(
        "{} is fine.\n\
         samples    {} of {} variants and {seeds} seeds{}\n\
         particles  {} in all samples\n\
         prepared   {prepared}\n\
         memory     about {:.0} MB in one batch\n\
         run time   not known: samples are consolidated until they are at rest\n\
         device     {}",
        file.display(),
        plan.samples.len(),
        plan.variants.len(),
        refusals(plan.refused()),
        all.particles,
        (all.bytes() / 1e6).max(1.0),
        chosen.backend.device(),
    );
    ui.result(&value, &text);
    Ok(Ended::Done)
}

fn calibration(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let device = args.device.open(0)?;
    let plan = super::calibrate::plan(&args.scene.scene, &args.scene.sets, ui)?;
    let chosen = device.admit(plan.middle())?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let c = &plan.calibration;
    let (round, evaluations) = plan.evaluations();
    let particles: usize = plan.particles.iter().sum();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let seconds = plan.particle_steps * evaluations as f64 / (RATE * cores as f64);
    let bytes = BYTES_PER_PARTICLE * (particles * round) as f64;
    let free: Vec<&str> = c.free.iter().map(|f| f.name.as_str()).collect();
    let targets: Vec<&str> = c.targets.iter().map(|t| t.name.as_str()).collect();
    let value = json!({
        "status": "ok",
        "free": free,
        "targets": targets,
        "experiments": c.experiments.len(),
        "method": c.method.name(),
        "most_evaluations": evaluations,
        "evaluations_of_a_round": round,
        "particles": particles,
        "most_steps": plan.steps as f64 * evaluations as f64,
        "memory_bytes": bytes,
        "device": chosen.backend.device(),
        "devices": [{ "name": "cpu", "threads": cores, "most_wall_s": seconds }],
        "warnings": plan.warnings,
    });
    let text = format!(
        "{} is fine.\n\
         free         {}\n\
         targets      {}\n\
         method       {}, at most {evaluations} evaluations, {round} in a round\n\
         experiments  {} with {particles} particles in all\n\
         length       at most {:.2e} steps in an evaluation\n\
         memory       about {:.0} MB for a round in one batch\n\
         run time     at most about {} on the CPU with {cores} threads, without settled beds\n\
         device       {}",
        args.scene.scene.display(),
        free.join(", "),
        targets.join(", "),
        c.method.name(),
        c.experiments.len(),
        plan.steps as f64,
        (bytes / 1e6).max(1.0),
        duration(seconds),
        chosen.backend.device(),
    );
    ui.result(&value, &text);
    Ok(Ended::Done)
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

/// `1 h 20 min`, `3 min 5 s`, `12 s`, `350 ms`
pub(super) fn duration(seconds: f64) -> String {
    if seconds > 0.0 && seconds < 1.0 {
        return format!("{:.0} ms", (1e3 * seconds).ceil());
    }
    let s = seconds.round().max(0.0) as u64;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min {} s", s / 60, s % 60),
        _ => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}
