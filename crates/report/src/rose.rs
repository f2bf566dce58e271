//! Rose diagrams: how often directions in a plane occur.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use crate::svg::{Anchor, Document, SOFT};

/// Radius of a rose, and room around it.
const RADIUS: f64 = 130.0;
const AROUND: f64 = 34.0;
const TOP: f64 = 50.0;
const COLOUR: &str = "#0072b2";

/// Counts of directions in planes, each by equal bins of a turn from its first axis on, as the text of an SVG file. A
/// circle shows what equal counts would be.
pub fn rose(title: &str, planes: &[(&str, &[f64])]) -> String {
    let side = 2.0 * (RADIUS + AROUND);
    let mut svg = Document::new(side * planes.len().max(1) as f64, TOP + side + 10.0, title);
    svg.text(AROUND, 30.0, Anchor::Start, " font-size=\"16\" font-weight=\"600\"", title);
    for (k, (name, counts)) in planes.iter().enumerate() {
        let centre = [side * (k as f64 + 0.5), TOP + 0.5 * side];
        petals(&mut svg, centre, counts);
        let axes = name.split_once('-').unwrap_or((name, ""));
        svg.text(centre[0] + RADIUS + 8.0, centre[1] + 4.0, Anchor::Start, "", axes.0);
        svg.text(centre[0], centre[1] - RADIUS - 8.0, Anchor::Middle, "", axes.1);
    }
    svg.finish()
}

fn petals(svg: &mut Document, [x, y]: [f64; 2], counts: &[f64]) {
    let most = counts.iter().copied().fold(0.0, f64::max);
    let mean = counts.iter().sum::<f64>() / counts.len().max(1) as f64;
    svg.line(
        format_args!(
            "M{:.1} {y:.1}h{:.1}M{x:.1} {:.1}v{:.1}",
            x - RADIUS,
            2.0 * RADIUS,
            y - RADIUS,
            2.0 * RADIUS
        ),
        SOFT,
    );
    if most <= 0.0 || !most.is_finite() {
        svg.text(x, y - 8.0, Anchor::Middle, &format!(" fill=\"{SOFT}\""), "no contacts");
        return;
    }
    let mut path = String::new();
    for (k, count) in counts.iter().enumerate() {
        let r = RADIUS * count / most;
        let at = |k: usize| {
            let angle = TAU * k as f64 / counts.len() as f64;
            [x + r * angle.cos(), y - r * angle.sin()]
        };
        let ([ax, ay], [bx, by]) = (at(k), at(k + 1));
        // Writing to a string cannot fail.
        let _ = write!(path, "M{x:.1} {y:.1}L{ax:.1} {ay:.1}A{r:.1} {r:.1} 0 0 0 {bx:.1} {by:.1}Z");
    }
    svg.area(&path, COLOUR);
    svg.line(format_args!("{path}"), COLOUR);
    let r = RADIUS * mean / most;
    svg.dashed_line(
        format_args!(
            "M{:.1} {y:.1}a{r:.1} {r:.1} 0 1 0 {:.1} 0a{r:.1} {r:.1} 0 1 0 {:.1} 0",
            x - r,
            2.0 * r,
            -2.0 * r
        ),
        SOFT,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rose_has_a_petal_for_each_bin_and_none_without_contacts() {
        let text = rose("Contacts", &[("x-y", &[4.0, 2.0, 4.0, 2.0]), ("x-z", &[0.0; 4])]);
        assert_eq!(text.matches("A130.0 130.0").count(), 4, "two petals, shaded and outlined: {text}");
        assert_eq!(text.matches("A65.0 65.0").count(), 4, "{text}");
        assert!(text.contains("no contacts") && text.contains("a97.5 97.5"), "{text}");
    }
}
