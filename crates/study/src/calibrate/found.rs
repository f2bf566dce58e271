//! What experiments gave for the targets, and how far that is from what was measured.

use std::collections::BTreeMap;

use glebe_io::output::summary;
use glebe_io::study::{Quantity, Statistic, Target};

use crate::capture::interpolated;
use crate::ensemble::Row;
use crate::rve;

/// What an experiment gave with a set of parameters.
#[derive(Clone, Debug)]
pub(super) struct Given {
    pub(super) status: summary::Status,
    pub(super) reason: Option<String>,
    pub(super) state_hash: String,
    pub(super) doubts: Vec<String>,
    /// Of each target of the experiment by its number: its values, or what is wrong with it.
    pub(super) found: BTreeMap<usize, Result<Vec<f64>, String>>,
}

impl Given {
    /// What a world of a scene gave, `of` being the targets of its experiment.
    pub(super) fn by_world(row: &Row, of: &[(usize, &Target)]) -> Self {
        let value = |target: &Target| match &target.quantity {
            Quantity::Measure { stage, measure, statistic } => {
                let m = row.measured(stage, measure).filter(|m| m.n > 0);
                let m = m.ok_or_else(|| {
                    format!("`{}` was not measured: its window was not reached", target.name)
                })?;
                Ok(vec![if *statistic == Statistic::Std { m.std } else { m.mean }])
            }
            Quantity::Curve { .. } => match row.curves.get(&target.name) {
                Some(Ok(values)) => Ok(values.clone()),
                Some(Err(why)) => Err(format!("`{}`: {why}", target.name)),
                None => Err(format!("`{}`: the world did not come to its stage", target.name)),
            },
            _ => Err(format!("`{}` is a number of periodic samples", target.name)),
        };
        Self {
            status: row.status,
            reason: row.reason.clone(),
            state_hash: row.state_hash.clone().unwrap_or_default(),
            doubts: row.doubts.clone(),
            found: of.iter().map(|(t, target)| (*t, value(target))).collect(),
        }
    }

    /// What periodic samples gave that differ in their seed alone: means.
    pub(super) fn by_samples(samples: &[rve::Outcome], of: &[(usize, &Target)]) -> Self {
        let failed = samples.iter().map(|s| &s.row).find(|row| row.status != summary::Status::Done);
        let one = |sample: &rve::Outcome, target: &Target| match &target.quantity {
            Quantity::Number(name) => {
                let value = sample.number(name).filter(|x| x.is_finite());
                Ok(vec![value.ok_or_else(|| format!("`{}`: the sample has no `{name}`", target.name))?])
            }
            Quantity::Curve { x, y, at, .. } => {
                let column = |name: &str| sample.curve.as_ref().and_then(|curve| curve.column(name));
                let (Some(x), Some(y)) = (column(x), column(y)) else {
                    return Err(format!("`{}`: the sample has no curve", target.name));
                };
                interpolated(&x, &y, at).map_err(|why| format!("`{}`: {why}", target.name))
            }
            _ => Err(format!("`{}` is a measure of a scene", target.name)),
        };
        let mean = |target: &Target| -> Result<Vec<f64>, String> {
            let mut sum = vec![0.0; target.values.len()];
            for sample in samples {
                for (sum, x) in sum.iter_mut().zip(one(sample, target)?) {
                    *sum += x / samples.len() as f64;
                }
            }
            Ok(sum)
        };
        Self {
            status: failed.map_or(summary::Status::Done, |row| row.status),
            reason: failed.and_then(|row| row.reason.clone()),
            state_hash: samples.iter().flat_map(|s| &s.row.state_hash).cloned().collect::<Vec<_>>().join(" "),
            doubts: Vec::new(),
            found: of.iter().map(|(t, target)| (*t, mean(target))).collect(),
        }
    }
}

/// Mean square of the deviations of a target's values from what was measured, in their scatters.
pub(super) fn mean_square(target: &Target, found: &[f64]) -> f64 {
    let wanted = target.values.iter().zip(&target.scatters);
    let square = |(found, (value, scatter)): (&f64, (&f64, &f64))| {
        let away = (found - value) / scatter;
        away * away
    };
    found.iter().zip(wanted).map(square).sum::<f64>() / target.values.len() as f64
}

/// Root of the weighted mean square of the deviations from the targets, in their scatters; the points of a curve share its
/// weight. With one number as target this is the paper's fitness (Nagy et al. 2024, equation 50) over the scatter.
pub(super) fn cost(targets: &[Target], found: &[Vec<f64>]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (target, found) in targets.iter().zip(found) {
        sum += target.weight * mean_square(target, found);
        weights += target.weight;
    }
    (sum / weights).sqrt()
}

/// What tables show of a target: its number; of a curve the root mean square deviation in scatters.
pub(super) fn shown(target: &Target, found: &[f64]) -> f64 {
    match found {
        _ if target.is_curve() => mean_square(target, found).sqrt(),
        [value] => *value,
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(name: &str, values: &[f64], weight: f64) -> Target {
        let at = (0..values.len()).map(|k| k as f64).collect();
        let quantity = match values {
            [_] => Quantity::Number("peak.q_over_p"),
            _ => Quantity::Curve { stage: None, x: "strain".into(), y: "q".into(), at, x_unit: "" },
        };
        let (values, scatters) = (values.to_vec(), vec![2.0; values.len()]);
        Target { name: name.to_owned(), experiment: 0, quantity, values, scatters, weight, unit: "Pa" }
    }

    #[test]
    fn a_curve_counts_as_one_number_does() {
        let (curve, number) = (target("curve", &[1.0, 2.0, 3.0, 4.0], 1.0), target("number", &[10.0], 3.0));
        // Two points 4 off are 2 scatters off each: mean square 2; the number 2 off is one scatter off.
        let found = [vec![1.0, 6.0, -1.0, 4.0], vec![12.0]];
        assert!((mean_square(&curve, &found[0]) - 2.0).abs() < 1e-15);
        assert!((shown(&curve, &found[0]) - 2_f64.sqrt()).abs() < 1e-15 && shown(&number, &found[1]) == 12.0);
        let both = cost(&[curve, number], &found);
        assert!((both - (5.0_f64 / 4.0).sqrt()).abs() < 1e-15, "{both}");
    }
}
