//! Frames: numbered `.vtp` files of several parts, and the collection that lists them.

use std::fs;
use std::path::PathBuf;

use super::atomic::OutputError;
use super::dir::OutputDir;
use super::pvd;
use super::vtp::PolyData;

/// Writes `frames/000000_NAME.vtp`, … and keeps `frames.pvd` complete after every frame.
#[derive(Debug)]
pub struct FrameWriter {
    folder: PathBuf,
    collection: PathBuf,
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
    pub fn create(dir: &OutputDir, parts: &[&str]) -> Result<Self, OutputError> {
        Self::begin(dir, parts, &[], 0)
    }

    /// Continues after the first `frames` frames of an earlier run; later ones are forgotten.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] if the collection does not list that many, [`OutputError::Io`].
    pub fn resume(dir: &OutputDir, parts: &[&str], frames: u64) -> Result<Self, OutputError> {
        if frames == 0 {
            return Self::create(dir, parts);
        }
        let path = dir.frames_pvd();
        let mut entries = pvd::read(&path)?;
        entries.retain(|e| frame_number(&e.file).is_some_and(|n| n < frames));
        let found = entries.iter().filter_map(|e| frame_number(&e.file)).max().map_or(0, |n| n + 1);
        if found < frames {
            return Err(OutputError::Malformed {
                path,
                what: format!(
                    "lists {found} frames, but the checkpoint was taken after {frames}: put the missing \
                     frames back, or start again with --force"
                ),
            });
        }
        Self::begin(dir, parts, &entries, frames)
    }

    fn begin(
        dir: &OutputDir,
        parts: &[&str],
        entries: &[pvd::Entry],
        next: u64,
    ) -> Result<Self, OutputError> {
        let folder = dir.frames();
        fs::create_dir_all(&folder).map_err(|e| OutputError::io(&folder, "make this folder", e))?;
        let writer = Self { folder, collection: dir.frames_pvd(), parts: name_parts(parts), next };
        pvd::write(&writer.collection, entries)?;
        Ok(writer)
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
    pub fn write(&mut self, time: f64, shown: &[(usize, PolyData)]) -> Result<(), OutputError> {
        let mut entries = Vec::with_capacity(shown.len());
        for (part, data) in shown {
            let Some(Part { name, stem }) = self.parts.get(*part) else {
                let what = format!("part {part} of the frame at {time} s has no name");
                return Err(OutputError::columns(&self.collection, what));
            };
            let file = format!("{:06}_{stem}.vtp", self.next);
            data.write(&self.folder.join(&file), time)?;
            entries.push(pvd::Entry {
                time,
                part: *part,
                name: name.clone(),
                file: format!("frames/{file}"),
            });
        }
        pvd::extend(&self.collection, &entries)?;
        self.next += 1;
        Ok(())
    }
}

/// The frame that `frames/000012_NAME.vtp` belongs to.
fn frame_number(file: &str) -> Option<u64> {
    file.strip_prefix("frames/")?.split_once('_')?.0.parse().ok()
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
