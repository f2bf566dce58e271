//! One run at a time in an output folder.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::atomic::OutputError;

/// The file that a run locks in its folder. It is empty: only the lock counts, which the system takes back when the
/// process ends, however it does.
pub(super) const LOCK: &str = ".glebe-lock";
/// Times that the file may vanish between being opened and being locked.
const TRIES: u32 = 100;

/// A folder that no other run writes into, for as long as this lives.
#[derive(Clone, Debug)]
pub(super) struct Lock {
    /// None where the file system knows no locks: there nothing guards the folder.
    _held: Option<Arc<Held>>,
}

/// A file that is locked.
#[derive(Debug)]
struct Held {
    path: PathBuf,
    _file: File,
}

impl Drop for Held {
    fn drop(&mut self) {
        // Elsewhere nobody could tell that the file that he has locked is gone.
        if cfg!(unix) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl Lock {
    /// Takes the lock of a folder that exists.
    ///
    /// # Errors
    /// [`OutputError::InUse`]; [`OutputError::Io`] for a folder that cannot be written to.
    pub(super) fn take(folder: &Path) -> Result<Self, OutputError> {
        let path = folder.join(LOCK);
        for _ in 0..TRIES {
            // For writing: network file systems give no lock otherwise.
            let file = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
            let file = file.map_err(|e| OutputError::io(folder, "write into this folder", e))?;
            match file.try_lock() {
                Ok(()) if is_at(&file, &path) => {
                    return Ok(Self { _held: Some(Arc::new(Held { path, _file: file })) });
                }
                // The run that had it has just ended, and took the file with it.
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => break,
                Err(TryLockError::Error(_)) => return Ok(Self { _held: None }),
            }
        }
        Err(OutputError::InUse { path: folder.to_owned() })
    }

    /// Refuses a folder that a run writes into, without writing to it.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub(super) fn refuse_used(folder: &Path) -> Result<(), OutputError> {
        match folder.join(LOCK).symlink_metadata() {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
            _ => Self::take(folder).map(drop),
        }
    }
}

/// Whether a path still leads to an open file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let number = |m: fs::Metadata| (m.dev(), m.ino());
    file.metadata().ok().map(number) == fs::metadata(path).ok().map(number)
}

#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}
