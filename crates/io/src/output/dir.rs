//! The output folder: who may write into it, and what of it is ours.

use std::fs;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::atomic::{OutputError, PARTIAL_PREFIX, write_atomic};
use super::frames::Collection;
use super::lock::{LOCK, Lock};
use super::pvd::HEAD;

/// The first line of every SVG file that glebe writes, by which it knows its own plots again.
pub const SVG_MARK: &str = "<!-- plotted by glebe -->";

/// The first line of the copy of a study, by which glebe knows it again.
const STUDY_MARK: &str = "# copied by glebe";

/// The first line of scenes that glebe writes, by which it knows them again.
const SCENE_MARK: &str = "# written by glebe";

/// Files at the top of an output folder that belong to a run or a study.
const OWN_FILES: [&str; 11] = [
    "series.csv",
    "series.parquet",
    "summary.json",
    "frames.pvd",
    "report.html",
    "worlds.csv",
    "evaluations.csv",
    JOURNAL,
    "curves.csv",
    "bands.csv",
    "homogenisation.csv",
];

/// What is done with the results of an earlier run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// They stay, and nothing is run.
    Refuse,
    /// They are removed.
    Replace,
    /// They are continued.
    Resume,
}

const STUDY: &str = "study.toml";
const JOURNAL: &str = "journal.jsonl";
const CHECKPOINTS: &str = "checkpoint";
const FRAMES: &str = "frames";
const FIELDS: &str = "fields";
const SAMPLES: &str = "samples";
const ROUNDS: &str = "rounds";

/// The folder that a run writes its results into. While this lives no other run gets hold of it.
#[derive(Clone, Debug)]
pub struct OutputDir {
    path: PathBuf,
    _lock: Lock,
}

impl OutputDir {
    /// Makes a folder for a new run, with its parents, and checks that it can be written to.
    ///
    /// A folder that exists must be empty. With `force` the results of an earlier run are removed
    /// from it: only files that glebe itself writes, everything else stays untouched.
    ///
    /// # Errors
    /// [`OutputError::InUse`]; [`OutputError::NotEmpty`] without `force`; [`OutputError::NotAFolder`];
    /// [`OutputError::Io`] for a place that cannot be written to.
    pub fn create(path: &Path, force: bool) -> Result<Self, OutputError> {
        if path.exists() && !path.is_dir() {
            return Err(OutputError::NotAFolder { path: path.to_owned() });
        }
        fs::create_dir_all(path).map_err(|e| OutputError::io(path, "make this folder", e))?;
        let refuse_occupied = || match occupant(path)? {
            Some(example) if !force => Err(OutputError::NotEmpty { path: path.to_owned(), example }),
            _ => Ok(()),
        };
        Lock::refuse_used(path)?;
        // Before anything is written; and once more when no other run can come between.
        refuse_occupied()?;
        let dir = Self { path: path.to_owned(), _lock: Lock::take(path)? };
        refuse_occupied()?;
        remove_partial(path)?;
        if force {
            remove_own(path)?;
        }
        dir.probe()?;
        Ok(dir)
    }

    /// Whether `path` is a folder in which nothing was kept yet: it is empty, or a run was killed there before
    /// its first checkpoint, or a study before its journal.
    ///
    /// # Errors
    /// [`OutputError::Io`] for a folder that cannot be read.
    pub fn is_vacant(path: &Path) -> Result<bool, OutputError> {
        Ok(path.is_dir() && occupant(path)?.is_none())
    }

    /// Opens the folder of an earlier run, to continue it, and removes what a crash left unfinished in it.
    ///
    /// # Errors
    /// [`OutputError::NothingToResume`] if there is no folder or no checkpoint in it; [`OutputError::InUse`];
    /// [`OutputError::Io`] for a place that cannot be written to.
    pub fn open_existing(path: &Path) -> Result<Self, OutputError> {
        Self::open(path, "holds no checkpoint", |path| {
            let checkpoints = path.join(CHECKPOINTS);
            Ok(checkpoints.is_dir() && names(&checkpoints)?.iter().any(|name| is_checkpoint(name)))
        })
    }

