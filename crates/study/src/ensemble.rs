//! What studies have in common: their settings, the folder with its journal, worlds made of scenes, batches that memory
//! holds, and what takes the worlds of a batch to their ends. States of worlds under way are kept, so that a study which
//! was stopped goes on.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Observer, Sample, Status};
use glebe_engine::state::State;
use glebe_engine::{Constants, prepare};
use glebe_io::checkpoint::{self, CheckpointError, Header};
use glebe_io::output::{Existing, Journal, OutputDir, OutputError, summary};
use glebe_io::scene::{Scene, SceneError};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::capture::{Capture, Wanted};
use crate::digest::scene_hash;
use crate::drive::{Drive, Event, Listener, Pulse, doubts};

/// Memory that a particle takes in a batch, its lists and what it was made from included \[bytes\]; see the table of
/// rates in the README.
const BYTES: f64 = 1500.0;

/// How a study is to be done.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The output folder.
    pub out: PathBuf,
    /// What computes.
    pub backend: Backend,
    /// What is done with results that are there.
    pub existing: Existing,
    /// Where settled beds are kept; none to keep none.
    pub beds: Option<PathBuf>,
    /// How many batches the worlds are divided into; none for as few as memory allows.
    pub batches: Option<usize>,
    /// Memory for worlds \[bytes\], if known.
    pub memory: Option<u64>,
    /// Wall time between checkpoints of worlds under way.
    pub checkpoint_every: Duration,
    /// The commit that this program was built from, if known.
    pub commit: Option<String>,
    /// By which arguments of `--set` the study was changed.
    pub sets: Vec<String>,
}

impl Settings {
    /// A new study on the CPU into the folder `out`, without kept beds, as one batch.
    pub fn new(out: impl Into<PathBuf>) -> Self {
        Self {
            out: out.into(),
            backend: Backend::Cpu,
            existing: Existing::Refuse,
            beds: None,
            batches: None,
            memory: None,
            checkpoint_every: Duration::from_secs(600),
            commit: None,
            sets: Vec::new(),
        }
    }
}

/// Why a study was not done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The output folder cannot be used, or writing failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A checkpoint cannot be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The folder holds another study.
    #[error(
        "{path}: these results belong to another study: resume with the study, scene and files that they were \
         begun with, or start again, in another folder (--out) or with --force"
    )]
    OtherStudy {
        /// The journal.
        path: PathBuf,
    },
    /// The folder's worlds were computed elsewhere.
    #[error(
        "{path}: these results were begun on `{found}`, and this is `{given}`, which rounds differently: resume with \
         the same --device, or start again, in another folder (--out) or with --force"
    )]
    OtherDevice {
        /// The journal.
        path: PathBuf,
        /// Where they were begun.
        found: String,
        /// What is to compute now.
        given: String,
    },
}

impl StudyError {
    /// Whether what was given is at fault, rather than what happened after the start.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Output(e) => e.is_input(),
            Self::Checkpoint(_) => false,
            Self::OtherStudy { .. } | Self::OtherDevice { .. } => true,
        }
    }
}

/// A number that worlds measure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Measure {
    /// The stage.
    pub stage: String,
    /// Its name.
    pub name: String,
    /// Its SI unit.
    pub unit: &'static str,
}

impl Measure {
    /// `till.draught_force`
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.stage, self.name)
    }
}

/// What a world measures, by stage.
pub(crate) fn measures(c: &Constants) -> Vec<Measure> {
    let of_stage = |stage: &glebe_engine::spec::Stage| {
        let name = stage.name.clone();
        let measure = |(measure, unit): (&str, &'static str)| Measure {
            stage: name.clone(),
            name: measure.to_owned(),
            unit,
        };
        stage.measured().map(measure).collect::<Vec<_>>()
    };
    c.spec.stages.iter().flat_map(of_stage).collect()
}

/// A world that was set up.
pub(crate) struct Made {
    pub(crate) constants: Arc<Constants>,
    pub(crate) state: State,
    pub(crate) scene_hash: String,
    pub(crate) warnings: Vec<String>,
}

