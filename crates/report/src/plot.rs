//! A plot: series on two axes, with marks, windows and a legend.

use crate::axis::{Axis, Ruler, minus, power_of_ten};
use crate::frame::{Frame, LEFT, PLOT_WIDTH};
use crate::svg::{Anchor, Document, SOFT, width_of};

const WIDTH: f64 = LEFT + PLOT_WIDTH + 24.0;
const HEIGHT: f64 = 370.0;
/// Bounds of the height where it follows from the width.
const EQUAL_HEIGHT: [f64; 2] = [170.0, 640.0];
const BOTTOM: f64 = 60.0;
/// Height of a line of the legend.
const LINE: f64 = 20.0;

/// Colours that stay apart for all common kinds of colour vision, after Okabe and Ito, "Color Universal
/// Design" (2008); the yellow of their set is too light on white.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#24292f"];

/// How a series is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Style {
    /// A line from point to point, interrupted at values that are not finite.
    #[default]
    Line,
    /// The same, dashed.
    Dashed,
    /// A dot at each point.
    Points,
}

/// Values over values.
#[derive(Clone, Debug)]
pub struct Series<'a> {
    /// Name in the legend; not listed if empty.
    pub name: &'a str,
    /// Abscissae.
    pub x: &'a [f64],
    /// Ordinates. If one column is longer, its rest is not shown.
    pub y: &'a [f64],
    /// How it is drawn.
    pub style: Style,
}

/// A shaded band between two curves, in the colour of a series.
#[derive(Clone, Debug)]
pub struct Band<'a> {
    /// Number of the series.
    pub of: usize,
    /// Abscissae.
    pub x: &'a [f64],
    /// Lower ordinates.
    pub low: &'a [f64],
    /// Upper ordinates.
    pub high: &'a [f64],
}

/// A labelled vertical line.
#[derive(Clone, Debug)]
pub struct Mark<'a> {
    /// Where.
    pub x: f64,
    /// What happens there.
    pub label: &'a str,
}

/// A shaded range of x, with the mean and the standard deviation of what was measured in it.
#[derive(Clone, Debug)]
pub struct Window<'a> {
    /// First and last x.
    pub x: [f64; 2],
    /// Name in the legend; not listed if empty.
    pub label: &'a str,
    /// Mean and standard deviation, in the unit of y.
    pub mean_std: Option<[f64; 2]>,
}

/// What is drawn.
#[derive(Clone, Debug, Default)]
pub struct Plot<'a> {
    /// Above the plot; nothing if empty.
    pub title: &'a str,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// The curves.
    pub series: Vec<Series<'a>>,
    /// Bands around them.
    pub bands: Vec<Band<'a>>,
    /// Vertical lines.
    pub marks: Vec<Mark<'a>>,
    /// Shaded ranges.
    pub windows: Vec<Window<'a>>,
    /// Whether a unit is as long on both (linear) axes, for shapes in space; the height follows.
    pub equal_units: bool,
}

