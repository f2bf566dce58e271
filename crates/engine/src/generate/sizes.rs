//! Particle radii from a distribution.

use serde::{Deserialize, Serialize};

use super::GenerateError;
use super::rng::{Purpose, Rng};

/// Of the truncated distributions, values drawn per particle before the limits are called unreachable:
/// they then hold less than about a thousandth of the untruncated distribution.
const MOST_DRAWS: usize = 20_000;

/// How particle radii are distributed, by number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
}

impl SizeDistribution {
    /// Draws `n` radii \[m\]: the same for the same seed, on every platform.
    ///
    /// # Errors
    /// A parameter outside its range, or limits that the distribution practically never meets.
    pub fn sample(&self, n: usize, seed: u64) -> Result<Vec<f64>, GenerateError> {
        self.check()?;
        let mut rng = Rng::new(seed, Purpose::Sizes);
        (0..n).map(|_| self.draw(&mut rng)).collect()
    }

    fn draw(&self, rng: &mut Rng) -> Result<f64, GenerateError> {
        match *self {
            Self::Constant(radius) => Ok(radius),
            Self::Uniform { min, max } => Ok(rng.between(min, max)),
            Self::Normal { mean, std, min, max } => truncated(min, max, || mean + std * rng.normal()),
            Self::LogNormal { median, sigma, min, max } => {
                truncated(min, max, || median * libm::exp(sigma * rng.normal()))
            }
        }
    }

    fn check(&self) -> Result<(), GenerateError> {
        match *self {
            Self::Constant(radius) => positive("constant radius", radius),
            Self::Uniform { min, max } => limits(min, max),
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
