//! Meshes of the simple shapes that a scene can name.

use std::f64::consts::TAU;

use glebe_engine::spec::{TriMesh, Vec3};

use crate::mesh::{Corners, assemble};

/// The twelve triangles of a box, seen from outside counter-clockwise.
pub(super) fn cuboid(min: Vec3, max: Vec3) -> Vec<Corners> {
    let corner = |bits: usize| [0, 1, 2].map(|k| if bits >> k & 1 == 1 { max[k] } else { min[k] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|f| quad(f.map(corner))).collect()
}

/// A cylinder shell of `length` about `axis` (unit), centred at the origin. Its flat pieces touch the
/// cylinder of `radius` from inside at their edges.
pub(super) fn drum(radius: f64, length: f64, axis: Vec3, segments: u32, ends: bool) -> Vec<Corners> {
    // Any vector that is not along the axis gives two directions across it.
    let least = (0..3).min_by(|a, b| axis[*a].abs().total_cmp(&axis[*b].abs())).unwrap_or(0);
    let mut other = [0.0; 3];
    other[least] = 1.0;
    let u = unit(cross(other, axis));
    let v = cross(axis, u);
    let point = |i: u32, side: f64| {
        let (sin, cos) = (TAU * f64::from(i % segments) / f64::from(segments)).sin_cos();
        [0, 1, 2].map(|k| radius * (cos * u[k] + sin * v[k]) + 0.5 * side * length * axis[k])
    };
    let mut all = Vec::new();
    for i in 0..segments {
        let [a, b, c, d] = [point(i, -1.0), point(i + 1, -1.0), point(i + 1, 1.0), point(i, 1.0)];
        all.extend(quad([a, b, c, d]));
        if ends {
            let [low, high] = [-0.5, 0.5].map(|s| axis.map(|x| s * length * x));
            all.extend([[low, b, a], [high, d, c]]);
        }
    }
    all
}

/// A drum of `radius` and `length` \[m\] about `axis` (unit), centred at the origin and closed at both ends, its
/// shell of `segments` flat pieces (3 or more): the mesh of a scene's `geometry.<name>.drum`.
pub fn drum_mesh(radius: f64, length: f64, axis: Vec3, segments: u32) -> TriMesh {
    assemble(&drum(radius, length, axis, segments, true)).0
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

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Vec3) -> Vec3 {
    let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
    a.map(|x| x / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_shapes_are_closed_with_normals_outwards() {
        let (_, report) = assemble(&cuboid([0.0, 0.0, 0.0], [1.0, 2.0, 3.0]));
        assert_eq!((report.triangles, report.open_edges, report.flipped), (12, 0, 0));
        assert!((report.volume.unwrap() - 6.0).abs() < 1e-12);

        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]] {
            let (_, report) = assemble(&drum(0.5, 2.0, axis, 90, true));
            assert!(report.is_closed());
            let polygon = 90.0 / 2.0 * 0.25 * (TAU / 90.0).sin();
            assert!((report.volume.unwrap() - 2.0 * polygon).abs() < 1e-12);
        }
    }

    #[test]
    fn a_hopper_is_open_at_both_ends() {
        let (mesh, report) = assemble(&hopper(0.1, 0.4, 0.5, 24));
        assert_eq!((mesh.triangles.len(), report.open_edges), (48, 48));
        assert_eq!((report.min[2], report.max[2]), (0.0, 0.5));
    }
}
