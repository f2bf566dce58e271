//! Periodic samples: made at a void ratio, consolidated, loaded, all in one batch.
//!
//! A sample is the scene with arguments of `--set`, as a world of a sweep is, taken through three steps. It is made by
//! compression with a friction of its own ([`Prepare`](glebe_io::study::Prepare)); of samples that are to have a void
//! ratio every round of the bisection is one batch. Then it gets its own material back, and is consolidated and loaded;
//! samples that end leave the batch. What was tried and what has ended is journaled.

mod curve;
mod fabric;
mod plan;
mod program;
mod results;
mod search;
mod statistics;

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fs;
use std::sync::Arc;
use std::time::Instant;

use glebe_engine::Constants;
use glebe_engine::batch::{Observer, Sample};
use glebe_engine::state::State;
use glebe_io::checkpoint;
use glebe_io::output::{Journal, summary, write_table};
use glebe_io::study::Rve;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::curve::Curve;
pub use self::fabric::{BINS, Orientations, chi_square};
pub use self::plan::{Facts, Plan, Planned};
pub(crate) use self::results::Outcome;
pub use self::results::{SampleSummary, Summary, VariantSummary};
use self::search::{Next, Tried, nearest, next};
pub use self::statistics::Spread;
use crate::digest::scene_hash;
use crate::drive::{Drive, Event, Listener};
use crate::ensemble::{self, Ensemble, Follower, Opened, divide, reason};
pub use crate::ensemble::{Settings, StudyError};

/// A line of the journal.
#[derive(Clone, Debug, Serialize, Deserialize)]
enum Entry {
    /// A friction was tried.
    Tried { prepared_hash: String, friction: f64, void_ratio: Option<f64>, reason: Option<String> },
    /// A sample is consolidated.
    Consolidated { sample: usize, consolidated: Consolidated },
    /// A sample has ended.
    Ended(Row),
}

/// A sample at the end of its consolidation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Consolidated {
    /// Void ratio \[-\].
    pub void_ratio: f64,
    /// Mechanical coordination number \[-\].
    pub coordination: f64,
    /// Mean stress \[Pa\].
    pub p: f64,
    /// Deviatoric stress \[Pa\].
    pub q: f64,
    /// Which way its contacts point.
    pub orientations: Orientations,
}

/// A sample that has ended.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Row {
    sample: usize,
    pub(crate) status: summary::Status,
    pub(crate) reason: Option<String>,
    pub(crate) state_hash: Option<String>,
    /// Friction with which it was made, and the void ratio that this gave.
    made: Option<[f64; 2]>,
    consolidated: Option<Consolidated>,
    /// Wall time since the row before, or since the study was begun or taken up \[s\].
    #[serde(default)]
    pub(crate) seconds: f64,
}

impl Row {
    fn without(sample: usize, status: summary::Status, reason: String) -> Self {
        let (state_hash, made, consolidated, seconds) = (None, None, None, 0.0);
        Self { sample, status, reason: Some(reason), state_hash, made, consolidated, seconds }
    }
}

/// Makes, consolidates and loads the samples of a plan, or those that are left, and writes everything into the output
/// folder.
///
/// Samples that cannot be set up, cannot be made or fail are no error here: their rows say so.
///
/// # Errors
/// A folder that cannot be used, a journal of another study, a full disk.
pub fn run(plan: &Plan, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, StudyError> {
    let started = Instant::now();
    let hash = plan.digest();
    let (study, warnings) = gather(plan, settings, &hash, listener)?;
    study.write(started, warnings, &hash)
}

/// Makes, consolidates and loads the samples of a plan, or those that are left, as [`run`] does; `hash` is the plan's
/// digest. Returns them with what was wrong on the way.
pub(crate) fn gather<'a>(
    plan: &'a Plan,
    settings: &'a Settings,
    hash: &str,
    listener: &mut dyn Listener,
) -> Result<(Samples<'a>, Vec<String>), StudyError> {
    let opened = ensemble::open::<Entry>(&plan.study.text, hash, settings, listener)?;
    let mut warnings = plan.warnings.clone();
    warnings.extend(opened.warnings);
    let Opened { dir, journal, entries, .. } = opened;
    fs::create_dir_all(dir.samples()).map_err(|source| glebe_io::output::OutputError::Io {
        path: dir.samples(),
        action: "make this folder",
        source,
    })?;
    let mut study = Samples {
        plan,
        ensemble: Ensemble::new(settings, dir),
        journal,
        rows: BTreeMap::new(),
        consolidated: BTreeMap::new(),
        tried: BTreeMap::new(),
        states: BTreeMap::new(),
        since: Instant::now(),
    };
    if let Some(entries) = entries {
        for entry in entries {
            study.take(entry);
        }
        let (ended, all) = (study.rows.len(), plan.samples.len());
        listener.note(&format!("{ended} of {all} samples have ended already"));
    }
    for (w, planned) in plan.samples.iter().enumerate() {
        if let Err(errors) = &planned.fate {
            study.rows.insert(w, Row::without(w, summary::Status::Refused, reason(errors)));
        }
    }
    let made = study.make(listener)?;
    let pending: Vec<usize> = made.keys().copied().filter(|w| !study.rows.contains_key(w)).collect();
    let batches = study.batches(&pending, listener);
    for (k, batch) in batches.iter().enumerate() {
        if study.stopped(listener) {
            break;
        }
        let later = batches[k + 1..].iter().flatten().filter_map(|w| study.facts(*w)).map(|f| f.steps).sum();
        study.load(batch, &made, later, listener)?;
    }
    if study.rows.len() == plan.samples.len() {
        study.discard_states()?;
        study.ensemble.tidy();
    }
    Ok((study, warnings))
}

