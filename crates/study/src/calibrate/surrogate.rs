//! Gaussian processes that stand for simulations where they are sure enough.
//!
//! Each target has one, a curve as many functions as it has points; they learn from what was simulated alone. A set of parameters
//! is simulated if its cost is not known well enough, if it could be the best, or if the evaluation nearest to it has no cost. Of
//! those left, every tenth is simulated too, so that the error of the others is known and not only stated. What is predicted is
//! marked wherever it is told, and never taken for the best.
//!
//! All of this is a function of the evaluations before, so that a calibration that goes on decides as one that was never stopped.

use std::collections::BTreeMap;

use glebe_io::study::{Calibration, Surrogate as Settings, Target};
use serde::Serialize;

use super::Evaluation;
use super::found::cost;
use crate::ensemble::short;
use crate::search::{GaussianProcess, Posterior};

/// Most evaluations that it learns from, those of the least cost: its work grows with their third power.
const MOST: usize = 250;
/// Kernels are looked for again when there is so much more to learn from.
const RENEWED: f64 = 1.2;
/// One in so many of those that it is sure of is simulated to see how far off it is.
const CHECKED: usize = 10;
/// How many standard deviations what could be the best may be away from it.
const COULD: f64 = 2.0;
/// Errors above this, as a share of what was stated of them, are told.
const UNSOUND: f64 = 2.0;

/// A point of a round.
pub(super) struct Candidate {
    pub(super) point: Vec<f64>,
    /// What the surrogate says of it.
    pub(super) guess: Option<Guess>,
    /// Whether it is simulated all the same.
    pub(super) simulated: bool,
    /// Whether that is only done to see how far off the guess is.
    checked: bool,
}

impl Candidate {
    /// One of which nothing is known.
    pub(super) fn simulated(point: Vec<f64>) -> Self {
        Self { point, guess: None, simulated: true, checked: false }
    }
}

/// What the surrogate says of a point.
pub(super) struct Guess {
    /// What each target comes to.
    pub(super) found: Vec<Vec<f64>>,
    /// Standard deviations of what simulations would give, in scatters.
    stds: Vec<Vec<f64>>,
    /// The cost of what the targets come to.
    pub(super) cost: f64,
    /// The standard deviation of the cost, at most: the cost is a norm of the deviations, and this is the norm of theirs. Noise has
    /// no part in it, since another simulation would have it too.
    pub(super) spread: f64,
}

pub(super) struct Surrogate {
    settings: Settings,
    /// One of each target, of its deviations in scatters.
    processes: Vec<GaussianProcess>,
    /// From how many evaluations the kernels are.
    learnt: usize,
    /// How much larger errors were than what was stated, by target; 1 at the least.
    widening: Vec<f64>,
    /// By target: of points left out, and of those simulated after a guess in the last round.
    left_out: Vec<Errors>,
    last: Vec<Errors>,
    /// By target: of those that were simulated to see how far off the guess is.
    checked: Vec<Errors>,
    /// How many that were.
    checks: usize,
    /// How many it was sure of.
    sure: usize,
}

/// Errors beside what was stated of them.
#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    count: usize,
    /// Sums of squares: of the errors \[scatters\], and in stated standard deviations.
    squares: f64,
    stated: f64,
    /// How many are not more than two stated standard deviations.
    within: usize,
}

impl Errors {
    fn add(&mut self, error: f64, std: f64) {
        if std == 0.0 && error == 0.0 {
            // What never changes tells nothing.
            return;
        }
        self.count += 1;
        self.squares += error * error;
        if std > 0.0 {
            self.stated += (error / std) * (error / std);
        }
        self.within += usize::from(error.abs() <= 2.0 * std);
    }

    fn mean(&self, sum: f64) -> f64 {
        sum / self.count as f64
    }

    /// Root mean square of the errors over what was stated; 1 of none.
    fn ratio(&self) -> f64 {
        if self.count == 0 { 1.0 } else { self.mean(self.stated).sqrt() }
    }
}

impl Surrogate {
    pub(super) fn new(settings: Settings) -> Self {
        Self {
            settings,
            processes: Vec::new(),
            learnt: 0,
            widening: Vec::new(),
            left_out: Vec::new(),
            last: Vec::new(),
            checked: Vec::new(),
            checks: 0,
            sure: 0,
        }
    }

