//! Axes: ranges, ticks and their labels.

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Scale {
    /// Equal steps for equal differences.
    #[default]
    Linear,
    /// Equal steps for equal ratios; values that are not positive are not shown.
    Log,
}

/// An axis of a plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// What is shown.
    pub label: String,
    /// Its unit; none if empty.
    pub unit: String,
    /// How values are spread.
    pub scale: Scale,
    /// First and last value; found from the data if absent.
    pub range: Option<[f64; 2]>,
    /// Whether a range found from the data reaches to zero.
    pub from_zero: bool,
}

impl Axis {
    /// A linear axis over the data.
    pub fn new(label: &str, unit: &str) -> Self {
        Self { label: label.to_owned(), unit: unit.to_owned(), ..Self::default() }
    }

    /// The same axis, logarithmic.
    pub fn log(self) -> Self {
        Self { scale: Scale::Log, ..self }
    }

    /// The same axis, from zero on.
    pub fn from_zero(self) -> Self {
        Self { from_zero: true, ..self }
    }

    /// The same axis with a fixed range.
    pub fn with_range(self, first: f64, last: f64) -> Self {
        Self { range: Some([first, last]), ..self }
    }
}

/// Decades that a logarithmic axis shows at most when it finds its range itself: a kinetic energy that
/// falls to zero would otherwise squeeze everything else.
const DECADES: f64 = 12.0;

/// Pixels beyond which a value is outside like any other: programs that draw SVG stumble over more.
const FAR: f64 = 1e5;

/// An axis with its range, laid over a length in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ruler {
    scale: Scale,
    /// In the scale's own measure: the value or its decimal logarithm.
    low: f64,
    high: f64,
    /// In pixels.
    length: f64,
}

/// A mark on an axis.
#[derive(Debug)]
pub(crate) struct Tick {
    /// Pixels from the axis' beginning.
    pub(crate) at: f64,
    /// None for the small ones in between.
    pub(crate) label: Option<String>,
}

impl Ruler {
    /// `margin`: share of the range left free at both ends where it follows the data.
    pub(crate) fn new(axis: &Axis, data: impl Iterator<Item = f64>, margin: f64, length: f64) -> Self {
        let scale = axis.scale;
        let given = axis.range.map(|r| r.map(|v| measure(scale, v)));
        let [low, high] = match given {
            Some([a, b]) if a.is_finite() && b.is_finite() && a != b => [a.min(b), a.max(b)],
            _ => found_range(axis, data.map(|v| measure(scale, v)).filter(|v| v.is_finite()), margin),
        };
        Self { scale, low, high, length }
    }

    pub(crate) fn length(&self) -> f64 {
        self.length
    }

    /// This axis and another with units of the same length: the other gets a length within `bounds`, and
    /// ranges grow where they must.
    pub(crate) fn equalised(self, other: Self, [least, most]: [f64; 2]) -> (Self, Self) {
        let unit = ((self.high - self.low) / self.length).max((other.high - other.low) / most);
        let length = ((other.high - other.low) / unit).max(least);
        (self.grown(unit), Self { length, ..other }.grown(unit))
    }

    /// The same middle with `unit` values per pixel.
    fn grown(self, unit: f64) -> Self {
        let (middle, half) = (0.5 * (self.low + self.high), 0.5 * self.length * unit);
        Self { low: middle - half, high: middle + half, ..self }
    }

    /// Pixels from the axis' beginning to a value; None if the scale cannot show it.
    pub(crate) fn at(&self, value: f64) -> Option<f64> {
        let v = measure(self.scale, value);
        let at = (v - self.low) / (self.high - self.low) * self.length;
        v.is_finite().then(|| at.clamp(-FAR, FAR))
    }

    /// The ticks, about `count` of them labelled, and the power of ten that the labels leave out.
    pub(crate) fn ticks(&self, count: usize) -> (Vec<Tick>, i32) {
        match self.scale {
            Scale::Linear => self.linear_ticks(count),
            Scale::Log => (self.log_ticks(count), 0),
        }
    }

