//! The rotating drum in which a bed flows.

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

use glebe_engine::generate::{FillRequest, Region, solid_volume};
use glebe_engine::spec::{Domain, Motion, Pose, Rotation, Shape, Side, Surface, Vec3};
use glebe_io::tool::{self, ToolError};

use super::bed::GRAVITY;

/// ω²R/g: the grains roll and cascade down a surface that stays inclined.
pub const FROUDE: f64 = 0.1;
/// Flat pieces of the shell.
const SEGMENTS: u32 = 90;
/// Solid fraction of the cloud in the square beam inscribed into the drum. When it has fallen to a solid
/// fraction of 0.57 it fills 0.49 of the drum.
const CLOUD: f64 = 0.44;
/// Time over which the flow develops, over that in which the drum turns by a radian \[-\].
const DEVELOP: f64 = 3.0;
/// Its axis.
const AXIS: Vec3 = [0.0, 1.0, 0.0];

/// A drum about y, centred at the origin and as long as it is wide, closed at both ends, which turn with it.
#[derive(Clone, Copy, Debug)]
pub struct Drum {
    /// Inner radius \[m\].
    pub radius: f64,
}

impl Drum {
    /// The drum that spheres of these radii fill about half.
    pub fn about_half_full_of(radii: &[f64]) -> Self {
        let beam = Self { radius: 1.0 }.beam();
        Self { radius: (solid_volume(radii) / (CLOUD * beam.volume())).cbrt() }
    }

    /// Where the cloud is that falls at the start.
    fn beam(self) -> Region {
        // The shell's flat pieces come nearer to the axis than their edges do.
        let half = FRAC_1_SQRT_2 * (PI / f64::from(SEGMENTS)).cos() * self.radius;
        Region::walled([-half, -self.radius, -half], [half, self.radius, half])
    }

    /// The request for the cloud's places.
    pub fn cloud(self, radii: &[f64], seed: u64) -> FillRequest<'_> {
        FillRequest { solid_fraction: Some(CLOUD), ..FillRequest::new(self.beam(), radii, seed) }
    }

    /// Inner length \[m\].
    pub fn length(self) -> f64 {
        2.0 * self.radius
    }

    /// Angular velocity \[rad/s\].
    pub fn rate(self) -> f64 {
        (FROUDE * GRAVITY / self.radius).sqrt()
    }

    /// Angular velocity as a vector \[rad/s\].
    pub fn spin(self) -> Vec3 {
        AXIS.map(|a| a * self.rate())
    }

    /// Time after which the grains flow steadily \[s\].
    pub fn develop(self) -> f64 {
        DEVELOP / self.rate()
    }

    /// The space around it. Nothing should ever get there.
    pub fn domain(self) -> Domain {
        let half = 1.25 * self.radius;
        Domain::aligned([-half; 3], [half; 3], [[Side::Open; 2]; 3], None)
    }

    /// The drum, turning.
    pub fn surface(self) -> Result<Surface, ToolError> {
        let drum =
            tool::Drum { axis: AXIS, segments: SEGMENTS, ..tool::Drum::smooth(self.radius, self.length()) };
        let mesh = drum.mesh()?;
        let rotation = Rotation { axis: AXIS, center: [0.0; 3], rate: self.rate() };
        Ok(Surface {
            name: "drum".to_owned(),
            material: 0,
            shape: Shape::Mesh(Arc::new(mesh)),
            pose: Pose::default(),
            motion: Motion { rotation: Some(rotation), ..Motion::default() },
            absent: false,
        })
    }
}
