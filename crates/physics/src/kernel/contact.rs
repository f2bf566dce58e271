//! Contact kinematics: what laws see of two bodies that touch.
//!
//! `n` is the unit vector from i to j and `δ > 0` means overlap. The contact point lies in the middle of
//! the overlap, so the lever arms of two spheres add up to their distance and angular momentum is
//! conserved. (GPUDEM eq. 13 prints δ with the other sign.)

use super::vector::{V3, cross, dot, minus, plus, scaled};
use crate::cube::*;

/// The four coefficients of a law for one pair of materials; the law's file says what they mean.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeLaunch))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coefficients {
    /// First.
    pub a: f32,
    /// Second.
    pub b: f32,
    /// Third.
    pub c: f32,
    /// Fourth.
    pub d: f32,
}

/// What a law remembers of a contact: up to four floats, as its `HISTORY` says. All are zero when two bodies meet.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    /// First.
    pub a: f32,
    /// Second.
    pub b: f32,
    /// Third.
    pub c: f32,
    /// Fourth.
    pub d: f32,
}

/// What a law without memory remembers.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn nothing() -> Memory {
    Memory { a: 0.0f32, b: 0.0f32, c: 0.0f32, d: 0.0f32 }
}

/// Size and speed of a contact, as normal laws see it.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touch {
    /// Overlap δ \[m\].
    pub delta: f32,
    /// Approach speed `dδ/dt` \[m/s\].
    pub vn: f32,
    /// Effective radius R* \[m\]; R on a wall.
    pub r_eff: f32,
    /// Effective mass m* \[kg\]; m on a driven wall.
    pub m_eff: f32,
    /// 4R* between spheres, 2R on a wall \[m\]: what CHRONO measures overlaps by.
    pub diameter: f32,
}

/// A contact as springs and dashpots see it: bodies that do not touch, and meet only because cohesion acts from
/// afar, neither overlap nor approach.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn pressed(c: Touch) -> Touch {
    Touch {
        delta: f32::max(c.delta, 0.0f32),
        vn: select(c.delta < 0.0f32, 0.0f32, c.vn),
        r_eff: c.r_eff,
        m_eff: c.m_eff,
        diameter: c.diameter,
    }
}

/// Distance between two spheres and where they touch.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Separation {
    /// Unit vector from i to j.
    pub n: V3,
    /// Distance of the centres \[m\].
    pub distance: f32,
    /// Overlap δ \[m\], negative when apart.
    pub delta: f32,
}

/// How two spheres lie to each other: `d = xⱼ - xᵢ` \[m\], radii \[m\].
///
/// `δ = (S² - d²)/(S + d)` with `S = Rᵢ + Rⱼ` does not lose digits to the square root.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn separation(d: V3, ri: f32, rj: f32) -> Separation {
    let d2 = dot(d, d);
    let distance = root(d2);
    let sum = ri + rj;
    Separation { n: scaled(d, 1.0f32 / distance), distance, delta: (sum * sum - d2) / (sum + distance) }
}

/// Velocity of body i relative to body j at their contact \[m/s\], spins included.
///
/// `arm_i` and `arm_j` are the distances of the centres from the contact point; for a wall `vj` is the
/// wall's velocity at the contact point and `arm_j = 0`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn relative_velocity(vi: V3, vj: V3, wi: V3, wj: V3, n: V3, arm_i: f32, arm_j: f32) -> V3 {
    plus(minus(vi, vj), cross(plus(scaled(wi, arm_i), scaled(wj, arm_j)), n))
}

/// What spins add to the velocity of slip \[m/s\] if all velocities belong to an instant before the places, where the
/// bodies lay to each other as they do now less `lag` times their way: half a step over the distance of the centres
/// \[s/m\].
///
/// Places that are half a step ahead of velocities make bodies that roll about each other slip out of the curve
/// of their path, `½ v² Δt/r` a second. That is little, but friction answers the whole of what has summed up (Vyas
/// et al. 2025). With the levers of the instant of the velocities nothing sums up, and nothing has to be remembered.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn lagging_spin(vi: V3, vj: V3, wi: V3, wj: V3, arm_i: f32, arm_j: f32, lag: f32) -> V3 {
    scaled(cross(plus(scaled(wi, arm_i), scaled(wj, arm_j)), minus(vi, vj)), lag)
}

/// The part of `u` across `n`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn tangential_part(u: V3, n: V3) -> V3 {
    minus(u, scaled(n, dot(u, n)))
}
