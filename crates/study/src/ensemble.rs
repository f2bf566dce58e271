//! What studies have in common: their settings, the folder with its journal, batches, and worlds under way.

use std::convert::Infallible;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Observer, Status};
use glebe_io::checkpoint::{self, CheckpointError, Header};
use glebe_io::output::{Existing, Journal, OutputDir, OutputError};
use glebe_io::study::Study;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::drive::{Drive, Event, Listener, Pulse};

/// Memory that a particle takes in a batch, its lists and what it was made from included \[bytes\]; see the table of
/// rates in the README.
pub(crate) const BYTES: f64 = 1500.0;

/// How a study is to be done.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The output folder.
    pub out: PathBuf,
    /// What computes.
    pub backend: Backend,
    /// What is done with results that are there.
    pub existing: Existing,
    /// Where settled beds are kept; none to keep none.
    pub beds: Option<PathBuf>,
    /// How many batches the worlds are divided into; none for as few as memory allows.
    pub batches: Option<usize>,
    /// Memory for worlds \[bytes\], if known.
    pub memory: Option<u64>,
    /// Wall time between checkpoints of worlds under way.
    pub checkpoint_every: Duration,
    /// The commit that this program was built from, if known.
    pub commit: Option<String>,
    /// By which arguments of `--set` the study was changed.
    pub sets: Vec<String>,
}

impl Settings {
    /// A new study on the CPU into the folder `out`, without kept beds, as one batch.
    pub fn new(out: impl Into<PathBuf>) -> Self {
        Self {
            out: out.into(),
            backend: Backend::Cpu,
            existing: Existing::Refuse,
            beds: None,
            batches: None,
            memory: None,
            checkpoint_every: Duration::from_secs(600),
            commit: None,
            sets: Vec::new(),
        }
    }
}

/// Why a study was not done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The output folder cannot be used, or writing failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A checkpoint cannot be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The folder holds another study.
    #[error(
        "{path}: these results belong to another study: resume with the study, scene and files that they were \
         begun with, or start again with --force"
    )]
    OtherStudy {
        /// The journal.
        path: PathBuf,
    },
    /// The folder's worlds were computed elsewhere.
    #[error(
        "{path}: these results were begun on `{found}`, and this is `{given}`, which rounds differently: resume with \
         the same --device, or start again with --force"
    )]
    OtherDevice {
        /// The journal.
        path: PathBuf,
        /// Where they were begun.
        found: String,
        /// What is to compute now.
        given: String,
    },
}

impl StudyError {
    /// Whether what was given is at fault, rather than what happened after the start.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Output(e) => e.is_input(),
            Self::Checkpoint(_) => false,
            Self::OtherStudy { .. } | Self::OtherDevice { .. } => true,
        }
    }
}

/// The first line of a journal.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    version: String,
    study_hash: String,
    device: String,
}

/// The folder of a study, to be written into.
pub(crate) struct Opened<E> {
    pub(crate) dir: OutputDir,
    pub(crate) journal: Journal,
    /// What was journaled earlier; none if the study begins.
    pub(crate) entries: Option<Vec<E>>,
    pub(crate) warnings: Vec<String>,
}

/// Makes the folder of a study, or opens it with what was journaled there. `hash` is a digest of all its worlds.
pub(crate) fn open<E: DeserializeOwned>(
    study: &Study,
    hash: &str,
    settings: &Settings,
    listener: &mut dyn Listener,
) -> Result<Opened<E>, StudyError> {
    let head = Head {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        study_hash: hash.to_owned(),
        device: settings.backend.maker(),
    };
    let mut warnings = Vec::new();
    let vacant = OutputDir::is_vacant(&settings.out)?;
    if settings.existing == Existing::Resume && !vacant {
        let dir = OutputDir::open_study(&settings.out)?;
        let path = dir.journal();
        let (found, entries, journal) = Journal::resume::<Head, E>(&path)?;
        if found.study_hash != head.study_hash {
            return Err(StudyError::OtherStudy { path });
        }
        if found.device != head.device {
            return Err(StudyError::OtherDevice { path, found: found.device, given: head.device });
        }
        if found.version != head.version {
            let line = format!(
                "these results were begun by glebe {}; this is {}: worlds may differ in the last digits",
                found.version, head.version
            );
            listener.warn(&line);
            warnings.push(line);
        }
        return Ok(Opened { dir, journal, entries: Some(entries), warnings });
    }
    let dir = OutputDir::create(&settings.out, settings.existing == Existing::Replace)?;
    if settings.existing == Existing::Resume {
        listener.note("nothing was kept before the study ended: it begins again");
    }
    dir.write_study(&study.text, &settings.sets)?;
    let journal = Journal::create(&dir.journal(), &head)?;
    Ok(Opened { dir, journal, entries: None, warnings })
}

