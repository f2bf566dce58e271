//! Calibrations: parameters of scenes for which their measures come to what was measured.
//!
//! A search asks for rounds of points ([`crate::search`]); each round is a batch of worlds, each of which is a scene with
//! arguments of `--set`. Worlds that have ended are journaled, and the periodic samples of a round are a study of their own, in a folder of its
//! own. A search is a function of its seed and of what worlds
//! measured, so a calibration that was stopped anywhere goes through its rounds again with what is journaled, and goes on
//! with the rest to the same bits.

mod answers;
mod curves;
mod found;
mod identify;
mod plan;
mod probe;
mod results;
mod rounds;
mod surrogate;

use std::collections::BTreeMap;
use std::time::Instant;

use glebe_io::output::{Journal, summary};
use glebe_io::study::Method;

pub use self::answers::{Agent, Cluster, Interval};
use self::found::{Given, shown};
pub use self::identify::Known;
pub use self::plan::Plan;
use self::probe::Slopes;
pub use self::results::{Counts, Parameter, Round, Summary, Wanted};
use self::surrogate::{Candidate, Surrogate};
pub use self::surrogate::{Missed, Report};
use crate::drive::Listener;
use crate::ensemble::{Ensemble, Opened, Results, Row, open, short};
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
    /// What each target came to: one number, or one for each point of a curve; NaN where there is none.
    found: Vec<Vec<f64>>,
    /// Infinite if a target has no value.
    cost: f64,
    /// If it was not simulated, the standard deviation that the surrogate states of its cost.
    predicted: Option<f64>,
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
    let (evaluations, rounds, sampled) = (Vec::new(), Vec::new(), BTreeMap::new());
    let mut calibration = Calibrator {
        plan,
        ensemble,
        work,
        sampled,
        sampled_s: 0.0,
        evaluations,
        rounds,
        surrogate: plan.calibration.surrogate.map(Surrogate::new),
        warnings,
    };
    let mut search = searcher(plan);
    let end = calibration.search(search.as_mut(), listener)?;
    let slopes = match end {
        End::Open => None,
        _ => calibration.probe(listener)?,
    };
    if !listener.interrupted() && calibration.ensemble.lost.is_none() {
        calibration.ensemble.tidy();
    }
    calibration.write(&dir, search.as_ref(), end, slopes.as_ref(), started, &hash, listener)
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
    /// What periodic samples gave, by the numbers that their worlds would have.
    sampled: BTreeMap<usize, Given>,
    /// Wall time of the samples that ended, over all runs \[s\].
    sampled_s: f64,
    evaluations: Vec<Evaluation>,
    rounds: Vec<Round>,
    surrogate: Option<Surrogate>,
    warnings: Vec<String>,
}

impl Calibrator<'_> {
    /// Goes through the rounds of a search until it ends.
    fn search(&mut self, search: &mut dyn Search, listener: &mut dyn Listener) -> Result<End, StudyError> {
        let stop = self.plan.calibration.stop;
        let mut unchanged = 0;
        loop {
            let candidates = self.candidates(search.ask());
            let simulations = candidates.iter().filter(|candidate| candidate.simulated).count();
            let round = self.rounds.len();
            let simulated = self.simulated().count();
            let worlds = (stop.rounds - round) * candidates.len();
            let most = stop.evaluations.map_or(worlds, |most| worlds.min(most));
            self.work.expected = (simulated + most) * self.plan.calibration.experiments.len();
            let beyond = |most| round > 0 && simulated + simulations > most;
            if stop.evaluations.is_some_and(beyond) {
                return Ok(End::Evaluations);
            }
            let later = (most.saturating_sub(candidates.len())) as u64 * self.plan.steps;
            let first = self.evaluations.len();
            let Some(costs) = self.evaluate(round, first, &candidates, later, listener)? else {
                return Ok(End::Open);
            };
            if let Some(surrogate) = &mut self.surrogate {
                surrogate.compare(&candidates, &self.evaluations[first..], &self.plan.calibration.targets);
            }
            search.tell(&costs);
            let before = self.rounds.last().map_or(f64::INFINITY, |r| r.best);
            let predicted = candidates.len() - simulations;
            let now = Round::of(&costs, &search.costs(), before, predicted, search.posterior());
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

    /// The points of a round, with what the surrogate says of them.
    fn candidates(&mut self, points: Vec<Vec<f64>>) -> Vec<Candidate> {
        let c = &self.plan.calibration;
        match &mut self.surrogate {
            Some(surrogate) => surrogate.candidates(points, &self.evaluations, &c.targets, c.seed),
            None => points.into_iter().map(Candidate::simulated).collect(),
        }
    }

    /// The evaluations that were simulated.
    fn simulated(&self) -> impl Iterator<Item = &Evaluation> {
        self.evaluations.iter().filter(|e| e.predicted.is_none())
    }

    fn told(&self, round: &Round, k: usize) -> String {
        let [best, mean] = [round.best, round.mean].map(short);
        let without = match round.without {
            0 => String::new(),
            n => format!("; {n} without a result"),
        };
        let best_so_far = self.best().map_or(String::new(), |e| format!(" ({})", self.found(e)));
        let rounds = self.plan.calibration.stop.rounds;
        let predicted = match round.predicted {
            0 => String::new(),
            n => format!("; {n} by the surrogate"),
        };
        format!(
            "round {} of at most {rounds}: best cost {best}{best_so_far}, mean {mean}{without}{predicted}",
            k + 1
        )
    }

    /// `draught = 309.1 N`
    fn found(&self, evaluation: &Evaluation) -> String {
        let targets = self.plan.calibration.targets.iter().zip(&evaluation.found);
        let all = targets.map(|(t, found)| {
            let unit = if t.is_curve() { "scatters off" } else { t.unit };
            format!("{} = {} {unit}", t.name, short(shown(t, found)))
        });
        all.collect::<Vec<_>>().join(", ")
    }

    /// The simulated evaluation of the least cost, the first of equal ones; none if none has a cost.
    fn best(&self) -> Option<&Evaluation> {
        let done = self.simulated().filter(|e| e.cost.is_finite());
        done.min_by(|a, b| a.cost.total_cmp(&b.cost))
    }

    /// How the targets change with each parameter around the best evaluation. None if that was not asked for, there is none, the
    /// search tells it itself, or it was not finished.
    fn probe(&mut self, listener: &mut dyn Listener) -> Result<Option<Slopes>, StudyError> {
        let c = &self.plan.calibration;
        if !self.plan.probes() {
            return Ok(None);
        }
        let Some(points) = self.best().map(|e| probe::points(&e.point, c.probe)) else { return Ok(None) };
        let points: Vec<Candidate> = points.into_iter().map(Candidate::simulated).collect();
        listener.note(&format!(
            "{} evaluations around the best tell how the targets depend on the parameters",
            points.len()
        ));
        let first = self.evaluations.len();
        let (count, round) = (points.len(), self.rounds.len());
        self.work.expected = (self.simulated().count() + count) * c.experiments.len();
        if self.evaluate(round, PROBES + first * count, &points, 0, listener)?.is_none() {
            return Ok(None);
        }
        let values: Vec<usize> = c.targets.iter().map(|t| t.values.len()).collect();
        let value =
            |t: usize, n: usize, i: usize| self.evaluations[first + i].found[t][n] / c.targets[t].scatters[n];
        Ok(Some(Slopes::of(c.free.len(), c.probe, &values, value)))
    }
}
