//! Curves that worlds are to give: columns of their series, kept while they run, at abscissae that were measured.

use std::path::Path;

use glebe_engine::Constants;
use glebe_engine::batch::Sample;
use glebe_io::output::series::Series;
use glebe_io::output::{Cell, OutputError, summary, write_table};

use crate::ensemble::short;
use crate::series::{names, row};

/// What a simulated curve may lack of the measured range at its ends, as a share of its own: stages end with a whole step.
const SLACK: f64 = 1e-3;

/// A curve that a world is to give.
#[derive(Clone, Debug)]
pub(crate) struct Wanted {
    pub(crate) name: String,
    stage: usize,
    /// Whether the series tells of bonds.
    bonds: bool,
    x: usize,
    y: usize,
    /// Whether the abscissa is the time, which counts from the beginning of the stage.
    timed: bool,
    at: Vec<f64>,
}

impl Wanted {
    /// Of columns of the series of a world, at abscissae; or what the world lacks.
    pub(crate) fn of(
        c: &Constants,
        name: &str,
        stage: &str,
        [x, y]: [&str; 2],
        at: &[f64],
    ) -> Result<Self, String> {
        let bonds = c.bonds();
        let names = names(c);
        let column = |wanted: &str| {
            names.iter().position(|n| n == wanted).ok_or_else(|| {
                let surfaces: Vec<String> = c.spec.surfaces.iter().map(|s| format!("`{}`", s.name)).collect();
                format!(
                    "the target `{name}` wants the column `{wanted}`, which the series of its scene does not have; its \
                     surfaces are {}",
                    surfaces.join(", ")
                )
            })
        };
        let (x, y) = (column(x)?, column(y)?);
        let at_stage = c.spec.stages.iter().position(|s| s.name == stage);
        let stage = at_stage.ok_or_else(|| format!("the target `{name}` wants the stage `{stage}`"))?;
        Ok(Self { name: name.to_owned(), stage, bonds, x, y, timed: x == 0, at: at.to_vec() })
    }
}

/// What is kept of a world for its curves.
#[derive(Clone, Debug, Default)]
pub(crate) struct Capture {
    wanted: Vec<Wanted>,
    /// Step, stage, then the columns of each curve.
    rows: Vec<Vec<f64>>,
}

impl Capture {
    pub(crate) fn new(wanted: Vec<Wanted>) -> Self {
        Self { wanted, rows: Vec::new() }
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.wanted.is_empty()
    }

    /// The first stage whose samples are needed.
    pub(crate) fn first_stage(&self) -> usize {
        self.wanted.iter().map(|w| w.stage).min().unwrap_or(usize::MAX)
    }

    pub(crate) fn sample(&mut self, sample: &Sample) {
        if self.wanted.iter().any(|w| w.stage == sample.stage) {
            let all = row(sample, self.wanted.iter().any(|w| w.bonds));
            let own = self.wanted.iter().flat_map(|w| [all[w.x], all[w.y]]);
            self.rows.push([sample.step as f64, sample.stage as f64].into_iter().chain(own).collect());
        }
    }

    fn header(&self) -> Vec<String> {
        let own = (0..self.wanted.len()).flat_map(|k| [format!("x{k}"), format!("y{k}")]);
        ["step".to_owned(), "stage".to_owned()].into_iter().chain(own).collect()
    }

    /// Keeps the rows of a world that is under way.
    pub(crate) fn keep(&self, path: &Path) -> Result<(), OutputError> {
        let cells: Vec<Vec<Cell>> =
            self.rows.iter().map(|row| row.iter().map(|x| Cell::Number(*x)).collect()).collect();
        write_table(path, &self.header(), &cells)
    }

    /// Takes up the rows up to a step that were kept, if they were.
    pub(crate) fn resume(&mut self, path: &Path, step: u64) -> bool {
        let Some(series) = Series::read(path).ok().filter(|series| series.names == self.header()) else {
            return false;
        };
        let row = |k: usize| series.columns.iter().map(|column| column[k]).collect::<Vec<f64>>();
        self.rows = (0..series.rows()).map(row).filter(|row| row[0] <= step as f64).collect();
        true
    }

    /// The curves of a world whose stages ended, each at its abscissae, or why it has none.
    pub(crate) fn curves(&self, stages: &[summary::Stage]) -> Vec<(String, Result<Vec<f64>, String>)> {
        let curve = |(k, wanted): (usize, &Wanted)| {
            let of_stage = || self.rows.iter().filter(|row| row[1] == wanted.stage as f64);
            let start = stages.get(wanted.stage).filter(|_| wanted.timed).map_or(0.0, |stage| stage.start);
            let x: Vec<f64> = of_stage().map(|row| row[2 + 2 * k] - start).collect();
            let y: Vec<f64> = of_stage().map(|row| row[3 + 2 * k]).collect();
            (wanted.name.clone(), interpolated(&x, &y, &wanted.at))
        };
        self.wanted.iter().enumerate().map(curve).collect()
    }
}

/// A curve at ascending abscissae, straight between its points. Points that do not go on in x are passed over. The first
/// point holds for as long before it as the second comes after it: forces are means since the row before.
pub(crate) fn interpolated(x: &[f64], y: &[f64], at: &[f64]) -> Result<Vec<f64>, String> {
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(x.len());
    for (x, y) in x.iter().zip(y) {
        if x.is_finite() && y.is_finite() && points.last().is_none_or(|last| *x > last[0]) {
            points.push([*x, *y]);
        }
    }
    let [first, second, ..] = points[..] else {
        return Err("the simulated curve has no two points: its abscissa does not go on".to_owned());
    };
    let last = points[points.len() - 1];
    let slack = SLACK * (last[0] - first[0]);
    let covered = [2.0 * first[0] - second[0] - slack, last[0] + slack];
    if let Some(beyond) = at.iter().find(|x| !(covered[0]..=covered[1]).contains(*x)) {
        return Err(format!(
            "the simulated curve goes from {} to {}, and was measured at {}: lengthen the stage or the loading, or take \
             these lines out of the file",
            short(first[0]),
            short(last[0]),
            short(*beyond)
        ));
    }
    let value = |&x: &f64| {
        let next = points.partition_point(|p| p[0] < x);
        match (next.checked_sub(1).and_then(|k| points.get(k)), points.get(next)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0]),
            (None, _) => first[1],
            (_, None) => last[1],
        }
    };
    Ok(at.iter().map(value).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_is_straight_between_its_points_and_ends_where_it_ends() {
        let (x, y) = ([0.1, 0.2, 0.15, 0.4], [1.0, 2.0, 50.0, 4.0]);
        let found = interpolated(&x, &y, &[0.0, 0.1, 0.15, 0.2, 0.3, 0.4]).unwrap();
        let expected = [1.0, 1.0, 1.5, 2.0, 3.0, 4.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let beyond = interpolated(&x, &y, &[0.1, 0.5]).unwrap_err();
        assert!(
            beyond.contains("from 0.1000 to 0.4000") && beyond.contains("measured at 0.5000"),
            "{beyond}"
        );
        assert!(interpolated(&x, &y, &[-0.05, 0.3]).is_err(), "the first point holds for one row only");
        assert!(interpolated(&[0.0; 3], &[1.0; 3], &[0.0]).unwrap_err().contains("no two points"));
    }
}
