//! A cultivator sweep.

use glebe_engine::spec::{TriMesh, Vec3};

use super::{ToolError, check_range, divisions, sheet, with_mirror_image};
use crate::mesh::{Corners, assemble};

/// A cultivator sweep (goosefoot share): a V-shaped plate with sharpened leading edges, rising from
/// them to the rear, on an upright shank.
///
/// The point of the nose, its lowest, is the origin. The wings go backwards (-x) and outwards (±y) with
/// their leading edges on z = 0; their ends are cut along the travel; the shank rises from the middle.
/// Without a lean the bounding box is `[-length, 0] × [-width/2, width/2] × [0, shank_height]`.
///
/// The default has the size of the sweep in the GPUDEM paper (2024): 313 mm × 289 mm. Its other
/// measures are usual ones for such a tool; the paper does not give them.
///
/// ```
/// let sweep = glebe_io::tool::Sweep { lift_angle: 30.0, resolution: 0.01, ..Default::default() };
/// let mesh = sweep.mesh()?;
/// assert!(mesh.triangles.len() > 2000);
/// # Ok::<(), glebe_io::tool::ToolError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Between the ends of the wings, along y \[m\], 0.01 to 10.
    pub width: f64,
    /// From the nose to the rear of the wings, along x \[m\], 0.01 to 10.
    pub length: f64,
    /// Full angle between the leading edges, seen from above \[deg\], 20 to 150; at least so large that
    /// a wing end of 5 % of the length is left.
    pub sweep_angle: f64,
    /// Rise of the plate from its leading edges, measured across them \[deg\], 0 to 60.
    pub lift_angle: f64,
    /// Length of the plate on its middle line, along x \[m\]; up to `length`.
    pub body_length: f64,
    /// Thickness of the plate, across it \[m\].
    pub thickness: f64,
    /// Thickness left at the leading edges \[m\].
    pub edge_thickness: f64,
    /// Width of the ground strip along the leading edges over which the plate reaches its thickness,
    /// across them and seen from above \[m\].
    pub bevel: f64,
    /// Size of the shank along the travel \[m\].
    pub shank_width: f64,
    /// Size of the shank across the travel \[m\].
    pub shank_thickness: f64,
    /// Height of the shank's upper end above the leading edges \[m\].
    pub shank_height: f64,
    /// From the nose back to the front of the shank's foot \[m\].
    pub shank_setback: f64,
    /// Inclination of the shank \[deg\], -45 to 45; positive with its upper end forward.
    pub shank_lean: f64,
    /// Length aimed at for the lines of the mesh's grid \[m\], `length`/500 to `length`; the plate is one
    /// cell thick. The default sweep has 452 triangles at 50 mm, 4 484 at 12 mm and 16 432 at 6 mm.
    pub resolution: f64,
}

impl Default for Sweep {
    fn default() -> Self {
        Self {
            width: 0.313,
            length: 0.289,
            sweep_angle: 66.0,
            lift_angle: 25.0,
            body_length: 0.150,
            thickness: 0.006,
            edge_thickness: 0.0008,
            bevel: 0.010,
            shank_width: 0.050,
            shank_thickness: 0.020,
            shank_height: 0.400,
            shank_setback: 0.075,
            shank_lean: 0.0,
            resolution: 0.012,
        }
    }
}