/// A sample that was made: friction, void ratio and state; none of these if it is consolidated as it is.
type Made = BTreeMap<usize, Option<(f64, f64, Arc<State>)>>;

/// A study under way.
pub(crate) struct Samples<'a> {
    plan: &'a Plan,
    pub(crate) ensemble: Ensemble<'a>,
    journal: Journal,
    rows: BTreeMap<usize, Row>,
    consolidated: BTreeMap<usize, Consolidated>,
    /// What was tried, by what is prepared.
    tried: BTreeMap<String, Vec<Tried>>,
    /// States that a preparation may take, by what is prepared and the bits of the friction.
    states: BTreeMap<(String, u64), Arc<State>>,
    /// When the last sample ended, or the study was taken up.
    since: Instant,
}

impl Samples<'_> {
    fn take(&mut self, entry: Entry) {
        match entry {
            Entry::Tried { prepared_hash, friction, void_ratio, reason } => {
                let found = void_ratio.ok_or_else(|| reason.unwrap_or_default());
                let tried = self.tried.entry(prepared_hash).or_default();
                tried.retain(|(f, _)| *f != friction);
                tried.push((friction, found));
            }
            Entry::Consolidated { sample, consolidated } => {
                self.consolidated.insert(sample, consolidated);
            }
            Entry::Ended(row) => {
                self.rows.insert(row.sample, row);
            }
        }
    }

    fn tell(&mut self, entry: Entry) -> Result<(), StudyError> {
        self.journal.append(&entry)?;
        self.take(entry);
        Ok(())
    }

    fn facts(&self, w: usize) -> Option<&Facts> {
        self.plan.samples.get(w)?.fate.as_ref().ok()
    }

    fn stopped(&self, listener: &dyn Listener) -> bool {
        listener.interrupted() || self.ensemble.lost.is_some()
    }

    fn batches(&self, worlds: &[usize], listener: &mut dyn Listener) -> Vec<Vec<usize>> {
        let particles = |w: usize| self.facts(w).map_or(0, |f| f.particles);
        let batches =
            divide(worlds, particles, self.ensemble.settings.batches, self.ensemble.settings.memory);
        if batches.len() > 1 {
            listener.note(&format!("{} samples in {} batches", worlds.len(), batches.len()));
        }
        batches
    }

    /// Makes the samples that have not ended, round after round, each round in one batch.
    fn make(&mut self, listener: &mut dyn Listener) -> Result<Made, StudyError> {
        let open: Vec<usize> = (0..self.plan.samples.len()).filter(|w| !self.rows.contains_key(w)).collect();
        let mut made = Made::new();
        for round in 1.. {
            // Samples that are the same as yet are tried once.
            let mut trials: BTreeMap<(String, u64), usize> = BTreeMap::new();
            for &w in &open {
                if made.contains_key(&w) || self.rows.contains_key(&w) {
                    continue;
                }
                let Some(facts) = self.facts(w) else { continue };
                let (Some(prepare), Some(hash)) = (facts.rve.prepare.clone(), facts.prepared_hash.clone())
                else {
                    made.insert(w, None);
                    continue;
                };
                match next(&prepare, self.tried.get(&hash).map_or(&[][..], Vec::as_slice)) {
                    Next::Try(frictions) => {
                        trials.extend(frictions.iter().map(|f| ((hash.clone(), f.to_bits()), w)));
                    }
                    Next::Take { friction, void_ratio } => match self.state_of(w, &hash, friction) {
                        Some(state) => {
                            made.insert(w, Some((friction, void_ratio, state)));
                        }
                        // Its state was not kept: it is made once more.
                        None => drop(trials.insert((hash, friction.to_bits()), w)),
                    },
                    Next::GiveUp(why) => {
                        listener.warn(&format!("sample {w}: {why}"));
                        self.tell(Entry::Ended(Row::without(w, summary::Status::Failed, why)))?;
                    }
                }
            }
            if trials.is_empty() || self.stopped(listener) {
                break;
            }
            listener.note(&format!("preparation, round {round}: {} worlds", trials.len()));
            let trials: Vec<_> = trials
                .into_iter()
                .map(|((hash, bits), w)| Trial { hash, friction: f64::from_bits(bits), w })
                .collect();
            let all: Vec<usize> = (0..trials.len()).collect();
            let particles = |k: usize| self.facts(trials[k].w).map_or(0, |f| f.particles);
            for batch in
                divide(&all, particles, self.ensemble.settings.batches, self.ensemble.settings.memory)
            {
                if self.stopped(listener) {
                    break;
                }
                self.try_out(batch.iter().map(|k| trials[*k].clone()).collect(), listener)?;
            }
            self.forget(&open);
        }
        Ok(made)
    }

    /// The state that a friction led to, as it is in memory or was kept; one in memory is kept.
    fn state_of(&self, w: usize, hash: &str, friction: f64) -> Option<Arc<State>> {
        let path = self.made_path(w);
        let key = format!("{hash}-{:016x}", friction.to_bits());
        if let Some(state) = self.states.get(&(hash.to_owned(), friction.to_bits())) {
            let header = checkpoint::Header { scene_hash: key, ..checkpoint::Header::default() };
            // What is not kept is made again.
            let _ = checkpoint::keep(&path, &header, state);
            return Some(state.clone());
        }
        let state = checkpoint::kept(&path, &key)?;
        let belongs =
            self.plan.prepared(w, friction).is_ok_and(|made| state.belongs_to(&made.constants).is_ok());
        belongs.then(|| Arc::new(state))
    }

    /// Where the state that a sample begins with is kept: numbers after those of samples.
    fn made_path(&self, w: usize) -> std::path::PathBuf {
        self.ensemble.checkpoint(self.plan.samples.len() + w)
    }

    /// Drops states that no preparation would take.
    fn forget(&mut self, open: &[usize]) {
        let mut wanted = std::collections::BTreeSet::new();
        for &w in open {
            let Some(facts) = self.facts(w) else { continue };
            if let (Some(prepare), Some(hash)) = (&facts.rve.prepare, &facts.prepared_hash)
                && let Some(friction) = self.tried.get(hash).and_then(|tried| nearest(prepare, tried))
            {
                wanted.insert((hash.clone(), friction.to_bits()));
            }
        }
        self.states.retain(|key, _| wanted.contains(key));
    }

    /// Tries frictions in one batch.
    fn try_out(&mut self, trials: Vec<Trial>, listener: &mut dyn Listener) -> Result<(), StudyError> {
        let plan = self.plan;
        let worlds: Vec<_> = trials.into_par_iter().map(|t| (plan.prepared(t.w, t.friction), t)).collect();
        let (mut crew, mut entrants) = (Vec::new(), Vec::new());
        for (world, trial) in worlds {
            match world.and_then(|made| self.admit(made)) {
                Ok(entrant) => {
                    entrants.push(entrant);
                    crew.push(trial);
                }
                Err(reason) => self.tell(trial.failed(reason))?,
            }
        }
        let (mut drive, _) = Drive::new(entrants, self.ensemble.settings.backend, None);
        let every = self.ensemble.settings.checkpoint_every;
        let void_ratios = vec![f64::NAN; crew.len()];
        let mut makers = Makers { study: self, trials: crew, void_ratios };
        ensemble::follow(&mut drive, &mut makers, 0, every, listener)?;
        self.ensemble.count(&drive);
        Ok(())
    }

    fn admit(&self, made: plan::Made) -> Result<(Arc<Constants>, State), String> {
        self.ensemble.accepts(&made.constants)?;
        Ok((made.constants, made.state))
    }

    /// Consolidates and loads samples in one batch.
    fn load(
        &mut self,
        samples: &[usize],
        made: &Made,
        later: u64,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError> {
        let plan = self.plan;
        let worlds: Vec<_> = samples.par_iter().map(|&w| (w, plan.loaded(w))).collect();
        let mut crew =
            Loaders { study: self, samples: Vec::new(), made, hashes: Vec::new(), rows: Vec::new() };
        let mut entrants = Vec::new();
        for (w, world) in worlds {
            let begun = world.and_then(|made| crew.study.admit(made)).and_then(|(constants, fresh)| {
                let Some(Some((_, _, state))) = crew.made.get(&w) else { return Ok((constants, fresh)) };
                let state = state.begin_anew(&constants, &fresh).map_err(|e| e.to_string())?;
                Ok((constants, state))
            });
            match begun {
                Ok((constants, state)) => {
                    let hash = scene_hash(&constants, &state);
                    let (state, rows) =
                        crew.study.resumed(w, &constants, &hash).unwrap_or((state, Vec::new()));
                    entrants.push((constants, state));
                    crew.samples.push(w);
                    crew.hashes.push(hash);
                    crew.rows.push(rows);
                }
                Err(reason) => {
                    let row = Row::without(w, summary::Status::Refused, reason);
                    crew.study.tell(Entry::Ended(row))?;
                }
            }
        }
        let (mut drive, _) = Drive::new(entrants, crew.study.ensemble.settings.backend, None);
        let every = crew.study.ensemble.settings.checkpoint_every;
        ensemble::follow(&mut drive, &mut crew, later, every, listener)?;
        self.ensemble.count(&drive);
        Ok(())
    }

    /// A sample as it was kept, with its curve as far as that goes.
    fn resumed(&self, w: usize, c: &Constants, hash: &str) -> Option<(State, Vec<curve::Raw>)> {
        let state = self.ensemble.kept(w, c, hash)?;
        let rows = curve::kept(&self.ensemble.dir.sample(w), state.progress.samples)?;
        Some((state, rows))
    }

    /// Removes the states that samples began with.
    fn discard_states(&self) -> Result<(), StudyError> {
        (0..self.plan.samples.len()).try_for_each(|w| ensemble::discard(&self.made_path(w)))
    }
}

