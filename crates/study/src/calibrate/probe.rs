//! How targets change with each parameter around the best evaluation, and how far noise makes that up.
//!
//! Simulations of many grains are noisy: with next to the same parameters grains come to lie otherwise. A difference of two of
//! them is then no slope. So each parameter is changed in six even steps, and a parabola is fitted to what each target came to;
//! what it leaves over is the noise, pooled over the parameters. That is the estimate of Moré and Wild (2011, "Estimating
//! computational noise", SIAM Journal on Scientific Computing 33, 1292-1314) by differences of third order and above, which a
//! smooth model hardly has over a few steps. What curvature a model does have beyond a parabola counts as noise too, so that no
//! more is told as known than is.

use super::identify::EVEN;

/// Where a parameter is changed to, in the share of its range that `probe` gives.
const OFFSETS: [f64; 3] = [1.0 / 3.0, 2.0 / 3.0, 1.0];
/// Points for each parameter.
pub(super) const POINTS: usize = 2 * OFFSETS.len();
/// Of those, the degrees of freedom that a parabola leaves.
const LEFT: usize = POINTS - 3;
/// The quantile of the normal distribution within which 95 % lie to both sides.
const NORMAL: f64 = 1.959_963_984_540_054;

/// Slopes of targets around a point of the unit cube \[scatters over the range\].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Slopes {
    /// By target, value and parameter.
    pub(super) found: Vec<Vec<Vec<f64>>>,
    /// Noise of each target: standard deviation of a value \[scatters\].
    pub(super) noise: Vec<f64>,
    /// The standard error of each target's slopes.
    error: Vec<f64>,
}

/// The points at which targets are looked at: of each parameter in turn, downwards and upwards. Near a bound the points lie
/// around one that is further inside.
pub(super) fn points(best: &[f64], probe: f64) -> Vec<Vec<f64>> {
    let moved = |k: usize, by: f64| {
        let mut point = best.to_vec();
        point[k] = point[k].clamp(probe, 1.0 - probe) + by * probe;
        point
    };
    let of = |k: usize| OFFSETS.into_iter().flat_map(move |by| [-by, by]).map(move |by| moved(k, by));
    (0..best.len()).flat_map(of).collect()
}

impl Slopes {
    /// From what each target came to at these points, in scatters: `value(t, n, i)` is value n of target t at point i.
    pub(super) fn of(
        parameters: usize,
        probe: f64,
        values: &[usize],
        value: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let squares = 2.0 * OFFSETS.iter().map(|x| x * x).sum::<f64>();
        let fits = |t: usize, n: usize| -> Vec<[f64; 2]> {
            let of = |k: usize| fit(|i| value(t, n, POINTS * k + i));
            (0..parameters).map(of).collect()
        };
        let fits: Vec<Vec<Vec<[f64; 2]>>> =
            values.iter().enumerate().map(|(t, count)| (0..*count).map(|n| fits(t, n)).collect()).collect();
        let noise: Vec<f64> = fits
            .iter()
            .map(|rows| {
                let left: f64 = rows.iter().flatten().map(|[_, left]| left).sum();
                (left / (LEFT * parameters * rows.len()) as f64).sqrt()
            })
            .collect();
        let slope = |row: &Vec<[f64; 2]>| row.iter().map(|[slope, _]| slope / probe).collect();
        Self {
            found: fits.iter().map(|rows| rows.iter().map(slope).collect()).collect(),
            error: noise.iter().map(|noise| noise / (probe * squares.sqrt())).collect(),
            noise,
        }
    }

    pub(super) fn finite(&self) -> bool {
        self.found.iter().flatten().flatten().chain(&self.noise).all(|x| x.is_finite())
    }

    /// What counts of the slopes, a row for each value, over the standard deviation of what a value is known by, times the root of
    /// its weight; `weights` are of the targets, whose values share them.
    ///
    /// A slope counts as far as it is sure: the end towards zero of its interval of 95 % (Student's t for the degrees of freedom
    /// of the noise; points of a curve, which depend on each other, count as one). What is open of the slopes makes a value
    /// uncertain by as much as the parameters move it within their ranges. And a scatter counts as no less than the noise.
    pub(super) fn sure(&self, weights: &[f64]) -> Vec<Vec<f64>> {
        let mut rows = Vec::new();
        for (t, of) in self.found.iter().enumerate() {
            let parameters = of.first().map_or(0, Vec::len);
            let open = student(LEFT * parameters) * self.error[t];
            let variance = (self.noise[t] * self.noise[t]).max(1.0)
                + parameters as f64 * self.error[t] * self.error[t] * EVEN;
            let factor = (weights[t] / of.len() as f64 / variance).sqrt();
            rows.extend(of.iter().map(|row| {
                row.iter().map(|g| factor * g.signum() * (g.abs() - open).max(0.0)).collect::<Vec<f64>>()
            }));
        }
        rows
    }

