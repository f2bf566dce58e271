//! Three-vectors.

use crate::cube::*;

/// A vector of three scalars.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct V3 {
    /// First component.
    pub x: f32,
    /// Second component.
    pub y: f32,
    /// Third component.
    pub z: f32,
}

/// The vector (x, y, z).
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn v3(x: f32, y: f32, z: f32) -> V3 {
    V3 { x, y, z }
}

/// `a + b`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn plus(a: V3, b: V3) -> V3 {
    V3 { x: a.x + b.x, y: a.y + b.y, z: a.z + b.z }
}

/// `a - b`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn minus(a: V3, b: V3) -> V3 {
    V3 { x: a.x - b.x, y: a.y - b.y, z: a.z - b.z }
}

/// `s a`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn scaled(a: V3, s: f32) -> V3 {
    V3 { x: a.x * s, y: a.y * s, z: a.z * s }
}

/// `a · b`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn dot(a: V3, b: V3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// `a × b`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn cross(a: V3, b: V3) -> V3 {
    V3 { x: a.y * b.z - a.z * b.y, y: a.z * b.x - a.x * b.z, z: a.x * b.y - a.y * b.x }
}

/// `|a|`
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn length(a: V3) -> f32 {
    root(dot(a, a))
}
