//! The benchmark: how many particle-steps a second this machine does.
//!
//! A settled bed is dense and random, in an open-topped box with frictional walls under gravity: Hertz-Mindlin
//! contacts with truncated history and rolling friction. It hardly needs new lists, so the same spheres are
//! also timed while they flow in a rotating drum that they fill about half. Beds of wide gradings show what
//! differences of size cost per contact.
//!
//! A bed is prepared once and kept; then the same steps are timed again and again from the same state, with
//! everything that a step needs in a real run: contacts, history, walls, rebuilds, and a sample every 1000
//! steps. Repeats of the beds of one size take turns, so that ratios between them hold on a machine that
//! has other things to do.

mod bed;
mod compare;
mod drum;
mod grading;
mod report;
mod timing;
mod tool;

use std::path::PathBuf;

use glebe_engine::SetupError;
use glebe_engine::backend::{Backend, Unavailable};
use glebe_engine::batch::Status;
use glebe_engine::generate::GenerateError;
use glebe_engine::spec::Search;
use glebe_io::checkpoint::CheckpointError;
use glebe_io::output::{OutputError, write_atomic};
use glebe_io::tool::ToolError;

use crate::cli::Ui;
use crate::device::Device;
use bed::{Bed, Mode};
use compare::Earlier;
pub use grading::BedKind;
use timing::Row;
pub use tool::Tool;

/// Times settled and flowing beds on this machine: particle-steps per second
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "\
Examples:
  glebe bench
  glebe bench --threads 1 --beds mono
  glebe bench --device gpu --sizes 100k,1M --flowing none
  glebe bench --sizes 50k --beds mono,1:3,1:20 --flowing none
  glebe bench --sizes none --tools sweep,fine-sweep,rotor
  glebe bench --sizes none --tools sweep --worlds 60
  glebe bench --sizes none --samples 2000 --worlds 400
  glebe bench --sizes 10k --flowing none --search grid,bvh
  glebe bench --sizes 10k,100k,1M --repeat 5 --out bench.json
  glebe bench --sizes 10k,100k,1M --repeat 5 --compare bench.json

Settled beds are dense, random, in an open-topped box. A flowing bed has the same spheres in a
closed drum, about half full, that turns at a Froude number of 0.1 and needs new lists often.
Tools are met in soil (R = 7 to 10 mm, the box and sweep of the main job, 0.7 m/s) or, turning at a
Froude number of 0.1, among mono spheres; boxes and tools shrink and grow with their beds.
Samples are mono spheres in a periodic cell at 100 kPa, compressed along z at an inertial number
of 1e-3 with the stress across held.

Columns of the table:
  search      how particles find those near to them
  particles   of a world
  rate        particle-steps a second of all worlds, median of the repeats
  best        largest rate of the repeats
  spread      largest less smallest rate, over the median
  steps/list  steps from one rebuild of the neighbour lists to the next
  contacts    contacts of a particle
  ns/contact  wall time of a step over the contacts in it, a pair counting once
  of mono     ns/contact over that of the settled mono bed of as many particles, the same search
  of settled  rate over that of the same spheres settled; both ratios are medians over repeats,
              in which the beds of one size take turns
  bytes/p     memory per particle
  first       seconds from the bed's state to the end of its first step: on a device with what its
              kernels take to be compiled, unless a bed above had the same
  lists ...   shares of the phases of a step in the wall time; on the CPU those of the first world

