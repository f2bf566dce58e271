//! `glebe run`: a scene from beginning to end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use glebe_io::output::summary::{Status, Summary};
use glebe_io::scene::SceneError;
use serde_json::json;

use super::bar::{Watch, catch_interrupts, interrupted};
use super::check::{SceneArgs, duration, prepared};
use super::ui::shell_word;
use super::{Ended, Problem, Ui};
use crate::device::Device;
use crate::run::{Existing, Settings, default_bed_folder};

/// Runs a scene and writes its results into a folder
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe run field/scene.toml
  glebe run field/scene.toml --out fast --set stage.till.move.sweep.velocity=[1.5,0,0]
  glebe run field/scene.toml --device gpu:1     on the second graphics processor
  glebe run field/scene.toml --resume           after Ctrl-C, a crash or a full disk
  glebe run field/scene.toml --force --profile  again, with the share of time per phase")]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    /// Wall time between checkpoints [s] [default: `checkpoint_wall` of the scene]
    #[arg(long, value_name = "SECONDS")]
    checkpoint_every: Option<u32>,
    /// Prints the share of time per phase
    #[arg(long)]
    profile: bool,
}

/// Where and how to compute, for every verb that runs worlds of files.
#[derive(Debug, clap::Args)]
pub(super) struct ComputeArgs {
    /// Output folder [default: `out` beside the file]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where to compute: auto, cpu, gpu, gpu:N or cuda:N, as `glebe devices` lists them
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: Device,
    /// Threads to use [default: all]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Continues what is in the output folder, to the same bits
    #[arg(long, conflicts_with = "force")]
    pub resume: bool,
    /// Replaces the results of an earlier run
    #[arg(long)]
    pub force: bool,
    /// Neither takes nor keeps settled beds
    #[arg(long)]
    pub no_cache: bool,
    /// Prints errors and warnings only
    #[arg(long, short)]
    pub quiet: bool,
}

impl ComputeArgs {
    /// Starts as many threads as asked for.
    pub(super) fn start_threads(&self) -> Result<(), Problem> {
        let Some(threads) = self.threads else { return Ok(()) };
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(threads))
            .build_global()
            .map_err(|e| Problem::Failed(format!("{threads} threads cannot be started: {e}")))
    }

    /// What is done with results that are there.
    pub(super) fn existing(&self) -> Existing {
        match (self.resume, self.force) {
            (true, _) => Existing::Resume,
            (_, true) => Existing::Replace,
            _ => Existing::Refuse,
        }
    }

    /// The command that goes on with what `verb` left of `file` in `out`.
    pub(super) fn resume_with(&self, verb: &str, file: &Path, out: &Path, sets: &[String]) -> String {
        let [file, out] = [file, out].map(|path| shell_word(&path.display().to_string()));
        let device =
            if self.device == Device::Auto { String::new() } else { format!(" --device {}", self.device) };
        format!("glebe {verb} {file} --out {out} --resume{device}{}", repeat(sets))
    }
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let compute = &args.compute;
    let ui = &ui.quieted(compute.quiet);
    catch_interrupts().map_err(Problem::Failed)?;
    compute.start_threads()?;
    let scene = args.scene.load()?;
    // Before particles are placed, which can take minutes.
    let device = compute.device.open(scene.generated())?;
    let built = args.scene.build(&scene, ui)?;
    // Its errors point into the scene, which those of the run itself cannot.
    let (constants, _) = prepared(&built)?;
    let chosen = device.admit(&[constants])?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let out = compute.out.clone().unwrap_or_else(|| args.scene.folder().join("out"));
    if interrupted() {
        return Ok(before_the_start(ui));
    }
    let settings = Settings {
        backend: chosen.backend,
        existing: compute.existing(),
        beds: default_bed_folder().filter(|_| !compute.no_cache),
        checkpoint_every: Duration::from_secs_f64(
            args.checkpoint_every.map_or(scene.checkpoint_wall, f64::from),
        ),
        checkpoint_time: scene.checkpoint,
        checkpoint_history: scene.checkpoint_history,
        warnings: built.warnings.iter().map(one_line).collect(),
        ..Settings::new(&out)
    };
    let mut watch = Watch::new(ui);
    let summary = crate::run::run(built.world.clone(), &settings, &mut watch)?;
    drop(watch);

    if args.profile {
        ui.note(profile(&summary).trim_end());
    }
    let resume = compute.resume_with("run", &args.scene.scene, &out, &args.scene.sets);
    match summary.status {
        Status::Done => {
            let mut value = json!(summary);
            value["out"] = json!(out);
            ui.result(&value, if compute.quiet { String::new() } else { told(&summary, &out) }.as_str());
            Ok(Ended::Done)
        }
        Status::Interrupted => {
            let mut value = json!(summary);
            value["resume"] = json!(resume);
            ui.result(&value, "");
            ui.note(&format!("interrupted; the state is kept. To go on: {resume}"));
            Ok(Ended::Interrupted)
        }
        _ => Err(Problem::Failed(format!(
            "{}\nThe series, frames and checkpoints up to here are in {}{}",
            summary.reason.as_deref().unwrap_or("the run failed"),
            out.display(),
            // A guard stops a run at the same step again; a device may be well again.
            if summary.state_hash.is_empty() {
                format!(", complete up to the last checkpoint. To go on from it: {resume}")
            } else {
                String::new()
            },
        ))),
    }
}

pub(super) fn before_the_start(ui: &Ui) -> Ended {
    ui.note("interrupted before the first step; nothing was written");
    Ended::Interrupted
}

/// The `--set` arguments again: a run can only be resumed with them.
fn repeat(sets: &[String]) -> String {
    sets.iter().flat_map(|set| [" --set ".to_owned(), shell_word(set)]).collect()
}

/// A warning of the scene, with its place, for the summary.
fn one_line(warning: &SceneError) -> String {
    let place = warning.place();
    format!("{}:{}: {warning}", place.source().name(), place.line_column().0)
}

fn told(s: &Summary, out: &std::path::Path) -> String {
    let p = &s.performance;
    let mut text = format!(
        "{} particles, {} lost; {} steps in {} ({:.2} M particle-steps/s on {})\n",
        s.particles.count,
        s.particles.lost.len(),
        p.steps,
        duration(p.wall_s),
        p.particle_steps_per_second / 1e6,
        s.device
    );
    // Writing to a string cannot fail.
    for stage in &s.stages {
        for (name, m) in stage.measures.iter().filter(|(_, m)| m.n > 0) {
            let _ = match m.n {
                1 => writeln!(text, "{} {name}: {:.5}", stage.name, m.mean),
                _ => writeln!(text, "{} {name}: {:.5} ± {:.3}", stage.name, m.mean, m.std),
            };
        }
    }
    let _ = write!(text, "state {}\nresults in {}", s.state_hash, out.display());
    text
}

/// Wall time by phase. Phases of one step run one after the other, so they add up; what is left is
/// sampling.
fn profile(s: &Summary) -> String {
    let p = &s.performance;
    let mut rows: Vec<(&str, f64)> = p.phases.iter().map(|(name, s)| (name.as_str(), *s)).collect();
    let rest = p.wall_s - rows.iter().map(|(_, s)| s).sum::<f64>();
    rows.push(("sampling and other", rest.max(0.0)));
    rows.sort_by(|a, b| b.1.total_cmp(&a.1));
    let line = |(name, seconds): &(&str, f64)| {
        format!("{name:<20} {seconds:>9.2} s {:>6.1} %\n", 100.0 * seconds / p.wall_s)
    };
    rows.iter().map(line).collect()
}
