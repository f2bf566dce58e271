//! Particles from CSV: columns by their headings, in any order, with units.

use std::{collections::BTreeMap, path::Path};

use glebe_engine::spec::Vec3;

use super::{Materials, ParticleColumns, ParticleError};
use crate::units::{Dimension, Factor};

/// A column: its name in messages, others of the same meaning, in lower case, and what it holds. ParaView calls
/// the components of an array by their number, behind a colon in one version and an underscore in another.
struct Meaning {
    name: &'static str,
    others: &'static [&'static str],
    dimension: Dimension,
}

const fn length(name: &'static str, others: &'static [&'static str]) -> Meaning {
    Meaning { name, others, dimension: Dimension::LENGTH }
}
const fn velocity(name: &'static str, others: &'static [&'static str]) -> Meaning {
    Meaning { name, others, dimension: Dimension::VELOCITY }
}
const fn spin(name: &'static str, others: &'static [&'static str]) -> Meaning {
    Meaning { name, others, dimension: Dimension::ANGULAR_VELOCITY }
}

static POSITION: [Meaning; 3] = [
    length("x", &["points:0", "points_0"]),
    length("y", &["points:1", "points_1"]),
    length("z", &["points:2", "points_2"]),
];
static RADIUS: Meaning = length("R", &["radius"]);
static VELOCITY: [Meaning; 3] = [
    velocity("vx", &["velocity:0", "velocity_0"]),
    velocity("vy", &["velocity:1", "velocity_1"]),
    velocity("vz", &["velocity:2", "velocity_2"]),
];
static SPIN: [Meaning; 3] = [
    spin("wx", &["angular_velocity:0", "angular_velocity_0"]),
    spin("wy", &["angular_velocity:1", "angular_velocity_1"]),
    spin("wz", &["angular_velocity:2", "angular_velocity_2"]),
];
static MATERIAL: Meaning = Meaning { name: "material", others: &[], dimension: Dimension::NONE };

impl Meaning {
    fn is(&self, heading: &str) -> bool {
        let other = |name: &&str| heading.eq_ignore_ascii_case(name);
        heading.eq_ignore_ascii_case(self.name) || self.others.iter().any(other)
    }
}

/// The known column that a heading means.
fn known(heading: &str) -> Option<&'static Meaning> {
    let all = POSITION.iter().chain([&RADIUS]).chain(&VELOCITY).chain(&SPIN).chain([&MATERIAL]);
    all.into_iter().find(|meaning| meaning.is(heading))
}

/// Reads a whole file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<ParticleColumns, ParticleError> {
    let text = String::from_utf8_lossy(bytes);
    let mut rows = Rows::new(path, &text);
    let Some((line, first)) = rows.next()? else { return Err(ParticleError::Empty { path: path.into() }) };

    let (layout, mut row) = if first.iter().all(|field| field.parse::<f64>().is_ok()) {
        if first.len() != 4 {
            return Err(ParticleError::NoHeader { path: path.into(), columns: first.len() });
        }
        (Layout::default(), Some((line, first)))
    } else {
        (Layout::new(path, line, &first)?, rows.next()?)
    };

    let mut columns = ParticleColumns { ignored: layout.ignored, path: path.into(), ..Default::default() };
    let (mut index, mut names) = (Vec::new(), Vec::new());
    let mut materials = BTreeMap::new();
    while let Some((line, fields)) = row {
        if fields.len() != layout.width {
            let (expected, found) = (layout.width, fields.len());
            return Err(ParticleError::Ragged { path: path.into(), line, expected, found });
        }
        let row_at = Row { path, line, fields: &fields };
        columns.position.push(row_at.vector(&layout.position)?);
        let radius = row_at.number(layout.radius)?;
        if radius <= 0.0 {
            return Err(row_at.fault(
                layout.radius.at,
                RADIUS.name,
                "is no radius: it must be greater than 0",
            ));
        }
        columns.radius.push(radius);
        if let Some(at) = &layout.velocity {
            columns.velocity.push(row_at.vector(at)?);
        }
        if let Some(at) = &layout.spin {
            columns.spin.push(row_at.vector(at)?);
        }
        if let Some(at) = layout.material {
            let name = &fields[at];
            if name.is_empty() {
                return Err(row_at.fault(at, MATERIAL.name, "is no name: every particle needs its material"));
            }
            index.push(materials.get(name).copied().unwrap_or_else(|| {
                names.push((name.to_owned(), line));
                materials.insert(name.to_owned(), names.len() - 1);
                names.len() - 1
            }));
        }
        row = rows.next()?;
    }
    if !names.is_empty() {
        columns.materials = Materials::Named { index, names };
    }
    Ok(columns)
}

/// Records of a file with the lines that they begin in; blank lines are passed over.
struct Rows<'a> {
    path: &'a Path,
    text: &'a str,
    reader: csv::Reader<&'a [u8]>,
}

impl<'a> Rows<'a> {
    fn new(path: &'a Path, text: &'a str) -> Self {
        let reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        Self { path, text, reader }
    }

