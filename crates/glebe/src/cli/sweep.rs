//! `glebe sweep`: the worlds of a study.

use std::fmt::Write as _;
use std::path::Path;

use glebe_io::study::Study;
use glebe_study::sweep::{Plan, Summary, run as run_sweep};

use super::bar::interrupted;
use super::study::{Came, StudyArgs, counted, tell_refused};
use super::{Ended, Problem, Ui};

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
    #[command(flatten)]
    study: StudyArgs,
}

/// A study whose worlds were looked at, of which at least one can be run; none if interrupted.
pub(super) fn plan(path: &Path, sets: &[String], ui: &Ui) -> Result<Option<Plan>, Problem> {
    let study = Study::load(path, sets).map_err(Problem::Scene)?;
    if study.rve.is_some() {
        return Err(Problem::Input(format!(
            "{} is a study of periodic samples: run it with `glebe rve`",
            path.display()
        )));
    }
    let plan = Plan::new(study, interrupted).map_err(|e| Problem::Input(e.to_string()))?;
    let Some(plan) = plan else { return Ok(None) };
    let fates: Vec<_> =
        plan.worlds.iter().map(|planned| planned.fate.as_ref().err().map(Vec::as_slice)).collect();
    let first =
        || format!("every world is refused; of the first ({}):", plan.worlds[0].world.sets.join(", "));
    tell_refused("world", &fates, first, ui)?;
    plan.warnings.iter().for_each(|warning| ui.warn(warning));
    Ok(Some(plan))
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    args.study.run("sweep", ui, plan, Plan::first, |plan, settings, watch| {
        let summary = run_sweep(plan, settings, watch)?;
        let came = Came::of(&summary, summary.status, summary.reason.as_deref());
        Ok((came, told(&summary)))
    })
}

fn told(s: &Summary) -> String {
    let mut text = counted("worlds", s.counts, &s.performance, &s.device);
    for measured in &s.measures {
        for fitted in &measured.fits {
            // Writing to a string cannot fail.
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
    text
}
