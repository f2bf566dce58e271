//! The benchmark: how many particle-steps a second this machine does on a settled bed.
//!
//! The bed is dense and random, in an open-topped box with frictional walls under gravity: Hertz-Mindlin
//! contacts with truncated history and rolling friction. It is settled once and kept; then the same steps
//! are timed again and again from the same state, with everything that a step needs in a real run:
//! contacts, history, walls, rebuilds, and a sample every 1000 steps.

mod bed;
mod report;
mod timing;

use std::path::PathBuf;

use glebe_engine::SetupError;
use glebe_engine::batch::Status;
use glebe_engine::generate::GenerateError;
use glebe_io::checkpoint::CheckpointError;
use glebe_io::output::{OutputError, write_atomic};

use crate::cli::Ui;
use bed::Bed;
pub use bed::BedKind;

/// Times settled beds on this machine: particle-steps per second
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "\
Examples:
  glebe bench
  glebe bench --threads 1 --beds mono
  glebe bench --sizes 10k,100k,1M --repeat 5 --out bench.json

The first run of a size settles its bed, which may take minutes; later ones find it in the cache.")]
pub struct BenchArgs {
    /// Numbers of particles; k and M stand for thousands and millions
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "10k,50k", value_parser = count)]
    pub sizes: Vec<usize>,
    /// Sizes of particles: all equal, or 1 : 1.5
    #[arg(long, value_name = "BED,…", value_delimiter = ',', value_enum, default_value = "mono,poly")]
    pub beds: Vec<BedKind>,
    /// Steps timed in each repeat
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// How often they are timed
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeat: u32,
    /// Threads to use [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Accounts dissipated energy each step, as runs do unless told otherwise
    #[arg(long)]
    pub ledger: bool,
    /// Also writes the results as JSON into this file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Neither takes nor keeps settled beds
    #[arg(long)]
    pub no_cache: bool,
}

/// `10k` and the like. At most what the engine numbers.
fn count(text: &str) -> Result<usize, String> {
    let (digits, factor) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1e3),
        None => text.strip_suffix(['m', 'M']).map_or((text, 1.0), |digits| (digits, 1e6)),
    };
    match digits.parse::<f64>().map(|n| (n * factor).round()) {
        Ok(n) if (100.0..=2e9).contains(&n) => Ok(n as usize),
        _ => Err("write a number of particles from 100 to 2000M, such as 5000, 10k or 1M".to_owned()),
    }
}

/// Why a benchmark has no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The spheres could not be placed.
    #[error("the bed cannot be made: {0}")]
    Generate(#[from] GenerateError),
    /// The engine refuses the bed.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The bed went wrong.
    #[error("the bed of {count} particles is {status:?} where it should be done")]
    Stopped {
        /// Its size.
        count: usize,
        /// How it stands.
        status: Status,
    },
    /// A settled bed could not be kept.
    #[error("the settled bed cannot be kept (--no-cache goes without): {0}")]
    Cache(#[from] CheckpointError),
    /// Results could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// No threads.
    #[error("the threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Settles the beds asked for, or finds them settled, times them, and prints a table or JSON.
///
/// # Errors
/// Beds that cannot be made, settled, kept or run; results that cannot be written.
pub fn run(args: &BenchArgs, ui: &Ui) -> Result<(), BenchError> {
    let threads = args.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let cache = crate::run::default_bed_folder().filter(|_| !args.no_cache).map(|f| f.join("bench"));
    let mut rows = Vec::new();
    for &kind in &args.beds {
        for &count in &args.sizes {
            let bed = Bed { kind, count };
            let row = pool.install(|| {
                let settled = bed.settled(cache.as_deref(), ui)?;
                timing::time(&bed, &settled, args, ui)
            })?;
            rows.push(row);
        }
    }
    let value = pool.install(|| report::json(&rows, args));
    if let Some(path) = &args.out {
        write_atomic(path, |out| writeln!(out, "{value:#}"))?;
    }
    ui.result(&value, &pool.install(|| report::table(&rows, args)));
    Ok(())
}