The first run of a size prepares its beds: minutes for 10k, half an hour for 50k on two cores.
Later runs find them in the cache. Mono beds of 8M and more are made of copies of a periodic
packing and timed as they are.")]
pub struct BenchArgs {
    /// Numbers of particles, or none; k and M stand for thousands and millions
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "10k,50k", value_parser = size)]
    pub sizes: Vec<Size>,
    /// Sizes of particles: all equal, or from 1 to 1.5, 3, 10 or 20
    #[arg(
        long,
        value_name = "BED,…",
        value_delimiter = ',',
        value_enum,
        default_value = "mono,poly,1:3,1:10"
    )]
    pub beds: Vec<BedKind>,
    /// Which of the beds are also timed flowing, or none
    #[arg(long, value_name = "BED,…", value_delimiter = ',', default_value = "mono,poly", value_parser = flowing)]
    pub flowing: Vec<Flowing>,
    /// Tools that are also timed, moving in beds of their own
    #[arg(long, value_name = "TOOL,…", value_delimiter = ',', value_enum)]
    pub tools: Vec<Tool>,
    /// Numbers of particles in the beds of tools
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "38912", value_parser = count)]
    pub tool_sizes: Vec<usize>,
    /// Numbers of particles in periodic samples that are also timed, compressed along one axis
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = count)]
    pub samples: Vec<usize>,
    /// How particles find those near to them: grid, bvh (a hierarchy of bounding volumes) or all-pairs; several take turns
    #[arg(long, value_name = "SEARCH,…", value_delimiter = ',', default_value = "grid", value_parser = search)]
    pub search: Vec<Search>,
    /// Worlds that begin with each bed and run together; their friction differs by up to a tenth
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub worlds: u32,
    /// Steps timed in each repeat
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u64).range(1..))]
    pub steps: u64,
    /// How often they are timed
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub repeat: u32,
    /// Where to compute: auto, cpu, gpu, gpu:N or cuda:N, as `glebe devices` lists them
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: Device,
    /// Threads to use [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub threads: Option<u16>,
    /// Accounts dissipated energy each step, as runs do unless told otherwise
    #[arg(long)]
    pub ledger: bool,
    /// Also writes the results as JSON into this file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Also tells the rates over those in this file, which --out wrote with the same settings
    #[arg(long, value_name = "FILE")]
    pub compare: Option<PathBuf>,
    /// Also writes the prepared beds into this folder, which must be there, as CSV: places, radii and velocities
    #[arg(long, value_name = "FOLDER")]
    pub write_beds: Option<PathBuf>,
    /// Neither takes nor keeps prepared beds
    #[arg(long)]
    pub no_cache: bool,
}

/// A bed that is also timed flowing, or the word that stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flowing(Option<BedKind>);

fn flowing(text: &str) -> Result<Flowing, String> {
    if text == "none" {
        return Ok(Flowing(None));
    }
    let kind = BedKind::ALL.into_iter().find(|kind| kind.name() == text);
    kind.map(|kind| Flowing(Some(kind)))
        .ok_or_else(|| format!("write {} or none", BedKind::ALL.map(BedKind::name).join(", ")))
}

fn search(text: &str) -> Result<Search, String> {
    let found = Search::ALL.into_iter().find(|search| search.name() == text);
    found.ok_or_else(|| format!("write {}", Search::ALL.map(Search::name).join(", ")))
}

/// A number of particles, or the word that stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size(Option<usize>);

