//! Averages over samples, and how they scatter.

use super::curve::Curve;

/// Mean and sample standard deviation of some numbers.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Sample standard deviation; 0 of one number.
    pub std: f64,
    /// How many.
    pub n: usize,
}

impl Spread {
    /// Of numbers; NaN of none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().collect();
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        let square: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
        let std = if n > 1 { (square / (n - 1) as f64).sqrt() } else { 0.0 * mean };
        Self { mean, std, n }
    }

    /// Standard deviation as a share of the mean.
    pub fn relative(&self) -> f64 {
        self.std / self.mean.abs()
    }
}

/// Quantities that are averaged over the samples of a variant, with how each reads of a curve.
type Read = fn(&Curve) -> &[f64];
pub(super) const AVERAGED: [(&str, Read); 6] = [
    ("strain", |c| &c.strain),
    ("p", |c| &c.p),
    ("q", |c| &c.q),
    ("eps_v", |c| &c.eps_v),
    ("eps_q", |c| &c.eps_q),
    ("void_ratio", |c| &c.void_ratio),
];

/// Curves of samples that went through the same program, averaged at equal shares of the way through it.
#[derive(Clone, Debug, Default)]
pub(super) struct Average {
    /// Mean and deviation of each of [`AVERAGED`] at every share.
    pub(super) columns: [Vec<Spread>; AVERAGED.len()],
}

impl Average {
    /// Of the loading of curves, at so many points as the longest has.
    pub(super) fn of(curves: &[&Curve]) -> Self {
        let points = curves.iter().map(|curve| curve.loading().len()).max().unwrap_or(0);
        let mut columns: [Vec<Spread>; AVERAGED.len()] = Default::default();
        for (column, (_, read)) in columns.iter_mut().zip(AVERAGED) {
            *column = (0..points)
                .map(|k| {
                    let share = k as f64 / (points - 1).max(1) as f64;
                    Spread::of(curves.iter().map(|curve| at(curve, read(curve), share)))
                })
                .collect();
        }
        Self { columns }
    }

    /// Means of one of [`AVERAGED`].
    pub(super) fn means(&self, name: &str) -> Vec<f64> {
        let at = AVERAGED.iter().position(|(n, _)| *n == name).unwrap_or_default();
        self.columns[at].iter().map(|spread| spread.mean).collect()
    }

    /// Mean less and plus a standard deviation.
    pub(super) fn band(&self, name: &str) -> [Vec<f64>; 2] {
        let at = AVERAGED.iter().position(|(n, _)| *n == name).unwrap_or_default();
        [-1.0, 1.0].map(|sign| self.columns[at].iter().map(|s| s.mean + sign * s.std).collect())
    }
}

/// The value of a column at a share of the time that the loading takes; of a compression in steps, whose rows are their
/// ends, at a share of its steps.
fn at(curve: &Curve, column: &[f64], share: f64) -> f64 {
    let range = curve.loading();
    let (first, last) = (range.start, range.end.saturating_sub(1));
    if last <= first {
        return column.get(first).copied().unwrap_or(f64::NAN);
    }
    let stepped = curve.stage[first..].windows(2).all(|pair| pair[0] != pair[1]);
    let clock = |k: usize| if stepped { k as f64 } else { curve.time[k] };
    let wanted = clock(first) + share * (clock(last) - clock(first));
    let after = (first + 1..=last).find(|&k| clock(k) >= wanted).unwrap_or(last);
    let (from, to) = (clock(after - 1), clock(after));
    let along = if to > from { ((wanted - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 };
    column[after - 1] + along * (column[after] - column[after - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_that_of_the_textbook() {
        let spread = Spread::of([2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert_eq!(spread.mean, 5.0);
        assert!((spread.std - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
        assert_eq!(Spread::of([3.0]).std, 0.0);
        assert!(Spread::of([]).mean.is_nan());
    }
}
