//! Sweeps: the worlds of a study run as batches, their results as a table, plots and fits.
//!
//! Worlds that end are journaled, so that a sweep which was stopped anywhere goes on with the rest. A world that cannot
//! be set up, or that fails, is a row with its reason.

mod results;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Blind, Status};
use glebe_engine::spec::Component;
use glebe_engine::state::{Progress, State};
use glebe_engine::{Constants, prepare};
use glebe_io::checkpoint::{self, CheckpointError, Header};
use glebe_io::output::{Existing, Journal, OutputDir, OutputError, summary};
use glebe_io::scene::{Scene, SceneError};
use glebe_io::study::Study;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::results::{Counts, Fitted, Measured, Summary, WorldSummary};
use crate::digest::{Digest, scene_hash};
use crate::drive::{Drive, Event, Listener, Pulse, doubts, steps_left};
use crate::sample::{self, TooManyDimensions, World};

/// Memory that a particle takes in a batch, its lists and what it was made from included \[bytes\]; see the table of
/// rates in the README.
const BYTES: f64 = 1500.0;

/// A study with its worlds, each of which was made once, to see that it can be.
pub struct Plan {
    /// The study.
    pub study: Study,
    /// Its worlds, in order.
    pub worlds: Vec<Planned>,
    /// What is measured, by stage.
    pub measures: Vec<Measure>,
    /// What looks wrong with worlds but does not stop them.
    pub warnings: Vec<String>,
    first: Option<Arc<Constants>>,
}

/// A world of a plan.
#[derive(Debug)]
pub struct Planned {
    /// Its values.
    pub world: World,
    /// What is known of it, or why it cannot be set up.
    pub fate: Result<Facts, Vec<SceneError>>,
}

/// What is known of a world before it runs.
#[derive(Clone, Debug)]
pub struct Facts {
    /// Digest of all that it is made of.
    pub scene_hash: String,
    /// Particles at the start.
    pub particles: usize,
    /// The most steps that it takes; stages that wait without limit count as none.
    pub steps: u64,
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

/// A world that was set up.
struct Made {
    constants: Arc<Constants>,
    state: State,
    scene_hash: String,
    warnings: Vec<String>,
}

impl Plan {
    /// Chooses the worlds and makes each of them once, without keeping it. None if `interrupted` before the last.
    ///
    /// # Errors
    /// A sampler that cannot spread points over so many parameters.
    pub fn new(
        study: Study,
        interrupted: impl Fn() -> bool + Sync,
    ) -> Result<Option<Self>, TooManyDimensions> {
        let worlds = sample::worlds(&study)?;
        let look = |world: World| {
            if interrupted() {
                return None;
            }
            Some(match make(&study, &world) {
                Ok(made) => {
                    let facts = Facts {
                        scene_hash: made.scene_hash,
                        particles: made.constants.count,
                        steps: steps_left(&made.constants, &Progress::default()),
                    };
                    (Planned { world, fate: Ok(facts) }, made.warnings)
                }
                Err(errors) => (Planned { world, fate: Err(errors) }, Vec::new()),
            })
        };
        let made: Option<Vec<_>> = worlds.into_par_iter().map(look).collect();
        let Some(made) = made else { return Ok(None) };
        let first = made.iter().find(|(planned, _)| planned.fate.is_ok());
        let first =
            first.and_then(|(planned, _)| make(&study, &planned.world).ok()).map(|made| made.constants);
        let measures = first.as_deref().map(measures).unwrap_or_default();
        let mut said: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (w, (_, warnings)) in made.iter().enumerate() {
            for warning in warnings {
                said.entry(warning.clone()).or_default().push(w);
            }
        }
        let warnings = told_once(said, made.len());
        let worlds = made.into_iter().map(|(planned, _)| planned).collect();
        Ok(Some(Self { study, worlds, measures, warnings, first }))
    }

    /// The first world that can be set up, to choose a device for; none if there is no such world.
    pub fn first(&self) -> Option<&Constants> {
        self.first.as_deref()
    }

