//! Curves that were measured beside those of the best evaluation.

use glebe_io::output::{Cell, OutputDir, file_word, write_table};
use glebe_io::study::Quantity;
use glebe_report::{Axis, Band, Plot, Series, Style};

use super::Calibrator;
use crate::ensemble::StudyError;

impl Calibrator<'_> {
    /// `curves.csv` and a plot of each curve; nothing if no target is a curve.
    pub(super) fn curves(&self, dir: &OutputDir) -> Result<(), StudyError> {
        let best = self.best();
        let mut rows = Vec::new();
        for (t, target) in self.plan.calibration.targets.iter().enumerate() {
            let Quantity::Curve { x, y, at, x_unit, .. } = &target.quantity else { continue };
            let nothing = vec![f64::NAN; at.len()];
            let found = best.map_or(&nothing, |e| &e.found[t]);
            for (k, x) in at.iter().enumerate() {
                let numbers = [*x, target.values[k], target.scatters[k], found[k]].map(Cell::Number);
                rows.push([vec![Cell::Text(target.name.clone())], numbers.to_vec()].concat());
            }
            let off = |sign: f64| -> Vec<f64> {
                target.values.iter().zip(&target.scatters).map(|(y, s)| y + sign * s).collect()
            };
            let (low, high) = (off(-1.0), off(1.0));
            let svg = Plot {
                title: &target.name,
                x: Axis::new(x, x_unit),
                y: Axis::new(y, target.unit),
                series: vec![
                    Series { name: "measured", x: at, y: &target.values, style: Style::Points },
                    Series { name: "best", x: at, y: found, style: Style::Line },
                ],
                bands: vec![Band { of: 0, x: at, low: &low, high: &high }],
                ..Plot::default()
            }
            .to_svg();
            dir.write_plot(&format!("curve_{}", file_word(&target.name)), &svg)?;
        }
        if rows.is_empty() {
            return Ok(());
        }
        let header = ["target", "x", "measured", "scatter", "best"].map(str::to_owned);
        Ok(write_table(&dir.table("curves"), &header, &rows)?)
    }
}
