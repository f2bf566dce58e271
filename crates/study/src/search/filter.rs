//! The iterative Bayesian filter.

use glebe_engine::generate::{Purpose, Rng};
use serde::Serialize;

use super::matrix::{Matrix, dot, mean_and_covariance};
use super::mixture::{Mixture, log_sum};
use super::{Search, reflected};
use crate::sample::{MOST_DIMENSIONS, latin_hypercube, shifted_sobol};

/// Most components of a proposal.
const MOST_COMPONENTS: usize = 5;
/// Share of a proposal that is spread evenly, so that no weight is without bound (Owen and Zhou 2000, "Safe and
/// effective importance sampling").
const EVEN: f64 = 0.1;
/// Draws by which the part of a mixture within the cube is found.
const DRAWS: usize = 4000;
/// The noise scale is looked for from 1 up to this.
const LARGEST_SCALE: f64 = 1e9;

/// Finds the distribution of the point, given what was measured, by rounds of samples (Cheng et al. 2019, "An iterative
/// Bayesian filtering framework for fast and automated calibration of DEM models"). The first round is quasi-random
/// and even over the cube. Each sample is weighted by its likelihood, `exp(-½ χ² / σ²)`, over the density that it was
/// drawn from (sequential Monte Carlo); χ² is the sum of the weights of the targets times the squared cost. The noise
/// scale σ is the least, but not below 1, that leaves the asked-for effective sample size, `1 / Σ w²`. A mixture of
/// normal distributions through the weighted samples proposes those of the next round.
///
/// Once σ is 1, samples are of the posterior for the scatter that the targets state; as long as it is larger, of a
/// wider one.
pub struct Filter {
    dimensions: usize,
    samples: usize,
    effective: f64,
    /// Sum of the targets' weights.
    weight: f64,
    seed: u64,
    rounds: u64,
    proposal: Option<Proposal>,
    points: Vec<Vec<f64>>,
    costs: Vec<f64>,
    posterior: Option<Posterior>,
}

struct Proposal {
    mixture: Mixture,
    /// Logarithm of the part of the mixture within the cube.
    log_inside: f64,
}

/// What is known of the point after a round.
#[derive(Clone, Debug, Serialize)]
pub struct Posterior {
    /// The noise scale, in scatters of the targets.
    pub scale: f64,
    /// How many independent samples the weighted ones are worth.
    pub effective_samples: f64,
    /// Components of the mixture through the samples.
    pub components: usize,
    /// The samples, in the unit cube.
    #[serde(skip)]
    pub points: Vec<Vec<f64>>,
    /// Their weights; the sum is 1.
    #[serde(skip)]
    pub weights: Vec<f64>,
    /// Mean of each coordinate.
    #[serde(skip)]
    pub mean: Vec<f64>,
    /// Their covariance.
    #[serde(skip)]
    pub covariance: Matrix,
}

impl Posterior {
    /// The value of a coordinate that has a share of the weight below it.
    pub fn quantile(&self, coordinate: usize, share: f64) -> f64 {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by(|i, j| self.points[*i][coordinate].total_cmp(&self.points[*j][coordinate]));
        let mut below = 0.0;
        for i in &order {
            below += self.weights[*i];
            if below >= share {
                return self.points[*i][coordinate];
            }
        }
        order.last().map_or(f64::NAN, |i| self.points[*i][coordinate])
    }

    /// So many of the samples, each as often as its weight says, evenly through them (systematic resampling, Kitagawa
    /// 1996).
    pub fn resampled(&self, count: usize) -> Vec<&Vec<f64>> {
        let (mut all, mut sum) = (Vec::with_capacity(count), 0.0);
        for (x, w) in self.points.iter().zip(&self.weights) {
            sum += w;
            while all.len() < count && (all.len() as f64 + 0.5) / count as f64 <= sum {
                all.push(x);
            }
        }
        all
    }
}

impl Filter {
    /// In so many dimensions, with so many samples a round; `effective` is the share of them that the effective sample
    /// size is to be, `weight` the sum of the weights of the targets.
    pub fn new(dimensions: usize, samples: usize, effective: f64, weight: f64, seed: u64) -> Self {
        Self {
            dimensions,
            samples,
            effective,
            weight,
            seed,
            rounds: 0,
            proposal: None,
            points: Vec::new(),
            costs: Vec::new(),
            posterior: None,
        }
    }

    /// Of this round's own, so that a round depends on those before by their results alone.
    fn seed(&self) -> u64 {
        self.seed.wrapping_add(self.rounds.wrapping_mul(0x9e37_79b9))
    }