impl Plot<'_> {
    /// The plot as the text of an SVG file. Any data give a plot; without a value to show it says so.
    pub fn to_svg(&self) -> String {
        let legend = self.legend();
        let top = 20.0 + if self.title.is_empty() { 0.0 } else { 26.0 } + legend.height;
        let [x, y] = self.rulers();
        let (x, y) = if self.equal_units { x.equalised(y, EQUAL_HEIGHT) } else { (x, y) };
        let frame = Frame { top, bottom: top + y.length(), x, y };

        let heading = if self.title.is_empty() { &self.y.label } else { self.title };
        let mut svg = Document::new(WIDTH, frame.bottom + BOTTOM, heading);
        if !self.title.is_empty() {
            let attributes = " font-size=\"16\" font-weight=\"600\"";
            svg.text(LEFT, 30.0, Anchor::Start, attributes, self.title);
        }
        legend.draw(&mut svg, top - legend.height - 4.0);
        for window in &self.windows {
            frame.draw_window(&mut svg, window);
        }
        frame.draw_axes(&mut svg, self);
        svg.begin_clipped(LEFT, frame.top, PLOT_WIDTH, frame.bottom - frame.top);
        for band in &self.bands {
            frame.draw_band(&mut svg, band, colour(band.of));
        }
        let mut shown = false;
        for (k, series) in self.series.iter().enumerate() {
            shown |= frame.draw_series(&mut svg, series, colour(k));
        }
        for window in &self.windows {
            frame.draw_mean(&mut svg, window);
        }
        frame.draw_marks(&mut svg, &self.marks);
        svg.end_clipped();
        if !shown {
            let (x, y) = (LEFT + 0.5 * PLOT_WIDTH, 0.5 * (frame.top + frame.bottom));
            svg.text(x, y, Anchor::Middle, &format!(" fill=\"{SOFT}\""), "no values to show");
        }
        svg.finish()
    }

    fn rulers(&self) -> [Ruler; 2] {
        let x = self.series.iter().flat_map(|s| s.x.iter().copied());
        let windows = self.windows.iter().flat_map(|w| w.x);
        let y = self.series.iter().flat_map(|s| s.y.iter().copied());
        let bands = self.windows.iter().filter_map(|w| w.mean_std).flat_map(|[m, s]| [m - s, m + s]);
        let around = self.bands.iter().flat_map(|b| b.low.iter().chain(b.high).copied());
        let scattered = self.series.iter().any(|s| s.style == Style::Points);
        [
            Ruler::new(&self.x, x.chain(windows), if scattered { 0.03 } else { 0.0 }, PLOT_WIDTH),
            Ruler::new(&self.y, y.chain(bands).chain(around), 0.06, HEIGHT),
        ]
    }

    fn legend(&self) -> Legend {
        let mut entries = Vec::new();
        // A single curve is named by its axis.
        if self.series.len() > 1 || !self.windows.is_empty() {
            for (k, series) in self.series.iter().enumerate().filter(|(_, s)| !s.name.is_empty()) {
                entries.push((Swatch::Series(series.style, colour(k)), series.name.to_owned()));
            }
        }
        for window in self.windows.iter().filter(|w| !w.label.is_empty()) {
            let text = match window.mean_std {
                Some([mean, std]) => format!("{}: {}", window.label, mean_std(mean, std, &self.y.unit)),
                None => window.label.to_owned(),
            };
            entries.push((Swatch::Window(window.mean_std.is_some()), text));
        }
        Legend::new(entries)
    }
}

/// `309.5 ± 14.5 N`, to the third digit of the deviation.
fn mean_std(mean: f64, std: f64, unit: &str) -> String {
    let decimals = if std > 0.0 { (2 - std.log10().floor() as i32).clamp(0, 9) as usize } else { 3 };
    let number = |v: f64| {
        let plain = v == 0.0 || (1e-4..1e7).contains(&v.abs());
        minus(&if plain { format!("{v:.decimals$}") } else { format!("{v:.3e}") })
    };
    format!("{} ± {} {unit}", number(mean), number(std)).trim_end().to_owned()
}

fn colour(k: usize) -> &'static str {
    COLOURS[k % COLOURS.len()]
}

/// What stands before a name in the legend.
enum Swatch {
    Series(Style, &'static str),
    /// Whether with a mean.
    Window(bool),
}

/// Names, flowing into as many lines as they need.
struct Legend {
    entries: Vec<Entry>,
    height: f64,
}

struct Entry {
    swatch: Swatch,
    text: String,
    x: f64,
    y: f64,
}

impl Legend {
    fn new(entries: Vec<(Swatch, String)>) -> Self {
        let (mut x, mut y) = (0.0, 0.0);
        let entries: Vec<_> = entries
            .into_iter()
            .map(|(swatch, text)| {
                let width = 34.0 + width_of(&text, 13.0) + 20.0;
                if x > 0.0 && x + width > PLOT_WIDTH {
                    (x, y) = (0.0, y + LINE);
                }
                x += width;
                Entry { swatch, text, x: x - width, y }
            })
            .collect();
        let height = if entries.is_empty() { 0.0 } else { y + LINE + 8.0 };
        Self { entries, height }
    }

    fn draw(&self, svg: &mut Document, top: f64) {
        for entry in &self.entries {
            let (x, y) = (LEFT + entry.x, top + entry.y + 0.5 * LINE);
            match entry.swatch {
                Swatch::Series(Style::Points, colour) => svg.dot(x + 13.0, y, colour),
                Swatch::Series(style, colour) => {
                    svg.curve(&format!("M{x:.1} {y:.1}h26"), colour, style == Style::Dashed);
                }
                Swatch::Window(mean) => svg.window(x, y, [26.0, 14.0], mean),
            }
            svg.text(x + 34.0, y + 4.5, Anchor::Start, "", &entry.text);
        }
    }
}

/// `draught force (10³ N)`
pub(crate) fn caption(axis: &Axis, power: i32) -> String {
    match (power, axis.unit.as_str()) {
        (0, "") => axis.label.clone(),
        (0, unit) => format!("{} ({unit})", axis.label),
        (power, "") => format!("{} ({})", axis.label, power_of_ten(power)),
        (power, unit) => format!("{} ({} {unit})", axis.label, power_of_ten(power)),
    }
}
