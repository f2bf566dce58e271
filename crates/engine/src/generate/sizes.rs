//! Particle radii from a distribution.

use serde::{Deserialize, Serialize};

use super::GenerateError;
use super::rng::{Purpose, Rng};

/// Of the truncated distributions, values drawn per particle before the limits are called unreachable:
/// they then hold less than about a thousandth of the untruncated distribution.
const MOST_DRAWS: usize = 20_000;

/// How particle radii are distributed: by number, but for sieve curves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum SizeDistribution {
    /// All the same \[m\], > 0.
    Constant(f64),
    /// Every radius between the limits is equally likely.
    Uniform {
        /// Smallest radius \[m\], > 0.
        min: f64,
        /// Largest radius \[m\], >= min.
        max: f64,
    },
    /// Normal; what falls outside the limits is drawn again, so that `mean` and `std` describe the
    /// distribution before truncation.
    Normal {
        /// Mean \[m\], > 0.
        mean: f64,
        /// Standard deviation \[m\], >= 0.
        std: f64,
        /// Smallest radius \[m\], > 0.
        min: f64,
        /// Largest radius \[m\], >= min.
        max: f64,
    },
    /// Log-normal: the logarithm of the radius is normal; truncated like `Normal`.
    LogNormal {
        /// Median \[m\], > 0.
        median: f64,
        /// Standard deviation of the natural logarithm \[-\], >= 0.
        sigma: f64,
        /// Smallest radius \[m\], > 0.
        min: f64,
        /// Largest radius \[m\], >= min.
        max: f64,
    },
    /// A sieve curve, by mass: radii \[m\] > 0, ascending, each with the share of the mass that is finer \[-\], from 0
    /// to 1. Between two radii the mass is spread evenly over the logarithm of the radius, as the straight line
    /// of a grading diagram says. Numbers follow the curve as closely as whole particles can.
    Sieve(Vec<(f64, f64)>),
}

impl SizeDistribution {
    /// Draws `n` radii \[m\]: the same for the same seed, on every platform.
    ///
    /// # Errors
    /// A parameter outside its range, or limits that the distribution practically never meets.
    pub fn sample(&self, n: usize, seed: u64) -> Result<Vec<f64>, GenerateError> {
        self.check()?;
        let mut rng = Rng::new(seed, Purpose::Sizes);
        if let Self::Sieve(curve) = self {
            return Ok(sieved(curve, n, &mut rng));
        }
        (0..n).map(|_| self.draw(&mut rng)).collect()
    }

    /// Least and largest radius \[m\].
    pub fn limits(&self) -> (f64, f64) {
        match self {
            Self::Constant(radius) => (*radius, *radius),
            Self::Uniform { min, max } | Self::Normal { min, max, .. } | Self::LogNormal { min, max, .. } => {
                (*min, *max)
            }
            Self::Sieve(curve) => {
                let radius = |point: Option<&(f64, f64)>| point.map_or(f64::NAN, |(radius, _)| *radius);
                (radius(curve.first()), radius(curve.last()))
            }
        }
    }

    /// Draws one radius \[m\].
    pub(crate) fn draw(&self, rng: &mut Rng) -> Result<f64, GenerateError> {
        match *self {
            Self::Constant(radius) => Ok(radius),
            Self::Uniform { min, max } => Ok(rng.between(min, max)),
            Self::Normal { mean, std, min, max } => truncated(min, max, || mean + std * rng.normal()),
            Self::LogNormal { median, sigma, min, max } => {
                truncated(min, max, || median * libm::exp(sigma * rng.normal()))
            }
            Self::Sieve(ref curve) => Ok(sieved(curve, 1, rng)[0]),
        }
    }

    fn check(&self) -> Result<(), GenerateError> {
        match *self {
            Self::Constant(radius) => positive("constant radius", radius),
            Self::Uniform { min, max } => limits(min, max),
            Self::Sieve(ref curve) => check_curve(curve),
            Self::Normal { mean, std, min, max } => {
                limits(min, max)?;
                positive("normal.mean", mean)?;
                not_negative("normal.std", std, "m")
            }
            Self::LogNormal { median, sigma, min, max } => {
                limits(min, max)?;
                positive("log_normal.median", median)?;
                not_negative("log_normal.sigma", sigma, "-")
            }
        }
    }
}

