//! A mixer.

use glebe_engine::spec::TriMesh;

use super::finned::{Around, body};
use super::{ToolError, check_range, divisions};
use crate::mesh::assemble;

/// Most flat pieces of the shaft: there are as many in each layer of twisted blades.
const SEGMENTS_MAX: f64 = 360.0;

/// Most turn of a twisted blade from one of its levels to the next \[rad\].
const TWIST: f64 = 0.05;

/// Rows of blades on a shaft about z. The middle of the shaft's lower end is the origin.
///
/// Blades stand along radii and have parallel sides. With a pitch they are pieces of a helicoid, row above row on the
/// same helix: turning positively about z (counter-clockwise, seen from above), a positive pitch lifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mixer {
    /// Of the blades' tips \[m\], 0.001 to 100.
    pub radius: f64,
    /// Of the shaft \[m\], 1 to 90 % of `radius`.
    pub shaft_radius: f64,
    /// Of the shaft, along z \[m\], 0.001 to 50 times `radius`.
    pub shaft_length: f64,
    /// Blades in a row, 1 to 64.
    pub blades: u32,
    /// Of a blade, along z \[m\].
    pub blade_height: f64,
    /// Of a blade, across it seen from above \[m\].
    pub blade_thickness: f64,
    /// Inclination of the blades' tips from the axis \[deg\], -75 to 75.
    pub pitch: f64,
    /// Rows of blades, 1 to 1000.
    pub rows: u32,
    /// From the shaft's lower end to the lowest row \[m\].
    pub first_row: f64,
    /// From a row's lower edge to that of the next \[m\].
    pub row_spacing: f64,
    /// Flat pieces of the shaft, 3 to 360; there is at least one between two blades.
    pub segments: u32,
}

impl Default for Mixer {
    fn default() -> Self {
        Self {
            radius: 0.1,
            shaft_radius: 0.015,
            shaft_length: 0.3,
            blades: 4,
            blade_height: 0.04,
            blade_thickness: 0.006,
            pitch: 0.0,
            rows: 1,
            first_row: 0.0,
            row_spacing: 0.08,
            segments: 32,
        }
    }
}

impl Mixer {
    /// The mixer as a closed mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        self.check()?;
        let around = Around::new(self.blades, self.blade_thickness, self.segments);
        let (levels, bladed) = self.levels();
        let twist = self.pitch.to_radians().tan() / self.radius;
        let soup = body(
            around,
            [self.shaft_radius, self.radius],
            bladed.len(),
            [true; 2],
            |cell, layer| around.is_fin(cell) && bladed[layer],
            |angle, radius, level| {
                let (sin, cos) = (angle - twist * levels[level]).sin_cos();
                [radius * cos, radius * sin, levels[level]]
            },
        );
        Ok(assemble(&soup).0)
    }

    fn check(&self) -> Result<(), ToolError> {
        let range =
            |name, value, unit, limits, reason| check_range("mixer", name, value, unit, limits, reason);
        range("radius", self.radius, "m", [1e-3, 100.0], "size of a tool")?;
        let shaft = [0.01 * self.radius, 0.9 * self.radius];
        range("shaft_radius", self.shaft_radius, "m", shaft, "1 to 90 % of the radius")?;
        let length = [1e-3, 50.0 * self.radius];
        range("shaft_length", self.shaft_length, "m", length, "up to 50 times the radius")?;
        range("blades", f64::from(self.blades), "pieces", [1.0, 64.0], "blades in a row")?;
        range("segments", f64::from(self.segments), "pieces", [3.0, SEGMENTS_MAX], "flat pieces around")?;
        let least = 1e-3 * self.shaft_length;
        let reason = "up to the shaft's length";
        range("blade_height", self.blade_height, "m", [least, self.shaft_length], reason)?;
        let most = Around::thickest(self.blades, self.shaft_radius);
        let reason = "a tenth of the shaft's circle must be left between the blades";
        range("blade_thickness", self.blade_thickness, "m", [1e-3 * self.shaft_radius, most], reason)?;
        range("pitch", self.pitch, "deg", [-75.0, 75.0], "inclination of the blades")?;
        range("rows", f64::from(self.rows), "pieces", [1.0, 1e3], "rows of blades")?;
        let room = self.shaft_length - self.blade_height;
        range("first_row", self.first_row, "m", [0.0, room], "the lowest row must end on the shaft")?;
        if self.rows > 1 {
            let most = (room - self.first_row) / f64::from(self.rows - 1);
            let least = 1.01 * self.blade_height;
            let reason = "rows must not meet, and the last one must end on the shaft";
            range("row_spacing", self.row_spacing, "m", [least, most], reason)?;
        }
        Ok(())
    }

    /// Heights of the levels, and which layers between them have blades.
    fn levels(&self) -> (Vec<f64>, Vec<bool>) {
        let mut ends: Vec<(f64, bool)> = Vec::new();
        for row in 0..self.rows {
            let low = self.first_row + f64::from(row) * self.row_spacing;
            ends.extend([(low, false), (low + self.blade_height, true)]);
        }
        ends.push((self.shaft_length, false));
        // So high is a layer that turns by the most that is allowed.
        let finest = TWIST * self.radius / self.pitch.to_radians().tan().abs();
        let sliver = 1e-6 * self.shaft_length;
        let (mut levels, mut bladed) = (vec![0.0], Vec::new());
        for (end, has_blades) in ends {
            let begin = levels[levels.len() - 1];
            if end - begin > sliver {
                let layers = divisions(end - begin, end - begin, finest);
                levels.extend(layers[1..].iter().map(|z| begin + z));
                bladed.resize(levels.len() - 1, has_blades);
            }
        }
        (levels, bladed)
    }
}
