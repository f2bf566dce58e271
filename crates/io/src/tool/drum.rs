//! A drum.

use glebe_engine::lattice::{cross, norm};
use glebe_engine::spec::{TriMesh, Vec3};

use super::finned::{Around, body};
use super::{SEGMENTS_MAX, ToolError, check_range};
use crate::mesh::assemble;

/// A cylinder shell about an axis, centred at the origin, with straight lifters inside or without. Closed ends turn
/// with it. What it encloses is what is left inside of the shell, and normals point away from that.
///
/// The shell's flat pieces touch the cylinder of `radius` from inside at their edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drum {
    /// Inner radius \[m\], 0.0001 to 10 000.
    pub radius: f64,
    /// Along the axis \[m\], 0.0001 to 10 000.
    pub length: f64,
    /// Unit vector of its axis.
    pub axis: Vec3,
    /// Flat pieces of the shell, 3 to 100 000; there is at least one between two lifters.
    pub segments: u32,
    /// Whether its ends are closed.
    pub ends: bool,
    /// How many lifters; 0 for a smooth drum.
    pub lifters: u32,
    /// How far they stand inwards from the shell \[m\], up to 90 % of the radius.
    pub lifter_height: f64,
    /// Along the shell \[m\].
    pub lifter_thickness: f64,
}

impl Drum {
    /// A closed drum of `radius` and `length` \[m\] about y, without lifters.
    pub fn smooth(radius: f64, length: f64) -> Self {
        Self {
            radius,
            length,
            axis: [0.0, 1.0, 0.0],
            segments: 72,
            ends: true,
            lifters: 0,
            lifter_height: 0.0,
            lifter_thickness: 0.0,
        }
    }

    /// The drum as a mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        let range =
            |name, value, unit, limits, reason| check_range("drum", name, value, unit, limits, reason);
        range("radius", self.radius, "m", [1e-4, 1e4], "size of a drum")?;
        range("length", self.length, "m", [1e-4, 1e4], "size of a drum")?;
        range("segments", f64::from(self.segments), "pieces", [3.0, SEGMENTS_MAX], "flat pieces around")?;
        let mut radii = [self.radius; 2];
        if self.lifters > 0 {
            range("lifters", f64::from(self.lifters), "pieces", [2.0, 1e4], "0 makes a smooth drum")?;
            let least = 1e-4 * self.radius;
            let reason = "up to 90 % of the radius";
            range("lifter_height", self.lifter_height, "m", [least, 0.9 * self.radius], reason)?;
            radii[0] -= self.lifter_height;
            let most = Around::thickest(self.lifters, radii[0]);
            let reason = "a tenth of the circle of their edges must be left between the lifters";
            range("lifter_thickness", self.lifter_thickness, "m", [least, most], reason)?;
        }
        let around = Around::new(self.lifters, self.lifter_thickness, self.segments);
        // Any vector that is not along the axis gives two directions across it.
        let least = (0..3).min_by(|a, b| self.axis[*a].abs().total_cmp(&self.axis[*b].abs()));
        let mut other = [0.0; 3];
        other[least.unwrap_or(0)] = 1.0;
        let aside = cross(other, self.axis);
        let u = aside.map(|x| x / norm(aside));
        let v = cross(self.axis, u);
        let soup = body(
            around,
            radii,
            1,
            [self.ends; 2],
            |cell, _| self.lifters > 0 && !around.is_fin(cell),
            |angle, radius, level| {
                let (sin, cos) = angle.sin_cos();
                let along = (level as f64 - 0.5) * self.length;
                [0, 1, 2].map(|k| radius * (cos * u[k] + sin * v[k]) + along * self.axis[k])
            },
        );
        Ok(assemble(&soup).0)
    }
}