    /// The points of a round, with what it says of them after these evaluations.
    pub(super) fn candidates(
        &mut self,
        points: Vec<Vec<f64>>,
        evaluations: &[Evaluation],
        targets: &[Target],
        seed: u64,
    ) -> Vec<Candidate> {
        let simulated: Vec<&Evaluation> = evaluations.iter().filter(|e| e.predicted.is_none()).collect();
        self.learn(&simulated, targets, seed);
        let best = simulated.iter().map(|e| e.cost).fold(f64::INFINITY, f64::min);
        points.into_iter().map(|point| self.candidate(point, &simulated, best, targets)).collect()
    }

    fn candidate(
        &mut self,
        point: Vec<f64>,
        simulated: &[&Evaluation],
        best: f64,
        targets: &[Target],
    ) -> Candidate {
        let Some(guess) = self.guess(&point, targets) else { return Candidate::simulated(point) };
        let away = |e: &&&Evaluation| e.point.iter().zip(&point).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let nearest = simulated.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let unsure = guess.spread > self.settings.spread * guess.cost.max(1.0)
            || guess.cost - COULD * guess.spread < best
            || nearest.is_none_or(|e| !e.cost.is_finite());
        self.sure += usize::from(!unsure);
        let checked = !unsure && self.sure % CHECKED == 1;
        Candidate { point, guess: Some(guess), simulated: unsure || checked, checked }
    }

    /// What the targets come to at a point; none if that is not known yet.
    fn guess(&self, point: &[f64], targets: &[Target]) -> Option<Guess> {
        if self.processes.is_empty() {
            return None;
        }
        let (mut found, mut stds, mut beside) = (Vec::new(), Vec::new(), Vec::new());
        for ((target, process), wider) in targets.iter().zip(&self.processes).zip(&self.widening) {
            let told = process.predict(point);
            let at = |n: usize, z: f64| target.values[n] + z * target.scatters[n];
            let all = |of: &[f64]| of.iter().enumerate().map(|(n, z)| at(n, *z)).collect::<Vec<f64>>();
            let wide: Vec<f64> = told.std.iter().map(|std| wider * std).collect();
            let noise = process.noise();
            stds.push(wide.iter().zip(noise).map(|(std, noise)| std.hypot(wider * noise)).collect());
            found.push(all(&told.mean));
            beside.push(all(&wide));
        }
        let (cost_of, spread) = (cost(targets, &found), cost(targets, &beside));
        (cost_of.is_finite() && spread.is_finite()).then_some(Guess { found, stds, cost: cost_of, spread })
    }

    /// Learns from what was simulated.
    fn learn(&mut self, simulated: &[&Evaluation], targets: &[Target], seed: u64) {
        let mut known: Vec<&Evaluation> = Vec::new();
        for e in simulated.iter().filter(|e| e.cost.is_finite()) {
            // A point that is found again teaches nothing.
            if known.iter().all(|k| k.point != e.point) {
                known.push(e);
            }
        }
        let done = known.len();
        if done < self.settings.after.max(2) {
            return;
        }
        known.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        known.truncate(MOST);
        let points: Vec<Vec<f64>> = known.iter().map(|e| e.point.clone()).collect();
        let anew = self.processes.is_empty() || done as f64 >= RENEWED * self.learnt as f64;
        let process = |t: usize, target: &Target| {
            let deviation =
                |e: &&Evaluation, n: usize| (e.found[t][n] - target.values[n]) / target.scatters[n];
            let values: Vec<Vec<f64>> =
                (0..target.values.len()).map(|n| known.iter().map(|e| deviation(e, n)).collect()).collect();
            match self.processes.get(t).filter(|_| !anew) {
                Some(process) => GaussianProcess::with(&points, &values, process.kernel().clone()),
                None => GaussianProcess::fit(&points, &values, seed),
            }
        };
        let processes: Option<Vec<GaussianProcess>> =
            targets.iter().enumerate().map(|(t, target)| process(t, target)).collect();
        let Some(processes) = processes else { return };
        self.left_out = processes.iter().map(left_out).collect();
        let ratio = |t: usize| {
            let last = self.last.get(t).copied().unwrap_or_default();
            self.left_out[t].ratio().max(last.ratio()).max(1.0)
        };
        self.widening = (0..processes.len()).map(ratio).collect();
        self.processes = processes;
        if anew {
            self.learnt = done;
        }
    }

