//! Checkpoint files: an opaque state in a container that knows when it is damaged.
//!
//! Layout (little-endian): magic (8 bytes), format version (u32), length of the header (u32), length of
//! the stored state (u64), length of the state itself (u64), header (JSON), state (zstd), SHA-256 of all
//! before it.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use glebe_engine::state::State;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::input;
use crate::output::{OutputError, write_atomic};

/// The version of the layout that this program writes.
const FORMAT: u32 = 1;
/// Like PNG's: the line ends show a transfer that took the file for text.
const MAGIC: [u8; 8] = *b"glebe\r\n\x1a";
const FIXED: usize = 32;
const DIGEST: usize = 32;
/// zstd's fast end: the state is mostly the noise of mantissas.
const LEVEL: i32 = 1;

/// What is known of a state without understanding it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the glebe that wrote it.
    pub glebe_version: String,
    /// What computed it: a resumed run gives the same bits on the same device only. Empty if not known.
    #[serde(default)]
    pub device: String,
    /// Hash of the scene that the state belongs to.
    pub scene_hash: String,
    /// Steps done.
    pub step: u64,
    /// Simulated time \[s\].
    pub time: f64,
    /// Rows that `series.csv` had then.
    pub rows: u64,
    /// Frames that `frames.pvd` had then.
    pub frames: u64,
    /// Whether what contacts remember was left out: a resumed run then ends with other bits.
    #[serde(default)]
    pub forgetful: bool,
    /// Bytes at the end of the state that are what fields under way have seen.
    #[serde(default)]
    pub seen: u64,
}

/// A state that was read back.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Where it was.
    pub path: PathBuf,
    /// What it belongs to.
    pub header: Header,
    /// The state.
    pub state: Vec<u8>,
    /// Newer files that could not be used, each with its reason and in plain words; empty if this is
    /// the newest.
    pub skipped: Vec<String>,
}

impl Checkpoint {
    /// The state of the world, and what fields under way have seen.
    pub fn parts(&self) -> (&[u8], &[u8]) {
        let seen = usize::try_from(self.header.seen).unwrap_or(usize::MAX);
        self.state.split_at(self.state.len().saturating_sub(seen))
    }
}

/// Why a checkpoint cannot be used or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// It could not be written or read at all.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Some other file.
    #[error("{path}: this is not a checkpoint of glebe")]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The end is missing.
    #[error("{path}: this checkpoint is cut short: it has {found} of {expected} bytes")]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Bytes there.
        found: u64,
        /// Bytes that there should be, as far as known.
        expected: u64,
    },
    /// Its content does not fit its checksum.
    #[error("{path}: this checkpoint is damaged: {what}")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        what: String,
    },
    /// Written by a later glebe.
    #[error(
        "{path}: this checkpoint has format {found}, but this glebe reads formats up to {FORMAT}: continue \
         with the newer glebe that wrote it"
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// Written for another scene.
    #[error(
        "{path}: this checkpoint belongs to another scene (hash {found}, the scene given has {expected}): \
         resume with the scene, meshes and settings that the run was started with, or start again with \
         --force"
    )]
    OtherScene {
        /// The file.
        path: PathBuf,
        /// Scene hash in the file.
        found: String,
        /// Scene hash asked for.
        expected: String,
    },
    /// There is none.
    #[error("{dir}: there is no checkpoint to resume from; start the run without --resume")]
    None {
        /// The folder.
        dir: PathBuf,
    },
    /// There are some, but none can be read.
    #[error(
        "{dir}: none of the checkpoints can be used, start the run again with --force\n{}",
        .reasons.join("\n")
    )]
    NoneValid {
        /// The folder.
        dir: PathBuf,
        /// One line for each file.
        reasons: Vec<String>,
    },
}

/// The checkpoints of one run: `000000.glebe`, `000001.glebe`, … in a folder, of which the last two
/// good ones are kept.
#[derive(Debug)]
pub struct CheckpointWriter {
    dir: PathBuf,
    next: u64,
    last_good: Option<PathBuf>,
}