/// The world of a scene file, whose text is known, with arguments of `--set`.
pub(crate) fn make(file: &Path, text: &str, sets: &[String]) -> Result<Made, Vec<SceneError>> {
    let scene = Scene::parse(&file.display().to_string(), text, sets)?;
    let mut built = scene.build(file.parent().unwrap_or(Path::new("")))?;
    built.world.throughput = throughput(&scene);
    let (constants, state) = prepare(built.world.clone()).map_err(|e| vec![built.locate(&e)])?;
    let scene_hash = scene_hash(&constants, &state);
    let warnings = built.warnings.iter().map(ToString::to_string).chain(constants.warnings.clone()).collect();
    Ok(Made { constants, state, scene_hash, warnings })
}

/// Worlds of studies are many, unless their scene says otherwise.
pub(crate) fn throughput(scene: &Scene) -> bool {
    scene.throughput.unwrap_or(true)
}

/// Why a world cannot be set up, in a line.
pub fn reason(errors: &[SceneError]) -> String {
    let one = |error: &SceneError| match error.advice() {
        Some(advice) => format!("{error} ({advice})"),
        None => error.to_string(),
    };
    errors.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// What was said of some of `all` worlds, each once.
pub(crate) fn told_once(said: BTreeMap<String, Vec<usize>>, all: usize) -> Vec<String> {
    let told = |(text, worlds): (String, Vec<usize>)| match worlds[..] {
        [w] => format!("world {w}: {text}"),
        _ if worlds.len() == all => format!("all worlds: {text}"),
        _ => format!("{} worlds, the first is {}: {text}", worlds.len(), worlds[0]),
    };
    said.into_iter().map(told).collect()
}

/// Four digits of a number.
pub(crate) fn short(x: f64) -> String {
    if x == 0.0 || (1e-3..1e5).contains(&x.abs()) {
        let decimals = (3 - x.abs().max(1e-3).log10().floor() as i32).clamp(0, 6) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.3e}")
    }
}

/// The worlds of each batch: of those given, in order, as many as memory holds, or in as many batches as asked for.
/// `particles` tells how many a world has.
pub(crate) fn divide(
    worlds: &[usize],
    particles: impl Fn(usize) -> usize,
    asked: Option<usize>,
    memory: Option<u64>,
) -> Vec<Vec<usize>> {
    if worlds.is_empty() {
        return Vec::new();
    }
    if let Some(asked) = asked {
        return worlds.chunks(worlds.len().div_ceil(asked.max(1))).map(<[usize]>::to_vec).collect();
    }
    // What else runs needs some too.
    let room = memory.map_or(f64::INFINITY, |bytes| 0.5 * bytes as f64);
    let mut batches: Vec<Vec<usize>> = Vec::new();
    let mut used = f64::INFINITY;
    for &w in worlds {
        let bytes = BYTES * particles(w) as f64;
        match batches.last_mut() {
            Some(batch) if used + bytes <= room => {
                batch.push(w);
                used += bytes;
            }
            _ => {
                batches.push(vec![w]);
                used = bytes;
            }
        }
    }
    batches
}

/// The first line of a journal.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    version: String,
    study_hash: String,
    device: String,
}

/// The folder of a study, to be written into.
pub(crate) struct Opened<E> {
    pub(crate) dir: OutputDir,
    pub(crate) journal: Journal,
    /// What was journaled earlier; none if the study begins.
    pub(crate) entries: Option<Vec<E>>,
    pub(crate) warnings: Vec<String>,
}

/// Makes the folder of a study, or opens it with what was journaled there. `text` is its file, `hash` a
/// digest of all its worlds.
pub(crate) fn open<E: DeserializeOwned>(
    text: &str,
    hash: &str,
    settings: &Settings,
    listener: &mut dyn Listener,
) -> Result<Opened<E>, StudyError> {
    let head = Head {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        study_hash: hash.to_owned(),
        device: settings.backend.maker(),
    };
    let mut warnings = Vec::new();
    let vacant = OutputDir::is_vacant(&settings.out)?;
    if settings.existing == Existing::Resume && !vacant {
        let dir = OutputDir::open_study(&settings.out)?;
        let path = dir.journal();
        let (found, entries, journal) = Journal::resume::<Head, E>(&path)?;
        if found.study_hash != head.study_hash {
            return Err(StudyError::OtherStudy { path });
        }
        if found.device != head.device {
            return Err(StudyError::OtherDevice { path, found: found.device, given: head.device });
        }
        if found.version != head.version {
            let line = format!(
                "these results were begun by glebe {}; this is {}: worlds may differ in the last digits",
                found.version, head.version
            );
            listener.warn(&line);
            warnings.push(line);
        }
        return Ok(Opened { dir, journal, entries: Some(entries), warnings });
    }
    let dir = OutputDir::create(&settings.out, settings.existing == Existing::Replace)?;
    if settings.existing == Existing::Resume {
        listener.note("nothing was kept before the study ended: it begins again");
    }
    dir.write_study(text, &settings.sets)?;
    let journal = Journal::create(&dir.journal(), &head)?;
    Ok(Opened { dir, journal, entries: None, warnings })
}

