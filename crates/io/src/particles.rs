//! Particles from CSV files, as GPUDEM writes them (columns `x, y, z, R`) and with a little more.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use glebe_engine::spec::{MaterialId, ParticleSet, Vec3};
use thiserror::Error;

const POSITION: [&str; 3] = ["x", "y", "z"];
const RADIUS: &str = "R";
const VELOCITY: [&str; 3] = ["vx", "vy", "vz"];
const SPIN: [&str; 3] = ["wx", "wy", "wz"];
const MATERIAL: &str = "material";

/// Whether a heading is one that is read, whatever its case.
fn is_known(heading: &str) -> bool {
    let names = [&POSITION[..], &[RADIUS], &VELOCITY, &SPIN, &[MATERIAL]];
    names.into_iter().flatten().any(|name| name.eq_ignore_ascii_case(heading))
}

/// The particles of a file, column by column.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ParticleColumns {
    /// Centres \[m\].
    pub position: Vec<Vec3>,
    /// Radii \[m\], > 0.
    pub radius: Vec<f64>,
    /// Velocities \[m/s\]; empty if the file has none.
    pub velocity: Vec<Vec3>,
    /// Angular velocities \[rad/s\]; empty if the file has none.
    pub spin: Vec<Vec3>,
    /// Headings of columns that were not used.
    pub ignored: Vec<String>,
    /// Index into `material_names`; empty if the file names no materials.
    material: Vec<usize>,
    /// Different materials in order of appearance, each with the line that it is first in.
    material_names: Vec<(String, u64)>,
    path: PathBuf,
}

/// Why particles could not be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ParticleError {
    /// The file cannot be opened or read.
    #[error("cannot read particle file `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is not CSV text.
    #[error("particle file `{}` is not CSV text: {source}", path.display())]
    NotCsv {
        /// The file.
        path: PathBuf,
        /// What the parser said.
        source: csv::Error,
    },
    /// There is no particle in it.
    #[error("particle file `{}` is empty: it needs a header `x,y,z,R` and a line for each particle", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A needed column is not there.
    #[error(
        "particle file `{}`, line {line}: no column `{missing}` among {}; known are x, y, z, R (needed), \
         vx, vy, vz, wx, wy, wz and material",
        path.display(),
        found.join(", ")
    )]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// Line of the header.
        line: u64,
        /// The column.
        missing: &'static str,
        /// The columns that are there.
        found: Vec<String>,
    },
    /// Two columns have the same name.
    #[error("particle file `{}`, line {line}: two columns are called `{name}` (case does not matter): rename or remove one", path.display())]
    TwiceColumn {
        /// The file.
        path: PathBuf,
        /// Line of the header.
        line: u64,
        /// The heading.
        name: String,
    },
    /// A file of numbers without a header has not four columns.
    #[error(
        "particle file `{}` has no header and {columns} columns: without a header there must be four (x, y, z, R); \
         add a header",
        path.display()
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// Columns of its first line.
        columns: usize,
    },
    /// A line has more or fewer fields than the first.
    #[error("particle file `{}`, line {line}: {found} fields, but the first line has {expected}", path.display())]
    Ragged {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Fields of the first line.
        expected: usize,
        /// Fields of this one.
        found: usize,
    },
    /// A field is not a finite number, or a radius not positive, or a material's name is missing.
    #[error("particle file `{}`, line {line}, column {column} ({name}): `{text}` {problem}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Column, from 1.
        column: usize,
        /// Name of the column.
        name: &'static str,
        /// What stands there.
        text: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A material that the scene does not define.
    #[error(
        "particle file `{}`, line {line}: material `{name}` is not defined; defined are {}",
        path.display(),
        listed(known)
    )]
    UnknownMaterial {
        /// The file.
        path: PathBuf,
        /// First line that names it.
        line: u64,
        /// The material.
        name: String,
        /// Materials that are defined.
        known: Vec<String>,
    },
    /// Neither the file nor the scene says what the particles are made of.
    #[error("particle file `{}` has no column `material`: add one, or set the material of all its particles in the scene", path.display())]
    NoMaterial {
        /// The file.
        path: PathBuf,
    },
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// Reads the CSV file `path`.
///
/// The first line names the columns, in any order and case: `x`, `y`, `z` \[m\] and `R` \[m\] are needed;
/// `vx`, `vy`, `vz` \[m/s\], `wx`, `wy`, `wz` \[rad/s\] and `material` (a name) are optional; others are
/// left alone and listed in [`ParticleColumns::ignored`]. A file of numbers only, in four columns, is
/// taken as x, y, z, R. A `#` before the header is allowed.
///
/// # Errors
/// A file that is missing, empty or not CSV; a missing or doubled column; a line with another number of
/// fields; a value that is not a finite number; a radius ≤ 0. The message names line and column.
pub fn read(path: &Path) -> Result<ParticleColumns, ParticleError> {
    let bytes = fs::read(path).map_err(|source| ParticleError::Read { path: path.into(), source })?;
    let text = String::from_utf8_lossy(&bytes);
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
    let mut materials = BTreeMap::new();
    while let Some((line, fields)) = row {
        if fields.len() != layout.width {
            let (expected, found) = (layout.width, fields.len());
            return Err(ParticleError::Ragged { path: path.into(), line, expected, found });
        }
        let row_at = Row { path, line, fields: &fields };
        columns.position.push(row_at.vector(layout.position, POSITION)?);
        let radius = row_at.number(layout.radius, RADIUS)?;
        if radius <= 0.0 {
            return Err(row_at.fault(layout.radius, RADIUS, "is no radius: it must be greater than 0"));
        }
        columns.radius.push(radius);
        if let Some(at) = layout.velocity {
            columns.velocity.push(row_at.vector(at, VELOCITY)?);
        }
        if let Some(at) = layout.spin {
            columns.spin.push(row_at.vector(at, SPIN)?);
        }
        if let Some(at) = layout.material {
            let name = &fields[at];
            if name.is_empty() {
                return Err(row_at.fault(at, MATERIAL, "is no name: every particle needs its material"));
            }
            let index = materials.get(name).copied().unwrap_or_else(|| {
                columns.material_names.push((name.to_owned(), line));
                materials.insert(name.to_owned(), columns.material_names.len() - 1);
                columns.material_names.len() - 1
            });
            columns.material.push(index);
        }
        row = rows.next()?;
    }
    if columns.is_empty() {
        return Err(ParticleError::Empty { path: path.into() });
    }
    Ok(columns)
}

