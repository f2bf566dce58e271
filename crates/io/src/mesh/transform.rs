//! Placing a mesh: scale, then rotate, then translate.

use glebe_engine::spec::Vec3;

use super::{Corners, error::TransformError};

/// How a file's coordinates become metres in the surface's frame: `x = R · (scale ∘ x_file) + translate`.
///
/// ```
/// use glebe_io::mesh::Transform;
/// // Drawn in millimetres with y up; put z up and lift it by 15 cm.
/// let t = Transform { translate: [0.0, 0.0, 0.15], ..Transform::scaled(1e-3) }
///     .rotated([1.0, 0.0, 0.0], 90f64.to_radians())?;
/// # assert!((t.rotate[0] - 0.5f64.sqrt()).abs() < 1e-15);
/// # Ok::<(), glebe_io::mesh::TransformError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Factor per axis of the file \[m per file unit\], not 0. An odd number of negative factors mirrors
    /// the mesh; the winding is then reversed so that normals keep pointing outwards.
    pub scale: Vec3,
    /// Quaternion (w, x, y, z), of any length but 0.
    pub rotate: [f64; 4],
    /// \[m\]
    pub translate: Vec3,
}

impl Default for Transform {
    fn default() -> Self {
        Self { scale: [1.0; 3], rotate: [1.0, 0.0, 0.0, 0.0], translate: [0.0; 3] }
    }
}

impl Transform {
    /// The same `factor` \[m per file unit\] along all axes and nothing else.
    pub fn scaled(factor: f64) -> Self {
        Self { scale: [factor; 3], ..Self::default() }
    }

    /// Adds a right-handed turn by `angle` \[rad\] about `axis` (of any length but 0, in the axes of
    /// the world), after the turns that are already there.
    pub fn rotated(self, axis: Vec3, angle: f64) -> Result<Self, TransformError> {
        let half = 0.5 * angle;
        let largest = axis.iter().fold(0.0, |m: f64, a| m.max(a.abs()));
        // Dividing by the largest part first keeps the length of any finite axis finite and not 0.
        let unit = axis.map(|a| a / largest);
        let length = unit.iter().map(|a| a * a).sum::<f64>().sqrt();
        if !(length.is_finite() && half.is_finite()) {
            return Err(TransformError::Rotation([angle, axis[0], axis[1], axis[2]]));
        }
        let [x, y, z] = unit.map(|a| a / length * half.sin());
        Ok(Self { rotate: quaternion_product([half.cos(), x, y, z], self.rotate), ..self })
    }

    /// Checks the values and works out the matrix.
    pub(super) fn compile(&self) -> Result<Placement, TransformError> {
        if !self.scale.iter().all(|s| s.is_finite() && *s != 0.0) {
            return Err(TransformError::Scale(self.scale));
        }
        if !self.translate.iter().all(|t| t.is_finite()) {
            return Err(TransformError::Translation(self.translate));
        }
        let norm = self.rotate.iter().map(|q| q * q).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 1e-100) {
            return Err(TransformError::Rotation(self.rotate));
        }
        let [w, x, y, z] = self.rotate.map(|q| q / norm);
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Ok(Placement {
            matrix: rotation.map(|row| [0, 1, 2].map(|k| row[k] * self.scale[k])),
            translate: self.translate,
            mirrors: self.scale.iter().filter(|s| **s < 0.0).count() % 2 == 1,
        })
    }
}

/// A checked transform, ready for use.
pub(super) struct Placement {
    matrix: [Vec3; 3],
    translate: Vec3,
    mirrors: bool,
}

impl Placement {
    /// Moves every corner.
    pub(super) fn apply(&self, soup: &mut [Corners]) -> Result<(), TransformError> {
        for corners in soup {
            for corner in corners.iter_mut() {
                let p = *corner;
                for (k, row) in self.matrix.iter().enumerate() {
                    corner[k] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + self.translate[k];
                }
                // Far below the f64 range, so that areas and volumes cannot overflow.
                if !corner.iter().all(|c| c.abs() < 1e100) {
                    return Err(TransformError::Overflow);
                }
            }
            if self.mirrors {
                corners.swap(1, 2);
            }
        }
        Ok(())
    }
}

fn quaternion_product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}
