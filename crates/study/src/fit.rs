//! Curves through results: straight lines and power laws by least squares.

use serde::Serialize;

/// A curve of two coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Value at 0 of a line; factor of a power law.
    pub a: f64,
    /// Slope of a line; exponent of a power law.
    pub b: f64,
    /// Share of the variance of y that the curve explains, of y itself for both kinds, so that they compare.
    pub r2: f64,
}

/// The line `y = a + b x` through points, by least squares. None for fewer than three points, which any line meets, or
/// if x or y does not vary.
pub fn linear(x: &[f64], y: &[f64]) -> Option<Fit> {
    let [a, b] = line(x, y)?;
    explained(x, y, |x| a + b * x).map(|r2| Fit { a, b, r2 })
}

/// The power law `y = a x^b`, by least squares on logarithms. None where [`linear`] gives none or a value is not
/// above 0.
pub fn power(x: &[f64], y: &[f64]) -> Option<Fit> {
    if x.iter().chain(y).any(|v| *v <= 0.0) {
        return None;
    }
    let log = |values: &[f64]| values.iter().map(|v| libm::log(*v)).collect::<Vec<_>>();
    let [log_a, b] = line(&log(x), &log(y))?;
    let a = libm::exp(log_a);
    explained(x, y, |x| a * libm::pow(x, b)).map(|r2| Fit { a, b, r2 })
}

/// Value at 0 and slope of the line through points, by least squares. None if x does not vary.
pub fn line(x: &[f64], y: &[f64]) -> Option<[f64; 2]> {
    let n = x.len().min(y.len());
    let mean = |v: &[f64]| v[..n].iter().sum::<f64>() / n as f64;
    let (mx, my) = (mean(x), mean(y));
    let product = |a: &[f64], ma: f64, b: &[f64], mb: f64| -> f64 {
        a.iter().zip(b).take(n).map(|(a, b)| (a - ma) * (b - mb)).sum()
    };
    let b = product(x, mx, y, my) / product(x, mx, x, mx);
    b.is_finite().then_some([my - b * mx, b])
}

fn explained(x: &[f64], y: &[f64], curve: impl Fn(f64) -> f64) -> Option<f64> {
    let n = x.len().min(y.len());
    if n < 3 {
        return None;
    }
    let mean = y[..n].iter().sum::<f64>() / n as f64;
    let total: f64 = y[..n].iter().map(|y| (y - mean) * (y - mean)).sum();
    let left: f64 = x.iter().zip(y).map(|(x, y)| (y - curve(*x)) * (y - curve(*x))).sum();
    (total > 0.0 && left.is_finite()).then(|| 1.0 - left / total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glebe_engine::generate::{Purpose, Rng};

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
    }

    #[test]
    fn exact_data_give_their_curve_back() {
        let x: Vec<f64> = (1..=20).map(f64::from).collect();
        let lines = linear(&x, &x.iter().map(|x| 3.0 - 0.5 * x).collect::<Vec<_>>()).unwrap();
        near(lines.a, 3.0, 1e-12);
        near(lines.b, -0.5, 1e-13);
        near(lines.r2, 1.0, 1e-12);
        let powers = power(&x, &x.iter().map(|x| 2.5 * x.powf(-1.7)).collect::<Vec<_>>()).unwrap();
        near(powers.a, 2.5, 1e-12);
        near(powers.b, -1.7, 1e-12);
        near(powers.r2, 1.0, 1e-12);
    }

    /// Slope and R² of a line with noise of known size: y = 2 + 3 x + 0.5 (u - 1/2), u uniform. The variance of the
    /// noise is 0.25/12, that of the line 9/12 over x in [0, 1), so that R² is 9 / 9.25.
    #[test]
    fn noise_is_told_from_the_line() {
        let mut rng = Rng::new(11, Purpose::Samples);
        let n = 20_000;
        let x: Vec<f64> = (0..n).map(|k| f64::from(k) / f64::from(n)).collect();
        let y: Vec<f64> = x.iter().map(|x| 2.0 + 3.0 * x + 0.5 * (rng.unit() - 0.5)).collect();
        let fit = linear(&x, &y).unwrap();
        // Four standard errors of the slope, sqrt(noise / (n var x)).
        near(fit.b, 3.0, 4.0 * (0.25 / 12.0 / (f64::from(n) / 12.0)).sqrt());
        near(fit.a, 2.0, 0.01);
        near(fit.r2, 9.0 / 9.25, 2e-3);
    }

    #[test]
    fn what_no_curve_goes_through_gives_none() {
        assert_eq!(linear(&[1.0, 2.0], &[1.0, 2.0]), None);
        assert_eq!(linear(&[1.0; 5], &[1.0, 2.0, 3.0, 4.0, 5.0]), None);
        assert_eq!(linear(&[1.0, 2.0, 3.0], &[4.0; 3]), None);
        assert_eq!(power(&[0.0, 1.0, 2.0], &[1.0, 2.0, 3.0]), None);
        assert_eq!(power(&[1.0, 2.0, 3.0], &[-1.0, -2.0, -3.0]), None);
        assert!(linear(&[-1.0, 0.0, 1.0], &[-2.0, 0.5, 1.0]).is_some());
    }
}
