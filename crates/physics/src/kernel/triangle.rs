//! Where a sphere meets a triangle.

use super::vector::{V3, cross, dot, minus, plus, scaled};
use crate::cube::*;

/// The point of a triangle closest to the origin.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Closest {
    /// The point.
    pub point: V3,
    /// 0: inside the face; 1, 2, 3: on the edge ab, bc, ca; 4, 5, 6: at the vertex a, b, c.
    pub feature: u32,
    /// Weight of b - a in the point, from a.
    pub s: f32,
    /// Weight of c - a in the point, from a.
    pub t: f32,
}

/// The point of the triangle (a, b, c) closest to the origin, which is the sphere's centre: vertices are
/// given relative to it, so that a far origin costs no digits.
///
/// The plane is divided into the seven Voronoi regions of the triangle's features (Ericson 2005,
/// section 5.1.5). Regions are closed towards the lower-dimensional feature.
#[cfg_attr(feature = "gpu", cube)]
#[inline]
pub fn closest_to_origin(a: V3, b: V3, c: V3) -> Closest {
    let ab = minus(b, a);
    let ac = minus(c, a);
    let d1 = 0.0f32 - dot(ab, a);
    let d2 = 0.0f32 - dot(ac, a);
    let d3 = 0.0f32 - dot(ab, b);
    let d4 = 0.0f32 - dot(ac, b);
    let d5 = 0.0f32 - dot(ab, c);
    let d6 = 0.0f32 - dot(ac, c);
    let va = d3 * d6 - d5 * d4;
    let vb = d5 * d2 - d1 * d6;
    let vc = d1 * d4 - d3 * d2;

    // Weights of ab and ac in the closest point, and the feature.
    let sum = va + vb + vc;
    let mut s = vb / sum;
    let mut t = vc / sum;
    let mut feature = 0u32;
    if d1 <= 0.0f32 && d2 <= 0.0f32 {
        s = 0.0f32;
        t = 0.0f32;
        feature = 4u32;
    } else if d3 >= 0.0f32 && d4 <= d3 {
        s = 1.0f32;
        t = 0.0f32;
        feature = 5u32;
    } else if d6 >= 0.0f32 && d5 <= d6 {
        s = 0.0f32;
        t = 1.0f32;
        feature = 6u32;
    } else if vc <= 0.0f32 && d1 >= 0.0f32 && d3 <= 0.0f32 {
        s = d1 / (d1 - d3);
        t = 0.0f32;
        feature = 1u32;
    } else if vb <= 0.0f32 && d2 >= 0.0f32 && d6 <= 0.0f32 {
        s = 0.0f32;
        t = d2 / (d2 - d6);
        feature = 3u32;
    } else if va <= 0.0f32 && d4 >= d3 && d5 >= d6 {
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        s = 1.0f32 - t;
        feature = 2u32;
    }
    Closest { point: plus(a, plus(scaled(ab, s), scaled(ac, t))), feature, s, t }
}

/// The face's own foot of the origin, exact to rounding of the plane's distance: `n (n·a)` with n the unit
/// normal of (a, b, c). For a point inside the face it equals [`closest_to_origin()`], but its length does
/// not suffer from weights that were rounded.
#[cfg_attr(feature = "gpu", cube)]
#[inline]
pub fn foot_of_plane(a: V3, b: V3, c: V3) -> V3 {
    let m = cross(minus(b, a), minus(c, a));
    scaled(m, dot(m, a) / dot(m, m))
}
