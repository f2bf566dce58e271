//! CMA-ES.

use glebe_engine::generate::{Purpose, Rng};

use super::matrix::{Eigen, Matrix, dot, identity, times};
use super::{Search, reflected};

/// First step size, as a share of the width of the cube.
const FIRST_STEP: f64 = 0.3;

/// The evolution strategy with covariance matrix adaptation (Hansen 2016, "The CMA evolution strategy: a tutorial",
/// arXiv 1604.00772, with its default constants and positive weights), from the middle of the cube. It searches the
/// whole space, which is folded into the cube by reflection at its sides.
pub struct CmaEs {
    rng: Rng,
    /// Weights of the better half, from the best.
    weights: Vec<f64>,
    population: usize,
    mu_eff: f64,
    mean: Vec<f64>,
    step: f64,
    covariance: Matrix,
    eigen: Eigen,
    path_c: Vec<f64>,
    path_s: Vec<f64>,
    rounds: i32,
    /// Of the points asked for: (point - mean) / step.
    moves: Vec<Vec<f64>>,
    costs: Vec<f64>,
}

impl CmaEs {
    /// In so many dimensions, with so many points a round, or as many as usual: 4 + 3 ln n.
    pub fn new(dimensions: usize, population: Option<usize>, seed: u64) -> Self {
        let usual = 4 + (3.0 * libm::log(dimensions as f64)) as usize;
        let population = population.unwrap_or(usual).max(4);
        let half = population / 2;
        let log = |x: f64| libm::log(x);
        let raw: Vec<f64> =
            (0..half).map(|i| log(0.5 * (population as f64 + 1.0)) - log(i as f64 + 1.0)).collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
        let covariance = identity(dimensions);
        Self {
            rng: Rng::new(seed, Purpose::Samples),
            mu_eff: 1.0 / dot(&weights, &weights),
            weights,
            population,
            mean: vec![0.5; dimensions],
            step: FIRST_STEP,
            eigen: Eigen::of(&covariance),
            covariance,
            path_c: vec![0.0; dimensions],
            path_s: vec![0.0; dimensions],
            rounds: 0,
            moves: Vec::new(),
            costs: Vec::new(),
        }
    }
}

impl Search for CmaEs {
    fn ask(&mut self) -> Vec<Vec<f64>> {
        self.eigen = Eigen::of(&self.covariance);
        let root = self.eigen.map(|x| x.max(0.0).sqrt());
        self.moves = (0..self.population)
            .map(|_| {
                let z: Vec<f64> = self.mean.iter().map(|_| self.rng.normal()).collect();
                times(&root, &z)
            })
            .collect();
        let point =
            |y: &Vec<f64>| self.mean.iter().zip(y).map(|(m, y)| reflected(m + self.step * y)).collect();
        self.moves.iter().map(point).collect()
    }

    fn costs(&self) -> Vec<f64> {
        self.costs.clone()
    }

    fn tell(&mut self, costs: &[f64]) {
        self.costs = costs.to_vec();
        if costs.iter().all(|cost| cost.is_infinite()) {
            return;
        }
        let n = self.mean.len() as f64;
        let mu_eff = self.mu_eff;
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let damping = 1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let c_c = (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n);
        let c_1 = 2.0 / ((n + 1.3) * (n + 1.3) + mu_eff);
        let c_mu = (2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((n + 2.0) * (n + 2.0) + mu_eff)).min(1.0 - c_1);
        // Length of a standard normal vector, on average.
        let chi = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));

        let mut order: Vec<usize> = (0..costs.len()).collect();
        order.sort_by(|i, j| costs[*i].total_cmp(&costs[*j]));
        let best: Vec<&Vec<f64>> = order.iter().take(self.weights.len()).map(|i| &self.moves[*i]).collect();
        let size = self.mean.len();
        let way: Vec<f64> =
            (0..size).map(|k| self.weights.iter().zip(&best).map(|(w, y)| w * y[k]).sum()).collect();
        for k in 0..size {
            self.mean[k] += self.step * way[k];
        }
        let whitening = self.eigen.map(|x| if x > 0.0 { 1.0 / x.sqrt() } else { 0.0 });
        let white = times(&whitening, &way);
        let keep = (c_sigma * (2.0 - c_sigma) * mu_eff).sqrt();
        for k in 0..size {
            self.path_s[k] = (1.0 - c_sigma) * self.path_s[k] + keep * white[k];
        }
        self.rounds += 1;
        let length = dot(&self.path_s, &self.path_s).sqrt();
        let settled = (1.0 - libm::pow(1.0 - c_sigma, 2.0 * f64::from(self.rounds))).sqrt();
        let slow = length / settled < (1.4 + 2.0 / (n + 1.0)) * chi;
        let keep = if slow { (c_c * (2.0 - c_c) * mu_eff).sqrt() } else { 0.0 };
        for k in 0..size {
            self.path_c[k] = (1.0 - c_c) * self.path_c[k] + keep * way[k];
        }
        let lost = if slow { 0.0 } else { c_1 * c_c * (2.0 - c_c) };
        for i in 0..size {
            for j in 0..size {
                let spread: f64 = self.weights.iter().zip(&best).map(|(w, y)| w * y[i] * y[j]).sum();
                self.covariance[i][j] = (1.0 - c_1 - c_mu + lost) * self.covariance[i][j]
                    + c_1 * self.path_c[i] * self.path_c[j]
                    + c_mu * spread;
            }
        }
        // No wider than the cube: beyond, reflection makes of any step a random one.
        let factor = libm::exp(c_sigma / damping * (length / chi - 1.0));
        self.step = (self.step * factor).min(1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{least, rastrigin, rosenbrock, sphere};
    use super::*;

    #[test]
    fn it_finds_the_minima_of_test_functions() {
        let found = |population, rounds, cost: fn(&[f64]) -> f64| {
            least(&mut CmaEs::new(6, population, 1), rounds, cost).0
        };
        let (round, valley) = (found(None, 150, sphere), found(None, 500, rosenbrock));
        // Many local minima need a large population (Hansen and Kern 2004).
        let many = found(Some(200), 200, rastrigin);
        assert!(round < 1e-10 && valley < 1e-8 && many < 1e-6, "{round} {valley} {many}");
    }

    /// The covariance becomes the inverse of a quadratic's curvature, up to a factor.
    #[test]
    fn it_learns_the_shape_of_a_valley() {
        let mut search = CmaEs::new(2, Some(20), 2);
        let cost = |u: &[f64]| (u[0] - 0.4).powi(2) + 1e4 * (u[1] - 0.6).powi(2);
        least(&mut search, 60, cost);
        let c = &search.covariance;
        let ratio = c[0][0] / c[1][1];
        assert!((2e3..5e4).contains(&ratio), "{ratio} instead of 1e4");
    }
}