    /// How many worlds cannot be set up.
    pub fn refused(&self) -> usize {
        self.worlds.iter().filter(|w| w.fate.is_err()).count()
    }

    /// The worlds of each batch: of those given, in order, as many as memory holds, or in as many batches as asked for.
    pub fn batches(&self, worlds: &[usize], asked: Option<usize>, memory: Option<u64>) -> Vec<Vec<usize>> {
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
            let bytes = self.worlds[w].fate.as_ref().map_or(0.0, |f| BYTES * f.particles as f64);
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

    /// A digest of all worlds.
    fn digest(&self) -> String {
        self.worlds
            .iter()
            .fold(Digest::default(), |digest, planned| {
                let fate = planned.fate.as_ref();
                let fate = fate.map(|f| f.scene_hash.as_str()).map_err(|errors| reason(errors));
                digest.debug(&planned.world.sets).debug(&fate)
            })
            .finish()
    }
}

fn make(study: &Study, world: &World) -> Result<Made, Vec<SceneError>> {
    let name = study.scene.display().to_string();
    let scene = Scene::parse(&name, &study.scene_text, &world.sets)?;
    let built = scene.build(study.scene.parent().unwrap_or(Path::new("")))?;
    let (constants, state) = prepare(built.world.clone()).map_err(|e| vec![built.locate(&e)])?;
    let scene_hash = scene_hash(&constants, &state);
    let warnings = built.warnings.iter().map(ToString::to_string).chain(constants.warnings.clone()).collect();
    Ok(Made { constants, state, scene_hash, warnings })
}

fn measures(c: &Constants) -> Vec<Measure> {
    let of_stage = |stage: &glebe_engine::spec::Stage| {
        let name = stage.name.clone();
        let measure = move |m: &glebe_engine::spec::Measure| Measure {
            stage: name.clone(),
            name: m.name.clone(),
            unit: if matches!(m.component, Component::Torque(_)) { "N m" } else { "N" },
        };
        stage.measures.iter().map(measure).collect::<Vec<_>>()
    };
    c.spec.stages.iter().flat_map(of_stage).collect()
}

/// What was said of some worlds, each once.
fn told_once(said: BTreeMap<String, Vec<usize>>, all: usize) -> Vec<String> {
    let told = |(text, worlds): (String, Vec<usize>)| match worlds[..] {
        [w] => format!("world {w}: {text}"),
        _ if worlds.len() == all => format!("all worlds: {text}"),
        _ => format!("{} worlds, the first is {}: {text}", worlds.len(), worlds[0]),
    };
    said.into_iter().map(told).collect()
}

/// Why a world cannot be set up, in a line.
pub fn reason(errors: &[SceneError]) -> String {
    let one = |error: &SceneError| match error.advice() {
        Some(advice) => format!("{error} ({advice})"),
        None => error.to_string(),
    };
    errors.iter().map(one).collect::<Vec<_>>().join("; ")
}

/// How a sweep is to be done.
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
    /// A new sweep on the CPU into the folder `out`, without kept beds, as one batch.
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

/// Why a sweep was not done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// The output folder cannot be used, or writing failed.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A checkpoint cannot be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The folder holds another study.
    #[error(
        "{path}: these results belong to another study: resume with the study, scene and files that they were \
         begun with, or start again with --force"
    )]
    OtherStudy {
        /// The journal.
        path: PathBuf,
    },
    /// The folder's worlds were computed elsewhere.
    #[error(
        "{path}: these results were begun on `{found}`, and this is `{given}`, which rounds differently: resume with \
         the same --device, or start again with --force"
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

impl SweepError {
    /// Whether what was given is at fault, rather than what happened after the start.
    pub fn is_input(&self) -> bool {
        match self {
            Self::Output(e) => e.is_input(),
            Self::Checkpoint(_) => false,
            Self::OtherStudy { .. } | Self::OtherDevice { .. } => true,
        }
    }
}