impl Sweep {
    /// The sweep as a closed mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        self.check()?;
        Ok(assemble(&Plan::new(self).build()).0)
    }

    fn check(&self) -> Result<(), ToolError> {
        let range = |name, value, unit, [min, max]: [f64; 2], reason| {
            check_range("sweep", name, value, unit, [min, max], reason)
        };
        range("width", self.width, "m", [0.01, 10.0], "size of a tool")?;
        range("length", self.length, "m", [0.01, 10.0], "size of a tool")?;
        let half = 0.5 * self.width;
        let sharpest = 2.0 * (half / (0.95 * self.length)).atan().to_degrees();
        let reason = "leading edges must reach the width within 95 % of the length";
        range("sweep_angle", self.sweep_angle, "deg", [sharpest.max(20.0), 150.0], reason)?;
        range("lift_angle", self.lift_angle, "deg", [0.0, 60.0], "rise of the plate")?;
        range("body_length", self.body_length, "m", [0.1 * self.length, self.length], "up to the length")?;

        let (sin, tan) = (self.half_angle().sin(), self.half_angle().tan());
        let wing_end = self.length - half / tan;
        let narrowest = sin * wing_end.min(self.body_length);
        let least = 1e-4 * self.width;
        range("thickness", self.thickness, "m", [least, 0.2 * self.width], "up to a fifth of the width")?;
        let reason = "up to the thickness";
        range("edge_thickness", self.edge_thickness, "m", [least, self.thickness], reason)?;
        let reason = "up to 80 % of the plate where it is narrowest";
        range("bevel", self.bevel, "m", [least, 0.8 * narrowest], reason)?;

        let reason = "up to half of the width";
        range("shank_thickness", self.shank_thickness, "m", [0.01 * self.width, half], reason)?;
        let gap = 0.01 * self.length;
        let front = 0.5 * self.shank_thickness / tan + self.bevel / sin + gap;
        let rear = self.body_length - gap;
        let reason = "the shank's foot must stand on the plate behind the bevel";
        range("shank_setback", self.shank_setback, "m", [front, rear - gap], reason)?;
        let reason = "the shank's foot must end before the plate";
        range("shank_width", self.shank_width, "m", [gap, rear - self.shank_setback], reason)?;
        let foot = self.plate_top((self.shank_setback + self.shank_width) * sin);
        let reason = "above the plate";
        range("shank_height", self.shank_height, "m", [foot + gap, 20.0 * self.length], reason)?;
        range("shank_lean", self.shank_lean, "deg", [-45.0, 45.0], "inclination of the shank")?;
        let reason = "the length divided by 1 to 500";
        range("resolution", self.resolution, "m", [self.length / 500.0, self.length], reason)
    }

    /// Between a leading edge and the middle line, seen from above \[rad\].
    fn half_angle(&self) -> f64 {
        0.5 * self.sweep_angle.to_radians()
    }

    /// Where the profile at `y` ≥ 0 changes, from front to rear \[m\]: leading edge, end of the bevel,
    /// front and rear of the shank's foot, trailing edge. Beside the foot its two lines run on to a third
    /// and two thirds of the wing's end.
    fn breaks(&self, y: f64) -> [f64; 5] {
        let (half, half_foot) = (0.5 * self.width, 0.5 * self.shank_thickness);
        let profile = |y: f64| {
            let front = -y / self.half_angle().tan();
            let rear = -self.body_length - (self.length - self.body_length) * (y / half);
            (front, front - self.bevel / self.half_angle().sin(), rear)
        };
        let (front, bevel, rear) = profile(y);
        let foot = [self.shank_setback, self.shank_setback + self.shank_width].map(|x| -x);
        if y <= half_foot {
            return [front, bevel, foot[0], foot[1], rear];
        }
        let (_, bevel_beside, rear_beside) = profile(half_foot);
        let outwards = (y - half_foot) / (half - half_foot);
        let run_on = |x: f64, end: f64| {
            let beside = (x - bevel_beside) / (rear_beside - bevel_beside);
            bevel + (beside + (end - beside) * outwards) * (rear - bevel)
        };
        [front, bevel, run_on(foot[0], 1.0 / 3.0), run_on(foot[1], 2.0 / 3.0), rear]
    }

    /// Height of the plate's lower face at the distance `d` behind the leading edge, across it \[m\].
    fn plate_bottom(&self, d: f64) -> f64 {
        d * self.lift_angle.to_radians().tan()
    }

    /// Height of the plate's upper face, likewise.
    fn plate_top(&self, d: f64) -> f64 {
        let ground = (d / self.bevel).min(1.0);
        let across = self.edge_thickness + (self.thickness - self.edge_thickness) * ground;
        self.plate_bottom(d) + across / self.lift_angle.to_radians().cos()
    }
}