    /// Opens the folder of an earlier study, to continue it.
    ///
    /// # Errors
    /// As [`open_existing`](Self::open_existing), with the journal in the place of checkpoints.
    pub fn open_study(path: &Path) -> Result<Self, OutputError> {
        Self::open(path, "holds no journal of a study", |path| Ok(is_file(&path.join(JOURNAL))))
    }

    fn open(
        path: &Path,
        without: &'static str,
        can: impl Fn(&Path) -> Result<bool, OutputError>,
    ) -> Result<Self, OutputError> {
        let missing = |why| OutputError::NothingToResume { path: path.to_owned(), why };
        if !path.is_dir() {
            return Err(missing("does not exist"));
        }
        if !can(path)? {
            return Err(missing(without));
        }
        let dir = Self { path: path.to_owned(), _lock: Lock::take(path)? };
        remove_partial(path)?;
        dir.probe()?;
        Ok(dir)
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }
    /// Where `series.csv` is.
    pub fn series(&self) -> PathBuf {
        self.path.join("series.csv")
    }
    /// Where `summary.json` is.
    pub fn summary(&self) -> PathBuf {
        self.path.join("summary.json")
    }
    /// The folder of the checkpoints; it may not exist yet.
    pub fn checkpoints(&self) -> PathBuf {
        self.path.join(CHECKPOINTS)
    }
    /// Where the frames are.
    pub fn frames(&self) -> Collection {
        Collection { folder: self.path.join(FRAMES), list: self.path.join("frames.pvd"), prefix: "frames/" }
    }
    /// Where the field of this name is: its list stands beside its files.
    pub fn field(&self, name: &str) -> Collection {
        let folder = self.path.join(FIELDS);
        Collection { list: folder.join(format!("{}.pvd", file_word(name))), folder, prefix: "" }
    }
    /// Where profile number `number` of the field of this name is.
    pub fn profile(&self, name: &str, number: u64) -> PathBuf {
        self.path.join(FIELDS).join(format!("{number:06}_{}.csv", file_word(name)))
    }
    /// Where the results of each world of a study are.
    pub fn worlds(&self) -> PathBuf {
        self.path.join("worlds.csv")
    }
    /// Where the results of each evaluation of a calibration are.
    pub fn evaluations(&self) -> PathBuf {
        self.path.join("evaluations.csv")
    }
    /// Where the worlds of a study are noted that have ended.
    pub fn journal(&self) -> PathBuf {
        self.path.join(JOURNAL)
    }
    /// The folder of the curves of samples; it may not exist yet.
    pub fn samples(&self) -> PathBuf {
        self.path.join(SAMPLES)
    }
    /// Where the curve of a sample is.
    pub fn sample(&self, number: usize) -> PathBuf {
        self.samples().join(format!("{number:06}.csv"))
    }
    /// The folder of a study that is a part of this one, from its number; it may not exist yet.
    pub fn round(&self, number: usize) -> PathBuf {
        self.path.join(ROUNDS).join(format!("{number:06}"))
    }
    /// Where the table `name` of a study of samples is.
    pub fn table(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.csv"))
    }
    /// Where the plot `name` (without extension) is. Plots start with [`SVG_MARK`].
    pub fn plot(&self, name: &str) -> PathBuf {
        self.path.join(format!("{name}.svg"))
    }

