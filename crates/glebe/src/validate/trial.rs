//! Running a case's worlds.

use std::convert::Infallible;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Frame, Observer, Sample, Status};
use glebe_engine::spec::WorldSpec;
use glebe_engine::state::{StageResult, State};
use glebe_engine::{Constants, prepare};
use glebe_io::output::Existing;
use glebe_io::scene::{Scene, SceneError};
use glebe_io::study::Study;
use glebe_study::calibrate::Settings;
use glebe_study::fit::line;

use super::case::CaseError;
use crate::device::admit;

/// Wall time between checkpoints of a study's worlds: what a stop loses at most.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(120);

/// How a case is run.
#[derive(Clone, Copy, Debug)]
pub struct Trial<'a> {
    /// In its quick size.
    pub quick: bool,
    /// What computes.
    pub backend: Backend,
    /// Where studies of the case leave their results.
    pub results: &'a Path,
    /// Whether studies that were begun there go on.
    pub resume: bool,
}

impl Trial<'_> {
    /// How a study of the case is run, whose results have a folder of their own.
    pub fn study(&self, name: &str) -> Settings {
        let out = self.results.join(name);
        // A stop may have come before the study was begun.
        let goes_on = self.resume && out.exists();
        Settings {
            backend: self.backend,
            memory: crate::device::memory(self.backend),
            existing: if goes_on { Existing::Resume } else { Existing::Replace },
            checkpoint_every: CHECKPOINT_EVERY,
            ..Settings::new(out)
        }
    }
}

/// A scene file of a case, as it is in `validation/`.
pub struct SceneFile {
    /// Path, for messages.
    pub name: &'static str,
    /// Content.
    pub text: &'static str,
}

/// The file `validation/$path`.
macro_rules! scene_file {
    ($path:literal) => {
        crate::validate::trial::SceneFile {
            name: concat!("validation/", $path),
            text: include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/", $path)),
        }
    };
}
pub(super) use scene_file;

impl SceneFile {
    /// The file with other text in some places.
    pub fn with(&self, changes: &[(&str, &str)]) -> Result<String, CaseError> {
        changes.iter().try_fold(self.text.to_owned(), |text, (from, to)| {
            if text.contains(from) {
                Ok(text.replace(from, to))
            } else {
                Err(CaseError::Scene(format!("{} has no `{from}`", self.name)))
            }
        })
    }

    /// The scene's world, with overrides as `--set` takes them.
    pub fn world(&self, sets: &[String]) -> Result<WorldSpec, CaseError> {
        self.world_in(Path::new("."), sets)
    }

    /// The same, with its files in a folder.
    pub fn world_in(&self, folder: &Path, sets: &[String]) -> Result<WorldSpec, CaseError> {
        let scene = Scene::parse(self.name, self.text, sets).map_err(|e| wrong(&e))?;
        Ok(scene.build(folder).map_err(|e| wrong(&e))?.world)
    }
}

/// The mistakes of a scene, each with its place.
pub fn wrong(errors: &[SceneError]) -> CaseError {
    CaseError::Scene(errors.iter().fold(String::new(), |mut text, e| {
        // Writing to a string does not fail.
        let _ = write!(text, "{e:#}");
        text
    }))
}

/// Worlds that have run, with their series.
pub struct Finished {
    /// The worlds, each done or failed.
    pub batch: Batch,
    /// The series of each.
    pub series: Vec<Vec<Sample>>,
}

/// Runs worlds on a backend until each is done or has failed.
pub fn run_to_end(worlds: Vec<WorldSpec>, backend: Backend) -> Result<Finished, CaseError> {
    run_states_to_end(worlds.into_iter().map(prepare).collect::<Result<_, _>>()?, backend)
}

/// The same for worlds that are under way.
pub fn run_states_to_end(
    worlds: Vec<(Arc<Constants>, State)>,
    backend: Backend,
) -> Result<Finished, CaseError> {
    let mut record = Record { series: vec![Vec::new(); worlds.len()] };
    let constants: Vec<_> = worlds.iter().map(|(constants, _)| constants.clone()).collect();
    admit(backend, &constants)?;
    let mut batch = Batch::from_states(worlds, backend);
    while batch.running() {
        let Ok(()) = batch.advance(&mut record);
    }
    Ok(Finished { batch, series: record.series })
}

impl Finished {
    /// Refuses to go on if a world was stopped.
    pub fn all_done(self) -> Result<Self, CaseError> {
        match (0..self.batch.len()).find(|&w| *self.batch.status(w) != Status::Done) {
            Some(w) => Err(CaseError::stopped(&self.batch.constants(w).spec.title, self.batch.status(w))),
            None => Ok(self),
        }
    }
}

/// Keeps series.
#[derive(Default)]
pub struct Record {
    /// The series of each world.
    pub series: Vec<Vec<Sample>>,
}

impl Observer for Record {
    type Error = Infallible;
    fn sample(&mut self, world: usize, sample: &Sample) -> Result<(), Infallible> {
        if let Some(series) = self.series.get_mut(world) {
            series.push(sample.clone());
        }
        Ok(())
    }
    fn frame(&mut self, _: usize, _: &Frame<'_>) -> Result<(), Infallible> {
        Ok(())
    }
    fn stage_ended(&mut self, _: usize, _: usize, _: &StageResult) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Kinetic energy of a sample \[J\].
pub fn kinetic(sample: &Sample) -> f64 {
    sample.ledger.translation + sample.ledger.rotation
}

/// Mean of values; NaN of none.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (n, sum) = values.into_iter().fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x));
    sum / n
}

/// The exponent p of `y ∝ x^p`, by least squares on logarithms; NaN if there is none.
pub fn power_law(x: &[f64], y: &[f64]) -> f64 {
    let log = |values: &[f64]| values.iter().map(|v| v.ln()).collect::<Vec<_>>();
    line(&log(x), &log(y)).map_or(f64::NAN, |[_, p]| p)
}

/// A folder for files of a case, which goes when it ends unless it is to be kept.
pub struct Folder(pub PathBuf);

impl Folder {
    /// A new one, named after the case.
    pub fn new(name: &str) -> Result<Self, CaseError> {
        let path = std::env::temp_dir().join(format!("glebe-{name}-{}", std::process::id()));
        fs::create_dir_all(&path)?;
        Ok(Self(path))
    }

    /// A study whose scene has a text of its own, with overrides as `--set` takes them. Both lie as in the repository,
    /// since a study names its scene from where it is; `beside` writes what the scene names into its folder.
    pub fn study(
        &self,
        (scene, text): (&SceneFile, &str),
        study: &SceneFile,
        sets: &[String],
        beside: impl FnOnce(&Path) -> Result<(), CaseError>,
    ) -> Result<Study, CaseError> {
        for (name, text) in [(scene.name, text), (study.name, study.text)] {
            let path = self.0.join(name);
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::write(path, text)?;
        }
        self.0.join(scene.name).parent().map_or(Ok(()), beside)?;
        Study::load(&self.0.join(study.name), sets).map_err(|errors| wrong(&errors))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left of it in the folder for temporary files harms nobody.
        let _ = fs::remove_dir_all(&self.0);
    }
}
