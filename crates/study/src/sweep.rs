//! Sweeps: the worlds of a study run as batches, their results as a table, plots and fits.
//!
//! Worlds that end are journaled, so that a sweep which was stopped anywhere goes on with the rest. A world that cannot
//! be set up, or that fails, is a row with its reason.

mod plan;
mod results;

use std::collections::BTreeMap;
use std::time::Instant;

use glebe_io::output::{Journal, summary};
use rayon::prelude::*;

pub use self::plan::{Facts, Plan, Planned};
pub(crate) use self::results::word;
pub use self::results::{Counts, Fitted, Measured, Named, Summary, WorldSummary};
use crate::drive::Listener;
use crate::ensemble::{Ensemble, Job, Opened, Results, Row, make, open};
pub use crate::ensemble::{Measure, Settings, StudyError, reason};

/// Runs the worlds of a plan, or those that are left, and writes everything into the output folder.
///
/// Worlds that cannot be set up or that fail are no error here: their rows say so.
///
/// # Errors
/// A folder that cannot be used, a journal of another study, a full disk.
pub fn run(plan: &Plan, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, StudyError> {
    let started = Instant::now();
    let hash = plan.digest();
    let Opened { dir, journal, entries, warnings: told } =
        open::<Row>(&plan.study.text, &hash, settings, listener)?;
    if let Some(ended) = &entries {
        listener.note(&format!("{} of {} worlds have ended already", ended.len(), plan.worlds.len()));
    }
    let mut warnings = plan.warnings.clone();
    warnings.extend(told);
    let ended = entries.unwrap_or_default();
    let mut rows: BTreeMap<usize, Row> = ended.into_iter().map(|row| (row.world, row)).collect();
    for (w, planned) in plan.worlds.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            rows.insert(w, Row::not_run(w, summary::Status::Refused, reason(errors)));
        }
    }
    let mut ensemble = Ensemble::new(settings, dir);
    let mut sweep = Sweep { plan, journal, rows };
    let pending: Vec<usize> = (0..plan.worlds.len()).filter(|w| !sweep.rows.contains_key(w)).collect();
    let batches = plan.batches(&pending, settings.batches, settings.memory);
    if batches.len() > 1 {
        listener.note(&format!("{} worlds in {} batches", pending.len(), batches.len()));
    }
    let steps = |w: &usize| plan.worlds[*w].fate.as_ref().map_or(0, |f| f.steps);
    for (k, batch) in batches.iter().enumerate() {
        let later = batches[k + 1..].iter().flatten().map(steps).sum();
        warnings.extend(ensemble.run(sweep.jobs(batch), later, &mut sweep, listener)?);
        if listener.interrupted() || ensemble.lost.is_some() {
            break;
        }
    }
    if (0..plan.worlds.len()).all(|w| sweep.rows.contains_key(&w)) {
        ensemble.tidy();
    }
    sweep.write(&ensemble, started, warnings, &hash)
}

/// A sweep under way.
struct Sweep<'a> {
    plan: &'a Plan,
    journal: Journal,
    rows: BTreeMap<usize, Row>,
}

impl Sweep<'_> {
    /// The worlds of a batch, made again.
    fn jobs(&self, worlds: &[usize]) -> Vec<Job> {
        let study = &self.plan.study;
        let job = |&world: &usize| {
            let planned = &self.plan.worlds[world];
            let made = make(&study.scene, &study.scene_text, &planned.world.sets);
            let made = made.map_err(|errors| reason(&errors)).and_then(|made| match &planned.fate {
                Ok(facts) if facts.scene_hash != made.scene_hash => {
                    Err("a file that the scene names was changed while the sweep ran".to_owned())
                }
                _ => Ok(made),
            });
            Job { world, made, curves: Vec::new() }
        };
        worlds.par_iter().map(job).collect()
    }
}

impl Results for Sweep<'_> {
    /// Journals a world that has ended.
    fn ended(&mut self, row: Row, listener: &mut dyn Listener) -> Result<(), StudyError> {
        self.journal.append(&row)?;
        let measured = |m: &Measure| {
            let found = row.measured(&m.stage, &m.name).filter(|found| found.n > 0)?;
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

    fn progress(&self) -> [usize; 2] {
        [self.plan.worlds.len(), self.rows.len()]
    }
}
