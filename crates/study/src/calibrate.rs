//! Calibrations: parameters of scenes for which their measures come to what was measured.
//!
//! A search asks for rounds of points ([`crate::search`]); each round is a batch of worlds, each of which is a scene with
//! arguments of `--set`. Worlds that have ended are journaled. A search is a function of its seed and of what worlds
//! measured, so a calibration that was stopped anywhere goes through its rounds again with what is journaled, and goes on
//! with the rest to the same bits.

mod answers;
mod identify;
mod plan;
mod results;

use std::collections::BTreeMap;
use std::time::Instant;

use glebe_io::output::{Journal, summary};
use glebe_io::study::{Method, Statistic, Target};
use rayon::prelude::*;

pub use self::answers::{Agent, Cluster, Interval};
pub use self::identify::Known;
pub use self::plan::Plan;
pub use self::results::{Counts, Parameter, Round, Summary, Wanted};
use crate::drive::Listener;
use crate::ensemble::{Ensemble, Job, Opened, Results, Row, divide, make, open, reason, short};
pub use crate::ensemble::{Settings, StudyError};
use crate::sample::World;
use crate::search::{CmaEs, DifferentialEvolution, Evolution, Filter, Search};

/// One set of parameters with what it gave.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation {
    /// The round; that of the probes is the last.
    round: usize,
    /// The parameters in the unit cube.
    point: Vec<f64>,
    world: World,
    /// What each target's measure came to; NaN where there is none.
    found: Vec<f64>,
    /// Infinite if a target has no value.
    cost: f64,
    status: summary::Status,
    reason: Option<String>,
    /// Of the worlds, in the order of the experiments.
    state_hashes: Vec<String>,
    doubts: Vec<String>,
}

/// Evaluations around the best are numbered from here, so that those of the search keep their numbers when it goes on.
const PROBES: usize = 1 << 24;

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Cost,
    Rounds,
    Evaluations,
    Stagnation,
    /// It did not: the user stopped it, or the device was lost.
    Open,
}

/// Runs a calibration, or what is left of it, and writes everything into the output folder.
///
/// Worlds that cannot be set up or that fail are no error here: their evaluations have no cost, and the rest goes on.
///
/// # Errors
/// A folder that cannot be used, a journal of another calibration, a full disk.
pub fn run(plan: &Plan, settings: &Settings, listener: &mut dyn Listener) -> Result<Summary, StudyError> {
    let started = Instant::now();
    let hash = plan.digest();
    let Opened { dir, journal, entries, warnings: told } =
        open::<Row>(&plan.calibration.text, &hash, settings, listener)?;
    if let Some(ended) = &entries {
        listener.note(&format!("{} worlds have ended already", ended.len()));
    }
    let mut warnings = plan.warnings.clone();
    warnings.extend(told);
    let settings = &Settings {
        // Beds that no other world shares are not worth their files.
        beds: settings.beds.clone().filter(|_| plan.shares_beds(settings.backend)),
        ..settings.clone()
    };
    let ensemble = Ensemble::new(settings, dir.clone());
    let rows = entries.unwrap_or_default().into_iter().map(|row| (row.world, row)).collect();
    let work = Work { journal, rows, expected: 0 };
    let mut calibration =
        Calibrator { plan, ensemble, work, evaluations: Vec::new(), rounds: Vec::new(), warnings };
    let mut search = searcher(plan);
    let end = calibration.search(search.as_mut(), listener)?;
    let slopes = match end {
        End::Open => None,
        _ => calibration.probe(listener)?,
    };
    if !listener.interrupted() && calibration.ensemble.lost.is_none() {
        calibration.ensemble.tidy();
    }
    calibration.write(&dir, search.as_ref(), end, slopes.as_deref(), started, &hash, listener)
}

/// The search that a calibration asks for.
fn searcher(plan: &Plan) -> Box<dyn Search> {
    let c = &plan.calibration;
    let dimensions = c.free.len();
    match c.method {
        Method::CmaEs { population } => Box::new(CmaEs::new(dimensions, population, c.seed)),
        Method::BayesianFilter { samples, effective } => {
            let weight = c.targets.iter().map(|t| t.weight).sum();
            Box::new(Filter::new(dimensions, samples, effective, weight, c.seed))
        }
        Method::DifferentialEvolution { population, weight, crossover, adaptive } => {
            let settings = Evolution { population, weight, crossover, adaptive };
            Box::new(DifferentialEvolution::new(dimensions, settings, c.seed))
        }
        // Methods that this version does not know are not read.
        _ => Box::new(DifferentialEvolution::new(dimensions, Evolution::default(), c.seed)),
    }
}