impl CheckpointWriter {
    /// Writes into `dir`, which is made if needed. After a resume `last_good` is the file that the run
    /// was continued from: it stays until the next but one is written, newer damaged ones go.
    ///
    /// # Errors
    /// [`CheckpointError::Output`].
    pub fn new(dir: &Path, last_good: Option<&Path>) -> Result<Self, CheckpointError> {
        fs::create_dir_all(dir).map_err(|e| OutputError::io(dir, "make this folder", e))?;
        let next = list(dir)?.last().map_or(0, |(number, _)| number + 1);
        Ok(Self { dir: dir.to_owned(), next, last_good: last_good.map(Path::to_owned) })
    }

    /// Writes a checkpoint, whole or not at all, and removes those before the last good one.
    ///
    /// # Errors
    /// [`CheckpointError::Output`]; the earlier checkpoints are then still there.
    pub fn write(&mut self, header: &Header, state: &[u8]) -> Result<PathBuf, CheckpointError> {
        let path = self.dir.join(format!("{:06}.glebe", self.next));
        write(&path, header, state)?;
        for (_, old) in list(&self.dir)? {
            if old != path && Some(&old) != self.last_good.as_ref() {
                fs::remove_file(&old).map_err(|e| OutputError::io(&old, "remove this old checkpoint", e))?;
            }
        }
        self.next += 1;
        self.last_good = Some(path.clone());
        Ok(path)
    }
}

/// Writes one checkpoint file, whole or not at all.
///
/// # Errors
/// [`CheckpointError::Output`].
pub fn write(path: &Path, header: &Header, state: &[u8]) -> Result<(), CheckpointError> {
    let failed = |e| OutputError::io(path, "pack this checkpoint", e);
    let header = serde_json::to_vec(header).map_err(|e| failed(e.into()))?;
    let stored = zstd::bulk::compress(state, LEVEL).map_err(failed)?;
    let mut start = Vec::with_capacity(FIXED + header.len());
    start.extend_from_slice(&MAGIC);
    start.extend_from_slice(&FORMAT.to_le_bytes());
    start.extend_from_slice(&(header.len() as u32).to_le_bytes());
    start.extend_from_slice(&(stored.len() as u64).to_le_bytes());
    start.extend_from_slice(&(state.len() as u64).to_le_bytes());
    start.extend_from_slice(&header);
    let digest = Sha256::new().chain_update(&start).chain_update(&stored).finalize();
    write_atomic(path, |out| {
        out.write_all(&start)?;
        out.write_all(&stored)?;
        out.write_all(&digest)
    })?;
    Ok(())
}

/// Reads one checkpoint file and checks it.
///
/// # Errors
/// [`CheckpointError`], but for scenes: see [`latest_valid`].
pub fn read(path: &Path) -> Result<Checkpoint, CheckpointError> {
    let bytes = input::read(path).map_err(|e| OutputError::io(path, "read this checkpoint", e))?;
    parse(path, &bytes)
}

/// The state that was [kept](keep) in a file for a scene; none if it is not there, damaged or of something else.
pub fn kept(path: &Path, scene_hash: &str) -> Option<State> {
    let found = read(path).ok().filter(|c| c.header.scene_hash == scene_hash)?;
    State::from_bytes(&found.state).ok()
}

/// Keeps a state in a file, and makes the folder for it.
///
/// # Errors
/// A folder that cannot be made, a full disk.
pub fn keep(path: &Path, header: &Header, state: &State) -> Result<(), CheckpointError> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|e| OutputError::io(folder, "make this folder", e))?;
    }
    write(path, header, &state.to_bytes())
}

