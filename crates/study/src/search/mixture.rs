//! Mixtures of normal distributions.

use glebe_engine::generate::{Purpose, Rng};

use super::kmeans::seeds;
use super::matrix::{Eigen, Matrix, dot, mean_and_covariance};

/// A variance below which a component may not fall, in squares of the width of the cube: a component on one point
/// would have any likelihood.
const LEAST_VARIANCE: f64 = 1e-8;
const ROUNDS: usize = 200;

/// A mixture of normal distributions.
#[derive(Clone, Debug)]
pub struct Mixture {
    components: Vec<Component>,
}

#[derive(Clone, Debug)]
struct Component {
    share: f64,
    mean: Vec<f64>,
    eigen: Eigen,
    /// Square root of the covariance.
    root: Matrix,
    log_norm: f64,
}

impl Component {
    fn new(share: f64, mean: Vec<f64>, covariance: &Matrix) -> Self {
        let mut eigen = Eigen::of(covariance);
        for value in &mut eigen.values {
            *value = value.max(LEAST_VARIANCE);
        }
        let log_det: f64 = eigen.values.iter().map(|x| libm::log(*x)).sum();
        let log_norm = -0.5 * (log_det + mean.len() as f64 * libm::log(std::f64::consts::TAU));
        Self { share, root: eigen.map(f64::sqrt), mean, eigen, log_norm }
    }

    fn log_density(&self, x: &[f64]) -> f64 {
        let away: Vec<f64> = x.iter().zip(&self.mean).map(|(x, m)| x - m).collect();
        let along = self.eigen.vectors.iter().map(|v| dot(v, &away));
        let square: f64 = self.eigen.values.iter().zip(along).map(|(value, y)| y * y / value).sum();
        self.log_norm - 0.5 * square
    }
}

impl Mixture {
    /// The mixture of up to `most` components that describes points with weights (sum 1) best: by expectation and
    /// maximisation (Dempster, Laird and Rubin 1977), their number by the Bayesian information criterion (Schwarz 1978)
    /// with the effective number of points.
    pub fn fit(points: &[Vec<f64>], weights: &[f64], most: usize, seed: u64) -> Self {
        let effective = 1.0 / dot(weights, weights);
        let d = points.first().map_or(0, Vec::len) as f64;
        let of = |k: usize| {
            let (mixture, log_likelihood) = Self::of_size(points, weights, k, seed);
            let numbers = k as f64 * (1.0 + d + 0.5 * d * (d + 1.0)) - 1.0;
            (numbers * libm::log(effective) - 2.0 * effective * log_likelihood, mixture)
        };
        // Each component needs points enough for its covariance.
        let most = most.min((effective / (2.0 * (d + 1.0))) as usize).max(1);
        let mut best = of(1);
        for k in 2..=most {
            let next = of(k);
            if next.0 < best.0 {
                best = next;
            }
        }
        best.1
    }

    /// With so many components; also the mean logarithm of its density at the points.
    fn of_size(points: &[Vec<f64>], weights: &[f64], k: usize, seed: u64) -> (Self, f64) {
        let (mean, covariance) = mean_and_covariance(points, weights);
        let first = |mean: Vec<f64>| Component::new(1.0 / k as f64, mean, &covariance);
        let mut mixture = Self {
            components: if k == 1 {
                vec![first(mean)]
            } else {
                let mut rng = Rng::new(seed, Purpose::Samples);
                seeds(points, weights, k, &mut rng).into_iter().map(first).collect()
            },
        };
        let mut last = f64::NEG_INFINITY;
        for _ in 0..ROUNDS {
            // Shares of the components in each point.
            let shares: Vec<(Vec<f64>, f64)> = points.iter().map(|x| mixture.shares(x)).collect();
            let likelihood: f64 = shares.iter().zip(weights).map(|((_, log), w)| w * log).sum();
            if k == 1 || likelihood - last < 1e-9 {
                return (mixture, likelihood);
            }
            last = likelihood;
            mixture.components = (0..mixture.components.len())
                .filter_map(|c| {
                    let of_it: Vec<f64> = shares.iter().zip(weights).map(|((s, _), w)| w * s[c]).collect();
                    let share: f64 = of_it.iter().sum();
                    let relative: Vec<f64> = of_it.iter().map(|w| w / share).collect();
                    let (mean, covariance) = mean_and_covariance(points, &relative);
                    (share > 1e-12).then(|| Component::new(share, mean, &covariance))
                })
                .collect();
        }
        (mixture, last)
    }

