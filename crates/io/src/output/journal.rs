//! A journal: what has ended, one line of JSON each, durable at once, so that a study that was stopped anywhere goes
//! on with what is left.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::atomic::{OutputError, write_atomic};

/// A journal that is being written: a line about the whole, then a line for each entry.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
}

impl Journal {
    /// Begins a journal, replacing a file at `path`.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn create(path: &Path, head: &impl Serialize) -> Result<Self, OutputError> {
        let line = line(path, head)?;
        write_atomic(path, |out| out.write_all(&line))?;
        Self::append_to(path)
    }

    /// Continues a journal: what stands in it, and the journal after that. A line that was not finished is cut off.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] with the line, [`OutputError::Io`].
    pub fn resume<H: DeserializeOwned, E: DeserializeOwned>(
        path: &Path,
    ) -> Result<(H, Vec<E>, Self), OutputError> {
        let text = std::fs::read(path).map_err(|e| OutputError::io(path, "read this journal", e))?;
        let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let malformed = |number: usize, why: String| OutputError::Malformed {
            path: path.to_owned(),
            what: format!("line {number} is not of a journal that this version of glebe wrote: {why}"),
        };
        let mut lines = text[..whole].split_inclusive(|byte| *byte == b'\n').enumerate();
        let Some((_, head)) = lines.next() else { return Err(malformed(1, "it is not there".to_owned())) };
        let head = serde_json::from_slice(head).map_err(|e| malformed(1, e.to_string()))?;
        let entries = lines
            .map(|(k, line)| serde_json::from_slice(line).map_err(|e| malformed(k + 1, e.to_string())))
            .collect::<Result<_, _>>()?;
        let journal = Self::append_to(path)?;
        let cut = journal.file.set_len(whole as u64);
        cut.map_err(|e| OutputError::io(path, "cut an unfinished line off this file", e))?;
        Ok((head, entries, journal))
    }

    fn append_to(path: &Path) -> Result<Self, OutputError> {
        let file = OpenOptions::new().append(true).open(path);
        let file = file.map_err(|e| OutputError::io(path, "open this file for writing", e))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Appends an entry and makes it durable.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn append(&mut self, entry: &impl Serialize) -> Result<(), OutputError> {
        let line = line(&self.path, entry)?;
        let written = self.file.write_all(&line).and_then(|()| self.file.sync_data());
        written.map_err(|e| OutputError::io(&self.path, "append to this file", e))
    }
}

fn line(path: &Path, value: &impl Serialize) -> Result<Vec<u8>, OutputError> {
    let line = serde_json::to_vec(value).map_err(|e| OutputError::io(path, "write this file", e.into()));
    line.map(|mut line| {
        line.push(b'\n');
        line
    })
}