/// A world that has ended, as it is journaled.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) world: usize,
    pub(crate) status: summary::Status,
    pub(crate) reason: Option<String>,
    pub(crate) state_hash: Option<String>,
    pub(crate) particles: u64,
    pub(crate) lost: u64,
    pub(crate) stages: Vec<summary::Stage>,
    pub(crate) doubts: Vec<String>,
    /// Curves that it was to give, by the names of their targets, or why there is none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) curves: BTreeMap<String, Result<Vec<f64>, String>>,
    /// Wall time since the row before, or since its batch began \[s\].
    #[serde(default)]
    pub(crate) seconds: f64,
}

impl Row {
    pub(crate) fn not_run(world: usize, status: summary::Status, reason: String) -> Self {
        let reason = Some(reason);
        Self {
            world,
            status,
            reason,
            state_hash: None,
            particles: 0,
            lost: 0,
            stages: Vec::new(),
            doubts: Vec::new(),
            curves: BTreeMap::new(),
            seconds: 0.0,
        }
    }

    /// What a world measured, if its stage ended.
    pub(crate) fn measured(&self, stage: &str, name: &str) -> Option<summary::Measure> {
        let stage = self.stages.iter().find(|s| s.name == stage)?;
        stage.measures.get(name).copied()
    }
}

/// A world that is to run, or why it cannot.
pub(crate) struct Job {
    pub(crate) world: usize,
    pub(crate) made: Result<Made, String>,
    /// Curves that it is to give.
    pub(crate) curves: Vec<Wanted>,
}

/// Takes what worlds give, by their numbers in the study.
pub(crate) trait Results {
    /// A world has ended, or could not be run.
    fn ended(&mut self, row: Row, listener: &mut dyn Listener) -> Result<(), StudyError>;
    /// How many worlds the study has, and how many of them have ended.
    fn progress(&self) -> [usize; 2];
}

/// Follows the worlds of a batch to their ends.
pub(crate) trait Follower: Observer<Error = Infallible> {
    /// Something happened to a world.
    fn happened(
        &mut self,
        drive: &Drive,
        event: Event,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError>;
    /// How many worlds the study has, and how many of them have ended; those of other batches are included.
    fn progress(&self) -> [usize; 2];
    /// Keeps what worlds under way need to be resumed.
    fn save(&mut self, drive: &Drive) -> Result<(), StudyError>;
}

/// Runs the worlds of a batch to their ends, or until the user stops them; `later` steps come in other batches.
pub(crate) fn follow(
    drive: &mut Drive,
    follower: &mut impl Follower,
    later: u64,
    checkpoint_every: Duration,
    listener: &mut dyn Listener,
) -> Result<(), StudyError> {
    let mut written = Instant::now();
    while drive.batch().running() && !listener.interrupted() {
        let Ok(events) = drive.advance(follower);
        for event in events {
            follower.happened(drive, event, listener)?;
        }
        let [worlds, ended] = follower.progress();
        listener.pulse(&Pulse { drive, kinetic: None, worlds, ended, later });
        if written.elapsed() >= checkpoint_every {
            follower.save(drive)?;
            written = Instant::now();
        }
    }
    follower.save(drive)
}

/// What runs the batches of a study.
pub(crate) struct Ensemble<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) dir: OutputDir,
    /// Why the device was lost, if it was.
    pub(crate) lost: Option<String>,
    pub(crate) steps: u64,
    pub(crate) particle_steps: f64,
}

impl<'a> Ensemble<'a> {
    pub(crate) fn new(settings: &'a Settings, dir: OutputDir) -> Self {
        Self { settings, dir, lost: None, steps: 0, particle_steps: 0.0 }
    }