    /// The components' shares in a point, and the logarithm of the density there.
    fn shares(&self, x: &[f64]) -> (Vec<f64>, f64) {
        let logs: Vec<f64> = self.components.iter().map(|c| libm::log(c.share) + c.log_density(x)).collect();
        let log = log_sum(&logs);
        (logs.iter().map(|l| libm::exp(l - log)).collect(), log)
    }

    /// Logarithm of the density at a point.
    pub fn log_density(&self, x: &[f64]) -> f64 {
        self.shares(x).1
    }

    /// A point of the mixture.
    pub fn draw(&self, rng: &mut Rng) -> Vec<f64> {
        let mut left = rng.unit();
        let found = self.components.iter().find(|c| {
            left -= c.share;
            left < 0.0
        });
        let Some(c) = found.or(self.components.last()) else { return Vec::new() };
        let z: Vec<f64> = c.mean.iter().map(|_| rng.normal()).collect();
        c.mean.iter().zip(&c.root).map(|(m, row)| m + dot(row, &z)).collect()
    }

    /// How many components it has.
    pub fn len(&self) -> usize {
        self.components.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.components.is_empty()
    }
}

/// Logarithm of a sum of exponentials.
pub(super) fn log_sum(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest == f64::NEG_INFINITY {
        return largest;
    }
    largest + libm::log(logs.iter().map(|l| libm::exp(l - largest)).sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(rng: &mut Rng, n: usize, middle: [f64; 2], std: [f64; 2]) -> Vec<Vec<f64>> {
        (0..n).map(|_| (0..2).map(|k| middle[k] + std[k] * rng.normal()).collect()).collect()
    }

    #[test]
    fn it_tells_how_many_clouds_there_are_and_where() {
        let mut rng = Rng::new(4, Purpose::Samples);
        let mut points = cloud(&mut rng, 400, [0.3, 0.3], [0.05, 0.02]);
        let one = Mixture::fit(&points, &vec![1.0 / 400.0; 400], 5, 1);
        assert_eq!(one.len(), 1);
        points.extend(cloud(&mut rng, 200, [0.7, 0.6], [0.03, 0.06]));
        let mut two = Mixture::fit(&points, &vec![1.0 / 600.0; 600], 5, 1);
        assert_eq!(two.len(), 2);
        two.components.sort_by(|a, b| a.mean[0].total_cmp(&b.mean[0]));
        let near = |found: f64, expected: f64, tolerance: f64| {
            assert!((found - expected).abs() < tolerance, "{found} instead of {expected}");
        };
        for (c, (share, mean, std)) in two
            .components
            .iter()
            .zip([(2.0 / 3.0, [0.3, 0.3], [0.05, 0.02]), (1.0 / 3.0, [0.7, 0.6], [0.03, 0.06])])
        {
            near(c.share, share, 0.01);
            let covariance = c.eigen.map(|x| x);
            for k in 0..2 {
                // Four standard errors.
                near(c.mean[k], mean[k], 4.0 * std[k] / 200f64.sqrt());
                near(covariance[k][k].sqrt(), std[k], 4.0 * std[k] / 400f64.sqrt());
            }
        }
    }

    /// Over a grid the density sums to 1, and points that are drawn have the mean.
    #[test]
    fn its_density_is_one_and_its_points_are_of_it() {
        let mut rng = Rng::new(9, Purpose::Samples);
        let points = cloud(&mut rng, 300, [0.5, 0.4], [0.06, 0.09]);
        let mixture = Mixture::fit(&points, &vec![1.0 / 300.0; 300], 1, 1);
        let n = 200;
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let density = |i, j| libm::exp(mixture.log_density(&[at(i), at(j)]));
        let all: f64 = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| density(i, j)).sum();
        assert!((all / (n * n) as f64 - 1.0).abs() < 1e-3, "{}", all / (n * n) as f64);
        let drawn: Vec<Vec<f64>> = (0..4000).map(|_| mixture.draw(&mut rng)).collect();
        let (mean, covariance) = mean_and_covariance(&drawn, &vec![1.0 / 4000.0; 4000]);
        let c = &mixture.components[0];
        for k in 0..2 {
            assert!((mean[k] - c.mean[k]).abs() < 4.0 * 0.09 / 4000f64.sqrt());
            let expected = c.eigen.map(|x| x)[k][k];
            assert!((covariance[k][k] / expected - 1.0).abs() < 0.1);
        }
    }
}
