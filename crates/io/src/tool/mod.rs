//! Tools by parameters: closed meshes with normals pointing outwards.
//!
//! A tool stands in its own frame: x is the direction of travel and z is up. Sweeps, blades and wheels are symmetric
//! about y = 0; their meshes are mirror images of themselves about that plane, triangle by triangle, so that a side
//! force never comes from the mesh.

mod blade;
mod drum;
mod finned;
mod mixer;
mod plough;
mod sweep;
mod wheel;

use std::ops::Range;

use glebe_engine::spec::{TriMesh, Vec3};
use thiserror::Error;

use crate::mesh::Corners;

pub use self::blade::Blade;
pub use self::drum::Drum;
pub use self::mixer::Mixer;
pub use self::plough::Plough;
pub use self::sweep::Sweep;
pub use self::wheel::Wheel;

/// Most flat pieces around an axis.
const SEGMENTS_MAX: f64 = 1e5;

/// A tool of any kind.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Tool {
    /// A cultivator sweep.
    Sweep(Sweep),
    /// A plate across the travel.
    Blade(Blade),
    /// Share and mouldboard of a plough.
    Plough(Plough),
    /// A wheel, with grousers or without.
    Wheel(Wheel),
    /// A drum, with lifters or without.
    Drum(Drum),
    /// Blades on a shaft.
    Mixer(Mixer),
}

impl Tool {
    /// The tool as a mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        match self {
            Self::Sweep(tool) => tool.mesh(),
            Self::Blade(tool) => tool.mesh(),
            Self::Plough(tool) => tool.mesh(),
            Self::Wheel(tool) => tool.mesh(),
            Self::Drum(tool) => tool.mesh(),
            Self::Mixer(tool) => tool.mesh(),
        }
    }
}

/// A parameter outside of its range.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "{tool}: {name} = {} {unit} is not allowed; it must lie between {} and {} {unit} ({reason})",
    as_written(*.value), limit(*.min), limit(*.max)
)]
#[non_exhaustive]
pub struct ToolError {
    /// Kind of the tool.
    pub tool: &'static str,
    /// Name of the parameter.
    pub name: &'static str,
    /// What was given.
    pub value: f64,
    /// Unit of the three numbers.
    pub unit: &'static str,
    /// Least allowed value, with the other parameters as they are.
    pub min: f64,
    /// Greatest allowed value, with the other parameters as they are.
    pub max: f64,
    /// What the range comes from.
    pub reason: &'static str,
}

/// A number without what turning degrees into radians and back has added to it.
fn as_written(x: f64) -> f64 {
    format!("{x:.12e}").parse().unwrap_or(x)
}

/// An end of a range.
fn limit(x: f64) -> String {
    if x != 0.0 && x.abs() < 1e-3 { format!("{x:.1e}") } else { format!("{x:.4}") }
}

fn check_range(
    tool: &'static str,
    name: &'static str,
    value: f64,
    unit: &'static str,
    [min, max]: [f64; 2],
    reason: &'static str,
) -> Result<(), ToolError> {
    if min <= value && value <= max {
        return Ok(());
    }
    Err(ToolError { tool, name, value, unit, min, max, reason })
}

/// `0 ..= end` in equal parts, so many that `length` divided by them is at most `h`.
fn divisions(end: f64, length: f64, h: f64) -> Vec<f64> {
    // A part in 10⁹ more is rounding, not a reason for another cell.
    let n = (length / h * (1.0 - 1e-9)).ceil().max(1.0) as usize;
    (0..=n).map(|i| end * (i as f64 / n as f64)).collect()
}

/// Adds the cells of a grid of points, each as two triangles cut along the shorter diagonal. Their
/// normals point along (direction of the first index) × (direction of the second).
fn sheet(
    soup: &mut Vec<Corners>,
    first: Range<usize>,
    second: Range<usize>,
    at: impl Fn(usize, usize) -> Vec3,
) {
    for u in first {
        for v in second.clone() {
            let [a, b, c, d] = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)];
            let distance = |p: Vec3, q: Vec3| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
            if distance(a, c) <= distance(b, d) {
                soup.extend([[a, b, c], [a, c, d]]);
            } else {
                soup.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
}

/// The half at y ≥ 0 together with its image at y ≤ 0, wound the other way round.
fn with_mirror_image(mut half: Vec<Corners>) -> Vec<Corners> {
    let image = half.iter().map(|&[a, b, c]| [a, c, b].map(|[x, y, z]| [x, -y, z])).collect::<Vec<_>>();
    half.extend(image);
    half
}
