//! Gaussian processes: what a function is likely to come to between the points where it is known.

use rayon::prelude::*;

use super::matrix::{Cholesky, Matrix, dot};
use super::{CmaEs, Search};

/// Length scales and the noise are looked for between these: over the unit cube shorter ones make of every point an island, and
/// longer ones are those of a plane; a little noise keeps matrices from being singular.
const LENGTHS: [f64; 2] = [0.05, 20.0];
const NOISES: [f64; 2] = [1e-8, 1.0];
/// The search for the likeliest ends after so many rounds, or once the costs of a round differ by less than this.
const ROUNDS: usize = 60;
const SAME: f64 = 1e-3;
/// Values that differ by less than this, as a share of their size, are one value.
const CONSTANT: f64 = 1e-12;

/// How what is known at one point tells of another: Matérn's correlation with the smoothness 5/2 (Rasmussen and Williams 2006,
/// "Gaussian processes for machine learning", equation 4.17), of the distance in length scales.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    /// The length scale of each coordinate.
    pub lengths: Vec<f64>,
    /// Variance of noise that differs from point to point, over that of the function.
    pub noise: f64,
}

impl Kernel {
    fn correlation(&self, a: &[f64], b: &[f64]) -> f64 {
        let parts = a.iter().zip(b).zip(&self.lengths).map(|((a, b), l)| (a - b) / l);
        let r = (5.0 * parts.map(|d| d * d).sum::<f64>()).sqrt();
        (1.0 + r + r * r / 3.0) * libm::exp(-r)
    }

    /// From a point of the unit cube: all on logarithmic scales.
    fn at(u: &[f64]) -> Self {
        let value = |[least, most]: [f64; 2], u: f64| least * libm::exp(u * libm::log(most / least));
        let (noise, lengths) = u.split_last().map_or((0.0, &[][..]), |(noise, lengths)| (*noise, lengths));
        Self { lengths: lengths.iter().map(|u| value(LENGTHS, *u)).collect(), noise: value(NOISES, noise) }
    }
}

/// Several functions of the same points with one kernel, each with a mean and a variance of its own. Of the mean nothing is known
/// before, so that its uncertainty is part of every prediction; the variance is the likeliest.
#[derive(Clone, Debug)]
pub struct GaussianProcess {
    points: Vec<Vec<f64>>,
    kernel: Kernel,
    root: Cholesky,
    /// R⁻¹ 1, R being the correlations of the points with the noise, and 1ᵀ R⁻¹ 1.
    ones: Vec<f64>,
    sum: f64,
    functions: Vec<Function>,
}

#[derive(Clone, Debug)]
struct Function {
    mean: f64,
    variance: f64,
    /// R⁻¹ (y - mean).
    weights: Vec<f64>,
}

/// What each of the functions is likely to come to.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Means.
    pub mean: Vec<f64>,
    /// Their standard deviations, without the noise that another look at the functions would have.
    pub std: Vec<f64>,
}

/// How far off what the others say of a point is.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The value of each function less what is predicted of it.
    pub error: Vec<f64>,
    /// The standard deviations that are stated of that, noise included.
    pub std: Vec<f64>,
}

impl GaussianProcess {
    /// With the kernel of the largest marginal likelihood, found by CMA-ES. `values` has a row for each function with its value at
    /// each point. None with fewer than two points, or where values are not finite.
    pub fn fit(points: &[Vec<f64>], values: &[Vec<f64>], seed: u64) -> Option<Self> {
        let mut search = CmaEs::new(points.first()?.len() + 1, None, seed);
        let mut best: Option<(f64, Kernel)> = None;
        for _ in 0..ROUNDS {
            let kernels: Vec<Kernel> = search.ask().iter().map(|u| Kernel::at(u)).collect();
            let cost = |kernel: &Kernel| {
                let process = Self::with(points, values, kernel.clone());
                process.map_or(f64::INFINITY, |p| -p.log_likelihood())
            };
            let costs: Vec<f64> = kernels.par_iter().map(cost).collect();
            search.tell(&costs);
            for (cost, kernel) in costs.iter().zip(kernels) {
                if best.as_ref().is_none_or(|(least, _)| cost < least) {
                    best = Some((*cost, kernel));
                }
            }
            let [least, most] =
                [f64::min, f64::max].map(|pick| costs.iter().copied().reduce(pick).unwrap_or(f64::NAN));
            if most - least < SAME {
                break;
            }
        }
        Self::with(points, values, best?.1)
    }

