//! Shapes and text of an SVG document, in the style of the plots.

use std::fmt::{Arguments, Write as _};

use glebe_io::output::SVG_MARK;

/// Colour of what should not catch the eye.
pub(crate) const SOFT: &str = "#57606a";
const MEAN: &str = "#d55e00";

/// Where a text is held at its position.
#[derive(Clone, Copy)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// A document in the making. Coordinates are in pixels, y downwards.
pub(crate) struct Document {
    text: String,
}

impl Document {
    pub(crate) fn new(width: f64, height: f64, title: &str) -> Self {
        let mut document = Self { text: format!("{SVG_MARK}\n") };
        document.put(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" font-family=\"Inter, 'Segoe UI', \
             'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif\" font-size=\"13\" fill=\"#24292f\">"
        ));
        document.put(format_args!("<title>{}</title>", escape(title)));
        document.put(format_args!("<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>"));
        document
    }

    fn put(&mut self, element: Arguments) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{element}");
    }

    /// A thin line along a path.
    pub(crate) fn line(&mut self, path: Arguments, colour: &str) {
        self.put(format_args!("<path d=\"{path}\" stroke=\"{colour}\" fill=\"none\"/>"));
    }

    pub(crate) fn dashed_line(&mut self, path: Arguments, colour: &str) {
        self.put(format_args!(
            "<path d=\"{path}\" stroke=\"{colour}\" stroke-dasharray=\"2 3\" fill=\"none\"/>"
        ));
    }

    /// A line that shows data.
    pub(crate) fn curve(&mut self, path: &str, colour: &str, dashed: bool) {
        let dashes = if dashed { " stroke-dasharray=\"7 4\"" } else { "" };
        self.put(format_args!(
            "<path class=\"curve\" d=\"{path}\" stroke=\"{colour}\" stroke-width=\"1.8\" \
             stroke-linejoin=\"round\" fill=\"none\"{dashes}/>"
        ));
    }

    /// A shaded area within a path.
    pub(crate) fn area(&mut self, path: &str, colour: &str) {
        self.put(format_args!(
            "<path d=\"{path}Z\" fill=\"{colour}\" fill-opacity=\"0.15\" stroke=\"none\"/>"
        ));
    }

    /// A point of data.
    pub(crate) fn dot(&mut self, x: f64, y: f64, colour: &str) {
        self.put(format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.4\" fill=\"{colour}\" fill-opacity=\"0.7\"/>"
        ));
    }

    /// A shaded rectangle around the height `y`, with or without its mean.
    pub(crate) fn window(&mut self, x: f64, y: f64, [width, height]: [f64; 2], mean: bool) {
        self.put(format_args!(
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#f1f3f5\" \
             stroke=\"#ced4da\"/>",
            y - 0.5 * height
        ));
        if mean {
            self.mean([x, x + width], y, 0.5 * height);
        }
    }

    /// A mean at the height `y` with a band around it.
    pub(crate) fn mean(&mut self, [from, to]: [f64; 2], y: f64, band: f64) {
        self.put(format_args!(
            "<rect x=\"{from:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{band:.1}\" fill=\"{MEAN}\" \
             fill-opacity=\"0.18\"/>",
            y - 0.5 * band,
            to - from
        ));
        self.put(format_args!(
            "<path d=\"M{from:.1} {y:.1}H{to:.1}\" stroke=\"{MEAN}\" stroke-width=\"2\" fill=\"none\"/>"
        ));
    }

    /// Begins a part that is cut off at a rectangle; a document has one at most.
    pub(crate) fn begin_clipped(&mut self, x: f64, y: f64, width: f64, height: f64) {
        self.put(format_args!(
            "<clipPath id=\"frame\"><rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height:.1}\"/>\
             </clipPath>\n<g clip-path=\"url(#frame)\">"
        ));
    }

    pub(crate) fn end_clipped(&mut self) {
        self.put(format_args!("</g>"));
    }

    /// A line of text with its baseline at (x, y); nothing if it is empty.
    pub(crate) fn text(&mut self, x: f64, y: f64, anchor: Anchor, attributes: &str, text: &str) {
        if text.is_empty() {
            return;
        }
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.put(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{attributes}>{}</text>",
            escape(text)
        ));
    }

    pub(crate) fn finish(mut self) -> String {
        self.put(format_args!("</svg>"));
        self.text
    }
}

/// Text as it stands in XML, without the control characters that XML cannot hold.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Width of a text in pixels, as far as it can be known without its font: enough to place a legend.
pub(crate) fn width_of(text: &str, size: f64) -> f64 {
    let em = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | ':' | '\'' | '|' | ' ' | '(' | ')' => 0.34,
        'm' | 'w' | 'M' | 'W' => 0.92,
        c if c.is_uppercase() => 0.70,
        _ => 0.59,
    };
    text.chars().map(em).sum::<f64>() * size
}
