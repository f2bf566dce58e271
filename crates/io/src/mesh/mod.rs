//! Triangle meshes: STL, PLY (each as text or binary) and OBJ in, STL out.
//!
//! Files that people draw are rarely clean, so reading has three steps: a parser per
//! format gives loose triangles, [`Transform`] places them in metres, and one assembly
//! step (shared with [`crate::tool`]) welds vertices, drops what the contact geometry cannot use and
//! counts what is wrong into a [`MeshReport`].
//!
//! The parsers are our own because errors must name the line, the facet or the byte, and no
//! allocation may follow a number that a damaged header claims.

mod assemble;
mod error;
mod obj;
mod ply;
mod polygon;
mod report;
mod stl;
mod transform;

use std::{io, path::Path};

use glebe_engine::spec::{TriMesh, Vec3};

use crate::input;

pub(crate) use assemble::assemble;
pub use error::{MeshError, Place, TransformError};
pub use report::MeshReport;
pub use stl::{StlFormat, write_stl};
pub use transform::Transform;

/// Corners of one triangle \[m\], counter-clockwise seen from outside.
pub(crate) type Corners = [Vec3; 3];

/// Reads the mesh file `path` (`.stl`, `.ply` or `.obj`, in any case) and applies `transform`.
///
/// Vertices that are equal, or closer than 1e-7 of the longest side of the bounding box, become one;
/// degenerate triangles (height below 1e-6 of the longest edge, where an `f32` normal is rounding
/// noise) and repeated triangles (same three vertices, either winding: each would push a particle
/// again) are left out. All of that is counted in the report. Winding is reported, not repaired:
/// both sides of a mesh act on particles.
///
/// Polygons are cut into triangles; they need be neither convex nor quite flat. Units are those of the file
/// times `transform.scale`: no format says which they are.
///
/// # Errors
/// A file that is missing, unreadable, of another kind, cut short, malformed, or without a usable
/// triangle; coordinates or a transform that are not finite numbers. The message names the place.
pub fn read(path: &Path, transform: &Transform) -> Result<(TriMesh, MeshReport), MeshError> {
    // Before the file, which may be large.
    format(path)?;
    let bytes = input::read(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => MeshError::Missing { path: path.into() },
        _ => MeshError::Read { path: path.into(), source },
    })?;
    parse(path, &bytes, transform)
}

/// Like [`read`], of the `bytes` of the file called `path`.
///
/// # Errors
/// As [`read`], but for those of the system.
pub fn parse(path: &Path, bytes: &[u8], transform: &Transform) -> Result<(TriMesh, MeshReport), MeshError> {
    let at_fault = |source| MeshError::Transform { path: path.into(), source };
    let place = transform.compile().map_err(at_fault)?;
    let mut soup = format(path)?(path, bytes)?;
    place.apply(&mut soup).map_err(at_fault)?;
    // Three vertices a triangle must fit into u32 indices.
    if soup.len() > (u32::MAX / 3) as usize {
        return Err(MeshError::TooLarge { path: path.into(), triangles: soup.len() });
    }
    let (mesh, report) = assemble(&soup);
    if mesh.triangles.is_empty() {
        return Err(MeshError::NoTriangles { path: path.into(), degenerate: report.degenerate });
    }
    Ok((mesh, report))
}

type Parser = fn(&Path, &[u8]) -> Result<Vec<Corners>, MeshError>;

/// What reads files of this name.
fn format(path: &Path) -> Result<Parser, MeshError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    match extension.as_str() {
        "stl" => Ok(stl::parse),
        "ply" => Ok(ply::parse),
        "obj" => Ok(obj::parse),
        _ => Err(MeshError::Extension { path: path.into(), found: extension }),
    }
}

/// Number, from 1, of the last line of a text that is not blank.
fn last_line(text: &[u8]) -> usize {
    text.trim_ascii_end().split(|b| *b == b'\n').count()
}
