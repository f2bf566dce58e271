//! Sweeps: the worlds of a study run as batches, their results as a table, plots and fits.
//!
//! Worlds that end are journaled, so that a sweep which was stopped anywhere goes on with the rest. A world that cannot
//! be set up, or that fails, is a row with its reason.

mod plan;
mod results;

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fs;
use std::sync::Arc;
use std::time::Instant;

use glebe_engine::Constants;
use glebe_engine::batch::Observer;
use glebe_engine::state::State;
use glebe_io::checkpoint;
use glebe_io::output::{Journal, OutputDir, summary};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub(crate) use self::plan::told_once;
pub use self::plan::{Facts, Measure, Plan, Planned, reason};
use self::plan::{Made, make};
pub(crate) use self::results::word;
pub use self::results::{Counts, Fitted, Measured, Named, Summary, WorldSummary};
use crate::drive::{Drive, Event, Listener, doubts};
use crate::ensemble::{self, Follower, Opened, checkpoint_of};
pub use crate::ensemble::{Settings, StudyError};

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
pub fn run(plan: &Plan, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, StudyError> {
    let started = Instant::now();
    let hash = plan.digest();
    let opened = ensemble::open::<Row>(&plan.study, &hash, settings, listener)?;
    let mut warnings = plan.warnings.clone();
    warnings.extend(opened.warnings);
    let mut rows: BTreeMap<usize, Row> = BTreeMap::new();
    if let Some(ended) = opened.entries {
        listener.note(&format!("{} of {} worlds have ended already", ended.len(), plan.worlds.len()));
        rows.extend(ended.into_iter().map(|row| (row.world, row)));
    }
    for (w, planned) in plan.worlds.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            rows.insert(w, Row::not_run(w, summary::Status::Refused, reason(errors)));
        }
    }
    let Opened { dir, journal, .. } = opened;
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
    sweep.write(started, warnings, &hash)
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
    ) -> Result<Vec<String>, StudyError> {
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
        let every = self.settings.checkpoint_every;
        let mut crew = Crew { sweep: self, numbers, shared: 0, warnings: Vec::new() };
        ensemble::follow(&mut drive, &mut crew, later, every, listener)?;
        let Crew { numbers, shared, warnings, .. } = crew;
        if shared > 0 {
            let all = numbers.len();
            listener.note(&format!("{shared} of {all} worlds began from the settled bed of another"));
        }
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
        let saved = checkpoint::kept(&checkpoint_of(&self.dir, w), &made.scene_hash);
        let saved = saved.filter(|state| state.belongs_to(&made.constants).is_ok());
        Ok((made.constants, saved.unwrap_or(made.state)))
    }

    fn ended(
        &mut self,
        drive: &Drive,
        k: usize,
        world: usize,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError> {
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
        ensemble::discard(&checkpoint_of(&self.dir, world))
    }

    /// Journals a world that has ended.
    fn end(&mut self, row: Row, listener: &mut dyn Listener) -> Result<(), StudyError> {
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
}

/// The worlds of a batch, with their numbers in the sweep.
struct Crew<'a, 'b> {
    sweep: &'a mut Sweep<'b>,
    numbers: Vec<usize>,
    /// How many began from the bed of another.
    shared: usize,
    warnings: Vec<String>,
}

impl Observer for Crew<'_, '_> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
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
            Event::Ended(k) => self.sweep.ended(drive, k, self.numbers[k], listener)?,
            Event::Reused(..) => self.shared += 1,
            Event::NotKept(_, line) => {
                listener.warn(&line);
                self.warnings.push(line);
            }
            Event::StageEnded(..) => {}
        }
        Ok(())
    }

    fn ended(&self) -> [usize; 2] {
        [self.sweep.rows.len(), self.sweep.plan.worlds.len()]
    }

    fn save(&mut self, drive: &Drive) -> Result<(), StudyError> {
        for (k, &world) in self.numbers.iter().enumerate() {
            let Ok(facts) = &self.sweep.plan.worlds[world].fate else { continue };
            ensemble::keep(drive, k, &checkpoint_of(&self.sweep.dir, world), &facts.scene_hash)?;
        }
        Ok(())
    }
}
