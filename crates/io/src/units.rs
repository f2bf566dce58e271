//! Quantities as people write them: `"8.5 mm"`, `"2 MPa"`, `"60 rpm"`, `"1850 kg/m^3"`.
//!
//! A unit is a product of powers of known symbols, so that any dimension a law's parameter may have
//! (`N/m`, `J/m^2`, `N/m^1.5`) needs no entry of its own.

use std::f64::consts::PI;

/// What a number measures, and how it is named in messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dimension {
    /// In words, such as `length`.
    pub name: &'static str,
    /// SI unit of plain numbers; empty for dimensionless ones.
    pub si: &'static str,
    /// How such a value may be written, for messages.
    pub examples: &'static str,
}

macro_rules! dimensions {
    ($($id:ident $name:literal $si:literal $examples:literal;)*) => {
        impl Dimension {
            $(#[doc = concat!("A ", $name, " \\[", $si, "\\], such as `", $examples, "`.")]
            pub const $id: Self = Self { name: $name, si: $si, examples: $examples };)*
            /// Every named dimension.
            pub const ALL: &'static [Self] = &[$(Self::$id),*];
        }
    };
}

dimensions! {
    NONE "plain number" "" r#"0.5 or "50 %""#;
    LENGTH "length" "m" r#"0.0085 or "8.5 mm""#;
    AREA "area" "m^2" r#"0.02 or "200 cm^2""#;
    VOLUME "volume" "m^3" r#"0.001 or "1000 cm^3""#;
    TIME "time" "s" r#"0.001 or "1 ms""#;
    FREQUENCY "frequency" "Hz" r#"50 or "50 Hz""#;
    VELOCITY "velocity" "m/s" r#"0.7 or "0.7 m/s""#;
    ACCELERATION "acceleration" "m/s^2" r#"9.81 or "9.81 m/s^2""#;
    ANGLE "angle" "rad" r#"0.5236 or "30 deg""#;
    ANGULAR_VELOCITY "angular velocity" "rad/s" r#"6.283 or "60 rpm""#;
    MASS "mass" "kg" r#"0.02 or "20 g""#;
    DENSITY "density" "kg/m^3" r#"1850 or "1850 kg/m^3""#;
    FORCE "force" "N" r#"1500 or "1.5 kN""#;
    PRESSURE "pressure" "Pa" r#"2e6 or "2 MPa""#;
    ENERGY "energy" "J" r#"0.1 or "100 mJ""#;
    POWER "power" "W" r#"500 or "0.5 kW""#;
    STIFFNESS "stiffness" "N/m" r#"1e5 or "100 kN/m""#;
    DAMPING "damping coefficient" "N s/m" r#"10 or "10 N s/m""#;
    MASS_RATE "mass per time" "kg/s" r#"0.5 or "0.5 kg/s""#;
}

impl Dimension {
    /// A torque \[N m\]; units tell it from an energy by their name alone.
    pub const TORQUE: Self = Self { name: "torque", si: "N m", examples: r#"0.5 or "0.5 N m""# };

    /// The dimension of an SI unit, named if it is a known one.
    pub fn of_si(si: &'static str) -> Self {
        let wanted = parse_unit(si).ok().map(|u| u.powers);
        Self::ALL
            .iter()
            .copied()
            .find(|d| parse_unit(d.si).ok().map(|u| u.powers) == wanted)
            .unwrap_or(Self { name: "quantity", si, examples: "" })
    }

    /// For messages: `a length, such as 0.0085 or "8.5 mm"`.
    pub fn expected(&self) -> String {
        let name = with_article(self.name);
        if self.examples.is_empty() {
            format!("{name} in {}", self.si)
        } else {
            format!("{name}, such as {}", self.examples)
        }
    }
}

/// Why a text is not a quantity.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum UnitError {
    /// It does not begin with a number.
    #[error("`{0}` does not begin with a number")]
    NoNumber(String),
    /// The unit is missing.
    #[error("`{0}` has no unit")]
    NoUnit(String),
    /// A symbol that is not known.
    #[error("`{symbol}` is not a known unit")]
    Unknown {
        /// As written.
        symbol: String,
    },
    /// The unit belongs to another dimension.
    #[error("`{text}` is {found}, not {expected}")]
    Dimension {
        /// As written.
        text: String,
        /// What the unit measures.
        found: String,
        /// What is wanted.
        expected: String,
    },
}

