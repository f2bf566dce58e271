//! The plots of a run, from the columns of its series.

use crate::axis::Axis;
use crate::plot::{Mark, Plot, Series, Style, Window};

/// What the plot of a tool's draught force shows.
#[derive(Clone, Debug)]
pub struct Draught<'a> {
    /// Path of the tool \[m\].
    pub displacement: &'a [f64],
    /// Force against its motion \[N\].
    pub force: &'a [f64],
    /// The range of displacement that the measure covers \[m\].
    pub window: Option<[f64; 2]>,
    /// Mean and standard deviation of the force in it \[N\].
    pub mean_std: Option<[f64; 2]>,
}

/// Draught force against displacement, with the averaging window, mean and standard deviation.
pub fn draught_force(data: &Draught) -> String {
    let window = |x| Window { x, label: "mean in the window", mean_std: data.mean_std };
    Plot {
        title: "Draught force",
        x: Axis::new("displacement of the tool", "m"),
        y: Axis::new("draught force", "N").from_zero(),
        series: vec![Series {
            name: "draught force",
            x: data.displacement,
            y: data.force,
            style: Style::Line,
        }],
        windows: data.window.map(window).into_iter().collect(),
        ..Plot::default()
    }
    .to_svg()
}

/// Energies \[J\] over time \[s\], by name, with the beginnings of the stages. On a logarithmic axis only
/// positive values are seen.
pub fn energies(time: &[f64], energies: &[(&str, &[f64])], stages: &[(f64, &str)], log: bool) -> String {
    let y = Axis::new("energy", "J");
    Plot {
        title: "Energies",
        x: Axis::new("time", "s"),
        y: if log { y.log() } else { y.from_zero() },
        series: energies.iter().map(|&(name, y)| Series { name, x: time, y, style: Style::Line }).collect(),
        marks: stages.iter().map(|&(x, label)| Mark { x, label }).collect(),
        ..Plot::default()
    }
    .to_svg()
}