    /// Takes note of how far off it was of those of a round that were simulated.
    pub(super) fn compare(
        &mut self,
        candidates: &[Candidate],
        evaluations: &[Evaluation],
        targets: &[Target],
    ) {
        self.checked.resize(targets.len(), Errors::default());
        self.last = vec![Errors::default(); targets.len()];
        for (candidate, e) in candidates.iter().zip(evaluations) {
            let Some(guess) = candidate.guess.as_ref().filter(|_| candidate.simulated && e.cost.is_finite())
            else {
                continue;
            };
            self.checks += usize::from(candidate.checked);
            for (t, target) in targets.iter().enumerate() {
                for (n, scatter) in target.scatters.iter().enumerate() {
                    let error = (e.found[t][n] - guess.found[t][n]) / scatter;
                    let std = guess.stds[t][n];
                    self.last[t].add(error, std / self.widening[t]);
                    if candidate.checked {
                        self.checked[t].add(error, std);
                    }
                }
            }
        }
    }

    /// What it did, and how far off it was.
    pub(super) fn report(
        &self,
        evaluations: &[Evaluation],
        posterior: Option<&Posterior>,
        c: &Calibration,
    ) -> Report {
        let predicted = evaluations.iter().filter(|e| e.predicted.is_some()).count();
        let target = |(t, target): (usize, &Target)| {
            let process = self.processes.get(t)?;
            let [left_out, checked] =
                [&self.left_out, &self.checked].map(|all| all.get(t).copied().unwrap_or_default());
            let noise = process.noise();
            let squares: f64 = noise.iter().map(|x| x * x).sum();
            let lengths = &process.kernel().lengths;
            Some(Missed {
                name: target.name.clone(),
                leave_one_out: left_out.mean(left_out.squares).sqrt(),
                leave_one_out_within: left_out.mean(left_out.within as f64),
                held_out: checked.mean(checked.squares).sqrt(),
                held_out_within: checked.mean(checked.within as f64),
                noise: (squares / noise.len() as f64).sqrt(),
                lengths: c.free.iter().map(|f| f.name.clone()).zip(lengths.iter().copied()).collect(),
            })
        };
        Report {
            simulated: evaluations.len() - predicted,
            predicted,
            saved: predicted as f64 / evaluations.len() as f64,
            checked: self.checks,
            posterior: posterior.map(|p| share_of(p, evaluations)),
            targets: c.targets.iter().enumerate().filter_map(target).collect(),
        }
    }

    /// What the user should know.
    pub(super) fn doubts(&self, targets: &[Target]) -> Vec<String> {
        let ratios = targets.iter().zip(&self.checked).map(|(t, e)| (&t.name, e.ratio()));
        let told = |(name, ratio): (&String, f64)| {
            format!(
                "the surrogate was off by {} times what it stated of `{name}` where that was checked by simulations: what it \
                 stands for is less sure than it says; take it away, or lower surrogate.spread",
                short(ratio)
            )
        };
        ratios.filter(|(_, ratio)| *ratio > UNSOUND).map(told).collect()
    }
}

fn left_out(process: &GaussianProcess) -> Errors {
    let mut errors = Errors::default();
    for point in process.leave_one_out() {
        for (error, std) in point.error.iter().zip(&point.std) {
            errors.add(*error, *std);
        }
    }
    errors
}

/// The share of the weight of a posterior that stands on predictions.
pub(super) fn share_of(posterior: &Posterior, evaluations: &[Evaluation]) -> f64 {
    let last = round(evaluations);
    let its = evaluations.iter().filter(|e| e.cost.is_finite() && e.round == last).zip(&posterior.weights);
    its.filter(|(e, _)| e.predicted.is_some()).map(|(_, weight)| weight).sum()
}

/// The last round that has a cost: a posterior is of that.
fn round(evaluations: &[Evaluation]) -> usize {
    evaluations.iter().filter(|e| e.cost.is_finite()).map(|e| e.round).max().unwrap_or_default()
}

/// What a surrogate did, and how far off it was.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Evaluations that were simulated, those around the best included.
    pub simulated: usize,
    /// Evaluations that it stood for.
    pub predicted: usize,
    /// Their share of all.
    pub saved: f64,
    /// How many that it was sure of were simulated to see how far off it is.
    pub checked: usize,
    /// Of a filter, the share of the posterior's weight that stands on predictions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub posterior: Option<f64>,
    /// Errors by target; none if it was never asked.
    pub targets: Vec<Missed>,
}

