//! Motions from files: tables of poses over time.

use std::io;
use std::path::{Path, PathBuf};

use glebe_engine::poses::{PoseTable, PoseTableError, TimedPose};
use glebe_engine::spec::{Pose, Vec3};
use glebe_engine::surface::quaternion;
use thiserror::Error;

use crate::input;
use crate::sheet::{Column, Header, Meaning, Row, Rows, SheetError};
use crate::units::Dimension;

const fn column(name: &'static str, dimension: Dimension) -> Meaning {
    Meaning { name, others: &[], dimension }
}

static TIME: Meaning = Meaning { name: "time", others: &["t"], dimension: Dimension::TIME };
static POSITION: [Meaning; 3] =
    [column("x", Dimension::LENGTH), column("y", Dimension::LENGTH), column("z", Dimension::LENGTH)];
static QUATERNION: [Meaning; 4] = [
    column("qw", Dimension::NONE),
    column("qx", Dimension::NONE),
    column("qy", Dimension::NONE),
    column("qz", Dimension::NONE),
];
static VECTOR: [Meaning; 3] =
    [column("rx", Dimension::ANGLE), column("ry", Dimension::ANGLE), column("rz", Dimension::ANGLE)];
const KNOWN: &str = "time, x, y, z (needed) and qw, qx, qy, qz or rx, ry, rz, each with a unit if need be, such as \
                     `x [mm]`";

/// Why a table of poses could not be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PoseFileError {
    /// The file cannot be opened or read.
    #[error("cannot read pose table `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is nothing in it.
    #[error("pose table `{}` is empty: it needs a header such as `time,x,y,z` and two lines or more", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// It is not a table.
    #[error("pose table `{}`{fault}", path.display())]
    Sheet {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: SheetError,
    },
    /// It has two kinds of rotations.
    #[error(
        "pose table `{}`, line {line}: rotations as quaternions (qw, qx, qy, qz) and as vectors (rx, ry, rz): remove one",
        path.display()
    )]
    TwoRotations {
        /// The file.
        path: PathBuf,
        /// Line of the header.
        line: u64,
    },
    /// A column that means nothing. Unlike a particle's, a pose's number that is not used would be a mistake unheard.
    #[error("pose table `{}`, line {line}: no column is called `{heading}`; known are {KNOWN}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// Line of the header.
        line: u64,
        /// The heading.
        heading: String,
    },
    /// Its rows are no motion.
    #[error("pose table `{}`{}: {problem}", path.display(), line.map_or_else(String::new, |at| format!(", line {at}")))]
    Rows {
        /// The file.
        path: PathBuf,
        /// Line of the row concerned, from 1.
        line: Option<u64>,
        /// What is wrong.
        problem: PoseTableError,
    },
}

/// Reads the file `path`: CSV whose first line names the columns, in any order and case: `time` \[s\] (or `t`), `x`,
/// `y`, `z` \[m\], and optionally the rotation, as a quaternion `qw`, `qx`, `qy`, `qz` of any length but zero, or as a
/// vector `rx`, `ry`, `rz` \[rad\] along the axis and as long as the angle. A heading may give its unit, as `x [mm]`
/// or `rz (deg)`.
///
/// # Errors
/// A file that is missing, empty or not CSV; columns that are missing, doubled or unknown; a field that is not a finite
/// number; rows that are not a motion (see [`PoseTableError`]). The message names the place.
pub fn read(path: &Path) -> Result<PoseTable, PoseFileError> {
    let bytes = input::read(path).map_err(|source| PoseFileError::Read { path: path.into(), source })?;
    parse(path, &bytes)
}

/// Like [`read`], of the `bytes` of the file called `path`.
///
/// # Errors
/// As [`read`], but for those of the system.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<PoseTable, PoseFileError> {
    let text = String::from_utf8_lossy(bytes);
    let of_file = |fault: SheetError| PoseFileError::Sheet { path: path.into(), fault };
    let mut rows = Rows::new(&text);
    let Some((line, first)) = rows.next().map_err(of_file)? else {
        return Err(PoseFileError::Empty { path: path.into() });
    };
    let all = [&TIME].into_iter().chain(&POSITION).chain(&QUATERNION).chain(&VECTOR);
    let header = Header::new(line, &first, all.collect(), KNOWN).map_err(of_file)?;
    let layout = Layout::new(&header).map_err(of_file)?;
    if layout.quaternion.is_some() && layout.vector.is_some() {
        return Err(PoseFileError::TwoRotations { path: path.into(), line });
    }
    if let Some(heading) = header.unknown().into_iter().next() {
        return Err(PoseFileError::Unknown { path: path.into(), line, heading });
    }
    let (mut poses, mut lines) = (Vec::new(), Vec::new());
    while let Some((line, fields)) = rows.next().map_err(of_file)? {
        poses.push(layout.pose(&Row::new(line, &fields, header.width()).map_err(of_file)?).map_err(of_file)?);
        lines.push(line);
    }
    PoseTable::new(&poses).map_err(|problem| {
        let line = problem.row().and_then(|row| lines.get(row).copied());
        PoseFileError::Rows { path: path.into(), line, problem }
    })
}

/// Which column holds what.
struct Layout {
    time: Column,
    position: [Column; 3],
    quaternion: Option<[Column; 4]>,
    vector: Option<[Column; 3]>,
}

impl Layout {
    fn new(header: &Header<'_>) -> Result<Self, SheetError> {
        Ok(Self {
            time: header.need(&TIME)?,
            position: header.group(&POSITION)?,
            quaternion: header.optional(&QUATERNION)?,
            vector: header.optional(&VECTOR)?,
        })
    }

    fn pose(&self, row: &Row<'_>) -> Result<TimedPose, SheetError> {
        let rotation = match (&self.quaternion, &self.vector) {
            (Some(columns), _) => row.numbers(columns)?,
            (None, Some(columns)) => turn(row.numbers(columns)?),
            (None, None) => Pose::default().rotation,
        };
        let translation = row.numbers(&self.position)?;
        Ok(TimedPose { time: row.number(self.time)?, pose: Pose { translation, rotation } })
    }
}

/// The quaternion of a rotation vector.
fn turn(vector: Vec3) -> [f64; 4] {
    let angle = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    if angle == 0.0 { Pose::default().rotation } else { quaternion(vector.map(|x| x / angle), angle) }
}