/// Like [`read`], of the `bytes` of the file called `path`.
///
/// # Errors
/// As [`read`], but for those of the system.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Checkpoint, CheckpointError> {
    let path = path.to_owned();
    let found = bytes.len() as u64;
    if !bytes.starts_with(&MAGIC[..bytes.len().min(MAGIC.len())]) {
        return Err(CheckpointError::Foreign { path });
    }
    if bytes.len() < FIXED + DIGEST {
        return Err(CheckpointError::CutShort { path, found, expected: (FIXED + DIGEST) as u64 });
    }
    let (content, digest) = bytes.split_at(bytes.len() - DIGEST);
    let intact = Sha256::digest(content).as_slice() == digest;
    let format = u32_at(bytes, 8);
    // All formats end with the checksum, so that a flipped bit is not taken for a later version.
    if format > FORMAT && intact {
        return Err(CheckpointError::Newer { path, found: format });
    }
    let header_end = FIXED as u64 + u64::from(u32_at(bytes, 12));
    let expected = header_end.saturating_add(u64_at(bytes, 16)).saturating_add(DIGEST as u64);
    if found < expected {
        return Err(CheckpointError::CutShort { path, found, expected });
    }
    let damaged = |what: String| CheckpointError::Damaged { path: path.clone(), what };
    if found > expected {
        return Err(damaged(format!("it has {found} bytes where {expected} should be")));
    }
    if !intact {
        return Err(damaged("its content does not fit its checksum".to_owned()));
    }
    let (header, stored) = content[FIXED..].split_at(header_end as usize - FIXED);
    let header = serde_json::from_slice(header).map_err(|e| damaged(format!("its header: {e}")))?;
    let length = u64_at(bytes, 24);
    // What is packed well may be small here and too large there.
    if let Some(free) = input::free_memory().filter(|free| length > *free) {
        let (length, free) = (input::size(length), input::size(free));
        return Err(damaged(format!(
            "its state is said to take {length}, but only {free} of memory are free"
        )));
    }
    let mut state = Vec::new();
    zstd::stream::read::Decoder::with_buffer(stored)
        // One byte more shows a state that is too long.
        .and_then(|decoder| decoder.take(length.saturating_add(1)).read_to_end(&mut state))
        .map_err(|e| damaged(format!("its state cannot be unpacked: {e}")))?;
    if state.len() as u64 != length {
        return Err(damaged(format!("its state is not {length} bytes long")));
    }
    Ok(Checkpoint { path, header, state, skipped: Vec::new() })
}

/// The newest good checkpoint in `dir`. If a newer one cannot be used, [`Checkpoint::skipped`] says why.
///
/// # Errors
/// [`CheckpointError::OtherScene`] unless its scene hash is `scene_hash`; [`CheckpointError::None`],
/// [`CheckpointError::NoneValid`], [`CheckpointError::Output`].
pub fn latest_valid(dir: &Path, scene_hash: &str) -> Result<Checkpoint, CheckpointError> {
    if !dir.is_dir() {
        return Err(CheckpointError::None { dir: dir.to_owned() });
    }
    let mut skipped = Vec::new();
    for (_, path) in list(dir)?.into_iter().rev() {
        match read(&path) {
            Ok(found) if found.header.scene_hash != scene_hash => {
                let (found, expected) = (found.header.scene_hash, scene_hash.to_owned());
                return Err(CheckpointError::OtherScene { path, found, expected });
            }
            Ok(found) => return Ok(Checkpoint { skipped, ..found }),
            Err(e) => skipped.push(e.to_string()),
        }
    }
    let dir = dir.to_owned();
    Err(if skipped.is_empty() {
        CheckpointError::None { dir }
    } else {
        CheckpointError::NoneValid { dir, reasons: skipped }
    })
}

/// The number of a checkpoint file, by its name.
pub(crate) fn sequence_number(name: &str) -> Option<u64> {
    let digits = name.strip_suffix(".glebe")?;
    (digits.len() >= 6 && digits.bytes().all(|b| b.is_ascii_digit())).then(|| digits.parse().ok()).flatten()
}

/// The checkpoint files of a folder, oldest first.
fn list(dir: &Path) -> Result<Vec<(u64, PathBuf)>, OutputError> {
    let read = |e| OutputError::io(dir, "read this folder", e);
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).map_err(read)? {
        let entry = entry.map_err(read)?;
        if let Some(number) = entry.file_name().to_str().and_then(sequence_number) {
            found.push((number, entry.path()));
        }
    }
    found.sort();
    Ok(found)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes[at..at + 8].iter().rev().fold(0, |n, &b| n << 8 | u64::from(b))
}