/// How far off a surrogate was of a target; root mean squares \[scatters\].
#[derive(Clone, Debug, Serialize)]
pub struct Missed {
    /// The target.
    pub name: String,
    /// Of each evaluation that it learnt from, by the others.
    pub leave_one_out: f64,
    /// The share of these that are not more than two stated standard deviations.
    pub leave_one_out_within: f64,
    /// Of those that were simulated to see it; NaN of none.
    pub held_out: f64,
    /// The share of these that are not more than two stated standard deviations.
    pub held_out_within: f64,
    /// The noise that it takes the target to have.
    pub noise: f64,
    /// Over what share of its range each parameter changes the target, by name.
    pub lengths: BTreeMap<String, f64>,
}

#[cfg(test)]
mod tests {
    use glebe_io::output::summary::Status;
    use glebe_io::study::Quantity;

    use super::*;
    use crate::sample::World;
    use crate::search::{DifferentialEvolution, Evolution, Search};

    const TRUTH: [f64; 2] = [0.55, 0.4];

    /// An impact without gravity: impulse (1 + e) m v, and duration by Hertz, E^(-2/5); e from 0.1 to 0.95, E over a factor of
    /// 50 on a logarithmic scale.
    fn model(u: &[f64]) -> [f64; 2] {
        [1.1 + 0.85 * u[0], libm::exp(-0.4 * u[1] * libm::log(50.0))]
    }

    fn targets() -> Vec<Target> {
        let target = |name: &str, value: f64, scatter: f64| Target {
            name: name.to_owned(),
            experiment: 0,
            quantity: Quantity::Number("peak.q_over_p"),
            values: vec![value],
            scatters: vec![scatter],
            weight: 1.0,
            unit: "",
        };
        let [impulse, duration] = model(&TRUTH);
        vec![target("impulse", impulse, 0.01), target("duration", duration, 0.005)]
    }

    /// Too soft a ball goes through the floor.
    fn fails(point: &[f64]) -> bool {
        point[1] < 0.08
    }

    fn evaluated(candidate: &Candidate, round: usize, targets: &[Target]) -> Evaluation {
        let guess = candidate.guess.as_ref().filter(|_| !candidate.simulated);
        let found: Vec<Vec<f64>> = model(&candidate.point).map(|x| vec![x]).to_vec();
        let simulated = if fails(&candidate.point) { f64::INFINITY } else { cost(targets, &found) };
        Evaluation {
            round,
            point: candidate.point.clone(),
            world: World { values: Vec::new(), sets: Vec::new() },
            found: guess.map_or(found, |g| g.found.clone()),
            cost: guess.map_or(simulated, |g| g.cost),
            predicted: guess.map(|g| g.spread),
            status: Status::Done,
            reason: None,
            state_hashes: Vec::new(),
            doubts: Vec::new(),
        }
    }

    /// Differential evolution until a simulated cost is 0.2.
    fn calibrated(mut surrogate: Option<Surrogate>) -> (Vec<Evaluation>, Option<Surrogate>) {
        let (targets, mut all) = (targets(), Vec::new());
        let settings = Evolution { population: 20, adaptive: true, ..Evolution::default() };
        let mut search = DifferentialEvolution::new(2, settings, 1);
        for round in 0..100 {
            let points = search.ask();
            let candidates: Vec<Candidate> = match &mut surrogate {
                Some(surrogate) => surrogate.candidates(points, &all, &targets, 1),
                None => points.into_iter().map(Candidate::simulated).collect(),
            };
            let now: Vec<Evaluation> = candidates.iter().map(|c| evaluated(c, round, &targets)).collect();
            if let Some(surrogate) = &mut surrogate {
                surrogate.compare(&candidates, &now, &targets);
            }
            search.tell(&now.iter().map(|e| e.cost).collect::<Vec<_>>());
            all.extend(now);
            if all.iter().any(|e| e.predicted.is_none() && e.cost <= 0.2) {
                break;
            }
        }
        (all, surrogate)
    }

    fn new() -> Surrogate {
        Surrogate::new(Settings { after: 20, spread: 0.1 })
    }