impl ParticleColumns {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is none; never so for a file that was read.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The materials that the file names, each once, in order of appearance.
    pub fn material_names(&self) -> impl Iterator<Item = &str> {
        self.material_names.iter().map(|(name, _)| name.as_str())
    }

    /// The particles with the ids that `known` gives to the materials' names. `default` is the material
    /// of particles in a file that names none; it does not replace names that are there.
    ///
    /// # Errors
    /// A material that is not in `known`, or neither a name nor a default.
    pub fn into_set(
        self,
        known: &BTreeMap<String, MaterialId>,
        default: Option<MaterialId>,
    ) -> Result<ParticleSet, ParticleError> {
        let count = self.len();
        let material = if self.material_names.is_empty() {
            vec![default.ok_or(ParticleError::NoMaterial { path: self.path })?; count]
        } else {
            let mut ids = Vec::new();
            for (name, line) in self.material_names {
                let Some(&id) = known.get(&name) else {
                    let known = known.keys().cloned().collect();
                    return Err(ParticleError::UnknownMaterial { path: self.path, line, name, known });
                };
                ids.push(id);
            }
            self.material.into_iter().map(|index| ids[index]).collect()
        };
        Ok(ParticleSet {
            position: self.position,
            radius: self.radius,
            material,
            velocity: self.velocity,
            spin: self.spin,
        })
    }
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

/// Which column holds what.
struct Layout {
    width: usize,
    position: [usize; 3],
    radius: usize,
    velocity: Option<[usize; 3]>,
    spin: Option<[usize; 3]>,
    material: Option<usize>,
    ignored: Vec<String>,
}

impl Default for Layout {
    fn default() -> Self {
        Self {
            width: 4,
            position: [0, 1, 2],
            radius: 3,
            velocity: None,
            spin: None,
            material: None,
            ignored: Vec::new(),
        }
    }
}

impl Layout {
    fn new(path: &Path, line: u64, header: &csv::StringRecord) -> Result<Self, ParticleError> {
        let heading = |field: &str| field.trim_start_matches('#').trim().to_owned();
        let found: Vec<String> = header.iter().map(heading).collect();
        let find = |name: &str| found.iter().position(|n| n.eq_ignore_ascii_case(name));
        for (index, name) in found.iter().enumerate() {
            if is_known(name) && find(name) != Some(index) {
                return Err(ParticleError::TwiceColumn { path: path.into(), line, name: name.clone() });
            }
        }
        let need = |missing: &'static str| {
            find(missing).ok_or_else(|| {
                let found = found.iter().map(|name| format!("`{name}`")).collect();
                ParticleError::MissingColumn { path: path.into(), line, missing, found }
            })
        };
        let group = |[a, b, c]: [&'static str; 3]| Ok([need(a)?, need(b)?, need(c)?]);
        let optional = |names: [&'static str; 3]| {
            names.iter().any(|name| find(name).is_some()).then(|| group(names)).transpose()
        };
        Ok(Self {
            width: found.len(),
            position: group(POSITION)?,
            radius: need(RADIUS)?,
            velocity: optional(VELOCITY)?,
            spin: optional(SPIN)?,
            material: find(MATERIAL),
            ignored: found.iter().filter(|name| !is_known(name)).cloned().collect(),
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
    fn number(&self, column: usize, name: &'static str) -> Result<f64, ParticleError> {
        match self.fields[column].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(self.fault(column, name, "is not finite")),
            Err(_) => Err(self.fault(column, name, "is not a number")),
        }
    }

    fn vector(&self, columns: [usize; 3], names: [&'static str; 3]) -> Result<Vec3, ParticleError> {
        let component = |k: usize| self.number(columns[k], names[k]);
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
