//! Meshes of the simple shapes that a scene can name.

use std::f64::consts::TAU;

use glebe_engine::spec::Vec3;

use crate::mesh::Corners;

/// The twelve triangles of a box, seen from outside counter-clockwise.
pub(super) fn cuboid(min: Vec3, max: Vec3) -> Vec<Corners> {
    let corner = |bits: usize| [0, 1, 2].map(|k| if bits >> k & 1 == 1 { max[k] } else { min[k] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|f| quad(f.map(corner))).collect()
}

/// The wall of a funnel about z, from the outlet at z = 0 up.
pub(super) fn hopper(outlet_radius: f64, top_radius: f64, height: f64, segments: u32) -> Vec<Corners> {
    let point = |i: u32, radius: f64, z: f64| {
        let (sin, cos) = (TAU * f64::from(i % segments) / f64::from(segments)).sin_cos();
        [radius * cos, radius * sin, z]
    };
    let low = |i| point(i, outlet_radius, 0.0);
    let high = |i| point(i, top_radius, height);
    (0..segments).flat_map(|i| quad([low(i), low(i + 1), high(i + 1), high(i)])).collect()
}

fn quad([a, b, c, d]: [Vec3; 4]) -> [Corners; 2] {
    [[a, b, c], [a, c, d]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::assemble;

    #[test]
    fn a_box_is_closed_with_normals_outwards() {
        let (_, report) = assemble(&cuboid([0.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
        assert_eq!((report.triangles, report.open_edges, report.flipped), (12, 0, 0));
        assert!((report.volume.unwrap() - 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_hopper_is_open_at_both_ends() {
        let (mesh, report) = assemble(&hopper(0.1, 0.4, 0.5, 24));
        assert_eq!((mesh.triangles.len(), report.open_edges), (48, 48));
        assert_eq!((report.min[2], report.max[2]), (0.0, 0.5));
    }
}
