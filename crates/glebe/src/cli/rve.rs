//! `glebe rve`: periodic samples, made, consolidated and loaded.

use std::fmt::Write as _;
use std::path::Path;

use glebe_io::study::Study;
use glebe_study::rve::{Plan, Summary, run as run_rve};
use glebe_study::sweep::reason;

use super::bar::{Watch, catch_interrupts, interrupted};
use super::run::before_the_start;
use super::study::{Came, StudyArgs, counted};
use super::{Ended, Problem, Ui};

/// Makes periodic samples, consolidates and loads them together: curves, averages, scatter
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe new sand --template rve --quick       a study to start from
  glebe rve sand/study.toml
  glebe rve sand/study.toml --set load.program=simple-shear --set seeds=4 --out sheared
  glebe rve sand/study.toml --resume          after Ctrl-C, a crash or a full disk: the rest only

Samples that cannot be made, are refused or fail are rows with their reason; the exit code is 0 if any is done.")]
pub(super) struct Args {
    #[command(flatten)]
    study: StudyArgs,
}

/// A study whose samples were looked at, of which at least one can be run; none if interrupted.
pub(super) fn plan(path: &Path, sets: &[String], ui: &Ui) -> Result<Option<Plan>, Problem> {
    let study = Study::load(path, sets).map_err(Problem::Scene)?;
    if study.rve.is_none() {
        return Err(Problem::Input(format!(
            "{} is no study of periodic samples: write [consolidate] with a pressure into it, or run it with `glebe \
             sweep`",
            path.display()
        )));
    }
    let plan = Plan::new(study, interrupted).map_err(|e| Problem::Input(e.to_string()))?;
    let Some(plan) = plan else { return Ok(None) };
    let refused = plan.refused();
    for (w, planned) in plan.samples.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            if refused == plan.samples.len() {
                ui.note("every sample is refused; of the first:");
                return Err(Problem::Scene(errors.clone()));
            }
            ui.warn(&format!("sample {w} is refused: {}", reason(errors)));
        }
    }
    plan.warnings.iter().for_each(|warning| ui.warn(warning));
    Ok(Some(plan))
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let args = &args.study;
    let compute = &args.compute;
    let ui = &ui.quieted(compute.quiet);
    catch_interrupts().map_err(Problem::Failed)?;
    compute.start_threads()?;
    let device = compute.device.open(0)?;
    let Some(plan) = plan(&args.study, &args.sets, ui)? else { return Ok(before_the_start(ui)) };
    let chosen = device.admit(plan.first())?;
    chosen.note.iter().for_each(|line| ui.note(line));
    if interrupted() {
        return Ok(before_the_start(ui));
    }
    let mut watch = Watch::new(ui);
    let summary = run_rve(&plan, &args.settings(chosen.backend), &mut watch)?;
    drop(watch);
    args.finish("rve", &Came::of(&summary, summary.status, summary.reason.as_deref()), &told(&summary), ui)
}

fn told(s: &Summary) -> String {
    let mut text = counted("samples", s.counts, &s.performance, &s.device);
    for variant in s.variants.iter().filter(|v| v.void_ratio.n > 0) {
        let name = if variant.name.is_empty() { "samples" } else { &variant.name };
        // Writing to a string cannot fail.
        let _ = write!(text, "{name}: e = {:.4}", variant.void_ratio.mean);
        if variant.void_ratio.n > 1 {
            let _ = write!(text, " ± {:.4}", variant.void_ratio.std);
        }
        if variant.peak_ratio.n > 0 {
            let _ = write!(
                text,
                ", largest q/p = {:.3} at a strain of {:.4}, at the end {:.3} and e = {:.4}",
                variant.peak_ratio.mean,
                variant.peak_strain.mean,
                variant.last_ratio.mean,
                variant.last_void_ratio.mean
            );
        }
        text.push('\n');
    }
    text
}