    /// Writes a plot, an SVG text, whole or not at all.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn write_plot(&self, name: &str, svg: &str) -> Result<(), OutputError> {
        write_atomic(&self.plot(name), |out| {
            if !svg.starts_with(SVG_MARK) {
                writeln!(out, "{SVG_MARK}")?;
            }
            out.write_all(svg.as_bytes())
        })
    }

    /// Writes the copy `study.toml` of a study, with a remark for each of `sets`, by which it was changed. A file of
    /// that name that is no such copy stays.
    ///
    /// # Errors
    /// [`OutputError::Foreign`], [`OutputError::Io`].
    pub fn write_study(&self, text: &str, sets: &[String]) -> Result<(), OutputError> {
        let path = self.path.join(STUDY);
        if path.symlink_metadata().is_ok() && !begins_with(&path, STUDY_MARK)? {
            return Err(OutputError::Foreign { path });
        }
        write_atomic(&path, |out| {
            writeln!(out, "{STUDY_MARK}")?;
            for set in sets {
                writeln!(out, "# --set {}", set.replace(['\n', '\r'], " "))?;
            }
            out.write_all(text.as_bytes())
        })
    }

    /// Writes a scene under a name (without extension), with a remark. A file of that name that is not glebe's stays.
    ///
    /// # Errors
    /// [`OutputError::Foreign`], [`OutputError::Io`].
    pub fn write_scene(&self, name: &str, text: &str, remark: &str) -> Result<PathBuf, OutputError> {
        let path = self.path.join(format!("{name}.toml"));
        if path.symlink_metadata().is_ok() && !begins_with(&path, SCENE_MARK)? {
            return Err(OutputError::Foreign { path });
        }
        write_atomic(&path, |out| {
            writeln!(out, "{SCENE_MARK}: {}", remark.replace(['\n', '\r'], " "))?;
            out.write_all(text.as_bytes())
        })?;
        Ok(path)
    }

    /// A read-only folder should be told of before hours of computing, not after.
    fn probe(&self) -> Result<(), OutputError> {
        let file = self.path.join(format!("{PARTIAL_PREFIX}probe-{}", std::process::id()));
        write_atomic(&file, |_| Ok(()))
            .and_then(|()| fs::remove_file(&file).map_err(|e| OutputError::io(&file, "remove this file", e)))
            .map_err(|e| match e {
                OutputError::Io { source, .. } => {
                    OutputError::io(&self.path, "write into this folder", source)
                }
                other => other,
            })
    }
}

/// The names in a folder, sorted. Names that are not Unicode are not ours, and shown with `�`.
fn names(folder: &Path) -> Result<Vec<String>, OutputError> {
    let read = |e| OutputError::io(folder, "read this folder", e);
    let mut names = fs::read_dir(folder)
        .map_err(read)?
        .map(|entry| Ok(entry.map_err(read)?.file_name().to_string_lossy().into_owned()))
        .collect::<Result<Vec<_>, OutputError>>()?;
    names.sort();
    Ok(names)
}