/// The first line of a journal.
#[derive(Debug, Serialize, Deserialize)]
struct Head {
    version: String,
    study_hash: String,
    device: String,
}

/// A world that has ended, as it is journaled.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Row {
    world: usize,
    status: summary::Status,
    reason: Option<String>,
    state_hash: Option<String>,
    particles: u64,
    lost: u64,
    stages: Vec<summary::Stage>,
    doubts: Vec<String>,
}

impl Row {
    fn not_run(world: usize, status: summary::Status, reason: String) -> Self {
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
        }
    }

    /// What a world measured, if its stage ended.
    fn measured(&self, measure: &Measure) -> Option<summary::Measure> {
        let stage = self.stages.iter().find(|s| s.name == measure.stage)?;
        stage.measures.get(&measure.name).copied()
    }
}

/// Runs the worlds of a plan, or those that are left, and writes everything into the output folder.
///
/// Worlds that cannot be set up or that fail are no error here: their rows say so.
///
/// # Errors
/// A folder that cannot be used, a journal of another study, a full disk.
pub fn run(plan: &Plan, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, SweepError> {
    let started = Instant::now();
    let device = match settings.backend {
        // Any number of threads gives the same bits.
        Backend::Cpu => settings.backend.name().to_owned(),
        other => other.device(),
    };
    let head = Head { version: env!("CARGO_PKG_VERSION").to_owned(), study_hash: plan.digest(), device };
    let mut warnings = plan.warnings.clone();
    let mut rows: BTreeMap<usize, Row> = BTreeMap::new();
    let (dir, journal) = if settings.existing == Existing::Resume {
        let dir = OutputDir::open_study(&settings.out)?;
        let path = dir.journal();
        let (found, ended, journal) = Journal::resume::<Head, Row>(&path)?;
        if found.study_hash != head.study_hash {
            return Err(SweepError::OtherStudy { path });
        }
        if found.device != head.device {
            return Err(SweepError::OtherDevice { path, found: found.device, given: head.device });
        }
        if found.version != head.version {
            let line = format!(
                "these results were begun by glebe {}; this is {}: worlds may differ in the last digits",
                found.version, head.version
            );
            listener.warn(&line);
            warnings.push(line);
        }
        listener.note(&format!("{} of {} worlds have ended already", ended.len(), plan.worlds.len()));
        rows.extend(ended.into_iter().map(|row| (row.world, row)));
        (dir, journal)
    } else {
        let dir = OutputDir::create(&settings.out, settings.existing == Existing::Replace)?;
        dir.write_study(&plan.study.text, &settings.sets)?;
        let journal = Journal::create(&dir.journal(), &head)?;
        (dir, journal)
    };
    for (w, planned) in plan.worlds.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            rows.insert(w, Row::not_run(w, summary::Status::Refused, reason(errors)));
        }
    }
    let mut sweep = Sweep { plan, settings, dir, journal, rows, steps: 0, particle_steps: 0.0 };
    let pending: Vec<usize> = (0..plan.worlds.len()).filter(|w| !sweep.rows.contains_key(w)).collect();
    let batches = plan.batches(&pending, settings.batches, settings.memory);
    if batches.len() > 1 {
        listener.note(&format!("{} worlds in {} batches", pending.len(), batches.len()));
    }
    let steps = |w: &usize| plan.worlds[*w].fate.as_ref().map_or(0, |f| f.steps);
    for (k, batch) in batches.iter().enumerate() {
        let later = batches[k + 1..].iter().flatten().map(steps).sum();
        warnings.extend(sweep.batch(batch, later, listener)?);
        if listener.interrupted() {
            break;
        }
    }
    let open = (0..plan.worlds.len()).filter(|w| !sweep.rows.contains_key(w)).count();
    if open == 0 {
        // Only what is empty goes.
        let _ = fs::remove_dir(sweep.dir.checkpoints());
    }
    sweep.write(started, warnings, &head.study_hash)
}

