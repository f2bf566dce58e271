//! What a calibration answers: the best agents, clusters of good ones, intervals. Agents are those that were simulated.

use std::collections::BTreeMap;

use serde::Serialize;

use super::found::shown;
use super::surrogate::share_of;
use super::{Calibrator, Evaluation};
use crate::search::{Posterior, clusters};

/// Agents that the summary lists.
const BEST: usize = 10;
/// Clusters are looked for among the best agents, at most so many.
const MOST: usize = 400;
/// With fewer good agents than this, the best tenth takes their place.
const FEW: usize = 10;

/// A set of parameters with what it gave.
#[derive(Clone, Debug, Serialize)]
pub struct Agent {
    /// Its number, a row of `evaluations.csv`.
    pub evaluation: usize,
    /// Root mean square of the deviations from the targets \[scatters\].
    pub cost: f64,
    /// Parameters and what follows them, by name, in SI units.
    pub parameters: BTreeMap<String, f64>,
    /// What the targets came to, by name, in SI units; of curves the root mean square deviation \[scatters\].
    pub targets: BTreeMap<String, f64>,
    /// The arguments of `--set` by which `glebe run` of each experiment's scene gives the same.
    pub set: BTreeMap<String, Vec<String>>,
}

/// Agents that lie together.
#[derive(Clone, Debug, Serialize)]
pub struct Cluster {
    /// How many.
    pub agents: usize,
    /// Their best.
    pub best: usize,
    /// Means of the parameters, by name, in SI units; geometric ones where the scale is logarithmic.
    pub parameters: BTreeMap<String, f64>,
    /// Means of what the targets' measures came to.
    pub targets: BTreeMap<String, f64>,
    /// The arguments of `--set` by which each experiment's scene gives the best of them.
    pub set: BTreeMap<String, Vec<String>>,
}

/// What is known of a parameter after a filter, in SI units.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Interval {
    /// Mean of the posterior; the geometric one where the scale is logarithmic.
    pub mean: f64,
    /// Its median.
    pub median: f64,
    /// The interval with 95 % of it.
    pub credible_95: [f64; 2],
    /// The share of the posterior's weight that stands on predictions of the surrogate.
    #[serde(skip_serializing_if = "none")]
    pub predicted: f64,
}

/// Whether no part of a number is predicted.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn none(share: &f64) -> bool {
    *share == 0.0
}

/// Clusters of the good agents.
pub(super) struct Found {
    pub(super) clusters: Vec<Cluster>,
    pub(super) silhouette: f64,
    /// How many agents are good.
    pub(super) good: usize,
    /// The cost up to which agents were taken.
    pub(super) up_to: f64,
}

impl Calibrator<'_> {
    /// Evaluations that were simulated and have a cost, the best first.
    fn ranked(&self) -> Vec<usize> {
        let told =
            |k: &usize| self.evaluations[*k].predicted.is_none() && self.evaluations[*k].cost.is_finite();
        let mut order: Vec<usize> = (0..self.evaluations.len()).filter(told).collect();
        order.sort_by(|a, b| self.evaluations[*a].cost.total_cmp(&self.evaluations[*b].cost));
        order
    }

    pub(super) fn best_agents(&self) -> Vec<Agent> {
        let mut all: Vec<Agent> = Vec::new();
        for k in self.ranked() {
            let agent = self.agent(k);
            // An agent may be found again.
            if all.iter().all(|a| a.parameters != agent.parameters) {
                all.push(agent);
            }
            if all.len() == BEST {
                break;
            }
        }
        all
    }

    fn agent(&self, k: usize) -> Agent {
        let (c, e) = (&self.plan.calibration, &self.evaluations[k]);
        let names = c.free.iter().map(|f| &f.name).chain(c.followers.iter().map(|f| &f.name));
        let values = e.world.values.iter().map(|v| v.number().unwrap_or(f64::NAN));
        Agent {
            evaluation: k,
            cost: e.cost,
            parameters: names.cloned().zip(values).collect(),
            targets: self.by_target(|t| self.shown(e, t)),
            set: self.sets(e),
        }
    }

    /// The arguments of `--set` by which each experiment's scene gives an evaluation.
    fn sets(&self, e: &Evaluation) -> BTreeMap<String, Vec<String>> {
        let all = self.plan.calibration.experiments.iter();
        all.map(|x| (x.name.clone(), [x.sets.as_slice(), &e.world.sets].concat())).collect()
    }

    /// What tables show of a target.
    pub(super) fn shown(&self, e: &Evaluation, t: usize) -> f64 {
        shown(&self.plan.calibration.targets[t], &e.found[t])
    }

    fn by_target(&self, value: impl Fn(usize) -> f64) -> BTreeMap<String, f64> {
        let targets = self.plan.calibration.targets.iter().enumerate();
        targets.map(|(k, t)| (t.name.clone(), value(k))).collect()
    }

    /// Clusters of the good agents in the unit cube; of the best tenth where few are good.
    pub(super) fn clusters(&self) -> Found {
        let c = &self.plan.calibration;
        let mut ranked = self.ranked();
        let mut seen: Vec<&[f64]> = Vec::new();
        ranked.retain(|k| {
            let point = self.evaluations[*k].point.as_slice();
            let new = !seen.contains(&point);
            if new {
                seen.push(point);
            }
            new
        });
        let good = ranked.iter().filter(|k| self.evaluations[**k].cost <= c.good).count();
        let taken = if good >= FEW { good.min(MOST) } else { (ranked.len() / 10).max(FEW) };
        ranked.truncate(taken);
        let points: Vec<Vec<f64>> = ranked.iter().map(|k| self.evaluations[*k].point.clone()).collect();
        let found = clusters(&points, c.seed);
        let up_to = ranked.last().map_or(f64::NAN, |k| self.evaluations[*k].cost);
        let cluster = |number: usize| {
            let its: Vec<usize> =
                ranked.iter().zip(&found.of).filter(|(_, of)| **of == number).map(|(k, _)| *k).collect();
            let mean = |value: &dyn Fn(&Evaluation) -> f64| {
                its.iter().map(|k| value(&self.evaluations[*k])).sum::<f64>() / its.len() as f64
            };
            let middle: Vec<f64> = (0..c.free.len()).map(|k| mean(&|e| e.point[k])).collect();
            let values = self.plan.world(&middle).values;
            let values = values.iter().map(|v| v.number().unwrap_or(f64::NAN));
            Cluster {
                agents: its.len(),
                best: its.first().copied().unwrap_or_default(),
                parameters: c.free.iter().map(|f| f.name.clone()).zip(values).collect(),
                targets: self.by_target(|t| mean(&|e| self.shown(e, t))),
                set: its.first().map_or_else(BTreeMap::new, |k| self.sets(&self.evaluations[*k])),
            }
        };
        let clusters = (0..found.count).map(cluster).collect();
        Found { clusters, silhouette: found.silhouette, good, up_to }
    }

    /// What a posterior says of a parameter.
    pub(super) fn interval(&self, posterior: &Posterior, k: usize) -> Interval {
        let value = |u: f64| {
            let free = &self.plan.calibration.free[k];
            let value = crate::sample::within(free.bounds, free.logarithmic, free.whole, u);
            value.number().unwrap_or(f64::NAN)
        };
        let quantile = |share| value(posterior.quantile(k, share));
        Interval {
            mean: value(posterior.mean[k]),
            median: quantile(0.5),
            credible_95: [quantile(0.025), quantile(0.975)],
            predicted: share_of(posterior, &self.evaluations),
        }
    }
}
