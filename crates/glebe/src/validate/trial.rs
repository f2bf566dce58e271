//! Running a case's worlds.

use std::convert::Infallible;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Frame, Glance, Observer, Sample, Status, positions};
use glebe_engine::spec::{ParticleSet, Vec3, WorldSpec};
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
    let batch = run_with(worlds, backend, &mut record)?;
    Ok(Finished { batch, series: record.series })
}

/// The same, with an observer of its own.
pub fn run_with<O: Observer<Error = Infallible>>(
    worlds: Vec<(Arc<Constants>, State)>,
    backend: Backend,
    observer: &mut O,
) -> Result<Batch, CaseError> {
    let constants: Vec<_> = worlds.iter().map(|(constants, _)| constants.clone()).collect();
    admit(backend, &constants)?;
    let mut batch = Batch::from_states(worlds, backend);
    while batch.running() {
        let Ok(()) = batch.advance(observer);
    }
    Ok(batch)
}

/// A world when its first stage has ended.
pub fn settled(world: WorldSpec, backend: Backend) -> Result<(Arc<Constants>, State), CaseError> {
    let (constants, state) = prepare(world)?;
    admit(backend, std::slice::from_ref(&constants))?;
    let mut batch = Batch::from_states(vec![(constants.clone(), state)], backend);
    while batch.running() && batch.progress(0).stage == 0 {
        let Ok(()) = batch.advance(&mut Record::default());
    }
    match (batch.sound_state(0), batch.status(0)) {
        (Ok(state), Status::Running | Status::Done) => Ok((constants, state)),
        (Ok(_), status) => Err(CaseError::stopped(&constants.spec.title, status)),
        (Err(failure), _) => Err(CaseError::stopped(&constants.spec.title, &Status::Failed(failure))),
    }
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

/// A world that goes on from where the particles of another have come to, at rest and in contacts that begin anew,
/// without its first stage: particles can be added to it.
pub fn at_rest(constants: &Constants, state: &State) -> WorldSpec {
    let mut spec = constants.spec.clone();
    spec.stages.remove(0);
    spec.particles = ParticleSet::default();
    let particles = &state.particles;
    for (k, x) in positions(constants, state).into_iter().enumerate() {
        let radius = f64::from(particles.place[k].radius);
        spec.particles.push(x, radius, particles.spin[k].material as usize);
    }
    spec
}

/// A world with those of its particles, by centre and radius \[m\], that are to be kept.
pub fn keep(mut spec: WorldSpec, kept: impl Fn(Vec3, f64) -> bool) -> WorldSpec {
    let all = std::mem::take(&mut spec.particles);
    for (k, x) in all.position.iter().enumerate() {
        if kept(*x, all.radius[k]) {
            spec.particles.push(*x, all.radius[k], all.material[k]);
        }
    }
    spec
}

/// Shows worlds with each row of their series.
pub struct Look<F>(pub F);

impl<F: FnMut(usize, &Frame<'_>)> Observer for Look<F> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
    fn wants_look(&self, _: usize, _: &Sample) -> bool {
        true
    }
    fn look(&mut self, world: usize, frame: &Frame<'_>) -> Result<(), Infallible> {
        (self.0)(world, frame);
        Ok(())
    }
}

/// Shows particles with each row of their world's series.
pub struct Watch<F>(pub F);

impl<F: FnMut(usize, &Glance<'_>)> Observer for Watch<F> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
    fn wants_glance(&self, _: usize, _: &Sample) -> bool {
        true
    }
    fn glance(&mut self, world: usize, glance: &Glance<'_>) -> Result<(), Infallible> {
        (self.0)(world, glance);
        Ok(())
    }
}

/// Kinetic energy of a sample \[J\].
pub fn kinetic(sample: &Sample) -> f64 {
    sample.ledger.translation + sample.ledger.rotation
}

/// Largest kinetic energy of samples \[J\].
pub fn peak_kinetic(series: &[Sample]) -> f64 {
    series.iter().map(kinetic).fold(0.0, f64::max)
}

/// Largest of values; NaN of none, or if one is, so that no limit holds.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().reduce(|a, b| if a >= b || a.is_nan() { a } else { b }).unwrap_or(f64::NAN)
}

/// Least of values; NaN as [`largest`].
pub fn least(values: impl IntoIterator<Item = f64>) -> f64 {
    -largest(values.into_iter().map(|x| -x))
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

/// A device counts as full where a step costs so many times what it costs with the fewest particles.
const FULLER: f64 = 4.0;

/// The power by which wall time grows with size, of the upper half of sizes and beyond what launches cost: a device is full
/// with many particles only, the CPU is from the start.
pub fn upper_power(costs: &[[f64; 2]]) -> f64 {
    let full = costs.iter().position(|cost| cost[1] >= FULLER * costs[0][1]).unwrap_or(costs.len());
    let from = full.min(costs.len().saturating_sub(2)).max(costs.len() / 2);
    let [n, t] = [0, 1].map(|k| costs[from..].iter().map(|cost| cost[k]).collect::<Vec<_>>());
    power_law(&n, &t)
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