/// `n` radii of a checked sieve curve, in random order.
///
/// The density of the number is that of the mass over r³, so that with the mass even over ln r it goes with r⁻⁴,
/// and r⁻³ is even. Particles take the n quantiles of the number, each somewhere within its own: the coarse end,
/// where a particle is a large share of the mass, is then not left to chance.
fn sieved(curve: &[(f64, f64)], n: usize, rng: &mut Rng) -> Vec<f64> {
    // In units of the largest radius, whose cube may be too small for a number.
    let unit = curve.last().map_or(1.0, |(radius, _)| *radius);
    let inverse_cube = |radius: f64| {
        let r = unit / radius;
        r * r * r
    };
    let classes = || curve.windows(2).map(|pair| (inverse_cube(pair[0].0), inverse_cube(pair[1].0), pair));
    let mut sum = 0.0;
    let upto: Vec<f64> = classes()
        .map(|(fine, coarse, pair)| {
            sum += (pair[1].1 - pair[0].1) / libm::log(pair[1].0 / pair[0].0) * (fine - coarse);
            sum
        })
        .collect();
    let edges: Vec<(f64, f64)> = classes().map(|(fine, coarse, _)| (fine, coarse)).collect();
    let mut quantile = |k: usize| {
        // Below the sum whatever rounding does, so that a class that has mass is found.
        let wanted = ((k as f64 + rng.unit()) / n as f64 * sum).min(sum.next_down());
        let class = upto.partition_point(|reached| *reached <= wanted);
        let before = if class == 0 { 0.0 } else { upto[class - 1] };
        let share = (wanted - before) / (upto[class] - before);
        let (fine, coarse) = edges[class];
        unit / libm::cbrt(fine - share.clamp(0.0, 1.0) * (fine - coarse))
    };
    let ordered: Vec<f64> = (0..n).map(&mut quantile).collect();
    rng.permutation(n).into_iter().map(|k| ordered[k]).collect()
}

fn check_curve(curve: &[(f64, f64)]) -> Result<(), GenerateError> {
    for (radius, _) in curve {
        positive("sieve radius", *radius)?;
    }
    for pair in curve.windows(2) {
        if pair[1].0 <= pair[0].0 {
            return Err(GenerateError::invalid(
                "sieve radius",
                pair[1].0,
                "larger than the one before it".to_owned(),
            ));
        }
        if pair[1].1.is_nan() || pair[1].1 < pair[0].1 {
            let allowed = "finite and not below the one before it [-]".to_owned();
            return Err(GenerateError::invalid("sieve share", pair[1].1, allowed));
        }
    }
    match curve {
        [(_, first), .., (_, last)] if *first == 0.0 && *last == 1.0 => Ok(()),
        [_, _, ..] => {
            let wrong = if curve[0].1 == 0.0 { curve[curve.len() - 1].1 } else { curve[0].1 };
            Err(GenerateError::invalid(
                "sieve share",
                wrong,
                "0 at the finest radius and 1 at the coarsest".to_owned(),
            ))
        }
        _ => Err(GenerateError::invalid("sieve points", curve.len() as f64, "two or more".to_owned())),
    }
}

fn truncated(min: f64, max: f64, mut draw: impl FnMut() -> f64) -> Result<f64, GenerateError> {
    (0..MOST_DRAWS)
        .map(|_| draw())
        .find(|radius| (min..=max).contains(radius))
        .ok_or(GenerateError::LimitsNeverMet { min, max, draws: MOST_DRAWS })
}

fn limits(min: f64, max: f64) -> Result<(), GenerateError> {
    positive("min", min)?;
    if max.is_finite() && max >= min {
        return Ok(());
    }
    Err(GenerateError::invalid("max", max, format!("finite and at least min = {min} [m]")))
}

fn positive(what: &str, value: f64) -> Result<(), GenerateError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(GenerateError::invalid(what, value, "finite and above 0 [m]"))
}

fn not_negative(what: &str, value: f64, unit: &str) -> Result<(), GenerateError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(GenerateError::invalid(what, value, format!("finite and at least 0 [{unit}]")))
}
