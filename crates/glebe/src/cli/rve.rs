//! `glebe rve`: periodic samples, made, consolidated and loaded.

use std::fmt::Write as _;
use std::path::Path;

use glebe_io::study::Study;
use glebe_study::rve::{Plan, Summary, run as run_rve};

use super::bar::interrupted;
use super::study::{Came, StudyArgs, counted, tell_refused};
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
    let fates: Vec<_> =
        plan.samples.iter().map(|planned| planned.fate.as_ref().err().map(Vec::as_slice)).collect();
    tell_refused("sample", &fates, || "every sample is refused; of the first:".to_owned(), ui)?;
    plan.warnings.iter().for_each(|warning| ui.warn(warning));
    Ok(Some(plan))
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    args.study.run("rve", ui, plan, Plan::first, |plan, settings, watch| {
        let summary = run_rve(plan, settings, watch)?;
        let came = Came::of(&summary, summary.status, summary.reason.as_deref());
        Ok((came, told(&summary)))
    })
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