    /// Runs worlds to their ends, or until the user stops them; returns what was wrong on the way. `later` is the
    /// most steps of batches to come.
    pub(crate) fn run(
        &mut self,
        jobs: Vec<Job>,
        later: u64,
        results: &mut dyn Results,
        listener: &mut dyn Listener,
    ) -> Result<Vec<String>, StudyError> {
        let (mut numbers, mut entrants) = (Vec::new(), Vec::new());
        let (mut hashes, mut captures) = (Vec::new(), Vec::new());
        for Job { world, made, curves } in jobs {
            let hash = made.as_ref().map(|made| made.scene_hash.clone()).unwrap_or_default();
            let mut capture = Capture::new(curves);
            match made.and_then(|made| self.admit(world, made, &mut capture)) {
                Ok(entrant) => {
                    numbers.push(world);
                    entrants.push(entrant);
                    hashes.push(hash);
                    captures.push(capture);
                }
                Err(reason) => {
                    results.ended(Row::not_run(world, summary::Status::Refused, reason), listener)?;
                }
            }
        }
        let settings = self.settings;
        let from: Vec<usize> = captures.iter().map(Capture::first_stage).collect();
        let (mut drive, reused) = Drive::watched(entrants, &from, settings.backend, settings.beds.as_deref());
        let all = numbers.len();
        if !reused.is_empty() {
            listener.note(&format!(
                "{} of {all} worlds begin from settled beds of earlier runs; --no-cache computes them",
                reused.len()
            ));
        }
        let mut crew = Crew {
            ensemble: self,
            numbers,
            hashes,
            captures,
            since: drive.started(),
            results,
            shared: 0,
            warnings: Vec::new(),
        };
        follow(&mut drive, &mut crew, later, settings.checkpoint_every, listener)?;
        let Crew { shared, warnings, .. } = crew;
        if shared > 0 {
            listener.note(&format!("{shared} of {all} worlds began from the settled bed of another"));
        }
        self.count(&drive);
        Ok(warnings)
    }

    /// Counts the steps of a batch.
    pub(crate) fn count(&mut self, drive: &Drive) {
        self.steps += drive.steps();
        self.particle_steps += drive.particle_steps();
    }

    /// Why the device cannot run a world, if it cannot.
    pub(crate) fn accepts(&self, constants: &Arc<Constants>) -> Result<(), String> {
        match self.settings.backend.refusal(std::slice::from_ref(constants)) {
            Some(why) => Err(format!("{why}; run the study with --device cpu")),
            None => Ok(()),
        }
    }

    /// The state of a world as it was kept under way, if it is still of the same scene.
    pub(crate) fn kept(&self, world: usize, constants: &Constants, scene_hash: &str) -> Option<State> {
        let state = checkpoint::kept(&self.checkpoint(world), scene_hash)?;
        state.belongs_to(constants).is_ok().then_some(state)
    }

    /// A world with the state that it begins from, or why it cannot be run. One that is to give curves goes on only if
    /// their rows were kept.
    fn admit(&self, w: usize, made: Made, capture: &mut Capture) -> Result<(Arc<Constants>, State), String> {
        self.accepts(&made.constants)?;
        let saved = self
            .kept(w, &made.constants, &made.scene_hash)
            .filter(|state| capture.is_idle() || capture.resume(&self.dir.sample(w), state.progress.step));
        Ok((made.constants, saved.unwrap_or(made.state)))
    }

    /// Where the state of a world is kept while it has not ended.
    pub(crate) fn checkpoint(&self, world: usize) -> PathBuf {
        self.dir.checkpoints().join(format!("{world:06}.glebe"))
    }

    /// Where the rows of a world are kept while it has not ended; its folder is made.
    fn sample(&self, world: usize) -> Result<PathBuf, StudyError> {
        let path = self.dir.samples();
        fs::create_dir_all(&path).map_err(|source| {
            let (path, action) = (path.clone(), "make this folder");
            OutputError::Io { path, action, source }
        })?;
        Ok(self.dir.sample(world))
    }