/// The right half of a sweep as a grid: columns along the travel, at every `y` ≥ 0; rows from the
/// leading edge to the rear. The shank's foot is a block of its cells, whatever the resolution.
struct Plan<'a> {
    sweep: &'a Sweep,
    columns: Vec<f64>,
    /// The band between two breaks of the profile (see [`Sweep::breaks`]) and the position in it.
    rows: Vec<(usize, f64)>,
    /// Column at the outside of the shank's foot, rows at its front and rear.
    foot: (usize, usize, usize),
    /// Levels of the shank, from 0 to 1.
    levels: Vec<f64>,
}

impl<'a> Plan<'a> {
    fn new(sweep: &'a Sweep) -> Self {
        let h = sweep.resolution;
        let (half, half_foot) = (0.5 * sweep.width, 0.5 * sweep.shank_thickness);
        let breaks = [0.0, half_foot, half].map(|y| sweep.breaks(y));

        // The grid lines that run outwards slant; the longer of the two edges counts.
        let slope = [0, 4].map(|k: usize| (breaks[2][k] - breaks[0][k]) / half);
        let stretch = slope.into_iter().map(|s| s.hypot(1.0)).fold(1.0, f64::max);
        let mut columns = divisions(half_foot, stretch * half_foot, h);
        let outside = columns.len() - 1;
        columns.extend(
            divisions(half - half_foot, stretch * (half - half_foot), h)[1..].iter().map(|y| half_foot + y),
        );

        let mut rows = vec![(0, 0.0)];
        let mut ends = [0; 4];
        for (band, end) in ends.iter_mut().enumerate() {
            let longest = breaks.iter().map(|b| b[band] - b[band + 1]).fold(0.0, f64::max);
            rows.extend(divisions(1.0, longest, h)[1..].iter().map(|t| (band, *t)));
            *end = rows.len() - 1;
        }
        let shank = sweep.shank_height / sweep.shank_lean.to_radians().cos();
        Self { sweep, columns, rows, foot: (outside, ends[1], ends[2]), levels: divisions(1.0, shank, h) }
    }

    /// The node of a column and a row on the lower or the upper face.
    fn plate(&self, column: usize, row: usize, upper: bool) -> Vec3 {
        let y = self.columns[column];
        let breaks = self.sweep.breaks(y);
        let (band, t) = self.rows[row];
        let x = breaks[band] * (1.0 - t) + breaks[band + 1] * t;
        let d = (breaks[0] - x) * self.sweep.half_angle().sin();
        [x, y, if upper { self.sweep.plate_top(d) } else { self.sweep.plate_bottom(d) }]
    }

    /// The node of the shank above a node of its foot.
    fn shank(&self, column: usize, row: usize, level: usize) -> Vec3 {
        let [x, y, z] = self.plate(column, row, true);
        let rise = (self.sweep.shank_height - z) * self.levels[level];
        [x + rise * self.sweep.shank_lean.to_radians().tan(), y, z + rise]
    }

    fn build(&self) -> Vec<Corners> {
        let (last, rear, head) = (self.columns.len() - 1, self.rows.len() - 1, self.levels.len() - 1);
        let (outside, foot_front, foot_rear) = self.foot;
        let mut half = Vec::new();

        // The upper face leaves out the foot of the shank.
        for (columns, rows) in
            [(0..last, 0..foot_front), (outside..last, foot_front..foot_rear), (0..last, foot_rear..rear)]
        {
            sheet(&mut half, columns, rows, |c, r| self.plate(c, r, true));
        }
        sheet(&mut half, 0..rear, 0..last, |r, c| self.plate(c, r, false));
        sheet(&mut half, 0..last, 0..1, |c, z| self.plate(c, 0, z == 1));
        sheet(&mut half, 0..1, 0..last, |z, c| self.plate(c, rear, z == 1));
        sheet(&mut half, 0..rear, 0..1, |r, z| self.plate(last, r, z == 1));

        sheet(&mut half, 0..outside, 0..head, |c, z| self.shank(c, foot_front, z));
        sheet(&mut half, 0..head, 0..outside, |z, c| self.shank(c, foot_rear, z));
        sheet(&mut half, foot_front..foot_rear, 0..head, |r, z| self.shank(outside, r, z));
        sheet(&mut half, 0..outside, foot_front..foot_rear, |c, r| self.shank(c, r, head));
        with_mirror_image(half)
    }
}
