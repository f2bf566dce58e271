//! What can be wrong with a mesh file.

use std::{fmt, io, path::PathBuf};

use thiserror::Error;

/// Why a mesh could not be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// There is no such file.
    #[error("mesh file `{}` does not exist: check the name and the folder", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file exists but cannot be read.
    #[error("cannot read mesh file `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write mesh file `{}`: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The name does not end in a known format.
    #[error("mesh file `{}`: unknown format `.{found}`; known are .stl, .ply (each ASCII or binary) and .obj", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// Its extension in lower case, empty if none.
        found: String,
    },
    /// The file ends in the middle of something.
    #[error("mesh file `{}` is cut short: it ends at {place}, {what}; copy or export it again", path.display())]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Where it ends.
        place: Place,
        /// What was not finished.
        what: String,
    },
    /// A binary STL file is not as long as its triangle count says.
    #[error(
        "mesh file `{}`: a binary STL of {claimed} triangles takes {expected} bytes, but the file has {found}; \
         it is {}: copy or export it again",
        path.display(),
        if found < expected { "cut short" } else { "damaged, or followed by something else" }
    )]
    Length {
        /// The file.
        path: PathBuf,
        /// Triangle count in its header.
        claimed: u32,
        /// Bytes that this count needs.
        expected: u64,
        /// Bytes that there are.
        found: u64,
    },
    /// A line that the format does not allow.
    #[error("mesh file `{}`, line {line}: expected {expected}, found `{found}`", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What would have been right.
        expected: &'static str,
        /// The beginning of what stands there.
        found: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("mesh file `{}`, {place}: a coordinate is {value}; vertices need finite numbers: repair or export the mesh again", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Where.
        place: Place,
        /// The value.
        value: f64,
    },
    /// An OBJ face names a vertex that does not exist.
    #[error(
        "mesh file `{}`, line {line}: a face names vertex {index}, but {}",
        path.display(),
        match vertices {
            0 => "the file has no vertices".to_owned(),
            n if *index < 0 => format!("only {n} stand before it"),
            n => format!("the file has vertices 1 to {n}"),
        }
    )]
    FaceIndex {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The index as written: from 1, or negative counting back.
        index: i64,
        /// Vertices it may choose from.
        vertices: usize,
    },
    /// A PLY face names a vertex that does not exist.
    #[error(
        "mesh file `{}`, {place}: a face names vertex {index}, but {}",
        path.display(),
        match vertices {
            0 => "no vertices stand before it".to_owned(),
            n => format!("the file has vertices 0 to {}", n - 1),
        }
    )]
    VertexIndex {
        /// The file.
        path: PathBuf,
        /// Where the face ends.
        place: Place,
        /// The number as written, from 0.
        index: f64,
        /// Vertices it may choose from.
        vertices: usize,
    },
    /// A face too complicated to be cut into triangles.
    #[error(
        "mesh file `{}`, {place}: a face of {corners} corners is not convex; cut it into triangles where it was drawn",
        path.display()
    )]
    Polygon {
        /// The file.
        path: PathBuf,
        /// Where the face ends.
        place: Place,
        /// Its corners.
        corners: usize,
    },
    /// Nothing to collide with.
    #[error(
        "mesh file `{}` has no triangles{}",
        path.display(),
        match degenerate {
            0 => String::new(),
            n => format!(" left: all {n} are degenerate (no area)"),
        }
    )]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// Triangles that were left out.
        degenerate: usize,
    },
    /// More triangles than 32-bit indices can address.
    #[error("mesh file `{}` has {triangles} triangles, more than 1.4e9: reduce it", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// How many it has.
        triangles: usize,
    },
    /// The transform cannot be applied.
    #[error("mesh file `{}`: {source}", path.display())]
    Transform {
        /// The file.
        path: PathBuf,
        /// Why.
        source: TransformError,
    },
    /// A mesh in memory cannot be written.
    #[error("cannot write mesh file `{}`: triangle {triangle} {what}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Index of the triangle, from 0.
        triangle: usize,
        /// What is wrong with it.
        what: &'static str,
    },
}

/// A place in a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line of a text file, from 1.
    Line(usize),
    /// Facet of a binary STL file, from 1, and its first byte, from 0.
    Facet(usize, usize),
    /// Byte of a file, from 0.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Facet(facet, byte) => write!(f, "facet {facet} (byte {byte})"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// Why a [`Transform`](super::Transform) cannot be applied.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum TransformError {
    /// Zero, NaN or infinite scale.
    #[error("scale {0:?} flattens the mesh or is not a number; each factor must be finite and not 0")]
    Scale([f64; 3]),
    /// A rotation without a direction.
    #[error("rotation {0:?} has no direction; it needs an axis (or quaternion) that is finite and not all 0")]
    Rotation([f64; 4]),
    /// NaN or infinite translation.
    #[error("translation {0:?} must be finite numbers [m]")]
    Translation([f64; 3]),
    /// Coordinates too large for f64 arithmetic.
    #[error("the transformed mesh reaches beyond 1e100 m; check its unit and scale")]
    Overflow,
}
