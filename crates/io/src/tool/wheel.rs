//! A wheel.

use glebe_engine::spec::TriMesh;

use super::finned::{Around, body};
use super::{SEGMENTS_MAX, ToolError, check_range, with_mirror_image};
use crate::mesh::assemble;

/// A rigid wheel about y, with straight grousers or without. Its centre is the origin; a positive rate about y rolls
/// it forward.
///
/// Its volume is that of a prism of `width`: the polygon of the rim, and `grousers` times a rectangle of
/// `grouser_thickness` and about `grouser_height`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wheel {
    /// Of the rim, without grousers \[m\], 0.001 to 100.
    pub radius: f64,
    /// Along y \[m\], 0.001 to 100.
    pub width: f64,
    /// How many grousers; 0 for a smooth wheel.
    pub grousers: u32,
    /// How far they stand out from the rim \[m\], up to the radius.
    pub grouser_height: f64,
    /// Along the rim \[m\].
    pub grouser_thickness: f64,
    /// Flat pieces of the rim, 3 to 100 000; there is at least one between two grousers.
    pub segments: u32,
}

impl Default for Wheel {
    fn default() -> Self {
        Self {
            radius: 0.15,
            width: 0.16,
            grousers: 24,
            grouser_height: 0.01,
            grouser_thickness: 0.003,
            segments: 72,
        }
    }
}

impl Wheel {
    /// The wheel as a closed mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        let range =
            |name, value, unit, limits, reason| check_range("wheel", name, value, unit, limits, reason);
        range("radius", self.radius, "m", [1e-3, 100.0], "size of a tool")?;
        range("width", self.width, "m", [1e-3, 100.0], "size of a tool")?;
        range("segments", f64::from(self.segments), "pieces", [3.0, SEGMENTS_MAX], "flat pieces around")?;
        if self.grousers > 0 {
            range("grousers", f64::from(self.grousers), "pieces", [2.0, 1e4], "0 makes a smooth wheel")?;
            let least = 1e-4 * self.radius;
            range("grouser_height", self.grouser_height, "m", [least, self.radius], "up to the radius")?;
            let most = Around::thickest(self.grousers, self.radius);
            let reason = "a tenth of the rim must be left between the grousers";
            range("grouser_thickness", self.grouser_thickness, "m", [least, most], reason)?;
        }
        let around = Around::new(self.grousers, self.grouser_thickness, self.segments);
        let radii = [self.radius, self.radius + self.grouser_height];
        let half = body(
            around,
            radii,
            1,
            [false, true],
            |cell, _| around.is_fin(cell),
            |angle, radius, level| {
                [radius * angle.sin(), 0.5 * self.width * level as f64, radius * angle.cos()]
            },
        );
        Ok(assemble(&with_mirror_image(half)).0)
    }
}