    fn log_proposed(&self, x: &[f64]) -> f64 {
        // Without a mixture points are even: density 1.
        self.proposal.as_ref().map_or(0.0, |p| {
            let peaked = libm::log(1.0 - EVEN) + p.mixture.log_density(x) - p.log_inside;
            log_sum(&[peaked, libm::log(EVEN)])
        })
    }

    /// Weights at a noise scale, and the effective sample size.
    fn weights(logs: &[(f64, f64)], scale: f64) -> (Vec<f64>, f64) {
        let logs: Vec<f64> =
            logs.iter().map(|(chi2, proposed)| -0.5 * chi2 / (scale * scale) - proposed).collect();
        let sum = log_sum(&logs);
        let weights: Vec<f64> = logs.iter().map(|l| libm::exp(l - sum)).collect();
        let effective = 1.0 / dot(&weights, &weights);
        (weights, effective)
    }

    /// The least noise scale from 1 that leaves an effective sample size; the one that leaves most if none does. The size
    /// falls again where samples were drawn from less than the noise would allow.
    fn scale(logs: &[(f64, f64)], wanted: f64) -> f64 {
        let size = |scale: f64| Self::weights(logs, scale).1;
        let (mut low, mut best) = (1.0, (0.0, 1.0));
        let mut scale = 1.0;
        while scale < LARGEST_SCALE {
            let found = size(scale);
            if found >= wanted {
                let (mut from, mut to) = (libm::log(low), libm::log(scale));
                for _ in 0..30 {
                    let middle = 0.5 * (from + to);
                    if size(libm::exp(middle)) >= wanted {
                        to = middle;
                    } else {
                        from = middle;
                    }
                }
                return libm::exp(to);
            }
            if found > best.0 {
                best = (found, scale);
            }
            (low, scale) = (scale, scale * 1.1);
        }
        best.1
    }
}

fn inside(x: &[f64]) -> bool {
    x.iter().all(|u| (0.0..=1.0).contains(u))
}

impl Search for Filter {
    fn ask(&mut self) -> Vec<Vec<f64>> {
        let (n, d) = (self.samples, self.dimensions);
        self.points = match &self.proposal {
            None if d <= MOST_DIMENSIONS => shifted_sobol(n, d, self.seed()).unwrap_or_default(),
            None => latin_hypercube(n, d, self.seed()),
            Some(proposal) => {
                let mut rng = Rng::new(self.seed(), Purpose::Samples);
                let mut draw = || {
                    if rng.unit() < EVEN {
                        return (0..d).map(|_| rng.unit()).collect();
                    }
                    // Almost all lie inside; one that never does is folded.
                    let mut x = proposal.mixture.draw(&mut rng);
                    for _ in 0..1000 {
                        if inside(&x) {
                            break;
                        }
                        x = proposal.mixture.draw(&mut rng);
                    }
                    x.into_iter().map(reflected).collect()
                };
                (0..n).map(|_| draw()).collect()
            }
        };
        self.points.clone()
    }

    fn costs(&self) -> Vec<f64> {
        self.costs.clone()
    }

    fn tell(&mut self, costs: &[f64]) {
        self.costs = costs.to_vec();
        let told = self.points.iter().zip(costs).filter(|(_, cost)| cost.is_finite());
        let (points, logs): (Vec<Vec<f64>>, Vec<(f64, f64)>) =
            told.map(|(x, cost)| (x.clone(), (self.weight * cost * cost, self.log_proposed(x)))).unzip();
        self.rounds += 1;
        if points.is_empty() {
            return;
        }
        let scale = Self::scale(&logs, self.effective * points.len() as f64);
        let (weights, effective_samples) = Self::weights(&logs, scale);
        let mixture = Mixture::fit(&points, &weights, MOST_COMPONENTS, self.seed());
        let mut rng = Rng::new(self.seed().wrapping_add(1), Purpose::Samples);
        let within = (0..DRAWS).filter(|_| inside(&mixture.draw(&mut rng))).count().max(1);
        let (mean, covariance) = mean_and_covariance(&points, &weights);
        let components = mixture.len();
        self.proposal = Some(Proposal { mixture, log_inside: libm::log(within as f64 / DRAWS as f64) });
        self.posterior =
            Some(Posterior { scale, effective_samples, components, points, weights, mean, covariance });
    }

