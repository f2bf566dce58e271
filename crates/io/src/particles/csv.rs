//! Particles from CSV.

use std::{collections::BTreeMap, path::Path};

use super::{Materials, ParticleColumns, ParticleError};
use crate::sheet::{Column, Header, Meaning, Row, Rows, SheetError};
use crate::units::Dimension;

// ParaView calls the components of an array by their number, behind a colon in one version and an underscore in
// another.
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
const KNOWN: &str = "x, y, z, R (needed), vx, vy, vz, wx, wy, wz and material, each with a unit if need be, such as \
                     `R [mm]`";

/// Reads a whole file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<ParticleColumns, ParticleError> {
    let text = String::from_utf8_lossy(bytes);
    let of_file = |fault: SheetError| ParticleError::Sheet { path: path.into(), fault };
    let mut rows = Rows::new(&text);
    let Some((line, first)) = rows.next().map_err(of_file)? else {
        return Err(ParticleError::Empty { path: path.into() });
    };
    let (layout, first) = if first.iter().all(|field| field.parse::<f64>().is_ok()) {
        if first.len() != 4 {
            return Err(ParticleError::NoHeader { path: path.into(), columns: first.len() });
        }
        (Layout::default(), Some((line, first)))
    } else {
        (Layout::new(line, &first).map_err(of_file)?, rows.next().map_err(of_file)?)
    };
    let columns = particles(layout, first, &mut rows).map_err(of_file)?;
    Ok(ParticleColumns { path: path.into(), ..columns })
}

fn particles(
    layout: Layout,
    first: Option<(u64, csv::StringRecord)>,
    rows: &mut Rows<'_>,
) -> Result<ParticleColumns, SheetError> {
    let mut columns = ParticleColumns { ignored: layout.ignored, ..Default::default() };
    let (mut index, mut names) = (Vec::new(), Vec::new());
    let mut materials = BTreeMap::new();
    let mut next = first;
    while let Some((line, fields)) = next {
        let row = Row::new(line, &fields, layout.width)?;
        columns.position.push(row.numbers(&layout.position)?);
        let radius = row.number(layout.radius)?;
        if radius <= 0.0 {
            return Err(row.fault(layout.radius.at, RADIUS.name, "is no radius: it must be greater than 0"));
        }
        columns.radius.push(radius);
        if let Some(at) = &layout.velocity {
            columns.velocity.push(row.numbers(at)?);
        }
        if let Some(at) = &layout.spin {
            columns.spin.push(row.numbers(at)?);
        }
        if let Some(at) = layout.material {
            let name = &fields[at];
            if name.is_empty() {
                return Err(row.fault(at, MATERIAL.name, "is no name: every particle needs its material"));
            }
            index.push(materials.get(name).copied().unwrap_or_else(|| {
                names.push((name.to_owned(), line));
                materials.insert(name.to_owned(), names.len() - 1);
                names.len() - 1
            }));
        }
        next = rows.next()?;
    }
    if !names.is_empty() {
        columns.materials = Materials::Named { index, names };
    }
    Ok(columns)
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
        Self {
            width: 4,
            position: [0, 1, 2].map(|k| Column::plain(k, &POSITION[k])),
            radius: Column::plain(3, &RADIUS),
            velocity: None,
            spin: None,
            material: None,
            ignored: Vec::new(),
        }
    }
}

impl Layout {
    fn new(line: u64, record: &csv::StringRecord) -> Result<Self, SheetError> {
        let all = POSITION.iter().chain([&RADIUS]).chain(&VELOCITY).chain(&SPIN).chain([&MATERIAL]);
        let header = Header::new(line, record, all.collect(), KNOWN)?;
        Ok(Self {
            width: header.width(),
            position: header.group(&POSITION)?,
            radius: header.need(&RADIUS)?,
            velocity: header.optional(&VELOCITY)?,
            spin: header.optional(&SPIN)?,
            material: header.find(&MATERIAL),
            ignored: header.unknown(),
        })
    }
}
