//! `glebe calibrate`: parameters for which scenes measure what was measured.

use std::fmt::Write as _;
use std::path::Path;

use glebe_io::study::Calibration;
use glebe_study::calibrate::{Plan, Report, Summary, run as run_calibration};

use super::check::duration;
use super::study::{Came, StudyArgs};
use super::ui::shell_word;
use super::{Ended, Problem, Ui};

/// Finds the parameters for which scenes measure what was measured
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe new field --template calibration --quick     a calibration to start from
  glebe calibrate field/study.toml
  glebe calibrate field/study.toml --resume          after Ctrl-C, a crash or a full disk: the rest only
  glebe calibrate field/study.toml --resume --set stop.rounds=90     goes on with more rounds
  glebe run field/out/best.toml                      the best parameters, with frames and series

Worlds that are refused or fail have no cost, with their reason; the exit code is 0 if any evaluation has one.",
    mut_arg("study", |arg| arg.help("The calibration file")),
    mut_arg("sets", |arg| arg.help(
        "Replaces a value of the calibration: keys joined by dots, such as stop.rounds=20"
    )),
    mut_arg("batches", |arg| arg.help(
        "Batches to divide a round into [default: as few as memory allows]; results do not depend on it"
    )))]
pub(super) struct Args {
    #[command(flatten)]
    study: StudyArgs,
}

/// A calibration whose scenes can be set up in the middle of its ranges.
pub(super) fn plan(path: &Path, sets: &[String], ui: &Ui) -> Result<Plan, Problem> {
    let calibration = Calibration::load(path, sets).map_err(Problem::Scene)?;
    let plan = Plan::new(calibration).map_err(|errors| {
        ui.note("with every parameter in the middle of its range:");
        Problem::Scene(errors)
    })?;
    plan.warnings.iter().for_each(|warning| ui.warn(warning));
    Ok(plan)
}

pub(super) fn run(args: &Args, ui: &Ui) -> Result<Ended, Problem> {
    let made = |path: &Path, sets: &[String], ui: &Ui| plan(path, sets, ui).map(Some);
    args.study.run("calibrate", ui, made, Plan::middle, |plan, settings, watch| {
        let summary = run_calibration(plan, settings, watch)?;
        let came = Came::of(&summary, summary.status, summary.reason.as_deref())
            .or("no evaluation has a cost", "evaluations.csv");
        Ok((came, told(&summary)))
    })
}

/// The answer, as tables.
fn told(s: &Summary) -> String {
    let mut text = format!(
        "{} evaluations in {} ({} of them without a cost); ended by {} after {} rounds of {}\n",
        s.counts.evaluations,
        duration(s.performance.wall_s),
        s.counts.failed + s.counts.refused,
        s.ended_by,
        s.rounds.len(),
        s.method
    );
    let mut rows =
        vec![vec!["best".to_owned(), "value".to_owned(), "unit".to_owned(), "uncertainty".to_owned()]];
    for p in &s.parameters {
        let known = match (&p.posterior, &p.known) {
            (Some(i), _) => {
                let [low, high] = i.credible_95.map(number);
                let by = if i.predicted > 0.0 {
                    format!(" ({:.0} % of it by the surrogate)", 100.0 * i.predicted)
                } else {
                    String::new()
                };
                format!("95 % in {low} … {high}{by}")
            }
            (None, Some(k)) => format!("{} of its range's", number(k.uncertainty)),
            (None, None) => String::new(),
        };
        rows.push(vec![p.name.clone(), number(p.best), p.unit.to_owned(), known]);
    }
    for t in &s.targets {
        let wanted = format!("wanted {} ± {}", number(t.value), number(t.scatter));
        rows.push(vec![t.name.clone(), number(t.best), t.unit.to_owned(), wanted]);
    }
    text += &table(&rows);
    if let Some(surrogate) = &s.surrogate {
        text += &told_of(surrogate);
    }
    let clusters = s.clusters.len();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{} good agents; the best, up to a cost of {}, in {clusters} cluster{} (silhouette {:.2}):",
        s.good,
        number(s.clusters_up_to_cost),
        if clusters == 1 { "" } else { "s" },
        s.silhouette
    );
    let names = |head: &str| std::iter::once(head.to_owned()).chain((1..=clusters).map(|k| format!("#{k}")));
    let mut rows = vec![names("mean of").collect::<Vec<_>>()];
    let mut row = |name: &str, value: &dyn Fn(&glebe_study::calibrate::Cluster) -> String| {
        rows.push(std::iter::once(name.to_owned()).chain(s.clusters.iter().map(value)).collect());
    };
    let of = |value: Option<&f64>| number(value.copied().unwrap_or(f64::NAN));
    for p in s.parameters.iter().filter(|p| p.bounds.is_some()) {
        row(&p.name, &|c| of(c.parameters.get(&p.name)));
    }
    for t in &s.targets {
        row(&t.name, &|c| of(c.targets.get(&t.name)));
    }
    row("agents", &|c| c.agents.to_string());
    text += &table(&rows);
    for args in &s.best_runs {
        let args: Vec<String> = args.iter().map(|arg| shell_word(arg)).collect();
        let _ = writeln!(text, "the best as a scene:  glebe {}", args.join(" "));
    }
    text
}

/// What the surrogate did, and how far off it was.
fn told_of(surrogate: &Report) -> String {
    let mut text = format!(
        "the surrogate stood for {} of {} evaluations ({:.0} % saved); {} that it was sure of were simulated to check it\n",
        surrogate.predicted,
        surrogate.predicted + surrogate.simulated,
        100.0 * surrogate.saved,
        surrogate.checked
    );
    let head = ["its error in scatters", "leave-one-out", "within two std", "checked", "within two std"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for t in &surrogate.targets {
        let within = [t.leave_one_out_within, t.held_out_within];
        let [left_out, held_out] = within
            .map(|share| if share.is_finite() { format!("{:.0} %", 100.0 * share) } else { "-".into() });
        rows.push(vec![t.name.clone(), number(t.leave_one_out), left_out, number(t.held_out), held_out]);
    }
    if rows.len() > 1 {
        text += &table(&rows);
    }
    text
}

/// Five digits of a number.
fn number(x: f64) -> String {
    if !x.is_finite() {
        return "-".to_owned();
    }
    if x == 0.0 || (1e-3..1e6).contains(&x.abs()) {
        let decimals = (4 - x.abs().max(1e-3).log10().floor() as i32).clamp(0, 7) as usize;
        return format!("{x:.decimals$}");
    }
    format!("{x:.4e}")
}

/// Columns side by side; the first to the left, the others to the right but for the last of words.
fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |k: usize| rows.iter().filter_map(|r| r.get(k)).map(|c| c.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::from(" ");
        for (k, cell) in row.iter().enumerate() {
            let pad = " ".repeat(widths[k] - cell.chars().count());
            // Writing to a string cannot fail.
            let _ = if k == 0 { write!(line, " {cell}{pad}") } else { write!(line, "  {pad}{cell}") };
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}
