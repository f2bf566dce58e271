//! Bonds between particles: cement that holds them together beside their contact, until it breaks.

use super::contact::Coefficients;
use super::tangential::carried;
use super::vector::{V3, dot, length, minus, plus, scaled};
use crate::cube::*;

slot! {
    /// The registered laws of bonds.
    BondLaw: Bond {
        none::NoBond,
        parallel::Parallel,
    }
    fn chosen_hold(k: &Coefficients, strength: Coefficients, p: Parting, h: Held) -> Hold = hold(k, strength, p, h);
}

/// What a bond remembers: rest length, shear, bending and twist.
pub const BOND_HISTORY: &[f64] = &[1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0];

/// Two particles as their bond sees them.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parting {
    /// Unit vector from i to j.
    pub n: V3,
    /// Overlap \[m\], negative when apart.
    pub delta: f32,
    /// Radius of body i \[m\].
    pub r_i: f32,
    /// Radius of body j \[m\].
    pub r_j: f32,
    /// Velocity of i relative to j across n, in the middle between their surfaces \[m/s\].
    pub vt: V3,
    /// Angular velocities \[rad/s\].
    pub wi: V3,
    /// Angular velocity of body j \[rad/s\].
    pub wj: V3,
    /// Time step \[s\].
    pub dt: f32,
}

/// What a bond remembers.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Held {
    /// Distance of the centres at which it was made \[m\]; 0 where there is none.
    pub rest: f32,
    /// Displacement of i relative to j across n \[m\].
    pub shear: V3,
    /// Rotation of i relative to j across n \[rad\].
    pub bend: V3,
    /// Rotation of i relative to j about n \[rad\].
    pub twist: f32,
}

/// What a bond does.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hold {
    /// Force on body i, in the middle between the surfaces \[N\].
    pub force: V3,
    /// Moment on body i, and its opposite on body j \[N m\].
    pub moment: V3,
    /// Energy stored \[J\].
    pub energy: f32,
    /// Energy lost because it broke in this step \[J\].
    pub lost: f32,
    /// 1 if it broke in this step, else 0.
    pub broke: f32,
    /// What it remembers after the step; all 0 once it broke.
    pub held: Held,
}

/// A law of bonds.
#[cfg_attr(feature = "gpu", cube)]
pub trait Bond: Send + Sync + 'static {
    /// What the bond `h` does in a step.
    fn hold(k: &Coefficients, strength: Coefficients, p: Parting, h: Held) -> Hold;
}

/// What a bond has been strained to after a step: it turns with the pair as a tangential spring does.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn strained(p: Parting, h: Held) -> Held {
    let turn = 0.5f32 * p.dt * dot(plus(p.wi, p.wj), p.n);
    let w = minus(p.wi, p.wj);
    let spin = dot(w, p.n);
    let across = minus(w, scaled(p.n, spin));
    Held {
        rest: h.rest,
        shear: plus(carried(h.shear, p.n, turn), scaled(p.vt, p.dt)),
        bend: plus(carried(h.bend, p.n, turn), scaled(across, p.dt)),
        twist: h.twist + spin * p.dt,
    }
}
