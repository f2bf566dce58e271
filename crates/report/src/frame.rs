//! The rectangle that curves are drawn in.

use std::fmt::Write as _;

use crate::axis::Ruler;
use crate::plot::{Band, Mark, Plot, Series, Style, Window, caption};
use crate::svg::{Anchor, Document, SOFT, width_of};

/// Where the rectangle begins, and how wide it is \[pixels\].
pub(crate) const LEFT: f64 = 84.0;
pub(crate) const PLOT_WIDTH: f64 = 752.0;

const GRID: &str = "#e6e9ed";
const ZERO: &str = "#afb8c1";
const TICK_TEXT: &str = " font-size=\"12\" fill=\"#57606a\"";
/// With a halo, as it stands among curves.
const MARK_TEXT: &str = " font-size=\"12\" fill=\"#57606a\" stroke=\"#ffffff\" stroke-width=\"3\" \
     stroke-linejoin=\"round\" paint-order=\"stroke\"";

/// The rectangle, in which x runs to the right and y upwards.
pub(crate) struct Frame {
    pub(crate) top: f64,
    pub(crate) bottom: f64,
    pub(crate) x: Ruler,
    pub(crate) y: Ruler,
}

/// Where a value is; None if it cannot be shown.
type Point = Option<(f64, f64)>;

impl Frame {
    fn x_at(&self, value: f64) -> Option<f64> {
        self.x.at(value).map(|at| LEFT + at)
    }

    fn y_at(&self, value: f64) -> Option<f64> {
        self.y.at(value).map(|at| self.bottom - at)
    }

    pub(crate) fn draw_axes(&self, svg: &mut Document, plot: &Plot) {
        let (right, top, bottom) = (LEFT + PLOT_WIDTH, self.top, self.bottom);
        let (ticks, power) = self.x.ticks((PLOT_WIDTH / 90.0) as usize);
        for tick in ticks {
            let x = LEFT + tick.at;
            if let Some(label) = tick.label {
                svg.line(format_args!("M{x:.1} {top}V{bottom}"), GRID);
                svg.line(format_args!("M{x:.1} {bottom}v5"), SOFT);
                svg.text(x, bottom + 20.0, Anchor::Middle, TICK_TEXT, &label);
            } else {
                svg.line(format_args!("M{x:.1} {bottom}v3"), SOFT);
            }
        }
        svg.text(LEFT + 0.5 * PLOT_WIDTH, bottom + 44.0, Anchor::Middle, "", &caption(&plot.x, power));

        let (ticks, power) = self.y.ticks((self.y.length() / 50.0).max(3.0) as usize);
        for tick in ticks {
            let y = bottom - tick.at;
            if let Some(label) = tick.label {
                svg.line(format_args!("M{LEFT} {y:.1}H{right}"), GRID);
                svg.line(format_args!("M{LEFT} {y:.1}h-5"), SOFT);
                svg.text(LEFT - 9.0, y + 4.5, Anchor::End, TICK_TEXT, &label);
            } else {
                svg.line(format_args!("M{LEFT} {y:.1}h-3"), SOFT);
            }
        }
        let middle = 0.5 * (top + bottom);
        let turned = format!(" transform=\"rotate(-90 20 {middle:.1})\"");
        svg.text(20.0, middle, Anchor::Middle, &turned, &caption(&plot.y, power));

        if let Some(zero) = self.y_at(0.0).filter(|zero| (top..bottom).contains(zero)) {
            svg.line(format_args!("M{LEFT} {zero:.1}H{right}"), ZERO);
        }
        svg.line(format_args!("M{LEFT} {top}V{bottom}H{right}"), SOFT);
    }

    /// The part of a window that is inside, as its ends.
    fn ends(&self, window: &Window) -> Option<[f64; 2]> {
        let ends = [self.x_at(window.x[0])?, self.x_at(window.x[1])?];
        let inside = ends.map(|x| x.clamp(LEFT, LEFT + PLOT_WIDTH));
        Some([inside[0].min(inside[1]), inside[0].max(inside[1])])
    }

    pub(crate) fn draw_window(&self, svg: &mut Document, window: &Window) {
        if let Some([a, b]) = self.ends(window) {
            svg.window(a, 0.5 * (self.top + self.bottom), [b - a, self.bottom - self.top], false);
        }
    }