/// Powers of metre, kilogram, second and radian, in halves (a Hertz stiffness is in N/m^1.5).
type Powers = [i32; 4];

#[derive(Clone, Copy, Debug, PartialEq)]
struct Unit {
    factor: f64,
    powers: Powers,
}

/// Symbol, value in SI units, powers of (m, kg, s, rad), whether it takes SI prefixes.
const SYMBOLS: &[(&str, f64, [i32; 4], bool)] = &[
    ("m", 1.0, [1, 0, 0, 0], true),
    ("g", 1e-3, [0, 1, 0, 0], true),
    ("s", 1.0, [0, 0, 1, 0], true),
    ("rad", 1.0, [0, 0, 0, 1], true),
    ("N", 1.0, [1, 1, -2, 0], true),
    ("Pa", 1.0, [-1, 1, -2, 0], true),
    ("J", 1.0, [2, 1, -2, 0], true),
    ("W", 1.0, [2, 1, -3, 0], true),
    ("Hz", 1.0, [0, 0, -1, 0], true),
    ("bar", 1e5, [-1, 1, -2, 0], true),
    ("L", 1e-3, [3, 0, 0, 0], true),
    ("in", 0.0254, [1, 0, 0, 0], false),
    ("ft", 0.3048, [1, 0, 0, 0], false),
    ("t", 1e3, [0, 1, 0, 0], false),
    ("min", 60.0, [0, 0, 1, 0], false),
    ("h", 3600.0, [0, 0, 1, 0], false),
    ("deg", PI / 180.0, [0, 0, 0, 1], false),
    ("°", PI / 180.0, [0, 0, 0, 1], false),
    ("rev", 2.0 * PI, [0, 0, 0, 1], false),
    ("rpm", 2.0 * PI / 60.0, [0, 0, -1, 1], false),
    ("%", 1e-2, [0, 0, 0, 0], false),
    ("1", 1.0, [0, 0, 0, 0], false),
];

const PREFIXES: &[(&str, f64)] = &[
    ("G", 1e9),
    ("M", 1e6),
    ("k", 1e3),
    ("h", 1e2),
    ("d", 1e-1),
    ("c", 1e-2),
    ("m", 1e-3),
    ("u", 1e-6),
    ("µ", 1e-6),
    ("μ", 1e-6),
    ("n", 1e-9),
];

/// The value of `text` in SI units, which must be of `dimension`.
///
/// # Errors
/// When there is no number, no unit, an unknown unit or one of another dimension.
///
/// ```
/// use glebe_io::units::{parse, Dimension};
/// assert_eq!(parse("8.5 mm", Dimension::LENGTH), Ok(0.0085));
/// assert!(parse("8.5 kg", Dimension::LENGTH).is_err());
/// ```
pub fn parse(text: &str, dimension: Dimension) -> Result<f64, UnitError> {
    let trimmed = text.trim();
    let (number, unit) = trimmed.split_at(number_length(trimmed));
    let value: f64 = number.replace('_', "").parse().map_err(|_| UnitError::NoNumber(trimmed.to_owned()))?;
    let unit = unit.trim();
    if unit.is_empty() && !dimension.si.is_empty() {
        return Err(UnitError::NoUnit(trimmed.to_owned()));
    }
    Ok(Factor::of(unit, dimension, trimmed)?.apply(value))
}

/// What turns numbers of a unit into SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Factor(f64);

impl Factor {
    /// For numbers in SI units.
    pub const ONE: Self = Self(1.0);

    /// For numbers of the `unit`, which must be of `dimension`; `text` stands for them in messages.
    pub fn of(unit: &str, dimension: Dimension, text: &str) -> Result<Self, UnitError> {
        let found = parse_unit(unit)?;
        if Ok(found.powers) == parse_unit(dimension.si).map(|u| u.powers) {
            return Ok(Self(found.factor));
        }
        let name = Dimension::ALL
            .iter()
            .find(|d| parse_unit(d.si).map(|u| u.powers) == Ok(found.powers))
            .map_or_else(|| "of another kind".to_owned(), |d| with_article(d.name));
        Err(UnitError::Dimension {
            text: text.to_owned(),
            found: name,
            expected: with_article(dimension.name),
        })
    }

    /// `value · factor`, dividing where the factor is the inverse of a whole number: `8.5 mm` is then the
    /// same f64 as `0.0085`.
    pub fn apply(self, value: f64) -> f64 {
        let Self(factor) = self;
        let inverse = (1.0 / factor).round();
        if factor < 1.0 && (inverse * factor - 1.0).abs() < 1e-15 { value / inverse } else { value * factor }
    }
}

