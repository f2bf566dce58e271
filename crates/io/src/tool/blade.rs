//! A plate across the travel.

use glebe_engine::spec::TriMesh;

use super::{ToolError, check_range, divisions, sheet, with_mirror_image};
use crate::mesh::assemble;

/// A flat plate across the travel, such as a bulldozer's blade or a test wall: upright, or inclined by its rake. The
/// lower edge of its front is the origin's x and z, its middle y = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blade {
    /// Along y \[m\], 0.001 to 100.
    pub width: f64,
    /// Along z \[m\], 0.001 to 100.
    pub height: f64,
    /// Across the plate \[m\], 0.0001 to 100.
    pub thickness: f64,
    /// Between the ground ahead and the front \[deg\], 10 to 170: 90 is upright, less leans the upper edge back, so
    /// that the blade lifts what it meets.
    pub rake_angle: f64,
    /// Length that no line of the mesh's grid exceeds (diagonals are longer) \[m\]: 1/500 to 1 times the
    /// longest side.
    pub resolution: f64,
}

impl Default for Blade {
    fn default() -> Self {
        Self { width: 0.3, height: 0.3, thickness: 0.01, rake_angle: 90.0, resolution: 0.05 }
    }
}

impl Blade {
    /// The blade as a closed mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        let range =
            |name, value, unit, limits, reason| check_range("blade", name, value, unit, limits, reason);
        range("width", self.width, "m", [1e-3, 100.0], "size of a tool")?;
        range("height", self.height, "m", [1e-3, 100.0], "size of a tool")?;
        range("thickness", self.thickness, "m", [1e-4, 100.0], "size of a tool")?;
        range("rake_angle", self.rake_angle, "deg", [10.0, 170.0], "90 deg is upright")?;
        let sine = self.rake_angle.to_radians().sin();
        let slant = self.height / sine;
        let longest = self.width.max(slant).max(self.thickness);
        let reason = "the longest side divided by 1 to 500";
        range("resolution", self.resolution, "m", [longest / 500.0, longest], reason)?;

        let grid = |end, length| divisions(end, length, self.resolution);
        // The ends of the plate are level.
        let level = self.thickness / sine;
        let (x, y) = (grid(level, level), grid(0.5 * self.width, 0.5 * self.width));
        let z = grid(self.height, slant);
        let (rear, side, top) = (x.len() - 1, y.len() - 1, z.len() - 1);
        let lean = (90.0 - self.rake_angle).to_radians().tan();
        let at = |i: usize, j: usize, k: usize| [-x[i] - lean * z[k], y[j], z[k]];
        let mut half = Vec::new();
        sheet(&mut half, 0..side, 0..top, |j, k| at(0, j, k));
        sheet(&mut half, 0..top, 0..side, |k, j| at(rear, j, k));
        sheet(&mut half, 0..rear, 0..top, |i, k| at(i, side, k));
        sheet(&mut half, 0..rear, 0..side, |i, j| at(i, j, 0));
        sheet(&mut half, 0..side, 0..rear, |j, i| at(i, j, top));
        Ok(assemble(&with_mirror_image(half)).0)
    }
}