    fn next(&mut self) -> Result<Option<(u64, csv::StringRecord)>, ParticleError> {
        let mut record = csv::StringRecord::new();
        loop {
            // The reader's position is the end of the record before, ahead of blank lines and, after a
            // carriage return, of its line feed.
            let start = self.reader.position().clone();
            let more = self
                .reader
                .read_record(&mut record)
                .map_err(|source| ParticleError::NotCsv { path: self.path.into(), source })?;
            if !more {
                return Ok(None);
            }
            if record.iter().any(|field| !field.is_empty()) {
                let rest = self.text.as_bytes().get(start.byte() as usize..).unwrap_or_default();
                let blank = rest.iter().take_while(|b| matches!(b, b'\r' | b'\n'));
                return Ok(Some((start.line() + blank.filter(|b| **b == b'\n').count() as u64, record)));
            }
        }
    }
}

/// A column of numbers.
#[derive(Clone, Copy)]
struct Column {
    at: usize,
    name: &'static str,
    factor: Factor,
}

/// Which column holds what.
struct Layout {
    width: usize,
    position: [Column; 3],
    radius: Column,
    velocity: Option<[Column; 3]>,
    spin: Option<[Column; 3]>,
    material: Option<usize>,
    ignored: Vec<String>,
}

impl Default for Layout {
    /// x, y, z, R.
    fn default() -> Self {
        let column = |at: usize, meaning: &Meaning| Column { at, name: meaning.name, factor: Factor::ONE };
        Self {
            width: 4,
            position: [0, 1, 2].map(|k| column(k, &POSITION[k])),
            radius: column(3, &RADIUS),
            velocity: None,
            spin: None,
            material: None,
            ignored: Vec::new(),
        }
    }
}

/// A heading without its unit, and the unit: `x [mm]`, `R (cm)`.
fn split(heading: &str) -> (&str, Option<&str>) {
    let inner = heading.strip_suffix(']').and_then(|h| h.split_once('['));
    let inner = inner.or_else(|| heading.strip_suffix(')').and_then(|h| h.split_once('(')));
    inner.map_or((heading, None), |(name, unit)| (name.trim(), Some(unit.trim())))
}

impl Layout {
    fn new(path: &Path, line: u64, header: &csv::StringRecord) -> Result<Self, ParticleError> {
        let found: Vec<&str> = header.iter().map(|field| field.trim_start_matches('#').trim()).collect();
        let find = |meaning: &Meaning| found.iter().position(|h| meaning.is(split(h).0));
        for (index, heading) in found.iter().enumerate() {
            if let Some(meaning) = known(split(heading).0)
                && find(meaning) != Some(index)
            {
                return Err(ParticleError::TwiceColumn {
                    path: path.into(),
                    line,
                    name: meaning.name.to_owned(),
                });
            }
        }
        let need = |meaning: &Meaning| {
            let at = find(meaning).ok_or_else(|| {
                let found = found.iter().map(|heading| format!("`{heading}`")).collect();
                ParticleError::MissingColumn { path: path.into(), line, missing: meaning.name, found }
            })?;
            let factor = match split(found[at]).1 {
                Some(unit) => Factor::of(unit, meaning.dimension, unit).map_err(|e| ParticleError::Unit {
                    path: path.into(),
                    line,
                    heading: found[at].to_owned(),
                    problem: e.to_string(),
                })?,
                None => Factor::ONE,
            };
            Ok(Column { at, name: meaning.name, factor })
        };
        let group = |[a, b, c]: &[Meaning; 3]| Ok([need(a)?, need(b)?, need(c)?]);
        let optional = |meanings: &[Meaning; 3]| {
            meanings.iter().any(|meaning| find(meaning).is_some()).then(|| group(meanings)).transpose()
        };
        Ok(Self {
            width: found.len(),
            position: group(&POSITION)?,
            radius: need(&RADIUS)?,
            velocity: optional(&VELOCITY)?,
            spin: optional(&SPIN)?,
            material: find(&MATERIAL),
            ignored: found.iter().filter(|h| known(split(h).0).is_none()).map(|h| (*h).to_owned()).collect(),
        })
    }
}

/// One line of the file.
struct Row<'a> {
    path: &'a Path,
    line: u64,
    fields: &'a csv::StringRecord,
}

impl Row<'_> {
    fn number(&self, column: Column) -> Result<f64, ParticleError> {
        match self.fields[column.at].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(column.factor.apply(value)),
            Ok(_) => Err(self.fault(column.at, column.name, "is not finite")),
            Err(_) => Err(self.fault(column.at, column.name, "is not a number")),
        }
    }

    fn vector(&self, columns: &[Column; 3]) -> Result<Vec3, ParticleError> {
        let component = |k: usize| self.number(columns[k]);
        Ok([component(0)?, component(1)?, component(2)?])
    }

    fn fault(&self, column: usize, name: &'static str, problem: &'static str) -> ParticleError {
        let text = self.fields[column].to_owned();
        ParticleError::Value {
            path: self.path.into(),
            line: self.line,
            column: column + 1,
            name,
            text,
            problem,
        }
    }
}