    /// Over the curves, so that it can be seen among noise.
    pub(crate) fn draw_mean(&self, svg: &mut Document, window: &Window) {
        let band = window.mean_std.and_then(|[mean, std]| {
            Some((self.ends(window)?, [mean - std, mean, mean + std].map(|v| self.y_at(v))))
        });
        if let Some(([a, b], [Some(low), Some(mean), Some(high)])) = band {
            svg.mean([a, b], mean, low - high);
        }
    }

    pub(crate) fn draw_marks(&self, svg: &mut Document, marks: &[Mark]) {
        let mut at: Vec<_> = marks.iter().filter_map(|m| Some((self.x_at(m.x)?, m.label))).collect();
        at.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (k, &(x, label)) in at.iter().enumerate() {
            let top = self.top;
            svg.dashed_line(format_args!("M{x:.1} {top}V{}", self.bottom), SOFT);
            let room = at.get(k + 1).map_or(LEFT + PLOT_WIDTH, |next| next.0) - x;
            if width_of(label, 12.0) + 10.0 < room {
                svg.text(x + 5.0, top + 14.0, Anchor::Start, MARK_TEXT, label);
            } else {
                // After its line where there is room, before it otherwise.
                let x = if room > 18.0 { x + 13.0 } else { x - 5.0 };
                let turned = format!("{MARK_TEXT} transform=\"rotate(-90 {x:.1} {:.1})\"", top + 6.0);
                svg.text(x, top + 6.0, Anchor::End, &turned, label);
            }
        }
    }

    pub(crate) fn draw_band(&self, svg: &mut Document, band: &Band, colour: &str) {
        let points = |y: &[f64]| -> Vec<(f64, f64)> {
            band.x.iter().zip(y).filter_map(|(&x, &y)| self.x_at(x).zip(self.y_at(y))).collect()
        };
        let around = points(band.low).into_iter().chain(points(band.high).into_iter().rev());
        svg.area(&path(&around.map(Some).collect::<Vec<_>>()), colour);
    }

    /// Draws the points that can be shown; whether there was one.
    pub(crate) fn draw_series(&self, svg: &mut Document, series: &Series, colour: &str) -> bool {
        let points: Vec<Point> =
            series.x.iter().zip(series.y).map(|(&x, &y)| self.x_at(x).zip(self.y_at(y))).collect();
        match series.style {
            Style::Points => points.iter().flatten().for_each(|&(x, y)| svg.dot(x, y, colour)),
            style => svg.curve(&path(&thinned(&points)), colour, style == Style::Dashed),
        }
        points.iter().any(Option::is_some)
    }
}

fn path(points: &[Point]) -> String {
    let mut text = String::new();
    let mut command = 'M';
    for (k, point) in points.iter().enumerate() {
        let Some((x, y)) = point else {
            command = 'M';
            continue;
        };
        // Writing to a string cannot fail.
        let _ = write!(text, "{command}{x:.1} {y:.1}");
        if command == 'M' && points.get(k + 1).is_none_or(Option::is_none) {
            // A point between two gaps would not be seen.
            text.push_str("h0.5");
        }
        command = 'L';
    }
    text
}

/// A long line with the same picture: of all points that share half a pixel of x, the first, the lowest,
/// the highest and the last.
fn thinned(points: &[Point]) -> Vec<Point> {
    if points.len() < 8 * PLOT_WIDTH as usize {
        return points.to_vec();
    }
    let column = |p: &Point| p.map(|(x, _)| (2.0 * x).floor());
    let mut kept = Vec::new();
    for group in points.chunk_by(|a, b| column(a) == column(b)) {
        let height = |k: &usize| group[*k].map_or(0.0, |(_, y)| y);
        let order = |a: &usize, b: &usize| height(a).total_cmp(&height(b));
        let mut ends = vec![0, group.len() - 1];
        ends.extend((0..group.len()).min_by(order));
        ends.extend((0..group.len()).max_by(order));
        ends.sort_unstable();
        ends.dedup();
        kept.extend(ends.into_iter().map(|k| group[k]));
    }
    kept
}
