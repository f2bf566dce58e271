//! Sweeps: the worlds of a study run as batches, their results as a table, plots and fits.
//!
//! Worlds that end are journaled, so that a sweep which was stopped anywhere goes on with the rest. A world that cannot
//! be set up, or that fails, is a row with its reason.

mod plan;
mod results;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_engine::batch::{Blind, Status};
use glebe_engine::state::State;
use glebe_io::checkpoint::{self, CheckpointError, Header};
use glebe_io::output::{Existing, Journal, OutputDir, OutputError, summary};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::plan::{Facts, Measure, Plan, Planned, reason};
use self::plan::{Made, make, told_once};
pub use self::results::{Counts, Fitted, Measured, Summary, WorldSummary};
use crate::drive::{Drive, Event, Listener, Pulse, doubts};

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
    let head = Head {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        study_hash: plan.digest(),
        device: settings.backend.maker(),
    };
    let mut warnings = plan.warnings.clone();
    let mut rows: BTreeMap<usize, Row> = BTreeMap::new();
    let vacant = OutputDir::is_vacant(&settings.out)?;
    let (dir, journal) = if settings.existing == Existing::Resume && !vacant {
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
        if settings.existing == Existing::Resume {
            listener.note("nothing was kept before the sweep ended: it begins again");
        }
        dir.write_study(&plan.study.text, &settings.sets)?;
        let journal = Journal::create(&dir.journal(), &head)?;
        (dir, journal)
    };
    for (w, planned) in plan.worlds.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            rows.insert(w, Row::not_run(w, summary::Status::Refused, reason(errors)));
        }
    }
    let mut sweep = Sweep { plan, settings, dir, journal, rows, lost: None, steps: 0, particle_steps: 0.0 };
    let pending: Vec<usize> = (0..plan.worlds.len()).filter(|w| !sweep.rows.contains_key(w)).collect();
    let batches = plan.batches(&pending, settings.batches, settings.memory);
    if batches.len() > 1 {
        listener.note(&format!("{} worlds in {} batches", pending.len(), batches.len()));
    }
    let steps = |w: &usize| plan.worlds[*w].fate.as_ref().map_or(0, |f| f.steps);
    for (k, batch) in batches.iter().enumerate() {
        let later = batches[k + 1..].iter().flatten().map(steps).sum();
        warnings.extend(sweep.batch(batch, later, listener)?);
        if listener.interrupted() || sweep.lost.is_some() {
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
    /// Why the device was lost, if it was.
    lost: Option<String>,
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
        if let Some(why) = self.settings.backend.refusal(std::slice::from_ref(&made.constants)) {
            return Err(format!("{why}; run the study with --device cpu"));
        }
        let saved = checkpoint::kept(&self.checkpoint(w), &made.scene_hash);
        let saved = saved.filter(|state| state.belongs_to(&made.constants).is_ok());
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
        let Some(state_hash) = outcome.state_hash else {
            // The world is left: a device may be well again.
            self.lost = outcome.reason;
            return Ok(());
        };
        let (c, g) = (drive.batch().constants(k), drive.batch().progress(k));
        let row = Row {
            world,
            status: outcome.status,
            reason: outcome.reason,
            state_hash: Some(state_hash),
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
            let Ok(state) = batch.sound_state(k) else { continue };
            let Ok(facts) = &self.plan.worlds[world].fate else { continue };
            let header = Header {
                glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
                scene_hash: facts.scene_hash.clone(),
                step: g.step,
                time: batch.time(k),
                device: batch.backend().maker(),
                ..Header::default()
            };
            checkpoint::keep(&self.checkpoint(world), &header, &state)?;
        }
        Ok(())
    }
}