    /// With a kernel that is known; see [`GaussianProcess::fit`].
    pub fn with(points: &[Vec<f64>], values: &[Vec<f64>], kernel: Kernel) -> Option<Self> {
        let n = points.len();
        if n < 2 || values.iter().any(|of| of.len() != n || !of.iter().all(|y| y.is_finite())) {
            return None;
        }
        let row = |i: usize| {
            let mut row: Vec<f64> = points[..i].iter().map(|x| kernel.correlation(&points[i], x)).collect();
            row.push(1.0 + kernel.noise);
            row
        };
        let correlations: Matrix = (0..n).map(row).collect();
        let root = Cholesky::of(&correlations)?;
        let ones = root.solve(&vec![1.0; n]);
        let sum: f64 = ones.iter().sum();
        let function = |y: &Vec<f64>| {
            let mean = dot(&ones, y) / sum;
            let away: Vec<f64> = y.iter().map(|y| y - mean).collect();
            let size = y.iter().fold(0.0_f64, |size, y| size.max(y.abs()));
            if away.iter().all(|a| a.abs() <= CONSTANT * size) {
                return Function { mean, variance: 0.0, weights: vec![0.0; n] };
            }
            let weights = root.solve(&away);
            Function { mean, variance: dot(&away, &weights) / (n - 1) as f64, weights }
        };
        let functions = values.iter().map(function).collect();
        Some(Self { points: points.to_vec(), kernel, root, ones, sum, functions })
    }

    /// Logarithm of the probability of the values, without its constant: integrated over all means, and the largest over all
    /// variances (Rasmussen and Williams 2006, equation 2.45, with one constant basis function). Functions that are constant have
    /// no part in it.
    pub fn log_likelihood(&self) -> f64 {
        let shared = self.root.log_determinant() + libm::log(self.sum);
        let n = (self.points.len() - 1) as f64;
        let varying = self.functions.iter().filter(|f| f.variance > 0.0);
        varying.map(|f| -0.5 * (n * libm::log(f.variance) + shared)).sum()
    }

    /// The kernel.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// Standard deviation of each function's noise.
    pub fn noise(&self) -> Vec<f64> {
        self.functions.iter().map(|f| (f.variance * self.kernel.noise).sqrt()).collect()
    }

    /// What the functions are likely to come to at a point (Rasmussen and Williams 2006, equations 2.41 and 2.42).
    pub fn predict(&self, x: &[f64]) -> Prediction {
        let r: Vec<f64> = self.points.iter().map(|p| self.kernel.correlation(p, x)).collect();
        let whitened = self.root.forward(&r);
        let unknown = 1.0 - dot(&self.ones, &r);
        let share = 1.0 - dot(&whitened, &whitened) + unknown * unknown / self.sum;
        // Below 0 by rounding alone.
        let share = share.max(0.0);
        Prediction {
            mean: self.functions.iter().map(|f| f.mean + dot(&f.weights, &r)).collect(),
            std: self.functions.iter().map(|f| (f.variance * share).sqrt()).collect(),
        }
    }