fn size(text: &str) -> Result<Size, String> {
    if text == "none" { Ok(Size(None)) } else { count(text).map(|n| Size(Some(n))) }
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
    /// The tool could not be made.
    #[error("the tool cannot be made: {0}")]
    Tool(#[from] ToolError),
    /// The engine refuses the bed.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The device is not there, or has no room for a bed.
    #[error(transparent)]
    Device(#[from] Unavailable),
    /// The bed went wrong.
    #[error("the {bed} is {status:?} where it should be done")]
    Stopped {
        /// Which one.
        bed: Bed,
        /// How it stands.
        status: Status,
    },
    /// A prepared bed could not be kept.
    #[error("the prepared bed cannot be kept (--no-cache goes without): {0}")]
    Cache(#[from] CheckpointError),
    /// Results could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The results to compare with cannot be used.
    #[error("{path}: {why}")]
    Compare {
        /// The file.
        path: String,
        /// What is wrong, and what to do.
        why: String,
    },
    /// No threads.
    #[error("the threads could not be started: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Prepares the beds asked for, or finds them prepared, times them, and prints a table or JSON.
///
/// # Errors
/// A device that is not there; beds that cannot be made, prepared, kept or run; results that cannot be written.
pub fn run(args: &BenchArgs, ui: &Ui) -> Result<(), BenchError> {
    let earlier = args.compare.as_deref().map(Earlier::read).transpose()?;
    let threads = args.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let (value, table) = pool.install(|| {
        let chosen = args.device.open(0)?.admit(&[])?;
        chosen.note.iter().for_each(|line| ui.note(line));
        let device = chosen.backend.device();
        if let Some(earlier) = &earlier {
            let beds = beds(args).into_iter().flatten().flat_map(|bed| {
                let worlds = args.worlds as usize;
                args.search.iter().map(move |search| report::bed(&bed, *search, worlds))
            });
            earlier.fits(&report::settings(args, &device), &beds.collect::<Result<Vec<_>, _>>()?)?;
        }
        let rows = measure(args, chosen.backend, ui)?;
        let mut value = report::json(&rows, args, &device)?;
        let mut table = report::table(&rows, args, &device);
        if let Some(earlier) = &earlier {
            table += &earlier.compare(&mut value, &rows);
        }
        Ok::<_, BenchError>((value, table))
    })?;
    if let Some(path) = &args.out {
        write_atomic(path, |out| writeln!(out, "{value:#}"))?;
    }
    ui.result(&value, &table);
    Ok(())
}

/// The beds of every size, each one's flowing one behind its settled one; those of one size take turns.
fn beds(args: &BenchArgs) -> Vec<Vec<Bed>> {
    let plain = |count| {
        let beds = args.beds.iter().flat_map(move |&kind| {
            let flows = args.flowing.contains(&Flowing(Some(kind)));
            let modes = [Some(Mode::Settled), flows.then_some(Mode::Flowing)];
            modes.into_iter().flatten().map(move |mode| Bed { kind, mode, count })
        });
        beds.collect::<Vec<_>>()
    };
    let tilled = |count| {
        let beds =
            args.tools.iter().map(move |&tool| Bed { kind: tool.kind(), mode: Mode::Tilled(tool), count });
        beds.collect::<Vec<_>>()
    };
    let sample = |count| vec![Bed { kind: BedKind::Mono, mode: Mode::Loaded, count }];
    let sizes = args.sizes.iter().filter_map(|size| size.0);
    sizes
        .map(plain)
        .chain(args.tool_sizes.iter().copied().map(tilled))
        .chain(args.samples.iter().copied().map(sample))
        .collect()
}

/// The rows of all beds, in their order.
fn measure(args: &BenchArgs, backend: Backend, ui: &Ui) -> Result<Vec<Row>, BenchError> {
    let cache = crate::run::default_bed_folder().filter(|_| !args.no_cache).map(|f| f.join("bench"));
    let mut rows = Vec::new();
    for beds in beds(args) {
        let mut prepared = Vec::new();
        for bed in beds {
            let ready = bed.prepared(cache.as_deref(), backend, ui)?;
            if let Some(folder) = &args.write_beds {
                bed.write(&ready, folder)?;
            }
            let row = |search: &Search| Row::new(bed, *search, args.worlds as usize, &ready, args.steps);
            prepared.push((args.search.iter().map(row).collect::<Vec<_>>(), ready));
        }
        for repeat in 1..=args.repeat {
            for (of_bed, ready) in &mut prepared {
                for row in of_bed {
                    let (bed, search) = (row.bed, row.search.name());
                    ui.note(&format!("timing the {bed}, {search}: {repeat} of {}", args.repeat));
                    row.time(ready, args.ledger, backend)?;
                }
            }
        }
        rows.extend(prepared.into_iter().flat_map(|(of_bed, _)| of_bed));
    }
    Ok(rows)
}
