//! Whole files or none: written beside their place, made durable, then renamed into it.

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Beginning of the names of files that are not complete yet. What is left of them after a crash may
/// be deleted.
pub(super) const PARTIAL_PREFIX: &str = ".glebe-partial-";

/// Why something could not be written to, or read from, an output folder.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}{}", advice(source))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb phrase.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The output folder holds something already.
    #[error(
        "{path}: this folder is not empty (it holds `{example}`), and results are never mixed or \
         overwritten unasked: give another folder with --out, continue the run in it with --resume, or \
         replace its results with --force"
    )]
    NotEmpty {
        /// The folder.
        path: PathBuf,
        /// A file in it.
        example: String,
    },
    /// Another run writes into the output folder.
    #[error(
        "{path}: another run is writing into this folder: wait until it has ended, or stop it, or give another \
         folder with --out"
    )]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// A path that should be a folder is something else.
    #[error("{path}: is a file, but an output folder is needed there: give another name with --out")]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// A file has the name of one of ours, and is none.
    #[error("{path}: is not a file that glebe made, and is not overwritten: give another folder with --out")]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// A run should be continued where there is none.
    #[error("{path}: there is no run to resume here: the folder {why}; start it without --resume")]
    NothingToResume {
        /// The folder.
        path: PathBuf,
        /// What is missing.
        why: &'static str,
    },
    /// A file that was read is not what it should be.
    #[error("{path}: {what}")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong, where, and what to do.
        what: String,
    },
    /// The columns given to a writer do not fit together.
    #[error("{path}: not written, because {what}")]
    Columns {
        /// The file.
        path: PathBuf,
        /// Which column, and why.
        what: String,
    },
}

impl OutputError {
    /// Whether what was given is at fault, rather than what happened after the start.
    pub fn is_input(&self) -> bool {
        matches!(
            self,
            Self::NotEmpty { .. }
                | Self::InUse { .. }
                | Self::NotAFolder { .. }
                | Self::Foreign { .. }
                | Self::NothingToResume { .. }
        )
    }

    pub(crate) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        Self::Io { path: path.to_owned(), action, source }
    }

    pub(super) fn columns(path: &Path, what: String) -> Self {
        Self::Columns { path: path.to_owned(), what }
    }
}

/// What to do about an error of the operating system, as the end of a sentence.
fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::StorageFull => "; the disk is full: free some space on it, then go on with --resume",
        ErrorKind::QuotaExceeded => {
            "; your quota is used up: free some space on it, then go on with --resume"
        }
        ErrorKind::FileTooLarge => {
            "; files may not grow that large here: choose another disk with --out, or raise the limit (ulimit -f)"
        }
        ErrorKind::ReadOnlyFilesystem => "; the disk is mounted read-only: choose another place with --out",
        ErrorKind::PermissionDenied => {
            "; you may not write there: change the folder's permissions or choose another with --out"
        }
        ErrorKind::NotFound => "; the folder it should be in does not exist (any more)",
        ErrorKind::NotADirectory => {
            "; a part of this path is a file, not a folder: choose another with --out"
        }
        ErrorKind::InvalidFilename => "; the name is too long or not allowed here: choose another with --out",
        _ => "",
    }
}

/// Writes a file whole or not at all.
///
/// `write` fills a temporary file in the same folder, which is made durable and then renamed to
/// `path`. If anything fails, a file that was at `path` before is unchanged and the temporary file is
/// removed.
///
/// # Errors
/// [`OutputError::Io`] with the path, what failed and what to do.
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), OutputError> {
    let (partial, file) = create_partial(path)?;
    let done = fill(file, write).map_err(|e| OutputError::io(path, "write this file", e)).and_then(|()| {
        fs::rename(&partial, path).map_err(|e| OutputError::io(path, "put this file in its place", e))
    });
    if done.is_err() {
        // The first error is the one that matters.
        let _ = fs::remove_file(&partial);
        return done;
    }
    sync_folder(path).map_err(|e| OutputError::io(path, "make this file durable", e))
}

fn fill(file: File, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(1 << 16, file);
    write(&mut out)?;
    out.flush()?;
    out.get_ref().sync_all()
}

/// A new file in the folder of `path`, of a name that no other thread or process uses.
fn create_partial(path: &Path) -> Result<(PathBuf, File), OutputError> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    if path.file_name().is_none() {
        let source = io::Error::from(ErrorKind::InvalidFilename);
        return Err(OutputError::io(path, "write a file of this name", source));
    }
    loop {
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let partial = path.with_file_name(format!("{PARTIAL_PREFIX}{}-{count}", std::process::id()));
        match File::create_new(&partial) {
            Ok(file) => return Ok((partial, file)),
            // Left behind by a process that was killed and had the same number, as all have in containers.
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(OutputError::io(path, "write this file", e)),
        }
    }
}

/// Makes the rename itself survive a power cut. Only Unix lets a folder be opened for this.
#[cfg(unix)]
fn sync_folder(path: &Path) -> io::Result<()> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => File::open(folder)?.sync_all(),
        _ => File::open(".")?.sync_all(),
    }
}

#[cfg(not(unix))]
fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}
