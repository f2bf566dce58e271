//! The validation suite: cases whose outcome is published or exact, from scenes in `validation/`.
//!
//! A new case is **one file and one row**: a file beside this one with a `pub(super) const CASE: Case`,
//! which says where its numbers come from and which of them are chosen; a folder `validation/ID-name` with
//! its scene; its module and its row in `CASES`. Command line, help, JSON and tests follow from the row.
//!
//! Nothing is tuned to pass: parameters are the source's, and what the source leaves open and we chose is
//! said in the case's file.

mod a1;
mod a2;
mod a3;
mod a4;
mod a5;
mod a6;
mod a7;
mod b1;
mod b10;
mod b11;
mod b2;
mod b3;
mod b4;
mod b5;
mod b6;
mod b7;
mod b8;
mod c1;
mod c2;
mod c3;
mod c4;
mod c5;
mod c6;
mod case;
mod output;
mod p1;
mod projectile;
mod samples;
mod trial;

use std::path::PathBuf;
use std::time::Instant;

use clap::builder::{PossibleValue, PossibleValuesParser};
use glebe_engine::backend::{Backend, Unavailable};
use glebe_io::output::OutputError;

use crate::cli::Ui;
use crate::device::Device;
pub use case::{Case, CaseError, Findings, Metric, Outcome};
use trial::Trial;
pub(crate) use trial::power_law;

/// Every case, in the order in which they run.
const CASES: &[Case] = &[
    a1::CASE,
    a2::CASE,
    a3::CASE,
    a4::CASE,
    a5::CASE,
    a6::CASE,
    a7::CASE,
    b1::CASE,
    b2::CASE,
    b3::CASE,
    b4::CASE,
    b5::CASE,
    b6::CASE,
    b7::CASE,
    b8::CASE,
    b10::CASE,
    b11::CASE,
    c1::CASE,
    c2::CASE,
    c3::CASE,
    c4::CASE,
    c5::CASE,
    c6::CASE,
    p1::CASE,
];

/// All registered cases.
pub fn cases() -> &'static [Case] {
    CASES
}

/// Reproduces published and exact cases: figures, numbers and a verdict for each
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "\
Examples:
  glebe validate --quick
  glebe validate A1 oblique-impact --out figures
  glebe validate --quick --json
  glebe validate C3 --device cuda:0 --resume    after a stop: the rest of its study only

Exit codes: 0 all passed, 1 a case failed, 2 no such case or device.")]
pub struct ValidateArgs {
    /// Cases by id or name; all if none is named
    #[arg(value_name = "NAME", value_parser = names(), ignore_case = true, hide_possible_values = true)]
    pub names: Vec<String>,
    /// Smaller sizes: all cases together take about a quarter of an hour on two cores
    #[arg(long)]
    pub quick: bool,
    /// Folder for figures, results.json and studies; those of an earlier validation in it are replaced
    #[arg(long, value_name = "DIR", default_value = "validation-results")]
    pub out: PathBuf,
    /// Goes on with the studies of cases that are in that folder, after a stop or a crash
    #[arg(long)]
    pub resume: bool,
    /// Where to compute: auto, cpu, gpu, gpu:N or cuda:N, as `glebe devices` lists them
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: Device,
    /// Threads to use [default: all]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
}

fn names() -> PossibleValuesParser {
    let both = |c: &Case| [PossibleValue::new(c.id), PossibleValue::new(c.name)];
    CASES.iter().flat_map(both).collect::<Vec<_>>().into()
}

/// Why the suite could not be run. Exit codes: 2 for input, 1 for the rest.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ValidateError {
    /// No such case.
    #[error("there is no case `{name}`; choose from {known}")]
    Unknown {
        /// As asked for.
        name: String,
        /// Ids and names.
        known: String,
    },
    /// A case could not be run to its end.
    #[error("case {id} could not be run: {source}")]
    Case {
        /// Its id.
        id: &'static str,
        /// Why.
        source: CaseError,
    },
    /// The device is not there.
    #[error(transparent)]
    Device(#[from] Unavailable),
    /// Results could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// No threads.
    #[error("the threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

impl ValidateError {
    /// 2 if what was asked for is wrong, 1 if running it failed.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Unknown { .. } | Self::Device(_) | Self::Output(OutputError::Malformed { .. }) => 2,
            Self::Case { source: CaseError::Study(e), .. } if e.is_input() => 2,
            _ => 1,
        }
    }
}

/// Runs the cases asked for, prints each as it ends (or all as JSON), and writes their figures.
///
/// Returns whether all passed; `glebe validate` then exits with 0, else with 1.
///
/// # Errors
/// An unknown case; a device that is not there; a scene that cannot be built or run; results that cannot be written.
pub fn run(args: &ValidateArgs, ui: &Ui) -> Result<bool, ValidateError> {
    let cases = select(&args.names)?;
    let threads = args.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let chosen = pool.install(|| args.device.open(0)?.admit(&[]))?;
    chosen.note.iter().for_each(|line| ui.note(line));
    let device = pool.install(|| chosen.backend.device());
    output::claim(&args.out, &cases)?;
    let mut outcomes = Vec::new();
    for case in cases {
        ui.note(&format!("running {} {}", case.id, case.name));
        let outcome = pool.install(|| evaluate(case, args, chosen.backend))?;
        output::write_figures(&args.out, &outcome)?;
        if !ui.json() {
            ui.print(&output::table(&outcome, &args.out));
        }
        outcomes.push(outcome);
    }
    let value = output::json(&outcomes, args.quick, &device);
    output::write_results(&args.out, &value)?;
    ui.result(&value, &output::verdict_of(&outcomes));
    Ok(outcomes.iter().all(Outcome::passed))
}

/// Runs one case, as asked for, on a backend and the threads of the current pool.
///
/// # Errors
/// [`ValidateError::Case`] if its scene cannot be built or run.
pub fn evaluate(
    case: &'static Case,
    args: &ValidateArgs,
    backend: Backend,
) -> Result<Outcome, ValidateError> {
    let began = Instant::now();
    let trial = Trial { quick: args.quick, backend, results: &args.out, resume: args.resume };
    let findings = (case.run)(trial).map_err(|source| ValidateError::Case { id: case.id, source })?;
    Ok(Outcome { case, findings, seconds: began.elapsed().as_secs_f64() })
}

/// The cases named, each once, in the order of the table; all of them if none is named.
fn select(names: &[String]) -> Result<Vec<&'static Case>, ValidateError> {
    let is = |case: &Case, name: &String| {
        name.eq_ignore_ascii_case(case.id) || name.eq_ignore_ascii_case(case.name)
    };
    if let Some(name) = names.iter().find(|name| !CASES.iter().any(|case| is(case, name))) {
        let known = CASES.iter().map(|c| format!("{} ({})", c.id, c.name)).collect::<Vec<_>>().join(", ");
        return Err(ValidateError::Unknown { name: name.clone(), known });
    }
    Ok(CASES.iter().filter(|case| names.is_empty() || names.iter().any(|name| is(case, name))).collect())
}
