//! Frames: numbered files of one or several parts, and the collection that lists them.

use std::fs;
use std::path::PathBuf;

use super::atomic::OutputError;
use super::pvd;
use super::xml::Part as File;

/// Where frames are.
#[derive(Clone, Debug)]
pub struct Collection {
    /// The folder of the files; it may not exist yet.
    pub folder: PathBuf,
    /// The file that lists them.
    pub list: PathBuf,
    /// From the list to the folder, with `/` at its end, or nothing.
    pub prefix: &'static str,
}

/// Writes numbered files, such as `frames/000000_NAME.vtp`, … and keeps their list complete after every frame.
#[derive(Debug)]
pub struct FrameWriter {
    at: Collection,
    parts: Vec<Part>,
    next: u64,
}

#[derive(Debug)]
struct Part {
    name: String,
    /// The name as a part of file names.
    stem: String,
}

impl FrameWriter {
    /// Begins the frames of a new run. `parts` names what a frame may show: particles, meshes.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn create(at: Collection, parts: &[&str]) -> Result<Self, OutputError> {
        Self::begin(at, parts, &[], 0)
    }

    /// Continues after the first `frames` frames of an earlier run; later ones are forgotten.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] if the collection does not list that many, [`OutputError::Io`].
    pub fn resume(at: Collection, parts: &[&str], frames: u64) -> Result<Self, OutputError> {
        if frames == 0 {
            return Self::create(at, parts);
        }
        let mut entries = pvd::read(&at.list)?;
        let number = |e: &pvd::Entry| frame_number(at.prefix, &e.file);
        entries.retain(|e| number(e).is_some_and(|n| n < frames));
        let found = entries.iter().filter_map(number).max().map_or(0, |n| n + 1);
        if found < frames {
            return Err(OutputError::Malformed {
                path: at.list.clone(),
                what: format!(
                    "lists {found} frames, but the checkpoint was taken after {frames}: put the missing \
                     frames back, or start again with --force"
                ),
            });
        }
        Self::begin(at, parts, &entries, frames)
    }

    fn begin(at: Collection, parts: &[&str], entries: &[pvd::Entry], next: u64) -> Result<Self, OutputError> {
        fs::create_dir_all(&at.folder).map_err(|e| OutputError::io(&at.folder, "make this folder", e))?;
        pvd::write(&at.list, entries)?;
        Ok(Self { at, parts: name_parts(parts), next })
    }

    /// Number of frames so far, to be kept with a checkpoint.
    pub fn count(&self) -> u64 {
        self.next
    }

    /// Writes the frame at `time` \[s\]. `shown` pairs the index of a part's name with its data; a
    /// part that is absent now is left out.
    ///
    /// # Errors
    /// [`OutputError::Columns`] for data that do not fit together or an index without a name,
    /// [`OutputError::Io`].
    pub fn write<F: File>(&mut self, time: f64, shown: &[(usize, F)]) -> Result<(), OutputError> {
        let mut entries = Vec::with_capacity(shown.len());
        for (part, data) in shown {
            let Some(Part { name, stem }) = self.parts.get(*part) else {
                let what = format!("part {part} of the frame at {time} s has no name");
                return Err(OutputError::columns(&self.at.list, what));
            };
            let file = format!("{:06}_{stem}.{}", self.next, F::EXTENSION);
            data.write(&self.at.folder.join(&file), time)?;
            entries.push(pvd::Entry {
                time,
                part: *part,
                name: name.clone(),
                file: format!("{}{file}", self.at.prefix),
            });
        }
        pvd::extend(&self.at.list, &entries)?;
        self.next += 1;
        Ok(())
    }
}

/// The frame that `frames/000012_NAME.vtp` belongs to.
fn frame_number(prefix: &str, file: &str) -> Option<u64> {
    file.strip_prefix(prefix)?.split_once('_')?.0.parse().ok()
}

/// Gives each part a stem that is safe in a file name and no other part has, whatever the case.
fn name_parts(names: &[&str]) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::with_capacity(names.len());
    for (k, name) in names.iter().enumerate() {
        let safe = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
        let mut stem: String = name.chars().take(60).map(safe).collect();
        while parts.iter().any(|p| p.stem.eq_ignore_ascii_case(&stem)) {
            stem = format!("{stem}-{k}");
        }
        parts.push(Part { name: (*name).to_owned(), stem });
    }
    parts
}
