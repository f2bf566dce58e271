//! Differential evolution.

use glebe_engine::generate::{Purpose, Rng};

use super::{Search, pick, reflected};

/// How differential evolution goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evolution {
    /// Agents; four or more.
    pub population: usize,
    /// How far agents go along the difference of two others, F.
    pub weight: f64,
    /// Chance of each coordinate to be changed, CR.
    pub crossover: f64,
    /// Whether each agent finds its own F and CR, beginning with those above.
    pub adaptive: bool,
}

impl Default for Evolution {
    /// Nagy et al. 2024 (GPUDEM), section 4.3.1.
    fn default() -> Self {
        Self { population: 60, weight: 0.8, crossover: 0.5, adaptive: false }
    }
}

/// Differential evolution, rand/1/bin (Storn and Price 1997): an agent x meets a + F (b - c), of three others, in some
/// of its coordinates; the better one stays. Coordinates are reflected at the bounds. The first agents are spread at
/// random. The adaptive variant is jDE (Brest et al. 2006, "Self-adapting control parameters in differential
/// evolution").
pub struct DifferentialEvolution {
    settings: Evolution,
    dimensions: usize,
    rng: Rng,
    agents: Vec<Agent>,
    trials: Vec<Agent>,
}

#[derive(Clone)]
struct Agent {
    x: Vec<f64>,
    weight: f64,
    crossover: f64,
    cost: f64,
}

/// jDE: how often F and CR are drawn anew, and the least and the range of F.
const RENEWED: f64 = 0.1;
const WEIGHTS: [f64; 2] = [0.1, 0.9];

impl DifferentialEvolution {
    /// In so many dimensions.
    pub fn new(dimensions: usize, settings: Evolution, seed: u64) -> Self {
        let settings = Evolution { population: settings.population.max(4), ..settings };
        let rng = Rng::new(seed, Purpose::Samples);
        Self { settings, dimensions, rng, agents: Vec::new(), trials: Vec::new() }
    }

    fn first(&mut self) -> Vec<Agent> {
        let Evolution { population, weight, crossover, .. } = self.settings;
        let mut agent = || {
            let x = (0..self.dimensions).map(|_| self.rng.unit()).collect();
            Agent { x, weight, crossover, cost: f64::INFINITY }
        };
        (0..population).map(|_| agent()).collect()
    }

    fn trial(&mut self, i: usize) -> Agent {
        let mut others = [0; 3];
        for k in 0..3 {
            others[k] = loop {
                let other = pick(&mut self.rng, self.agents.len());
                if other != i && !others[..k].contains(&other) {
                    break other;
                }
            };
        }
        let mut trial = self.agents[i].clone();
        if self.settings.adaptive {
            if self.rng.unit() < RENEWED {
                trial.weight = WEIGHTS[0] + WEIGHTS[1] * self.rng.unit();
            }
            if self.rng.unit() < RENEWED {
                trial.crossover = self.rng.unit();
            }
        }
        let [a, b, c] = others.map(|k| &self.agents[k].x);
        let always = pick(&mut self.rng, self.dimensions);
        for k in 0..self.dimensions {
            // Drawn for each, so that a choice does not shift those that follow.
            let crossed = self.rng.unit() < trial.crossover;
            if crossed || k == always {
                trial.x[k] = reflected(a[k] + trial.weight * (b[k] - c[k]));
            }
        }
        trial
    }
}

impl Search for DifferentialEvolution {
    fn ask(&mut self) -> Vec<Vec<f64>> {
        self.trials = if self.agents.is_empty() {
            self.first()
        } else {
            (0..self.agents.len()).map(|i| self.trial(i)).collect()
        };
        self.trials.iter().map(|agent| agent.x.clone()).collect()
    }

    fn tell(&mut self, costs: &[f64]) {
        for (trial, cost) in self.trials.iter_mut().zip(costs) {
            trial.cost = *cost;
        }
        if self.agents.is_empty() {
            self.agents = std::mem::take(&mut self.trials);
            return;
        }
        for (agent, trial) in self.agents.iter_mut().zip(self.trials.drain(..)) {
            if trial.cost <= agent.cost {
                *agent = trial;
            }
        }
    }

    fn costs(&self) -> Vec<f64> {
        self.agents.iter().map(|agent| agent.cost).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{least, rastrigin, rosenbrock, sphere};
    use super::*;

    /// Both variants, in as many dimensions as the paper has parameters.
    #[test]
    fn it_finds_the_minima_of_test_functions() {
        for adaptive in [false, true] {
            let found = |rounds, cost: fn(&[f64]) -> f64| {
                let settings = Evolution { adaptive, ..Evolution::default() };
                least(&mut DifferentialEvolution::new(6, settings, 1), rounds, cost).0
            };
            let (round, valley, many) = (found(300, sphere), found(2500, rosenbrock), found(1500, rastrigin));
            assert!(round < 1e-8 && valley < 1e-4 && many < 1e-4, "{adaptive}: {round} {valley} {many}");
        }
    }

    /// The rule of the paper (equations 51 and 52): an agent differs from the one it may replace in at least one
    /// coordinate, by a + F (b - c) of three others, and no agent ever becomes worse.
    #[test]
    fn agents_change_as_the_rule_says_and_never_for_the_worse() {
        let settings = Evolution { population: 8, crossover: 0.0, ..Evolution::default() };
        let mut search = DifferentialEvolution::new(4, settings, 3);
        let mut agents = search.ask();
        let mut costs: Vec<f64> = agents.iter().map(|x| sphere(x)).collect();
        search.tell(&costs);
        for _ in 0..20 {
            let trials = search.ask();
            for (i, trial) in trials.iter().enumerate() {
                // With a crossover of 0 one coordinate changes, which is drawn.
                let changed: Vec<usize> = (0..4).filter(|k| trial[*k] != agents[i][*k]).collect();
                assert!(changed.len() <= 1, "{changed:?}");
                let Some(&k) = changed.first() else { continue };
                let others = || (0..8).filter(|j| *j != i);
                let value = |a: usize, b: usize, c: usize| agents[a][k] + 0.8 * (agents[b][k] - agents[c][k]);
                let possible = others().any(|a| {
                    others()
                        .any(|b| others().any(|c| reflected(value(a, b, c)) == trial[k] && a != b && b != c))
                });
                assert!(possible, "{} is of no three agents", trial[k]);
            }
            let found: Vec<f64> = trials.iter().map(|x| sphere(x)).collect();
            search.tell(&found);
            for i in 0..8 {
                if found[i] <= costs[i] {
                    (agents[i], costs[i]) = (trials[i].clone(), found[i]);
                }
                assert_eq!(search.agents[i].x, agents[i]);
                assert_eq!(search.agents[i].cost, costs[i]);
            }
        }
    }
}