/// A sweep under way.
struct Sweep<'a> {
    plan: &'a Plan,
    settings: &'a Settings,
    dir: OutputDir,
    journal: Journal,
    rows: BTreeMap<usize, Row>,
    steps: u64,
    particle_steps: f64,
}

impl Sweep<'_> {
    /// Runs worlds to their ends, or until the user stops them; returns what was wrong on the way.
    fn batch(
        &mut self,
        worlds: &[usize],
        later: u64,
        listener: &mut dyn Listener,
    ) -> Result<Vec<String>, SweepError> {
        let (plan, backend) = (self.plan, self.settings.backend);
        let made: Vec<_> =
            worlds.par_iter().map(|&w| (w, make(&plan.study, &plan.worlds[w].world))).collect();
        let (mut numbers, mut entrants) = (Vec::new(), Vec::new());
        for (w, made) in made {
            match made.map_err(|errors| reason(&errors)).and_then(|made| self.admit(w, made)) {
                Ok(entrant) => {
                    numbers.push(w);
                    entrants.push(entrant);
                }
                Err(reason) => self.end(Row::not_run(w, summary::Status::Refused, reason), listener)?,
            }
        }
        let (mut drive, reused) = Drive::new(entrants, backend, self.settings.beds.as_deref());
        if !reused.is_empty() {
            let all = numbers.len();
            listener.note(&format!(
                "{} of {all} worlds begin from settled beds of earlier runs; --no-cache computes them",
                reused.len()
            ));
        }
        let mut written = Instant::now();
        let (mut shared, mut warnings) = (0, Vec::new());
        while drive.batch().running() && !listener.interrupted() {
            let Ok(events) = drive.advance(&mut Blind);
            for event in events {
                match event {
                    Event::Ended(k) => self.ended(&drive, k, numbers[k], listener)?,
                    Event::Reused(..) => shared += 1,
                    Event::NotKept(_, line) => {
                        listener.warn(&line);
                        warnings.push(line);
                    }
                    Event::StageEnded(..) => {}
                }
            }
            let (worlds, ended) = (plan.worlds.len(), self.rows.len());
            listener.pulse(&Pulse { drive: &drive, kinetic: None, worlds, ended, later });
            if written.elapsed() >= self.settings.checkpoint_every {
                self.save(&drive, &numbers)?;
                written = Instant::now();
            }
        }
        if shared > 0 {
            let all = numbers.len();
            listener.note(&format!("{shared} of {all} worlds began from the settled bed of another"));
        }
        self.save(&drive, &numbers)?;
        self.steps += drive.steps();
        self.particle_steps += drive.particle_steps();
        Ok(warnings)
    }

    /// A world with the state that it begins from, or why it cannot be run.
    fn admit(&self, w: usize, made: Made) -> Result<(Arc<Constants>, State), String> {
        let planned = self.plan.worlds[w].fate.as_ref();
        if planned.is_ok_and(|facts| facts.scene_hash != made.scene_hash) {
            return Err("a file that the scene names was changed while the sweep ran".to_owned());
        }
        if let Some(why) = self.settings.backend.refusal(&made.constants) {
            return Err(format!("{why}; run the study with --device cpu"));
        }
        let found =
            checkpoint::read(&self.checkpoint(w)).ok().filter(|c| c.header.scene_hash == made.scene_hash);
        let saved = found.and_then(|found| State::from_bytes(&found.state).ok());
        Ok((made.constants, saved.unwrap_or(made.state)))
    }

    fn ended(
        &mut self,
        drive: &Drive,
        k: usize,
        world: usize,
        listener: &mut dyn Listener,
    ) -> Result<(), SweepError> {
        let outcome = drive.outcome(k);
        let (c, g) = (drive.batch().constants(k), drive.batch().progress(k));
        let row = Row {
            world,
            status: outcome.status,
            reason: outcome.reason,
            state_hash: Some(outcome.state_hash),
            particles: outcome.particles.count,
            lost: outcome.particles.lost.len() as u64,
            stages: outcome.stages,
            doubts: g.results.iter().flat_map(|result| doubts(result, c)).collect(),
        };
        self.end(row, listener)?;
        match fs::remove_file(self.checkpoint(world)) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                let path = self.checkpoint(world);
                Err(OutputError::Io { path, action: "remove this file", source }.into())
            }
            _ => Ok(()),
        }
    }

    /// Journals a world that has ended.
    fn end(&mut self, row: Row, listener: &mut dyn Listener) -> Result<(), SweepError> {
        self.journal.append(&row)?;
        let measured = |m: &Measure| {
            let found = row.measured(m).filter(|found| found.n > 0)?;
            Some(format!("; {} = {:.5} ± {:.3} {}", m.full_name(), found.mean, found.std, m.unit))
        };
        let measured: String = self.plan.measures.iter().filter_map(measured).collect();
        match &row.reason {
            Some(reason) => listener.warn(&format!("world {}: {reason}", row.world)),
            None => listener.note(&format!("world {} is done{measured}", row.world)),
        }
        self.rows.insert(row.world, row);
        Ok(())
    }

    /// Where the state of a world is kept while it has not ended.
    fn checkpoint(&self, world: usize) -> PathBuf {
        self.dir.checkpoints().join(format!("{world:06}.glebe"))
    }

    /// Keeps the states of worlds that are under way.
    fn save(&self, drive: &Drive, numbers: &[usize]) -> Result<(), SweepError> {
        let batch = drive.batch();
        for (k, &world) in numbers.iter().enumerate() {
            let g = batch.progress(k);
            if *batch.status(k) != Status::Running || g.step == 0 {
                continue;
            }
            let state = batch.state(k);
            if batch.fault(k).is_some() {
                continue;
            }
            let Ok(facts) = &self.plan.worlds[world].fate else { continue };
            let header = Header {
                glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
                scene_hash: facts.scene_hash.clone(),
                step: g.step,
                time: batch.time(k),
                ..Header::default()
            };
            let folder = self.dir.checkpoints();
            fs::create_dir_all(&folder).map_err(|source| OutputError::Io {
                path: folder,
                action: "make this folder",
                source,
            })?;
            checkpoint::write(&self.checkpoint(world), &header, &state.to_bytes())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_are_as_few_as_memory_holds_or_as_many_as_asked_for() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../io/tests/scene_common");
        let text = "scene = \"example.toml\"\n[vary.s]\npath = \"seed\"\nvalues = [1, 2, 3, 4, 5]\n";
        let study = Study::parse("study.toml", text, &folder, &[]).unwrap();
        let planned = |world| {
            let facts = Facts { scene_hash: String::new(), particles: 1000, steps: 1 };
            Planned { world, fate: Ok(facts) }
        };
        let worlds = sample::worlds(&study).unwrap().into_iter().map(planned).collect();
        let mut plan = Plan { study, worlds, measures: Vec::new(), warnings: Vec::new(), first: None };
        let all = [0, 1, 2, 3, 4];
        let of_worlds = |n: f64| Some((2.0 * n * 1000.0 * BYTES) as u64);
        assert_eq!(plan.batches(&all, None, None), [all]);
        assert_eq!(plan.batches(&all, None, of_worlds(2.5)), [vec![0, 1], vec![2, 3], vec![4]]);
        assert_eq!(plan.batches(&all, Some(2), of_worlds(1.0)), [vec![0, 1, 2], vec![3, 4]]);
        assert_eq!(plan.batches(&[1, 4], Some(9), None), [[1], [4]]);
        assert_eq!(plan.batches(&[], Some(2), None), Vec::<Vec<usize>>::new());
        // One that is larger than the memory is tried alone.
        if let Ok(facts) = &mut plan.worlds[1].fate {
            facts.particles = 9000;
        }
        assert_eq!(plan.batches(&all, None, of_worlds(2.5)), [vec![0], vec![1], vec![2, 3], vec![4]]);
    }
}
