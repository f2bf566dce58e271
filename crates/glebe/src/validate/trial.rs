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
use glebe_io::output::{Existing, OutputDir};
use glebe_io::scene::{Scene, SceneError};
use glebe_study::calibrate::{Settings, StudyError};
use glebe_study::fit::line;

use super::case::CaseError;
use crate::device::admit;

/// How a case is run.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// In its quick size.
    pub quick: bool,
    /// What computes.
    pub backend: Backend,
    /// Where long cases keep their worlds, to go on with them in a later run.
    pub work: Option<&'static Path>,
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
pub struct Folder(pub PathBuf, bool);

impl Folder {
    /// A new one, named after the case.
    pub fn new(name: &str) -> Result<Self, CaseError> {
        let path = std::env::temp_dir().join(format!("glebe-{name}-{}", std::process::id()));
        fs::create_dir_all(&path)?;
        Ok(Self(path, false))
    }

    /// That of a long case: kept where the trial says so, for a later run.
    pub fn of(name: &str, trial: Trial) -> Result<Self, CaseError> {
        let Some(work) = trial.work else { return Self::new(name) };
        let path = work.join(if trial.quick { format!("{name}-quick") } else { name.to_owned() });
        fs::create_dir_all(&path)?;
        Ok(Self(path, true))
    }

    /// Settings of a study of a long case, which goes on where an earlier run was stopped.
    pub fn study(&self, name: &str, trial: Trial) -> Result<Settings, CaseError> {
        let out = self.0.join(name);
        let begun = out.is_dir() && !OutputDir::is_vacant(&out).map_err(StudyError::from)?;
        Ok(Settings {
            backend: trial.backend,
            memory: crate::device::memory(trial.backend),
            existing: if begun { Existing::Resume } else { Existing::Refuse },
            checkpoint_every: Duration::from_secs(120),
            ..Settings::new(out)
        })
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if self.1 {
            return;
        }
        // What is left of it in the folder for temporary files harms nobody.
        let _ = fs::remove_dir_all(&self.0);
    }
}
