//! A cell that deforms, and what drives it.
//!
//! The cell matrix C follows `Ċ = U C` with the velocity gradient U of the world. Particles move with `U x` and a
//! motion of their own: velocities of a state are the latter. In fractions of the cell the common motion is none, so
//! places stay exact integers and nothing is encoded anew. A pair across a seam sees the velocity of the image, since
//! what it sees is `vⱼ - vᵢ + U d` with the branch d to the nearest image. Own velocities obey `v̇ = f/m - U v` (Evans
//! and Morriss, Phys. Rev. A 30, 1528, 1984, doi 10.1103/PhysRevA.30.1528), which does not ask where a particle is, so
//! every image moves alike; in steady simple shear that is Newton's second law of the whole motion.
//!
//! U is an upper triangle: the first cell vector keeps its direction, and the second stays in the plane of the first
//! two.

use serde::{Deserialize, Serialize};

use crate::failure::SetupError;
use crate::lattice::{Lattice, Vec3x3, product};
use crate::spec::{Deformation, Drive, WorldSpec};

/// Most strain per step \[-\], each component.
pub const STRAIN_PER_STEP: f64 = 1e-4;
/// What a displacement may grow by when it is seen in the cell of the next step: all components together.
pub const STEP_GROWTH: f64 = 1.0 + 6.0 * STRAIN_PER_STEP;
/// Cut-offs that a window of a cell that deforms is high at the start, instead of 2.5: as long as one window is higher
/// than two of them the cell may go on, so each axis may shorten to 55 % before that; cells of one window to two
/// cut-offs.
pub const WINDOW: f64 = 3.6;

/// Row and column of the driven components, in the order of [`Deformation::drive`].
pub const COMPONENTS: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]];

/// The cell of a world that deforms, as it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// C \[m\]; columns are the cell vectors.
    pub matrix: Vec3x3,
    /// U \[1/s\].
    pub gradient: Vec3x3,
    /// Strain since the start, positive in compression: minus the sum of the symmetric parts of `U Δt` \[-\].
    pub strain: Vec3x3,
    /// Sum of `|U| Δt` since the start \[-\]: no distance has shrunk by more than a factor `exp(-path)`.
    pub path: f64,
    /// C at the last rebuild \[m\].
    pub reference: Vec3x3,
    /// `path` at the last rebuild.
    pub reference_path: f64,
}

impl Cell {
    /// A cell that has not moved yet.
    pub fn new(matrix: Vec3x3) -> Self {
        let none = [[0.0; 3]; 3];
        Self { matrix, gradient: none, strain: none, path: 0.0, reference: matrix, reference_path: 0.0 }
    }

    /// Takes up the prescribed rates of a stage.
    pub fn begin(&mut self, deformation: Option<&Deformation>) {
        self.gradient = [[0.0; 3]; 3];
        let drives = deformation.map(|d| d.drive).unwrap_or_default();
        for (drive, [a, b]) in drives.into_iter().zip(COMPONENTS) {
            let Drive::Rate(rate) = drive;
            self.gradient[a][b] = -rate;
        }
    }

    /// The cell after a step `dt` \[s\].
    pub fn step(&mut self, dt: f64) {
        let mut moved = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (a, row) in moved.iter_mut().enumerate() {
            for (b, x) in row.iter_mut().enumerate() {
                *x += dt * self.gradient[a][b];
                self.strain[a][b] -= 0.5 * dt * (self.gradient[a][b] + self.gradient[b][a]);
            }
        }
        self.matrix = product(&moved, &self.matrix);
        self.path += dt * self.gradient.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
    }

    /// The affine map of the next step `dt` \[s\], `I + U Δt`.
    pub fn map(&self, dt: f64) -> Vec3x3 {
        [0, 1, 2].map(|a| [0, 1, 2].map(|b| f64::from(u8::from(a == b)) + dt * self.gradient[a][b]))
    }

    /// Makes the present cell the one that lists are made of.
    pub fn refer(&mut self) {
        self.reference = self.matrix;
        self.reference_path = self.path;
    }

    /// What is left of a skin \[m\] of lists that hold pairs up to `touch` + `skin`.
    pub fn skin_left(&self, skin: f64, touch: f64) -> f64 {
        skin - (self.path - self.reference_path) * (touch + skin)
    }
}

/// The first axis along which a cell is less than two cut-offs high \[m\], with its height \[m\]: a particle could
/// meet two images of another.
pub fn too_narrow(lattice: &Lattice, cutoff: f64) -> Option<(usize, f64)> {
    (0..3).map(|k| (k, lattice.height[k])).find(|(_, h)| *h < 2.0 * cutoff)
}

/// Refuses what a world that deforms cannot have.
pub fn check(spec: &WorldSpec, sample: bool, dt: f64) -> Result<(), SetupError> {
    let bad = |what: String| Err(SetupError::Invalid(what));
    let mut stages = spec.stages.iter().filter_map(|s| Some((s.name.as_str(), s.deformation.as_ref()?)));
    let Some((name, _)) = stages.clone().next() else { return Ok(()) };
    if !sample {
        return bad(format!(
            "the stage `{name}` deforms the cell, but the world has walls, open sides or surfaces; only a cell that is \
             periodic along x, y and z and has none can deform"
        ));
    }
    if spec.gravity != [0.0; 3] {
        return bad(format!(
            "the stage `{name}` deforms the cell, and there is gravity; a sample would fall without end. Set gravity to \
             [0, 0, 0]"
        ));
    }
    if [[1, 0], [2, 0], [2, 1]].into_iter().any(|[a, b]| spec.domain.cell[a][b] != 0.0) {
        return bad(format!(
            "the stage `{name}` deforms the cell, whose first vector is not along x, or whose second is not in the plane of \
             x and y; turn the cell"
        ));
    }
    stages.try_for_each(|(name, d)| {
        for Drive::Rate(rate) in d.drive {
            if !rate.is_finite() || rate.abs() * dt > STRAIN_PER_STEP {
                return bad(format!(
                    "the stage `{name}` strains the cell by {:e} a step ({rate:e} 1/s over {dt:e} s); allowed is \
                     {STRAIN_PER_STEP:e}. Lower the rate",
                    rate.abs() * dt
                ));
            }
        }
        Ok(())
    })
}