    /// The slopes as they were found, with the same weights: what would be known were there no noise.
    pub(super) fn plain(&self, weights: &[f64]) -> Vec<Vec<f64>> {
        let mut rows = Vec::new();
        for (of, weight) in self.found.iter().zip(weights) {
            let factor = (weight / of.len() as f64).sqrt();
            rows.extend(of.iter().map(|row| row.iter().map(|g| factor * g).collect::<Vec<f64>>()));
        }
        rows
    }
}

/// The slope of the parabola of least squares through values at the points, over offsets as shares of `probe`, and the sum of
/// the squares that it leaves. Sums of the values to both sides have the even part, differences the odd one.
fn fit(value: impl Fn(usize) -> f64) -> [f64; 2] {
    let odd: [f64; 3] = [0, 1, 2].map(|j| 0.5 * (value(2 * j + 1) - value(2 * j)));
    let even: [f64; 3] = [0, 1, 2].map(|j| 0.5 * (value(2 * j + 1) + value(2 * j)));
    let squares: f64 = OFFSETS.iter().map(|x| x * x).sum();
    let slope = odd.iter().zip(OFFSETS).map(|(y, x)| x * y).sum::<f64>() / squares;
    let [mean, middle] = [even.iter().sum::<f64>() / 3.0, squares / 3.0];
    let bent = OFFSETS.map(|x| x * x - middle);
    let bend = even.iter().zip(bent).map(|(y, b)| b * (y - mean)).sum::<f64>()
        / bent.iter().map(|b| b * b).sum::<f64>();
    let left = |j: usize| {
        let [o, e] = [odd[j] - slope * OFFSETS[j], even[j] - mean - bend * bent[j]];
        2.0 * (o * o + e * e)
    };
    [slope, (0..3).map(left).sum()]
}

/// The quantile of Student's distribution within which 95 % lie to both sides: three terms beyond the normal one, within 1 % from
/// three degrees of freedom (Abramowitz and Stegun 1964, 26.7.5).
fn student(degrees: usize) -> f64 {
    let (z, n) = (NORMAL, degrees as f64);
    let square = z * z;
    let first = z * (square + 1.0) / 4.0;
    let second = z * ((5.0 * square + 16.0) * square + 3.0) / 96.0;
    let third = z * (((3.0 * square + 19.0) * square + 17.0) * square - 15.0) / 384.0;
    z + (first + (second + third / n) / n) / n
}

#[cfg(test)]
mod tests {
    use glebe_engine::generate::{Purpose, Rng};

    use super::super::identify::{covariance, known};
    use super::*;

    /// Slopes of targets of one value each around the middle.
    fn probed(
        parameters: usize,
        probe: f64,
        targets: usize,
        model: impl Fn(usize, usize, &[f64]) -> f64,
    ) -> Slopes {
        let points = points(&vec![0.5; parameters], probe);
        Slopes::of(parameters, probe, &vec![1; targets], |t, _, i| model(t, i, &points[i]))
    }

    fn determined(slopes: &Slopes, weights: &[f64]) -> Vec<bool> {
        let names = ["a", "b", "c"];
        let [sure, plain] = [slopes.sure(weights), slopes.plain(weights)].map(|rows| covariance(&rows));
        let names = &names[..sure.len()];
        known(names, &sure, Some(&plain)).iter().map(|known| known.determined).collect()
    }

    /// Quantiles of tables: 3.182, 2.447, 2.262, 2.101 and 1.960.
    #[test]
    fn quantiles_are_those_of_tables() {
        for (degrees, table) in [(3, 3.182), (6, 2.447), (9, 2.262), (18, 2.101), (1_000_000, 1.960)] {
            assert!((student(degrees) / table - 1.0).abs() < 0.01, "{degrees}: {}", student(degrees));
        }
    }

    #[test]
    fn points_stay_in_the_cube_and_in_even_steps() {
        let points = points(&[0.99, 0.5], 0.06);
        assert_eq!(points.len(), 2 * POINTS);
        let mut first: Vec<f64> = points[..POINTS].iter().map(|p| p[0]).collect();
        first.sort_by(f64::total_cmp);
        for (found, exact) in first.iter().zip([0.88, 0.90, 0.92, 0.96, 0.98, 1.0]) {
            assert!((found - exact).abs() < 1e-12, "{first:?}");
        }
        assert!(points[..POINTS].iter().all(|p| p[1] == 0.5));
        assert!(points[POINTS..].iter().all(|p| p[0] == 0.99));
    }

