//! Curves that were measured, from CSV.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::input;
use crate::sheet::{Header, Row, Rows, SheetError};
use crate::units::Dimension;

const KNOWN: &str = "those that the target names, each with a unit if need be, such as `force [kN]`";

/// Why a measured curve cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeasuredError {
    /// The file cannot be opened or read.
    #[error("cannot read the curve `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// It is not a table, or lacks a column.
    #[error("the curve `{}`{fault}", path.display())]
    Sheet {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: SheetError,
    },
    /// There are no two points in it.
    #[error(
        "the curve `{}` has {found} of the two lines or more that a curve needs below its headings, such as \
         `displacement [mm],force [kN]`",
        path.display()
    )]
    Short {
        /// The file.
        path: PathBuf,
        /// How many lines it has.
        found: usize,
    },
    /// Its abscissae do not ascend.
    #[error(
        "the curve `{}`, line {line}: `{x}` is {next} after {before}, and a curve goes on in it from line to line: sort \
         the lines, average those of equal `{x}`, or take another column, such as a time",
        path.display()
    )]
    Order {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// The heading.
        x: String,
        /// The abscissa before, in SI units.
        before: f64,
        /// That of this line.
        next: f64,
    },
    /// A scatter that is none.
    #[error("the curve `{}`, line {line}: the scatter is {value}; it must be more than 0", path.display())]
    Scatter {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// As it stands there.
        value: f64,
    },
}

/// Which columns of a file are read, by their headings without units, and what they hold.
#[derive(Clone, Copy, Debug)]
pub struct Headings<'a> {
    /// The abscissa.
    pub x: (&'a str, Dimension),
    /// The ordinate.
    pub y: (&'a str, Dimension),
    /// The scatter of the ordinate, if it stands in the file.
    pub scatter: Option<&'a str>,
}

/// A curve that was measured, in SI units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Abscissae, ascending.
    pub x: Vec<f64>,
    /// Ordinates.
    pub y: Vec<f64>,
    /// Their scatters, above 0; empty if they do not stand in the file.
    pub scatter: Vec<f64>,
}

/// Reads the file `path`: CSV whose first line has the headings, each with its unit if that is not the SI unit, as
/// `force [kN]`. Other columns are passed over.
///
/// # Errors
/// A file that cannot be read; columns that are missing or doubled; units of another kind; fewer than two lines; abscissae
/// that do not ascend; scatters that are not above 0. The message names the place.
pub fn read(path: &Path, headings: Headings<'_>) -> Result<Measured, MeasuredError> {
    let bytes = input::read(path).map_err(|source| MeasuredError::Read { path: path.into(), source })?;
    parse(path, &bytes, headings)
}

/// Like [`read`], of the `bytes` of the file called `path`.
///
/// # Errors
/// As [`read`], but for those of the system.
pub fn parse(path: &Path, bytes: &[u8], headings: Headings<'_>) -> Result<Measured, MeasuredError> {
    let text = String::from_utf8_lossy(bytes);
    let of_file = |fault: SheetError| MeasuredError::Sheet { path: path.into(), fault };
    let mut rows = Rows::new(&text);
    let short = |found| MeasuredError::Short { path: path.into(), found };
    let Some((line, first)) = rows.next().map_err(of_file)? else { return Err(short(0)) };
    let header = Header::new(line, &first, Vec::new(), KNOWN).map_err(of_file)?;
    let x = header.called(headings.x.0, "x", headings.x.1).map_err(of_file)?;
    let y = header.called(headings.y.0, "y", headings.y.1).map_err(of_file)?;
    let scatter = headings.scatter.map(|heading| header.called(heading, "scatter", headings.y.1));
    let scatter = scatter.transpose().map_err(of_file)?;
    let mut curve = Measured::default();
    while let Some((line, fields)) = rows.next().map_err(of_file)? {
        let row = Row::new(line, &fields, header.width()).map_err(of_file)?;
        let next = row.number(x).map_err(of_file)?;
        if let Some(&before) = curve.x.last().filter(|before| **before >= next) {
            let (path, x) = (path.into(), headings.x.0.to_owned());
            return Err(MeasuredError::Order { path, line, x, before, next });
        }
        curve.x.push(next);
        curve.y.push(row.number(y).map_err(of_file)?);
        if let Some(scatter) = scatter {
            let value = row.number(scatter).map_err(of_file)?;
            if value <= 0.0 {
                return Err(MeasuredError::Scatter { path: path.into(), line, value });
            }
            curve.scatter.push(value);
        }
    }
    if curve.x.len() < 2 { Err(short(curve.x.len())) } else { Ok(curve) }
}