    fn linear_ticks(&self, count: usize) -> (Vec<Tick>, i32) {
        let step = nice_step((self.high - self.low) / count.max(1) as f64);
        let largest = self.low.abs().max(self.high.abs());
        let magnitude = largest.log10().floor() as i32;
        // Thousands and thousandths are read better with the power beside the unit.
        let power = if (-2..4).contains(&magnitude) { 0 } else { magnitude.div_euclid(3) * 3 };
        let decimals = (power - step.log10().floor() as i32).max(0) as usize;
        let first = (self.low / step - 1e-9).ceil() as i64;
        let last = (self.high / step + 1e-9).floor() as i64;
        let ticks = (first..=last)
            .filter_map(|k| {
                let value = k as f64 * step;
                let label = minus(&format!("{:.decimals$}", value / 10_f64.powi(power)));
                Some(Tick { at: self.at(value)?, label: Some(label) })
            })
            .collect();
        (ticks, power)
    }

    fn log_ticks(&self, count: usize) -> Vec<Tick> {
        let decades = self.high - self.low;
        let every = (decades / count.max(1) as f64).ceil().max(1.0) as i32;
        let plain = self.low > -2.5 && self.high < 3.5;
        let mut ticks = Vec::new();
        for exponent in self.low.floor() as i32..=self.high.ceil() as i32 {
            for digit in 1..10 {
                let value = f64::from(digit) * 10_f64.powi(exponent);
                let inside = (self.low - 1e-9..=self.high + 1e-9).contains(&value.log10());
                let labelled = match digit {
                    1 => exponent.rem_euclid(every) == 0,
                    // Less than two decades hold too few powers of ten to read values from.
                    2 | 5 => decades < 2.0,
                    _ => false,
                };
                if inside && (labelled || digit == 1 || decades < 5.0) {
                    let label = labelled.then(|| power_label(digit, exponent, plain));
                    ticks.extend(self.at(value).map(|at| Tick { at, label }));
                }
            }
        }
        ticks
    }
}

fn measure(scale: Scale, value: f64) -> f64 {
    match scale {
        Scale::Linear => value,
        Scale::Log if value > 0.0 => value.log10(),
        Scale::Log => f64::NAN,
    }
}

fn found_range(axis: &Axis, data: impl Iterator<Item = f64>, margin: f64) -> [f64; 2] {
    let (mut low, mut high) = data.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        // Nothing to show: any range will do.
        (low, high) = (0.0, 1.0);
    }
    if axis.scale == Scale::Log {
        low = low.max(high - DECADES);
        return if high - low < 1e-9 { [low - 0.5, high + 0.5] } else { widened(low, high, margin) };
    }
    if axis.from_zero {
        (low, high) = (low.min(0.0), high.max(0.0));
    }
    if high - low <= 1e-12 * low.abs().max(high.abs()) {
        let half = if high == 0.0 { 1.0 } else { 0.1 * high.abs() };
        return [low - half, high + half];
    }
    let [l, h] = widened(low, high, margin);
    if axis.from_zero {
        // The zero line is the frame, not something above it.
        return [if low == 0.0 { 0.0 } else { l }, if high == 0.0 { 0.0 } else { h }];
    }
    [l, h]
}

fn widened(low: f64, high: f64, margin: f64) -> [f64; 2] {
    // Halves first: the range of finite numbers may be infinite.
    let more = 2.0 * margin * (0.5 * high - 0.5 * low);
    [(low - more).max(f64::MIN / 4.0), (high + more).min(f64::MAX / 4.0)]
}

/// The next larger of 1, 2, 5 × 10ⁿ.
fn nice_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    let digit = [1.0, 2.0, 5.0].into_iter().find(|d| rough <= d * power * (1.0 + 1e-9)).unwrap_or(10.0);
    digit * power
}