    fn posterior(&self) -> Option<&Posterior> {
        self.posterior.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two targets with scatter 1 that are linear in the point: `a · (u - u₀)`. The posterior is normal with the mean
    /// u₀ and the covariance (aᵀ a)⁻¹, far within the cube.
    #[test]
    fn the_posterior_of_a_linear_model_with_normal_noise_is_found() {
        let (a, middle) = ([[60.0, 10.0], [-15.0, 40.0]], [0.42, 0.6]);
        let deviations = |u: &[f64]| -> Vec<f64> {
            a.iter().map(|row| row[0] * (u[0] - middle[0]) + row[1] * (u[1] - middle[1])).collect()
        };
        let cost = |u: &[f64]| (deviations(u).iter().map(|d| d * d).sum::<f64>() / 2.0).sqrt();
        let mut filter = Filter::new(2, 800, 0.3, 2.0, 7);
        let mut scales = Vec::new();
        for _ in 0..6 {
            let points = filter.ask();
            filter.tell(&points.iter().map(|u| cost(u)).collect::<Vec<_>>());
            scales.push(filter.posterior().unwrap().scale);
        }
        assert!(scales[0] > 2.0 && scales[5] == 1.0, "{scales:?}");
        let found = filter.posterior().unwrap();
        let (g11, g12, g22) = (
            a[0][0] * a[0][0] + a[1][0] * a[1][0],
            a[0][0] * a[0][1] + a[1][0] * a[1][1],
            a[0][1] * a[0][1] + a[1][1] * a[1][1],
        );
        let det = g11 * g22 - g12 * g12;
        let expected = [[g22 / det, -g12 / det], [-g12 / det, g11 / det]];
        assert!(found.effective_samples > 240.0, "{}", found.effective_samples);
        let error = 1.0 / found.effective_samples.sqrt();
        for k in 0..2 {
            let std = expected[k][k].sqrt();
            assert!((found.mean[k] - middle[k]).abs() < 4.0 * std * error, "{found:?}");
            let ratio = found.covariance[k][k] / expected[k][k];
            assert!((ratio - 1.0).abs() < 4.0 * 1.5 * error, "variance {ratio} of what it should be");
            // The 95 % interval of a normal distribution.
            for (share, sign) in [(0.025, -1.0), (0.975, 1.0)] {
                let quantile = found.quantile(k, share);
                assert!((quantile - middle[k] - sign * 1.96 * std).abs() < 0.25 * std, "{quantile}");
            }
        }
        let correlation = |c: [[f64; 2]; 2]| c[0][1] / (c[0][0] * c[1][1]).sqrt();
        let c = &found.covariance;
        let both = [correlation([[c[0][0], c[0][1]], [c[1][0], c[1][1]]]), correlation(expected)];
        assert!((both[0] - both[1]).abs() < 4.0 * error, "{both:?}");
    }

    /// The density from which points are drawn has the integral 1 over the cube where the mixture reaches out of it.
    #[test]
    fn what_points_are_weighted_by_is_a_density() {
        let mut filter = Filter::new(2, 400, 0.3, 1.0, 1);
        let points = filter.ask();
        filter.tell(&points.iter().map(|u| 4.0 * u[0].hypot(u[1] - 0.9)).collect::<Vec<_>>());
        let n = 200;
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let cells = (0..n).flat_map(|i| (0..n).map(move |j| [at(i), at(j)]));
        let sum: f64 = cells.map(|u| libm::exp(filter.log_proposed(&u))).sum();
        assert!((sum / (n * n) as f64 - 1.0).abs() < 0.03, "{}", sum / (n * n) as f64);
        assert!(filter.ask().iter().all(|x| inside(x)));
    }

    /// One target and two parameters that only act as their sum: the posterior lies along a line.
    #[test]
    fn what_cannot_be_told_apart_stays_apart() {
        let mut filter = Filter::new(2, 400, 0.3, 1.0, 1);
        for _ in 0..4 {
            let points = filter.ask();
            filter.tell(&points.iter().map(|u| 50.0 * (u[0] + u[1] - 1.0).abs()).collect::<Vec<_>>());
        }
        let found = filter.posterior().unwrap();
        let c = &found.covariance;
        // Even along a diagonal of the square: each coordinate is uniform, of variance 1/12.
        assert!((c[0][0] * 12.0 - 1.0).abs() < 0.25, "{c:?}");
        assert!(c[0][1] / (c[0][0] * c[1][1]).sqrt() < -0.98, "{c:?}");
        assert_eq!(found.resampled(100).len(), 100);
    }
}