/// Worlds that have ended, journaled.
struct Work {
    journal: Journal,
    rows: BTreeMap<usize, Row>,
    /// Worlds of the rounds to come and of those done, as far as is known.
    expected: usize,
}

impl Results for Work {
    fn ended(&mut self, row: Row, listener: &mut dyn Listener) -> Result<(), StudyError> {
        self.journal.append(&row)?;
        if let Some(reason) = &row.reason {
            listener.warn(&format!("world {}: {reason}", row.world));
        }
        self.rows.insert(row.world, row);
        Ok(())
    }

    fn progress(&self) -> [usize; 2] {
        [self.expected, self.rows.len()]
    }
}

/// A calibration under way.
struct Calibrator<'a> {
    plan: &'a Plan,
    ensemble: Ensemble<'a>,
    work: Work,
    evaluations: Vec<Evaluation>,
    rounds: Vec<Round>,
    warnings: Vec<String>,
}

impl Calibrator<'_> {
    /// Goes through the rounds of a search until it ends.
    fn search(&mut self, search: &mut dyn Search, listener: &mut dyn Listener) -> Result<End, StudyError> {
        let stop = self.plan.calibration.stop;
        let mut unchanged = 0;
        loop {
            let points = search.ask();
            let round = self.rounds.len();
            let worlds = (stop.rounds - round) * points.len();
            let most = stop.evaluations.map_or(worlds, |most| worlds.min(most));
            self.work.expected = (self.evaluations.len() + most) * self.plan.calibration.experiments.len();
            let beyond = |most| round > 0 && self.evaluations.len() + points.len() > most;
            if stop.evaluations.is_some_and(beyond) {
                return Ok(End::Evaluations);
            }
            let later = (most.saturating_sub(points.len())) as u64 * self.plan.steps;
            let Some(costs) = self.evaluate(round, self.evaluations.len(), points, later, listener)? else {
                return Ok(End::Open);
            };
            search.tell(&costs);
            let before = self.rounds.last().map_or(f64::INFINITY, |r| r.best);
            let now = Round::of(&costs, &search.costs(), before);
            listener.note(&self.told(&now, round));
            unchanged = if now.best < before { 0 } else { unchanged + 1 };
            let best = now.best;
            self.rounds.push(now);
            if stop.cost.is_some_and(|cost| best <= cost) {
                return Ok(End::Cost);
            }
            if self.rounds.len() >= stop.rounds {
                return Ok(End::Rounds);
            }
            if stop.stagnation.is_some_and(|rounds| unchanged >= rounds) {
                return Ok(End::Stagnation);
            }
        }
    }

    fn told(&self, round: &Round, k: usize) -> String {
        let [best, mean] = [round.best, round.mean].map(short);
        let without = match round.without {
            0 => String::new(),
            n => format!("; {n} without a result"),
        };
        let best_so_far = self.best().map_or(String::new(), |e| format!(" ({})", self.found(e)));
        let rounds = self.plan.calibration.stop.rounds;
        format!("round {} of at most {rounds}: best cost {best}{best_so_far}, mean {mean}{without}", k + 1)
    }

    /// `draught = 309.1 N`
    fn found(&self, evaluation: &Evaluation) -> String {
        let targets = self.plan.calibration.targets.iter().zip(&evaluation.found);
        let all = targets.map(|(t, found)| format!("{} = {} {}", t.name, short(*found), t.unit));
        all.collect::<Vec<_>>().join(", ")
    }

    /// The evaluation of the least cost, the first of equal ones; none if none has a cost.
    fn best(&self) -> Option<&Evaluation> {
        let done = self.evaluations.iter().filter(|e| e.cost.is_finite());
        done.min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// Runs what is not journaled of a round as one batch, or several if memory asks for it; its evaluations are numbered
    /// from `first`. None if it was not finished.
    fn evaluate(
        &mut self,
        round: usize,
        first: usize,
        points: Vec<Vec<f64>>,
        later: u64,
        listener: &mut dyn Listener,
    ) -> Result<Option<Vec<f64>>, StudyError> {
        let experiments = self.plan.calibration.experiments.len();
        let before = self.evaluations.len();
        let worlds: Vec<World> = points.iter().map(|x| self.plan.world(x)).collect();
        let numbers = first * experiments..(first + points.len()) * experiments;
        let pending: Vec<usize> = numbers.clone().filter(|w| !self.work.rows.contains_key(w)).collect();
        let particles = |w: usize| self.plan.particles[w % experiments];
        let settings = self.ensemble.settings;
        let batches = divide(&pending, particles, settings.batches, settings.memory);
        for batch in batches {
            let job = |&world: &usize| {
                let experiment = &self.plan.calibration.experiments[world % experiments];
                let own = &worlds[world / experiments - first].sets;
                let sets = [experiment.sets.as_slice(), own].concat();
                let made = make(&experiment.scene, &experiment.scene_text, &sets);
                Job { world, made: made.map_err(|errors| reason(&errors)) }
            };
            let jobs = batch.par_iter().map(job).collect();
            self.warnings.extend(self.ensemble.run(jobs, later, &mut self.work, listener)?);
            if listener.interrupted() || self.ensemble.lost.is_some() {
                break;
            }
        }
        if !numbers.clone().all(|w| self.work.rows.contains_key(&w)) {
            return Ok(None);
        }
        for (k, (point, world)) in points.into_iter().zip(worlds).enumerate() {
            let evaluation = self.evaluation(first + k, round, point, world);
            self.evaluations.push(evaluation);
        }
        Ok(Some(self.evaluations[before..].iter().map(|e| e.cost).collect()))
    }

    /// What the worlds of a set of parameters gave.
    fn evaluation(&self, number: usize, round: usize, point: Vec<f64>, world: World) -> Evaluation {
        let targets = &self.plan.calibration.targets;
        let experiments = self.plan.calibration.experiments.len();
        let rows: Vec<&Row> = (number * experiments..(number + 1) * experiments)
            .filter_map(|w| self.work.rows.get(&w))
            .collect();
        let failed = rows.iter().find(|row| row.status != summary::Status::Done);
        let found: Vec<f64> =
            targets.iter().map(|t| rows.get(t.experiment).map_or(f64::NAN, |r| of(r, t))).collect();
        let nothing = targets.iter().zip(&found).find(|(_, x)| !x.is_finite());
        let (status, reason) = match (failed, nothing) {
            (Some(row), _) => (row.status, row.reason.clone()),
            (None, Some((target, _))) => {
                let why = format!("`{}` was not measured: its window was not reached", target.name);
                (summary::Status::Failed, Some(why))
            }
            (None, None) => (summary::Status::Done, None),
        };
        let cost = if reason.is_some() { f64::INFINITY } else { cost(targets, &found) };
        Evaluation {
            round,
            point,
            world,
            found,
            cost,
            status,
            reason,
            state_hashes: rows.iter().map(|row| row.state_hash.clone().unwrap_or_default()).collect(),
            doubts: rows.iter().flat_map(|row| row.doubts.clone()).collect(),
        }
    }

    /// How the targets change with each parameter around the best evaluation \[scatters over the range\]: a row for each
    /// target. None if that was not asked for, there is none, the search tells it itself, or it was not finished.
    fn probe(&mut self, listener: &mut dyn Listener) -> Result<Option<Vec<Vec<f64>>>, StudyError> {
        let c = &self.plan.calibration;
        let step = c.probe;
        if !self.plan.probes() {
            return Ok(None);
        }
        let Some(best) = self.best().map(|e| e.point.clone()) else { return Ok(None) };
        let moved = |k: usize, by: f64| {
            let mut point = best.clone();
            point[k] = (point[k] + by).clamp(0.0, 1.0);
            point
        };
        let points: Vec<Vec<f64>> = (0..best.len()).flat_map(|k| [moved(k, -step), moved(k, step)]).collect();
        listener.note(&format!(
            "{} evaluations around the best tell how the targets depend on the parameters",
            points.len()
        ));
        let first = self.evaluations.len();
        let (count, round) = (points.len(), self.rounds.len());
        self.work.expected = (first + count) * c.experiments.len();
        if self.evaluate(round, PROBES + first * count, points, 0, listener)?.is_none() {
            return Ok(None);
        }
        let slope = |t: usize, k: usize| {
            let [low, high] = [0, 1].map(|side| &self.evaluations[first + 2 * k + side]);
            (high.found[t] - low.found[t]) / (high.point[k] - low.point[k]) / c.targets[t].scatter
        };
        let row = |t: usize| (0..best.len()).map(|k| slope(t, k)).collect();
        Ok(Some((0..c.targets.len()).map(row).collect()))
    }
}

/// What a target's measure came to.
fn of(row: &Row, target: &Target) -> f64 {
    let measured = row.measured(&target.stage, &target.measure).filter(|m| m.n > 0);
    measured.map_or(f64::NAN, |m| match target.statistic {
        Statistic::Std => m.std,
        _ => m.mean,
    })
}

/// Root of the weighted mean square of the deviations from the targets, in their scatters. With one target this is the
/// paper's fitness (Nagy et al. 2024, equation 50) over the scatter.
fn cost(targets: &[Target], found: &[f64]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (target, found) in targets.iter().zip(found) {
        let away = (found - target.value) / target.scatter;
        sum += target.weight * away * away;
        weights += target.weight;
    }
    (sum / weights).sqrt()
}
