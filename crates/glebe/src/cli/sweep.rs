//! `glebe sweep`: the worlds of a study.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use glebe_io::output::summary::Status;
use glebe_io::study::Study;
use glebe_study::sweep::{Plan, Settings, Summary, reason, run as run_sweep};
use serde_json::json;

use super::bar::{Watch, catch_interrupts, interrupted};
use super::check::{duration, folder_of};
use super::run::{ComputeArgs, before_the_start};
use super::{Ended, Problem, Ui};
use crate::device::memory;
use crate::run::default_bed_folder;

/// Runs many variants of a scene together and writes a table, plots and fits into a folder
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe new field --template sweep --quick     a study to start from
  glebe sweep field/study.toml
  glebe sweep field/study.toml --out fine --set vary.depth.count=9
  glebe sweep field/study.toml --resume        after Ctrl-C, a crash or a full disk: the rest only

Worlds that are refused or fail are rows with their reason; the exit code is 0 if any world is done.")]
pub(super) struct Args {
    /// The study file
    study: PathBuf,
    /// Replaces a value of the study: keys joined by dots, such as vary.density.count=8
    #[arg(long = "set", value_name = "PATH=VALUE")]
    sets: Vec<String>,
    #[command(flatten)]
    compute: ComputeArgs,
    /// Batches to divide the worlds into [default: as few as memory allows]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    batches: Option<u32>,
    /// Wall time between checkpoints of worlds under way [s]
    #[arg(long, value_name = "SECONDS", default_value_t = 600)]
    checkpoint_every: u64,
}

/// A study whose worlds were looked at, of which at least one can be run; none if interrupted.
pub(super) fn plan(path: &Path, sets: &[String], ui: &Ui) -> Result<Option<Plan>, Problem> {
    let study = Study::load(path, sets).map_err(Problem::Scene)?;
    let plan = Plan::new(study, interrupted).map_err(|e| Problem::Input(e.to_string()))?;
    let Some(plan) = plan else { return Ok(None) };
    let refused = plan.refused();
    for (w, planned) in plan.worlds.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            if refused == plan.worlds.len() {
                ui.note(&format!(
                    "every world is refused; of the first ({}):",
                    planned.world.sets.join(", ")
                ));
                return Err(Problem::Scene(errors.clone()));
            }
            ui.warn(&format!("world {w} is refused: {}", reason(errors)));
        }
    }
    plan.warnings.iter().for_each(|warning| ui.warn(warning));
    Ok(Some(plan))
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let compute = &args.compute;
    let ui = &ui.quieted(compute.quiet);
    catch_interrupts().map_err(Problem::Failed)?;
    compute.start_threads()?;
    // Before worlds are made, which can take minutes; how large they are is seen then.
    let device = compute.device.open(0)?;
    let Some(plan) = plan(&args.study, &args.sets, ui)? else { return Ok(before_the_start(ui)) };
    let chosen = device.admit(plan.first())?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let out = compute.out.clone().unwrap_or_else(|| folder_of(&args.study).join("out"));
    if interrupted() {
        return Ok(before_the_start(ui));
    }
    let settings = Settings {
        backend: chosen.backend,
        existing: compute.existing(),
        beds: default_bed_folder().filter(|_| !compute.no_cache),
        batches: args.batches.map(|n| n as usize),
        memory: memory(chosen.backend),
        checkpoint_every: Duration::from_secs(args.checkpoint_every),
        commit: option_env!("GLEBE_COMMIT").map(str::to_owned),
        sets: args.sets.clone(),
        ..Settings::new(&out)
    };
    let mut watch = Watch::new(ui);
    let summary = run_sweep(&plan, &settings, &mut watch)?;
    drop(watch);

    let mut value = json!(summary);
    value["out"] = json!(out);
    let resume = compute.resume_with("sweep", &args.study, &out, &args.sets);
    if summary.status == Status::Interrupted {
        value["resume"] = json!(resume);
        ui.result(&value, "");
        ui.note(&format!("interrupted; what has ended is kept. To go on: {resume}"));
        return Ok(Ended::Interrupted);
    }
    if let Some(reason) = &summary.reason {
        return Err(Problem::Failed(format!("{reason}\nWhat has ended is kept. To go on: {resume}")));
    }
    if summary.status == Status::Failed {
        return Err(Problem::Failed(format!(
            "no world is done; {} tells why of each",
            out.join("worlds.csv").display()
        )));
    }
    ui.result(&value, if compute.quiet { String::new() } else { told(&summary, &out) }.as_str());
    Ok(Ended::Done)
}

fn told(s: &Summary, out: &Path) -> String {
    let (counts, p) = (s.counts, &s.performance);
    let mut text = format!("{} of {} worlds done", counts.done, counts.worlds);
    // Writing to a string cannot fail.
    for (count, how) in [(counts.failed, "failed"), (counts.refused, "refused")] {
        if count > 0 {
            let _ = write!(text, ", {count} {how}");
        }
    }
    let _ = writeln!(
        text,
        "; {} steps in {} ({:.2} M particle-steps/s on {})",
        p.steps,
        duration(p.wall_s),
        p.particle_steps_per_second / 1e6,
        s.device
    );
    for measured in &s.measures {
        for fitted in &measured.fits {
            let _ = write!(text, "{} over {}", measured.measure.full_name(), fitted.parameter);
            if let Some(f) = fitted.linear {
                let _ = write!(text, ": {:.4e} {:+.4e} x (R² {:.4})", f.a, f.b, f.r2);
            }
            if let Some(f) = fitted.power {
                let _ = write!(text, "; {:.4e} x^{:.3} (R² {:.4})", f.a, f.b, f.r2);
            }
            text.push('\n');
        }
    }
    let _ = write!(text, "results in {}", out.display());
    text
}
