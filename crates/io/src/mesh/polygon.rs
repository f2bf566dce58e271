//! Polygons of any shape, cut into triangles.

use earcut::{Earcut, utils3d::project3d_to_2d};
use glebe_engine::spec::Vec3;

use super::Corners;

/// Corners that a polygon with reflex angles may have: cutting it takes their square.
const MOST_CORNERS: usize = 10_000;

/// Cuts the polygon into triangles of its winding: a fan from the first corner where no triangle of it runs
/// against the others, which none does in convex ones; else by clipping ears. False if it has reflex angles and
/// too many corners.
pub(super) fn triangulate(corners: &[Vec3], soup: &mut Vec<Corners>) -> bool {
    let Some((hub, rest)) = corners.split_first() else { return true };
    let fan = rest.windows(2).map(|pair| [*hub, pair[0], pair[1]]);
    let whole = area(corners);
    let is_star = || rest.windows(2).all(|pair| dot(area(&[*hub, pair[0], pair[1]]), whole) >= 0.0);
    // Numbers that overflow are the transform's to refuse.
    if corners.len() <= 3 || !dot(whole, whole).is_finite() || is_star() {
        soup.extend(fan);
        return true;
    }
    if corners.len() > MOST_CORNERS {
        return false;
    }
    let mut flat = Vec::new();
    let mut indices: Vec<u32> = Vec::new();
    // A polygon without area has no plane; its fan has no area either and is dropped later.
    if project3d_to_2d(corners, corners.len(), &mut flat) {
        Earcut::new().earcut(flat.iter().copied(), &[], &mut indices);
    }
    if indices.is_empty() {
        soup.extend(fan);
        return true;
    }
    for t in indices.chunks_exact(3) {
        let mut triangle = [t[0], t[1], t[2]].map(|i| corners[i as usize]);
        if dot(area(&triangle), whole) < 0.0 {
            triangle.swap(1, 2);
        }
        soup.push(triangle);
    }
    true
}

/// Twice the area of a polygon, along its normal (Newell's).
fn area(corners: &[Vec3]) -> Vec3 {
    // From a point of it, since far from the origin digits would be lost.
    let o = corners[0];
    let from = |p: Vec3| [p[0] - o[0], p[1] - o[1], p[2] - o[2]];
    corners.windows(2).map(|pair| (from(pair[0]), from(pair[1]))).fold([0.0; 3], |sum, (a, b)| {
        [
            sum[0] + (a[1] * b[2] - a[2] * b[1]),
            sum[1] + (a[2] * b[0] - a[0] * b[2]),
            sum[2] + (a[0] * b[1] - a[1] * b[0]),
        ]
    })
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
