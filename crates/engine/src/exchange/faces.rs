//! Faces of meshes that particles come off.

use crate::generate::Rng;
use crate::lattice::{add, cross, norm, scale, sub};
use crate::setup::{BoundaryShape, Constants};
use crate::spec::Vec3;
use crate::state::Progress;

/// Gap between a face and a sphere that comes off it, in radii.
pub(super) const CLEAR: f64 = 1e-3;

/// Faces that particles come off.
pub(super) struct Faces {
    corners: Vec<[Vec3; 3]>,
    /// Area of the faces up to each \[m²\].
    up_to: Vec<f64>,
}

impl Faces {
    /// A box around all centres of spheres that come off \[m\].
    pub(super) fn bounds(&self, radius_max: f64) -> [Vec3; 2] {
        let off = (1.0 + CLEAR) * radius_max;
        let all = || self.corners.iter().flatten();
        [
            [0, 1, 2].map(|k| all().map(|x| x[k]).fold(f64::INFINITY, f64::min) - off),
            [0, 1, 2].map(|k| all().map(|x| x[k]).fold(f64::NEG_INFINITY, f64::max) + off),
        ]
    }

    /// The centre of a sphere that touches a face, evenly over their area, on the side of its normal.
    pub(super) fn draw(&self, radius: f64, rng: &mut Rng) -> Vec3 {
        let area = rng.between(0.0, self.up_to.last().copied().unwrap_or_default());
        let face = self.up_to.partition_point(|up_to| *up_to <= area).min(self.corners.len() - 1);
        let [a, b, c] = self.corners[face];
        let (u, v) = (sub(b, a), sub(c, a));
        let [mut s, mut t] = [rng.between(0.0, 1.0), rng.between(0.0, 1.0)];
        if s + t > 1.0 {
            [s, t] = [1.0 - s, 1.0 - t];
        }
        let n = cross(u, v);
        let on = add(a, add(scale(u, s), scale(v, t)));
        add(on, scale(n, (1.0 + CLEAR) * radius / norm(n)))
    }
}

impl Constants {
    /// The faces of a mesh where they stand.
    pub(super) fn faces(&self, surface: usize, g: &Progress) -> Option<Faces> {
        let BoundaryShape::Mesh(mesh, _) = &self.boundaries[surface].shape else { return None };
        let pose = g.surfaces[surface].placed(self, surface, g).pose;
        let corner = |v: u32| pose.apply(mesh.vertices[v as usize]);
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.map(corner)).collect();
        let mut area = 0.0;
        let up_to = corners.iter().map(|[a, b, c]| {
            area += 0.5 * norm(cross(sub(*b, *a), sub(*c, *a)));
            area
        });
        let up_to = up_to.collect();
        Some(Faces { corners, up_to })
    }
}
