//! The worlds and samples of a round.

use std::path::Path;

use glebe_io::output::{Existing, OutputDir, summary};
use rayon::prelude::*;

use super::found::{Given, cost};
use super::surrogate::{Candidate, Guess};
use super::{Calibrator, Evaluation};
use crate::drive::{Listener, Pulse};
use crate::ensemble::{Job, Settings, StudyError, divide, make, reason};
use crate::rve;
use crate::sample::World;

/// A listener that is told of what is wrong, but not of every sample.
struct Quiet<'a>(&'a mut dyn Listener);

impl Listener for Quiet<'_> {
    fn warn(&mut self, line: &str) {
        self.0.warn(line);
    }
    fn pulse(&mut self, pulse: &Pulse<'_>) {
        self.0.pulse(pulse);
    }
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// An evaluation that is simulated.
struct Simulated {
    number: usize,
    world: World,
}

impl Calibrator<'_> {
    /// Runs what is not kept of a round: its worlds as one batch, or several if memory asks for it, and its periodic samples
    /// as another; its evaluations are numbered from `first`. None if it was not finished.
    pub(super) fn evaluate(
        &mut self,
        round: usize,
        first: usize,
        candidates: &[Candidate],
        later: u64,
        listener: &mut dyn Listener,
    ) -> Result<Option<Vec<f64>>, StudyError> {
        let before = self.evaluations.len();
        let simulated: Vec<Simulated> = (first..)
            .zip(candidates)
            .filter(|(_, candidate)| candidate.simulated)
            .map(|(number, candidate)| Simulated { number, world: self.plan.world(&candidate.point) })
            .collect();
        let done =
            self.run_worlds(&simulated, later, listener)? && self.run_samples(first, &simulated, listener)?;
        if !done {
            return Ok(None);
        }
        for (number, candidate) in (first..).zip(candidates) {
            let evaluation = match &candidate.guess {
                Some(guess) if !candidate.simulated => self.guessed(round, &candidate.point, guess),
                _ => self.evaluation(number, round, &candidate.point),
            };
            self.evaluations.push(evaluation);
        }
        Ok(Some(self.evaluations[before..].iter().map(|e| e.cost).collect()))
    }

    /// Runs the worlds of scenes that are not journaled; false if not all of them ended.
    fn run_worlds(
        &mut self,
        simulated: &[Simulated],
        later: u64,
        listener: &mut dyn Listener,
    ) -> Result<bool, StudyError> {
        let all = &self.plan.calibration.experiments;
        let experiments = all.len();
        let numbers: Vec<usize> = simulated
            .iter()
            .flat_map(|s| s.number * experiments..(s.number + 1) * experiments)
            .filter(|w| all[w % experiments].samples.is_none())
            .collect();
        let pending: Vec<usize> =
            numbers.iter().copied().filter(|w| !self.work.rows.contains_key(w)).collect();
        let particles = |w: usize| self.plan.particles[w % experiments];
        let settings = self.ensemble.settings;
        for batch in divide(&pending, particles, settings.batches, settings.memory) {
            let job = |&world: &usize| {
                let experiment = &all[world % experiments];
                let own = simulated.binary_search_by_key(&(world / experiments), |s| s.number);
                let own = own.map_or(&[][..], |at| &simulated[at].world.sets);
                let sets = [experiment.sets.as_slice(), own].concat();
                let made = make(&experiment.scene, &experiment.scene_text, &sets);
                let made = made.map_err(|errors| reason(&errors));
                Job { world, made, curves: self.plan.curves[world % experiments].clone() }
            };
            let jobs = batch.par_iter().map(job).collect();
            self.warnings.extend(self.ensemble.run(jobs, later, &mut self.work, listener)?);
            if listener.interrupted() || self.ensemble.lost.is_some() {
                break;
            }
        }
        Ok(numbers.iter().all(|w| self.work.rows.contains_key(w)))
    }

    /// Runs the periodic samples that are not kept; false if not all of them ended. Those of one study that differ in what
    /// its experiments set are one study in a folder of its own, with a journal of its own.
    fn run_samples(
        &mut self,
        first: usize,
        simulated: &[Simulated],
        listener: &mut dyn Listener,
    ) -> Result<bool, StudyError> {
        if simulated.is_empty() {
            return Ok(true);
        }
        let plan = self.plan;
        let experiments = plan.calibration.experiments.len();
        for group in &plan.groups {
            let of = |world: &World, e: &usize| World {
                values: Vec::new(),
                sets: [plan.calibration.experiments[*e].sets.as_slice(), &world.sets].concat(),
            };
            let variants = simulated
                .iter()
                .flat_map(|s| group.experiments.iter().map(move |e| of(&s.world, e)))
                .collect();
            let Some(samples) = rve::Plan::of(group.study.clone(), variants, || false) else {
                return Ok(false);
            };
            let out = self.ensemble.dir.round(first * experiments + group.experiments[0]);
            let given = {
                let settings = Settings { existing: existing(&out)?, out, ..self.ensemble.settings.clone() };
                let mut quiet = Quiet(listener);
                let (mut study, _) = rve::gather(&samples, &settings, &samples.digest(), &mut quiet)?;
                self.ensemble.steps += study.ensemble.steps;
                self.ensemble.particle_steps += study.ensemble.particle_steps;
                if study.ensemble.lost.is_some() {
                    self.ensemble.lost.clone_from(&study.ensemble.lost);
                }
                study.outcomes()
            };
            if given.iter().any(|sample| sample.row.status == summary::Status::Interrupted) {
                return Ok(false);
            }
            self.sampled_s += given.iter().map(|sample| sample.row.seconds).sum::<f64>();
            let seeds = given.len() / samples.variants.len().max(1);
            for (v, sample) in given.chunks(seeds.max(1)).enumerate() {
                let (k, e) = (v / group.experiments.len(), group.experiments[v % group.experiments.len()]);
                let given = Given::by_samples(sample, &plan.targets_of(e));
                self.sampled.insert(simulated[k].number * experiments + e, given);
            }
        }
        Ok(true)
    }

    /// What the surrogate says of a set of parameters.
    fn guessed(&self, round: usize, point: &[f64], guess: &Guess) -> Evaluation {
        Evaluation {
            round,
            point: point.to_vec(),
            world: self.plan.world(point),
            found: guess.found.clone(),
            cost: guess.cost,
            predicted: Some(guess.spread),
            status: summary::Status::Done,
            reason: None,
            state_hashes: Vec::new(),
            doubts: Vec::new(),
        }
    }

    /// What a set of parameters gave.
    fn evaluation(&mut self, number: usize, round: usize, point: &[f64]) -> Evaluation {
        let targets = &self.plan.calibration.targets;
        let experiments = self.plan.calibration.experiments.len();
        let given: Vec<Given> = (0..experiments)
            .filter_map(|e| {
                let w = number * experiments + e;
                let by_world = |row| Given::by_world(row, &self.plan.targets_of(e));
                self.sampled.remove(&w).or_else(|| self.work.rows.get(&w).map(by_world))
            })
            .collect();
        let failed = given.iter().find(|g| g.status != summary::Status::Done);
        let lacks = given.iter().flat_map(|g| g.found.values()).find_map(|found| found.as_ref().err());
        let (status, reason) = match (failed, lacks) {
            (Some(given), _) => (given.status, given.reason.clone()),
            (None, Some(why)) => (summary::Status::Failed, Some(why.clone())),
            (None, None) => (summary::Status::Done, None),
        };
        let found = |t: usize| {
            let found = given.iter().find_map(|g| g.found.get(&t)).and_then(|found| found.as_ref().ok());
            found.cloned().unwrap_or_else(|| vec![f64::NAN; targets[t].values.len()])
        };
        let found: Vec<Vec<f64>> = (0..targets.len()).map(found).collect();
        let cost = if status == summary::Status::Done { cost(targets, &found) } else { f64::INFINITY };
        Evaluation {
            round,
            point: point.to_vec(),
            world: self.plan.world(point),
            predicted: None,
            cost: if cost.is_finite() { cost } else { f64::INFINITY },
            found,
            status,
            reason,
            state_hashes: given.iter().map(|g| g.state_hash.clone()).collect(),
            doubts: given.iter().flat_map(|g| g.doubts.clone()).collect(),
        }
    }
}

/// Whether the study of a round begins or goes on.
fn existing(folder: &Path) -> Result<Existing, StudyError> {
    let begun = folder.is_dir() && !OutputDir::is_vacant(folder)?;
    Ok(if begun { Existing::Resume } else { Existing::Refuse })
}