/// A friction to be tried for a sample.
#[derive(Clone)]
struct Trial {
    hash: String,
    friction: f64,
    w: usize,
}

impl Trial {
    fn failed(&self, reason: String) -> Entry {
        let prepared_hash = self.hash.clone();
        Entry::Tried { prepared_hash, friction: self.friction, void_ratio: None, reason: Some(reason) }
    }
}

/// Worlds in which samples are made.
struct Makers<'a, 'b> {
    study: &'a mut Samples<'b>,
    trials: Vec<Trial>,
    void_ratios: Vec<f64>,
}

impl Observer for Makers<'_, '_> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
    fn sample(&mut self, k: usize, sample: &Sample) -> Result<(), Infallible> {
        if let (Some(void_ratio), Some(inside)) = (self.void_ratios.get_mut(k), &sample.interior) {
            *void_ratio = inside.void_ratio;
        }
        Ok(())
    }
}

impl Follower for Makers<'_, '_> {
    fn happened(
        &mut self,
        drive: &Drive,
        event: Event,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError> {
        let Event::Ended(k) = event else { return Ok(()) };
        let (trial, void_ratio) = (self.trials[k].clone(), self.void_ratios[k]);
        let outcome = drive.outcome(k);
        if outcome.state_hash.is_none() {
            self.study.ensemble.lost = outcome.reason;
            return Ok(());
        }
        let restless = drive.batch().progress(k).results.iter().any(|result| result.ended_by == "at most");
        let reason = outcome.reason.or_else(|| {
            let time = drive.batch().time(k);
            restless.then(|| {
                format!(
                    "with a friction of {} it was not at rest under the stress of its preparation after {time:.3e} s; \
                     begin with denser particles, or raise prepare.inertial_number",
                    trial.friction
                )
            })
        });
        if let Some(reason) = reason {
            return self.study.tell(trial.failed(reason));
        }
        if let Ok(state) = drive.batch().sound_state(k) {
            self.study.states.insert((trial.hash.clone(), trial.friction.to_bits()), Arc::new(state));
        }
        listener
            .note(&format!("sample {}: friction {:.6} gives e = {void_ratio:.4}", trial.w, trial.friction));
        self.study.tell(Entry::Tried {
            prepared_hash: trial.hash,
            friction: trial.friction,
            void_ratio: Some(void_ratio),
            reason: None,
        })
    }

    fn progress(&self) -> [usize; 2] {
        [self.study.plan.samples.len(), self.study.rows.len()]
    }

    /// A round that was interrupted is done again; what ended of it stands.
    fn save(&mut self, _: &Drive) -> Result<(), StudyError> {
        Ok(())
    }
}

/// Worlds in which samples are consolidated and loaded.
struct Loaders<'a, 'b> {
    study: &'a mut Samples<'b>,
    samples: Vec<usize>,
    made: &'a Made,
    hashes: Vec<String>,
    rows: Vec<Vec<curve::Raw>>,
}

impl Loaders<'_, '_> {
    fn consolidated(&mut self, drive: &Drive, k: usize) -> Result<(), StudyError> {
        let (Ok(state), Some(row)) = (drive.batch().sound_state(k), self.rows[k].last()) else {
            return Ok(());
        };
        let orientations = Orientations::of(drive.batch().constants(k), &state);
        let here = Curve::new(std::slice::from_ref(row), None);
        let consolidated = Consolidated {
            void_ratio: row[14],
            coordination: row[15],
            p: here.p.first().copied().unwrap_or(f64::NAN),
            q: here.q.first().copied().unwrap_or(f64::NAN),
            orientations,
        };
        self.study.tell(Entry::Consolidated { sample: self.samples[k], consolidated })
    }