    /// Removes the folders of what worlds under way need when none is left; only if they are empty.
    pub(crate) fn tidy(&self) {
        for folder in [self.dir.checkpoints(), self.dir.samples()] {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// The worlds of a batch, with their numbers in the study and what they were made from.
struct Crew<'a, 'b> {
    ensemble: &'a mut Ensemble<'b>,
    numbers: Vec<usize>,
    hashes: Vec<String>,
    captures: Vec<Capture>,
    /// When the last of them ended, or the batch began.
    since: Instant,
    results: &'a mut dyn Results,
    /// How many began from the bed of another.
    shared: usize,
    warnings: Vec<String>,
}

impl Crew<'_, '_> {
    fn ended(&mut self, drive: &Drive, k: usize, listener: &mut dyn Listener) -> Result<(), StudyError> {
        let outcome = drive.outcome(k);
        let Some(state_hash) = outcome.state_hash else {
            // The world is left: a device may be well again.
            self.ensemble.lost = outcome.reason;
            return Ok(());
        };
        let world = self.numbers[k];
        let seconds = std::mem::replace(&mut self.since, Instant::now()).elapsed().as_secs_f64();
        let (c, g) = (drive.batch().constants(k), drive.batch().progress(k));
        let row = Row {
            world,
            status: outcome.status,
            reason: outcome.reason,
            state_hash: Some(state_hash),
            particles: outcome.particles.count,
            lost: outcome.particles.lost.len() as u64,
            seconds,
            curves: self.captures[k].curves(&outcome.stages).into_iter().collect(),
            stages: outcome.stages,
            doubts: g.results.iter().flat_map(|result| doubts(result, c)).collect(),
        };
        self.results.ended(row, listener)?;
        self.captures[k] = Capture::default();
        discard(&self.ensemble.dir.sample(world))?;
        discard(&self.ensemble.checkpoint(world))
    }
}

impl Observer for Crew<'_, '_> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
    fn sample(&mut self, k: usize, sample: &Sample) -> Result<(), Infallible> {
        if let Some(capture) = self.captures.get_mut(k) {
            capture.sample(sample);
        }
        Ok(())
    }
}

impl Follower for Crew<'_, '_> {
    fn happened(
        &mut self,
        drive: &Drive,
        event: Event,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError> {
        match event {
            Event::Ended(k) => self.ended(drive, k, listener)?,
            Event::Reused(..) => self.shared += 1,
            Event::NotKept(_, line) => {
                listener.warn(&line);
                self.warnings.push(line);
            }
            Event::StageEnded(..) => {}
        }
        Ok(())
    }

    fn progress(&self) -> [usize; 2] {
        self.results.progress()
    }

    fn save(&mut self, drive: &Drive) -> Result<(), StudyError> {
        for (k, (&world, hash)) in self.numbers.iter().zip(&self.hashes).enumerate() {
            // Rows go first: of a state that was kept they must all be there.
            if !self.captures[k].is_idle() && *drive.batch().status(k) == Status::Running {
                self.captures[k].keep(&self.ensemble.sample(world)?)?;
            }
            keep(drive, k, &self.ensemble.checkpoint(world), hash)?;
        }
        Ok(())
    }
}

/// Keeps the state of world `k` of a batch in a file, if it is under way; `scene_hash` says of what it is.
pub(crate) fn keep(drive: &Drive, k: usize, path: &Path, scene_hash: &str) -> Result<bool, StudyError> {
    let batch = drive.batch();
    let g = batch.progress(k);
    if *batch.status(k) != Status::Running || g.step == 0 {
        return Ok(false);
    }
    let Ok(state) = batch.sound_state(k) else { return Ok(false) };
    let header = Header {
        glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
        scene_hash: scene_hash.to_owned(),
        step: g.step,
        time: batch.time(k),
        device: batch.backend().maker(),
        ..Header::default()
    };
    checkpoint::keep(path, &header, &state)?;
    Ok(true)
}

/// Removes a file that may be there.
pub(crate) fn discard(path: &Path) -> Result<(), StudyError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(OutputError::Io { path: path.to_owned(), action: "remove this file", source }.into())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_are_as_few_as_memory_holds_or_as_many_as_asked_for() {
        let all = [0, 1, 2, 3, 4];
        let equal = |_| 1000;
        let of_worlds = |n: f64| Some((2.0 * n * 1000.0 * BYTES) as u64);
        assert_eq!(divide(&all, equal, None, None), [all]);
        assert_eq!(divide(&all, equal, None, of_worlds(2.5)), [vec![0, 1], vec![2, 3], vec![4]]);
        assert_eq!(divide(&all, equal, Some(2), of_worlds(1.0)), [vec![0, 1, 2], vec![3, 4]]);
        assert_eq!(divide(&[1, 4], equal, Some(9), None), [[1], [4]]);
        assert_eq!(divide(&[], equal, Some(2), None), Vec::<Vec<usize>>::new());
        // One that is larger than the memory is tried alone.
        let large = |w| if w == 1 { 9000 } else { 1000 };
        assert_eq!(divide(&all, large, None, of_worlds(2.5)), [vec![0], vec![1], vec![2, 3], vec![4]]);
    }
}