/// Something in the folder that is more than a run leaves that is killed before its first checkpoint, or a
/// study before its journal.
fn occupant(path: &Path) -> Result<Option<String>, OutputError> {
    for name in names(path)? {
        let inner = path.join(&name);
        let begun = name.starts_with(PARTIAL_PREFIX)
            || name == LOCK
            || name == CHECKPOINTS
                && is_folder(&inner)
                && names(&inner)?.iter().all(|n| n.starts_with(PARTIAL_PREFIX))
            || name == STUDY && is_file(&inner) && begins_with(&inner, STUDY_MARK)?;
        if !begun {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Removes what a crash left unfinished.
fn remove_partial(path: &Path) -> Result<(), OutputError> {
    let inner = [FRAMES, FIELDS, CHECKPOINTS, SAMPLES]
        .map(|name| path.join(name))
        .into_iter()
        .filter(|f| is_folder(f));
    for folder in std::iter::once(path.to_owned()).chain(inner) {
        for name in names(&folder)?.iter().filter(|name| name.starts_with(PARTIAL_PREFIX)) {
            remove_file(&folder.join(name))?;
        }
    }
    Ok(())
}

/// Checkpoints go first: without them, what is left when this is interrupted is not taken for a run.
fn remove_own(path: &Path) -> Result<(), OutputError> {
    remove_own_in(&path.join(CHECKPOINTS), is_checkpoint)?;
    for name in names(path)? {
        let file = path.join(&name);
        if is_file(&file)
            && (OWN_FILES.contains(&name.as_str())
                || (file.extension().is_some_and(|e| e == "svg") && begins_with(&file, SVG_MARK)?)
                || (name == STUDY && begins_with(&file, STUDY_MARK)?)
                || (file.extension().is_some_and(|e| e == "toml") && begins_with(&file, SCENE_MARK)?))
        {
            remove_file(&file)?;
        }
    }
    remove_own_in(&path.join(SAMPLES), is_sample)?;
    let fields = path.join(FIELDS);
    if is_folder(&fields) {
        for name in names(&fields)? {
            let list = fields.join(name);
            let named = list.extension().is_some_and(|e| e == "pvd");
            if named && is_file(&list) && begins_with(&list, HEAD)? {
                remove_file(&list)?;
            }
        }
    }
    remove_own_in(&fields, |name| is_numbered(name, ".vti") || is_numbered(name, ".csv"))?;
    remove_own_in(&path.join(FRAMES), |name| is_numbered(name, ".vtp"))?;
    let rounds = path.join(ROUNDS);
    if is_folder(&rounds) {
        for name in names(&rounds)?.iter().filter(|name| is_number(name)) {
            let round = rounds.join(name);
            if is_folder(&round) {
                remove_own(&round)?;
                remove_empty(&round)?;
            }
        }
        remove_empty(&rounds)?;
    }
    Ok(())
}

/// Removes a folder's files whose names are `own`, and the folder if nothing is left in it.
fn remove_own_in(folder: &Path, own: impl Fn(&str) -> bool) -> Result<(), OutputError> {
    if !is_folder(folder) {
        return Ok(());
    }
    for name in names(folder)? {
        let file = folder.join(&name);
        if is_file(&file) && own(&name) {
            remove_file(&file)?;
        }
    }
    remove_empty(folder)
}

/// Removes a folder if nothing is left in it.
fn remove_empty(folder: &Path) -> Result<(), OutputError> {
    match fs::remove_dir(folder) {
        Err(e) if e.kind() != ErrorKind::DirectoryNotEmpty => {
            Err(OutputError::io(folder, "remove this folder", e))
        }
        _ => Ok(()),
    }
}

fn remove_file(file: &Path) -> Result<(), OutputError> {
    fs::remove_file(file).map_err(|e| OutputError::io(file, "remove this file", e))
}

/// Whether it is a folder and no link, which may lead to somebody else's files.
fn is_folder(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|m| m.is_dir())
}

fn is_file(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|m| m.is_file())
}

/// Such as `000012_particles.vtp`.
fn is_numbered(name: &str, extension: &str) -> bool {
    name.strip_suffix(extension)
        .and_then(|stem| stem.split_once('_'))
        .is_some_and(|(number, _)| is_number(number))
}

/// `000012.csv`
fn is_sample(name: &str) -> bool {
    name.strip_suffix(".csv").is_some_and(is_number)
}

/// `000012`
fn is_number(name: &str) -> bool {
    name.len() >= 6 && name.bytes().all(|b| b.is_ascii_digit())
}

fn is_checkpoint(name: &str) -> bool {
    crate::checkpoint::sequence_number(name).is_some()
}

fn begins_with(file: &Path, mark: &str) -> Result<bool, OutputError> {
    let mut start = Vec::new();
    fs::File::open(file)
        .and_then(|f| f.take(mark.len() as u64).read_to_end(&mut start))
        .map_err(|e| OutputError::io(file, "read this file", e))?;
    Ok(start == mark.as_bytes())
}

/// A name as a part of a file's name.
pub fn file_word(name: &str) -> String {
    name.chars().map(|x| if x.is_alphanumeric() || x == '-' { x } else { '-' }).collect()
}