fn with_article(name: &str) -> String {
    let article = if name.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
    format!("{article} {name}")
}

/// Bytes of the number that `text` begins with. `e` belongs to it only if an exponent follows.
pub(crate) fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(|b| b.is_ascii_digit() || *b == b'_') {
            at += 1;
        }
        at
    };
    let sign = |at: usize| at + usize::from(matches!(bytes.get(at), Some(b'+' | b'-')));
    let start = sign(0);
    let mut end = digits(start);
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if end == start {
        return 0;
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let exponent = sign(end + 1);
        let after = digits(exponent);
        if after > exponent {
            end = after;
        }
    }
    end
}

fn parse_unit(text: &str) -> Result<Unit, UnitError> {
    let mut unit = Unit { factor: 1.0, powers: [0; 4] };
    let mut direction = 1;
    let mut rest = text.trim();
    while let Some(first) = rest.chars().next() {
        if first == '/' || matches!(first, ' ' | '*' | '·' | '.') {
            if first == '/' {
                direction = -1;
            }
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let end = rest.find([' ', '*', '·', '/', '.', '^', '²', '³', '⁻', '¹']).unwrap_or(rest.len());
        let (symbol, tail) = rest.split_at(end);
        let (halves, after) = exponent(tail)
            .filter(|_| !symbol.is_empty())
            .ok_or_else(|| UnitError::Unknown { symbol: text.to_owned() })?;
        let base = base_unit(symbol).ok_or_else(|| UnitError::Unknown { symbol: symbol.to_owned() })?;
        let halves = direction * halves;
        unit.factor *= if halves % 2 == 0 {
            base.factor.powi(halves / 2)
        } else {
            base.factor.powf(f64::from(halves) / 2.0)
        };
        for (sum, power) in unit.powers.iter_mut().zip(base.powers) {
            *sum += halves * power;
        }
        direction = 1;
        rest = after;
    }
    Ok(unit)
}

/// The exponent at the beginning of `tail`, in halves, and what follows it.
fn exponent(tail: &str) -> Option<(i32, &str)> {
    if let Some(after) = tail.strip_prefix('^') {
        let (number, rest) = after.split_at(number_length(after));
        let halves = 2.0 * number.parse::<f64>().ok()?;
        let exact = halves.fract() == 0.0 && halves.abs() <= 20.0;
        return exact.then_some((halves as i32, rest));
    }
    let (negative, body) = tail.strip_prefix('⁻').map_or((1, tail), |rest| (-1, rest));
    for (mark, value) in [('¹', 1), ('²', 2), ('³', 3)] {
        if let Some(rest) = body.strip_prefix(mark) {
            return Some((2 * negative * value, rest));
        }
    }
    (negative == 1).then_some((2, tail))
}

fn base_unit(symbol: &str) -> Option<Unit> {
    let find = |name: &str, prefixed: bool| {
        SYMBOLS
            .iter()
            .find(|(s, _, _, takes)| *s == name && (*takes || !prefixed))
            .map(|&(_, factor, powers, _)| Unit { factor, powers })
    };
    find(symbol, false).or_else(|| {
        PREFIXES.iter().find_map(|(prefix, scale)| {
            let unit = find(symbol.strip_prefix(prefix)?, true)?;
            Some(Unit { factor: unit.factor * scale, ..unit })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_dimension_reads_its_units() {
        let cases: &[(&str, Dimension, f64)] = &[
            ("8.5 mm", Dimension::LENGTH, 0.0085),
            ("-3um", Dimension::LENGTH, -3e-6),
            ("3 µm", Dimension::LENGTH, 3e-6),
            ("1.5 km", Dimension::LENGTH, 1500.0),
            ("2 in", Dimension::LENGTH, 0.0508),
            ("10 ft", Dimension::LENGTH, 3.048),
            ("200 cm^2", Dimension::AREA, 0.02),
            ("2 L", Dimension::VOLUME, 0.002),
            ("5 cm³", Dimension::VOLUME, 5e-6),
            ("1 ms", Dimension::TIME, 1e-3),
            ("2 min", Dimension::TIME, 120.0),
            ("1.5 h", Dimension::TIME, 5400.0),
            ("50 Hz", Dimension::FREQUENCY, 50.0),
            ("3 1/s", Dimension::FREQUENCY, 3.0),
            ("0.7 m/s", Dimension::VELOCITY, 0.7),
            ("3.6 km/h", Dimension::VELOCITY, 1.0),
            ("9.81 m/s^2", Dimension::ACCELERATION, 9.81),
            ("9.81 m s⁻²", Dimension::ACCELERATION, 9.81),
            ("180 deg", Dimension::ANGLE, PI),
            ("90°", Dimension::ANGLE, PI / 2.0),
            ("1 rev", Dimension::ANGLE, 2.0 * PI),
            ("60 rpm", Dimension::ANGULAR_VELOCITY, 2.0 * PI),
            ("360 deg/s", Dimension::ANGULAR_VELOCITY, 2.0 * PI),
            ("20 g", Dimension::MASS, 0.02),
            ("1 t", Dimension::MASS, 1000.0),
            ("1850 kg/m^3", Dimension::DENSITY, 1850.0),
            ("1.85 g/cm³", Dimension::DENSITY, 1850.0),
            ("1.5 kN", Dimension::FORCE, 1500.0),
            ("2 MPa", Dimension::PRESSURE, 2e6),
            ("8 GPa", Dimension::PRESSURE, 8e9),
            ("1 N/mm^2", Dimension::PRESSURE, 1e6),
            ("3 bar", Dimension::PRESSURE, 3e5),
            ("100 mJ", Dimension::ENERGY, 0.1),
            ("2 N m", Dimension::ENERGY, 2.0),
            ("0.5 kW", Dimension::POWER, 500.0),
            ("100 kN/m", Dimension::STIFFNESS, 1e5),
            ("10 N s/m", Dimension::DAMPING, 10.0),
            ("10 kg/s", Dimension::DAMPING, 10.0),
            ("3.6 t/h", Dimension::MASS_RATE, 1.0),
            ("50 %", Dimension::NONE, 0.5),
            ("0.25", Dimension::NONE, 0.25),
            ("1e-3 m", Dimension::LENGTH, 1e-3),
            ("1_000 m", Dimension::LENGTH, 1000.0),
        ];
        for (text, dimension, value) in cases {
            let read = parse(text, *dimension).unwrap();
            assert!((read - value).abs() <= 1e-14 * value.abs(), "{text}: {read} instead of {value}");
        }
        for dimension in Dimension::ALL {
            assert!(cases.iter().any(|(_, d, _)| d == dimension), "{} is not covered", dimension.name);
        }
    }

    #[test]
    fn decimal_prefixes_give_the_number_one_would_type() {
        assert_eq!(parse("8.5 mm", Dimension::LENGTH), Ok(8.5e-3));
        assert_eq!(parse("7 mm", Dimension::LENGTH), Ok(0.007));
        assert_eq!(parse("20 ms", Dimension::TIME), Ok(0.02));
    }

    #[test]
    fn laws_may_have_units_of_their_own() {
        let hertz = Dimension::of_si("N/m^1.5");
        assert_eq!(hertz.name, "quantity");
        assert_eq!(parse("1e8 N/m^1.5", hertz), Ok(1e8));
        assert!((parse("1 N/mm^1.5", hertz).unwrap() - 10f64.powf(4.5)).abs() < 1e-6);
        assert_eq!(Dimension::of_si("Pa"), Dimension::PRESSURE);
        assert_eq!(Dimension::of_si(""), Dimension::NONE);
    }

    #[test]
    fn mistakes_are_named() {
        let message = |text, dimension| parse(text, dimension).unwrap_err().to_string();
        assert_eq!(message("2 MPa", Dimension::LENGTH), "`2 MPa` is a pressure, not a length");
        assert_eq!(
            message("2 Hz", Dimension::ANGULAR_VELOCITY),
            "`2 Hz` is a frequency, not an angular velocity"
        );
        assert_eq!(message("3 furlong", Dimension::LENGTH), "`furlong` is not a known unit");
        assert_eq!(message("8.5", Dimension::LENGTH), "`8.5` has no unit");
        assert_eq!(message("wide", Dimension::LENGTH), "`wide` does not begin with a number");
        assert_eq!(message("3 m^x", Dimension::LENGTH), "`m^x` is not a known unit");
        assert_eq!(message("3 m²³", Dimension::VOLUME), "`m²³` is not a known unit");
        assert_eq!(message("2 kg m", Dimension::LENGTH), "`2 kg m` is of another kind, not a length");
    }
}