    /// What is smooth has no noise: a parabola to rounding, an exponential to its third derivative over the steps.
    #[test]
    fn a_deterministic_model_is_known_by_its_slopes() {
        let slopes = probed(3, 0.05, 2, |t, _, x| match t {
            0 => 40.0 * x[0] + 25.0 * x[0] * x[0] + 0.1 * x[1] + 7.0,
            _ => 30.0 * libm::exp(x[2]) + 1000.0,
        });
        let exact = [[65.0, 0.1, 0.0], [0.0, 0.0, 30.0 * libm::exp(0.5)]];
        for (row, exact) in slopes.found.iter().zip(exact) {
            for (found, exact) in row[0].iter().zip(exact) {
                assert!((found - exact).abs() < 1e-3 * exact.abs() + 1e-9, "{slopes:?}");
            }
        }
        assert!(slopes.noise[0] < 1e-11 && slopes.noise[1] < 1e-3, "{slopes:?}");
        assert_eq!(determined(&slopes, &[1.0, 1.0]), [true, false, true]);
        // A value that depends on nothing has no slope at all.
        assert_eq!(probed(2, 0.05, 1, |_, _, _| 0.3).found, [[[0.0, 0.0]]]);
    }

    fn normal(rng: &mut Rng) -> f64 {
        // Twelve even numbers come to a variance of one.
        (0..12).map(|_| rng.unit()).sum::<f64>() - 6.0
    }

    /// Noise of two scatters over steps of a twentieth of the range looks like slopes of tens of scatters: taken for slopes, they
    /// would determine parameters on which nothing depends. In 400 trials of three parameters each the noise is found, and it is
    /// hardly ever taken for something known.
    #[test]
    fn noise_determines_nothing() {
        let mut rng = Rng::new(5, Purpose::Samples);
        let (trials, mut taken, mut plain, mut variance) = (400, 0, 0, 0.0);
        for _ in 0..trials {
            let noise: Vec<f64> = (0..3 * POINTS * 2).map(|_| 2.0 * normal(&mut rng)).collect();
            let slopes = probed(3, 0.05, 2, |t, i, _| noise[3 * POINTS * t + i]);
            taken += determined(&slopes, &[1.0, 1.0]).iter().filter(|known| **known).count();
            let without = covariance(&slopes.plain(&[1.0, 1.0]));
            plain += known(&["a", "b", "c"], &without, None).iter().filter(|k| k.determined).count();
            variance += slopes.noise.iter().map(|s| s * s).sum::<f64>() / (2 * trials) as f64;
        }
        // The variance is a mean of 400 · 2 · 9 squares, with a standard error of 4 √(2/7200) = 0.07.
        assert!((variance - 4.0).abs() < 0.3, "{variance}");
        assert!(plain > trials, "{plain} of {} without a look at the noise", 3 * trials);
        assert!(taken * 100 < 3 * trials, "{taken} of {}", 3 * trials);
    }

    /// What stands out of the noise is known still: 100 scatters over the range with a noise of one scatter, and steps of a fifth.
    #[test]
    fn what_stands_out_of_the_noise_is_determined() {
        let mut rng = Rng::new(6, Purpose::Samples);
        let (trials, mut found) = (200, [0; 3]);
        for _ in 0..trials {
            let noise: Vec<f64> = (0..3 * POINTS * 2).map(|_| normal(&mut rng)).collect();
            let slopes = probed(3, 0.2, 2, |t, i, x| {
                let own = if t == 0 { 100.0 * x[0] } else { 12.0 * (x[1] + x[2]) };
                own + noise[3 * POINTS * t + i]
            });
            for (count, known) in found.iter_mut().zip(determined(&slopes, &[1.0, 1.0])) {
                *count += usize::from(known);
            }
        }
        assert!(found[0] * 100 > 99 * trials && found[1] + found[2] < trials / 20, "{found:?}");
    }

    /// Values of a curve share one weight, and a scatter below the noise counts as the noise.
    #[test]
    fn weights_are_shared_and_scatters_are_no_less_than_the_noise() {
        let slopes = Slopes { found: vec![vec![vec![8.0], vec![-8.0]]], noise: vec![0.0], error: vec![0.0] };
        assert_eq!(slopes.sure(&[8.0]), [[16.0], [-16.0]]);
        assert_eq!(slopes.plain(&[8.0]), slopes.sure(&[8.0]));
        let noisy = Slopes { noise: vec![2.0], ..slopes };
        assert_eq!(noisy.sure(&[8.0]), [[8.0], [-8.0]]);
    }
}