    fn end(&mut self, drive: &Drive, k: usize, listener: &mut dyn Listener) -> Result<(), StudyError> {
        let (w, outcome) = (self.samples[k], drive.outcome(k));
        let Some(state_hash) = outcome.state_hash else {
            // The sample is left: a device may be well again.
            self.study.ensemble.lost = outcome.reason;
            return Ok(());
        };
        let rve = self.study.facts(w).map(|facts| facts.rve.clone());
        let program = rve.as_ref().and_then(|rve: &Rve| rve.load).map(|load| load.program);
        let curve = Curve::new(&self.rows[k], program);
        let cells: Vec<_> = (0..curve.len()).map(|row| curve.cells(row)).collect();
        write_table(&self.study.ensemble.dir.sample(w), &Curve::header(), &cells)?;
        let restless = outcome.stages.iter().find(|stage| stage.ended_by == "at most");
        let reason = outcome.reason.or_else(|| {
            restless.map(|stage| {
                format!(
                    "it was not at rest under the stress of the stage `{}` after {:.3e} s",
                    stage.name, stage.duration
                )
            })
        });
        let status = if reason.is_some() { summary::Status::Failed } else { outcome.status };
        match &reason {
            Some(reason) => listener.warn(&format!("sample {w}: {reason}")),
            None => listener.note(&format!("sample {w} is done")),
        }
        let row = Row {
            sample: w,
            status,
            reason,
            state_hash: Some(state_hash),
            made: self.made.get(&w).and_then(Option::as_ref).map(|(friction, e, _)| [*friction, *e]),
            consolidated: self.study.consolidated.get(&w).cloned(),
            seconds: std::mem::replace(&mut self.study.since, Instant::now()).elapsed().as_secs_f64(),
        };
        self.study.tell(Entry::Ended(row))?;
        ensemble::discard(&self.study.ensemble.checkpoint(w))
    }
}

impl Observer for Loaders<'_, '_> {
    type Error = Infallible;
    fn wants_frames(&self) -> bool {
        false
    }
    fn sample(&mut self, k: usize, sample: &Sample) -> Result<(), Infallible> {
        if let Some(rows) = self.rows.get_mut(k) {
            rows.extend(curve::row(sample));
        }
        Ok(())
    }
}

impl Follower for Loaders<'_, '_> {
    fn happened(
        &mut self,
        drive: &Drive,
        event: Event,
        listener: &mut dyn Listener,
    ) -> Result<(), StudyError> {
        match event {
            Event::StageEnded(k, result) if result.name == program::CONSOLIDATE => {
                self.consolidated(drive, k)
            }
            Event::Ended(k) => self.end(drive, k, listener),
            _ => Ok(()),
        }
    }

    fn progress(&self) -> [usize; 2] {
        [self.study.plan.samples.len(), self.study.rows.len()]
    }

    fn save(&mut self, drive: &Drive) -> Result<(), StudyError> {
        for (k, &w) in self.samples.iter().enumerate() {
            if self.study.rows.contains_key(&w) || drive.batch().progress(k).step == 0 {
                continue;
            }
            // Of both the rows must be as many as the state has seen, so they go first.
            curve::keep(&self.study.ensemble.dir.sample(w), &self.rows[k])?;
            ensemble::keep(drive, k, &self.study.ensemble.checkpoint(w), &self.hashes[k])?;
        }
        Ok(())
    }
}
