//! What targets tell of each parameter.

use serde::Serialize;

use crate::ensemble::short;
use crate::search::matrix::{Eigen, Matrix};

/// A parameter whose range is narrowed less than to this share is not determined.
const LEAST: f64 = 0.5;
/// Parameters whose errors correlate more are told of together.
const TOGETHER: f64 = 0.5;
/// Variance of a parameter of which nothing is known but its range, in squares of that.
pub(super) const EVEN: f64 = 1.0 / 12.0;

/// What is known of a parameter.
#[derive(Clone, Debug, Serialize)]
pub struct Known {
    /// Its standard deviation for the scatters of the targets, over that of an even distribution in its range: 1 if the
    /// targets tell nothing of it.
    pub uncertainty: f64,
    /// Whether the targets determine it.
    pub determined: bool,
    /// Whether they would if the simulations had no noise: differences of these say that they do, but they are not sure.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub lost_in_noise: bool,
    /// Parameters with which it trades off, by name, and the correlation of their errors.
    pub trades_off_with: Vec<(String, f64)>,
}

/// The covariance of parameters in the unit cube if targets with unit scatter depend on them with these slopes (a row for
/// each target, times the root of its weight), and nothing else is known but their ranges.
pub(super) fn covariance(slopes: &[Vec<f64>]) -> Matrix {
    let n = slopes.first().map_or(0, Vec::len);
    let mut information = vec![vec![0.0; n]; n];
    for row in slopes {
        for i in 0..n {
            for j in 0..n {
                information[i][j] += row[i] * row[j];
            }
        }
    }
    for (k, row) in information.iter_mut().enumerate() {
        row[k] += 1.0 / EVEN;
    }
    Eigen::of(&information).map(|x| 1.0 / x)
}

/// How wide a distribution with this covariance in the unit cube is beside an even one: geometric mean over the parameters of
/// the ratio of standard deviations.
pub(super) fn uncertainty(covariance: &Matrix) -> f64 {
    let logs = covariance.iter().enumerate().map(|(k, row)| libm::log((row[k] / EVEN).sqrt()));
    libm::exp(logs.sum::<f64>() / covariance.len() as f64)
}

/// What is known of parameters with this covariance in the unit cube, `plain` being that without a look at the noise.
pub(super) fn known(names: &[&str], covariance: &Matrix, plain: Option<&Matrix>) -> Vec<Known> {
    let uncertainty = |covariance: &Matrix, i: usize| (covariance[i][i] / EVEN).sqrt();
    let correlation = |i: usize, j: usize| covariance[i][j] / (covariance[i][i] * covariance[j][j]).sqrt();
    let one = |i: usize| {
        let (own, plain) = (uncertainty(covariance, i), plain.map(|plain| uncertainty(plain, i)));
        let others = (0..names.len()).filter(|j| *j != i && correlation(i, *j).abs() > TOGETHER);
        Known {
            uncertainty: own,
            determined: own <= LEAST,
            lost_in_noise: own > LEAST && plain.is_some_and(|plain| plain <= LEAST),
            trades_off_with: others.map(|j| (names[j].to_owned(), correlation(i, j))).collect(),
        }
    };
    (0..names.len()).map(one).collect()
}

/// What the user should know of parameters that are not determined.
pub(super) fn doubts(names: &[&str], known: &[Known]) -> Vec<String> {
    let undetermined = names.iter().zip(known).filter(|(_, k)| !k.determined);
    let told = |(name, known): (&&str, &Known)| {
        let others: Vec<String> =
            known.trades_off_with.iter().map(|(other, r)| format!("`{other}` ({r:+.2})")).collect();
        let left = short(100.0 * known.uncertainty);
        if known.lost_in_noise {
            format!(
                "the targets do not determine `{name}` ({left} % of the uncertainty of its range is left): what they change \
                 with it is within the noise of the simulations; take more grains, several seeds as experiments or a wider `probe`"
            )
        } else if others.is_empty() {
            format!(
                "the targets do not determine `{name}`: its uncertainty is {left} % of that of its range; measure \
                 something that depends on it, or take it out"
            )
        } else {
            format!(
                "the targets do not determine `{name}` ({left} % of the uncertainty of its range): they cannot tell it \
                 apart from {} (correlation); measure something that they change differently, or fix one of them",
                others.join(", ")
            )
        }
    };
    undetermined.map(told).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_determines_what_it_depends_on_alone() {
        // The first parameter moves the target by 40 scatters over its range, the second by 0.2.
        let c = covariance(&[vec![40.0, 0.2]]);
        let known = known(&["a", "b"], &c, None);
        // The inverse of [[40² + 12, 8], [8, 0.2² + 12]], as a share of 1/12.
        let exact: f64 = 12.0 * 12.04 / (1612.0 * 12.04 - 64.0);
        assert!((known[0].uncertainty - exact.sqrt()).abs() < 1e-12, "{known:?}");
        assert!(known[0].determined && !known[1].determined && known[1].uncertainty > 0.99);
        let doubts = doubts(&["a", "b"], &known);
        assert!(doubts.len() == 1 && doubts[0].contains("do not determine `b`: its"), "{doubts:?}");
    }

    #[test]
    fn what_only_acts_as_a_sum_is_told_of_together() {
        let names = ["a", "b", "c"];
        let found = known(&names, &covariance(&[vec![30.0, 30.0, 0.0], vec![0.0, 0.0, 30.0]]), None);
        assert!(!found[0].determined && !found[1].determined && found[2].determined);
        assert_eq!(found[0].trades_off_with[0].0, "b");
        assert!(found[0].trades_off_with[0].1 < -0.95 && found[2].trades_off_with.is_empty());
        // One more target that they change differently mends it.
        let third = [vec![30.0, 30.0, 0.0], vec![0.0, 0.0, 30.0], vec![20.0, -20.0, 0.0]];
        assert!(doubts(&names, &known(&names, &covariance(&third), None)).is_empty());
        assert_eq!(doubts(&names, &found).len(), 2);
    }
}