    /// What the process would predict of each of its points from all others, with the same kernel and variance and a mean of theirs
    /// (Dubrule 1983, "Cross validation of kriging in a unique neighborhood").
    pub fn leave_one_out(&self) -> Vec<LeftOut> {
        let diagonal = self.root.inverse_diagonal();
        let one = |k: usize| {
            // R⁻¹ without the part along the mean, which is found anew without the point.
            let own = diagonal[k] - self.ones[k] * self.ones[k] / self.sum;
            LeftOut {
                error: self.functions.iter().map(|f| f.weights[k] / own).collect(),
                std: self.functions.iter().map(|f| (f.variance / own).sqrt()).collect(),
            }
        };
        (0..self.points.len()).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::shifted_sobol;

    fn column(points: &[Vec<f64>], f: impl Fn(&[f64]) -> f64) -> Vec<f64> {
        points.iter().map(|x| f(x)).collect()
    }

    fn smooth(x: &[f64]) -> f64 {
        (3.0 * x[0]).sin() + 2.0 * x[1] * x[1] * x[0]
    }

    /// Two points at the distance of a length scale: the correlation is (1 + √5 + 5/3) exp(-√5), the mean that of both, and the
    /// rest follows by hand from the inverse of [[1, c], [c, 1]].
    #[test]
    fn the_posterior_of_two_points_is_that_of_the_closed_form() {
        let kernel = Kernel { lengths: vec![0.4], noise: 0.0 };
        let process = GaussianProcess::with(&[vec![0.2], vec![0.6]], &[vec![3.0, 7.0]], kernel).unwrap();
        let c = (1.0 + 5_f64.sqrt() + 5.0 / 3.0) * (-5_f64.sqrt()).exp();
        let variance = 2.0 * 4.0 / (1.0 - c);
        let correlation = |d: f64| {
            let r = 5_f64.sqrt() * d / 0.4;
            (1.0 + r + r * r / 3.0) * (-r).exp()
        };
        for x in [0.0, 0.3, 0.4, 0.95] {
            let [r1, r2] = [0.2, 0.6].map(|p: f64| correlation((x - p).abs()));
            let found = process.predict(&[x]);
            let mean = 5.0 + (r2 - r1) * 2.0 / (1.0 - c);
            assert!((found.mean[0] - mean).abs() < 1e-12, "{x}: {found:?}, {mean}");
            let explained = (r1 * r1 + r2 * r2 - 2.0 * c * r1 * r2) / (1.0 - c * c);
            let unknown = 1.0 - (r1 + r2) / (1.0 + c);
            let share = 1.0 - explained + unknown * unknown * (1.0 + c) / 2.0;
            assert!((found.std[0] - (variance * share).sqrt()).abs() < 1e-12, "{x}: {found:?}");
        }
        // -½ (ln σ² + ln |R| + ln 1ᵀR⁻¹1), with |R| = 1 - c² and 1ᵀR⁻¹1 = 2 / (1 + c).
        let expected = -0.5 * (variance.ln() + (1.0 - c * c).ln() + (2.0 / (1.0 + c)).ln());
        assert!((process.log_likelihood() - expected).abs() < 1e-12);
    }

    #[test]
    fn without_noise_it_goes_through_what_is_known() {
        let points = shifted_sobol(25, 2, 3).unwrap();
        let values = [column(&points, smooth), vec![2.5; 25]];
        let kernel = Kernel { lengths: vec![0.6, 0.9], noise: 0.0 };
        let process = GaussianProcess::with(&points, &values, kernel).unwrap();
        for (k, x) in points.iter().enumerate() {
            let found = process.predict(x);
            assert!((found.mean[0] - values[0][k]).abs() < 1e-9 && found.std[0] < 1e-6, "{found:?}");
            // One that never changes is known everywhere.
            assert!((found.mean[1] - 2.5).abs() < 1e-12 && found.std[1] == 0.0, "{found:?}");
        }
        let none = GaussianProcess::with(&points[..1], &[vec![1.0]], process.kernel().clone());
        assert!(none.is_none(), "one point has no variance");
        let nan = GaussianProcess::fit(&points, &[vec![f64::NAN; 25]], 1);
        assert!(nan.is_none());
    }

    /// In place of what the formula says each point is really left out, mean included; the variance stays.
    #[test]
    fn points_left_out_are_predicted_as_if_they_were() {
        let points = shifted_sobol(12, 2, 4).unwrap();
        let values = column(&points, |x| smooth(x) + 0.1 * (40.0 * x[1]).sin());
        let kernel = Kernel { lengths: vec![0.5, 0.8], noise: 0.01 };
        let process = GaussianProcess::with(&points, std::slice::from_ref(&values), kernel.clone()).unwrap();
        let variance = process.functions[0].variance;
        for (k, told) in process.leave_one_out().iter().enumerate() {
            let others = |from: &[Vec<f64>]| [&from[..k], &from[k + 1..]].concat();
            let left: Vec<f64> = [&values[..k], &values[k + 1..]].concat();
            let without = GaussianProcess::with(&others(&points), &[left], kernel.clone()).unwrap();
            let found = without.predict(&points[k]);
            let std = (found.std[0].powi(2) / without.functions[0].variance + kernel.noise).sqrt()
                * variance.sqrt();
            assert!((told.error[0] - (values[k] - found.mean[0])).abs() < 1e-10, "{k}: {told:?} {found:?}");
            assert!((told.std[0] - std).abs() < 1e-10, "{k}: {told:?} {std}");
        }
    }

    /// What is stated of the error holds at points that were not seen: about 95 % within two standard deviations, for a smooth
    /// function without noise, and for one with noise, whose size is found.
    #[test]
    fn stated_errors_are_those_at_points_that_were_not_seen() {
        let mut rng = glebe_engine::generate::Rng::new(9, glebe_engine::generate::Purpose::Samples);
        for noise in [0.0, 0.1] {
            let mut noisy = |x: &[f64]| smooth(x) + noise * rng.normal();
            let (points, others) = (shifted_sobol(60, 2, 1).unwrap(), shifted_sobol(400, 2, 2).unwrap());
            let values: Vec<f64> = points.iter().map(|x| noisy(x)).collect();
            let process = GaussianProcess::fit(&points, &[values], 1).unwrap();
            let (mut within, mut squares, mut stated) = (0, 0.0, 0.0);
            for x in &others {
                let found = process.predict(x);
                let error = found.mean[0] - noisy(x);
                let std = found.std[0].hypot(process.noise()[0]);
                within += usize::from(error.abs() <= 2.0 * std);
                squares += error * error / 400.0;
                stated += std * std / 400.0;
            }
            assert!((0.90..=1.0).contains(&(within as f64 / 400.0)), "{noise}: {within} of 400");
            let ratio = (squares / stated).sqrt();
            assert!((0.4..1.4).contains(&ratio), "{noise}: errors are {ratio} of what is stated");
            if noise > 0.0 {
                assert!((process.noise()[0] / noise - 1.0).abs() < 0.3, "{:?}", process.noise());
                assert!((0.92..0.99).contains(&(within as f64 / 400.0)), "{within} of 400");
            } else {
                assert!(squares.sqrt() < 0.02, "{}", squares.sqrt());
            }
            let [along, across] = [process.kernel().lengths[0], process.kernel().lengths[1]];
            assert!(along > 0.2 && across > 0.2, "{along} {across}");
        }
    }

    #[test]
    fn a_coordinate_that_does_nothing_has_the_longest_scale() {
        let points = shifted_sobol(40, 3, 5).unwrap();
        let process = GaussianProcess::fit(&points, &[column(&points, smooth)], 2).unwrap();
        let lengths = &process.kernel().lengths;
        assert!(lengths[2] > 5.0 * lengths[0].max(lengths[1]), "{lengths:?}");
        let again = GaussianProcess::fit(&points, &[column(&points, smooth)], 2).unwrap();
        assert_eq!(again.predict(&[0.3, 0.4, 0.5]), process.predict(&[0.3, 0.4, 0.5]));
    }
}