/// Typographic minus; no negative zero.
pub(crate) fn minus(number: &str) -> String {
    let is_zero = !number.bytes().any(|b| b.is_ascii_digit() && b != b'0');
    if is_zero { number.trim_start_matches('-').to_owned() } else { number.replace('-', "\u{2212}") }
}

/// `10³`
pub(crate) fn power_of_ten(exponent: i32) -> String {
    format!("10{}", superscript(exponent))
}

/// `0.02`, or `2·10⁻²` unless `plain`.
fn power_label(digit: i32, exponent: i32, plain: bool) -> String {
    match digit {
        digit if plain => {
            format!("{:.*}", (-exponent).max(0) as usize, f64::from(digit) * 10_f64.powi(exponent))
        }
        1 => power_of_ten(exponent),
        digit => format!("{digit}·{}", power_of_ten(exponent)),
    }
}

fn superscript(number: i32) -> String {
    number
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '\u{207b}',
            '1' => '\u{b9}',
            '2' => '\u{b2}',
            '3' => '\u{b3}',
            digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, data: &[f64]) -> (Vec<String>, i32) {
        let ruler = Ruler::new(axis, data.iter().copied(), 0.0, 100.0);
        let (ticks, power) = ruler.ticks(5);
        (ticks.into_iter().filter_map(|t| t.label).collect(), power)
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::new("", "");
        let plain = |data: &[f64]| labels(&axis, data).0.join(" ");
        assert_eq!(plain(&[0.0, 1.0]), "0.0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(plain(&[-3.2, 7.9]), "0 5");
        assert_eq!(plain(&[-0.01, 0.011]), "\u{2212}0.010 \u{2212}0.005 0.000 0.005 0.010");
        assert_eq!(plain(&[0.28, 0.56]), "0.3 0.4 0.5");
        assert_eq!(
            labels(&axis, &[0.0, 25_000.0]),
            (["0", "5", "10", "15", "20", "25"].map(String::from).into(), 3)
        );
        assert_eq!(labels(&axis, &[0.0, 2e-6]).1, -6);
    }

    #[test]
    fn a_log_axis_has_decades() {
        let axis = Axis::new("", "").log();
        let plain = |data: &[f64]| labels(&axis, data).0.join(" ");
        assert_eq!(plain(&[0.5, 0.0, -3.0, 2000.0]), "1 10 100 1000");
        assert_eq!(plain(&[3.0, 30.0]), "5 10 20");
        assert_eq!(plain(&[1e-7, 1e5]), "10\u{207b}\u{2076} 10\u{207b}\u{b3} 10\u{2070} 10\u{b3}");
        // What has died away does not squeeze the rest.
        assert!(!plain(&[1e-300, 1.0]).contains("10\u{207b}\u{b9}\u{2075}"));
    }

    #[test]
    fn any_data_give_a_range() {
        for scale in [Scale::Linear, Scale::Log] {
            for data in
                [&[][..], &[0.0], &[5.0], &[-5.0, -5.0], &[f64::NAN, f64::INFINITY], &[f64::MIN, f64::MAX]]
            {
                let axis = Axis { scale, ..Axis::default() };
                let ruler = Ruler::new(&axis, data.iter().copied(), 0.05, 100.0);
                assert!(ruler.low < ruler.high && (ruler.high - ruler.low).is_finite(), "{ruler:?}");
                assert!(ruler.ticks(5).0.iter().all(|t| (-1e-3..100.001).contains(&t.at)), "{ruler:?}");
            }
        }
        let ruler = Ruler::new(&Axis::default().from_zero(), [3.0, 4.0].into_iter(), 0.05, 100.0);
        assert_eq!(ruler.at(0.0), Some(0.0));
    }

    #[test]
    fn zero_has_no_sign() {
        assert_eq!(minus("-0.00"), "0.00");
        assert_eq!(minus("-0.01"), "\u{2212}0.01");
    }
}