    #[test]
    fn it_saves_simulations_and_the_best_is_simulated() {
        let (plain, (all, surrogate)) = (calibrated(None).0, calibrated(Some(new())));
        let simulated = || all.iter().filter(|e| e.predicted.is_none());
        let (with, without) = (simulated().count(), plain.len());
        assert!(2 * with < without, "{with} simulations instead of {without}");
        let best = simulated().min_by(|a, b| a.cost.total_cmp(&b.cost)).unwrap();
        for k in 0..2 {
            let [found, truth] = [model(&best.point)[k], model(&TRUTH)[k]];
            assert!((found / truth - 1.0).abs() < 0.02, "{:?}", best.point);
        }
        // At the time each guess was made it was no candidate for the best.
        for (k, e) in all.iter().enumerate().filter(|(_, e)| e.predicted.is_some()) {
            let before = all[..k].iter().filter(|b| b.round < e.round && b.predicted.is_none());
            let least = before.map(|b| b.cost).fold(f64::INFINITY, f64::min);
            assert!(e.cost > least && e.predicted.unwrap() <= 0.1 * e.cost.max(1.0), "{k}: {e:?}");
        }
        // Every tenth was checked, and errors are what is stated of them.
        let surrogate = surrogate.unwrap();
        let predicted = all.len() - with;
        assert_eq!(surrogate.checks, (predicted + surrogate.checks).div_ceil(CHECKED));
        for (t, errors) in surrogate.checked.iter().enumerate() {
            assert!(errors.ratio() < 1.5, "{t}: {errors:?}");
            assert!(errors.within + 1 >= errors.count * 9 / 10, "{t}: {errors:?}");
        }
        assert!(surrogate.doubts(&targets()).is_empty());
        // And what it really was off is within what was stated, for all that it stood for.
        let predicted = || all.iter().filter(|e| e.predicted.is_some());
        let off = |e: &&Evaluation| {
            let truth: Vec<Vec<f64>> = model(&e.point).map(|x| vec![x]).to_vec();
            (cost(&targets(), &truth) - e.cost).abs() <= 2.0 * e.predicted.unwrap()
        };
        let within = predicted().filter(off).count() as f64 / predicted().count() as f64;
        assert!(within > 0.9, "{within}");
    }

    #[test]
    fn it_decides_alike_again_and_simulates_beside_failures() {
        let ((first, surrogate), (second, _)) = (calibrated(Some(new())), calibrated(Some(new())));
        let bits = |all: &[Evaluation]| {
            all.iter().map(|e| (e.point.clone(), e.cost.to_bits(), e.predicted)).collect::<Vec<_>>()
        };
        assert!(bits(&first) == bits(&second));
        let simulated: Vec<&Evaluation> = first.iter().filter(|e| e.predicted.is_none()).collect();
        let failed = simulated.iter().find(|e| !e.cost.is_finite()).unwrap();
        let candidate = surrogate.unwrap().candidate(failed.point.clone(), &simulated, 0.0, &targets());
        assert!(candidate.guess.is_some() && candidate.simulated && !candidate.checked);
    }

    /// A function that the process cannot know is found out: the spread of what is off grows with it.
    #[test]
    fn errors_beyond_what_is_stated_widen_it_and_are_told() {
        let targets = targets();
        let (all, surrogate) = calibrated(Some(new()));
        let mut surrogate = surrogate.unwrap();
        let point = vec![0.9, 0.9];
        let spread = surrogate.guess(&point, &targets).unwrap().spread;
        let guess = surrogate.guess(&point, &targets);
        let candidate = Candidate { point, guess, simulated: true, checked: true };
        let mut wrong = evaluated(&Candidate::simulated(candidate.point.clone()), 1, &targets);
        wrong.found[0][0] += 5.0;
        surrogate.compare(&[candidate], std::slice::from_ref(&wrong), &targets);
        let told = surrogate.doubts(&targets);
        assert!(told.len() == 1 && told[0].contains("what it stated of `impulse`"), "{told:?}");
        let simulated: Vec<&Evaluation> = all.iter().filter(|e| e.predicted.is_none()).collect();
        surrogate.learn(&simulated, &targets, 1);
        let wider = surrogate.guess(&[0.9, 0.9], &targets).unwrap().spread;
        assert!(wider > 2.0 * spread, "{wider} {spread}");
    }
}