/// The worlds of each batch: of those given, in order, as many as memory holds, or in as many batches as asked for.
/// `particles` tells how many a world has.
pub(crate) fn divide(
    worlds: &[usize],
    particles: impl Fn(usize) -> usize,
    asked: Option<usize>,
    memory: Option<u64>,
) -> Vec<Vec<usize>> {
    if worlds.is_empty() {
        return Vec::new();
    }
    if let Some(asked) = asked {
        return worlds.chunks(worlds.len().div_ceil(asked.max(1))).map(<[usize]>::to_vec).collect();
    }
    // What else runs needs some too.
    let room = memory.map_or(f64::INFINITY, |bytes| 0.5 * bytes as f64);
    let mut batches: Vec<Vec<usize>> = Vec::new();
    let mut used = f64::INFINITY;
    for &w in worlds {
        let bytes = BYTES * particles(w) as f64;
        match batches.last_mut() {
            Some(batch) if used + bytes <= room => {
                batch.push(w);
                used += bytes;
            }
            _ => {
                batches.push(vec![w]);
                used = bytes;
            }
        }
    }
    batches
}

/// Follows the worlds of a batch to their ends.
pub(crate) trait Follower: Observer<Error = Infallible> {
    /// Something happened to a world.
    fn happened(
        &mut self,
        drive: &Drive,
        event: Event,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError>;
    /// How many worlds have ended, of how many, those of other batches included.
    fn ended(&self) -> [usize; 2];
    /// Keeps what worlds under way need to be resumed.
    fn save(&mut self, drive: &Drive) -> Result<(), StudyError>;
}

/// Runs the worlds of a batch to their ends, or until the user stops them; `later` steps come in other batches.
pub(crate) fn follow(
    drive: &mut Drive,
    follower: &mut impl Follower,
    later: u64,
    checkpoint_every: Duration,
    listener: &mut dyn Listener,
) -> Result<(), StudyError> {
    let mut written = Instant::now();
    while drive.batch().running() && !listener.interrupted() {
        let Ok(events) = drive.advance(follower);
        for event in events {
            follower.happened(drive, event, listener)?;
        }
        let [ended, worlds] = follower.ended();
        listener.pulse(&Pulse { drive, kinetic: None, worlds, ended, later });
        if written.elapsed() >= checkpoint_every {
            follower.save(drive)?;
            written = Instant::now();
        }
    }
    follower.save(drive)
}

/// Where the state of a world is kept while it has not ended.
pub(crate) fn checkpoint_of(dir: &OutputDir, world: usize) -> PathBuf {
    dir.checkpoints().join(format!("{world:06}.glebe"))
}

/// Keeps the state of world `k` of a batch in a file, if it is under way; `scene_hash` says of what it is.
pub(crate) fn keep(drive: &Drive, k: usize, path: &Path, scene_hash: &str) -> Result<bool, StudyError> {
    let batch = drive.batch();
    let g = batch.progress(k);
    if *batch.status(k) != Status::Running || g.step == 0 {
        return Ok(false);
    }
    let Ok(state) = batch.sound_state(k) else { return Ok(false) };
    let header = Header {
        glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
        scene_hash: scene_hash.to_owned(),
        step: g.step,
        time: batch.time(k),
        device: batch.backend().maker(),
        ..Header::default()
    };
    checkpoint::keep(path, &header, &state)?;
    Ok(true)
}

/// Removes a file that may be there.
pub(crate) fn discard(path: &Path) -> Result<(), StudyError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(OutputError::Io { path: path.to_owned(), action: "remove this file", source }.into())
        }
        _ => Ok(()),
    }
}
