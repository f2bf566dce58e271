//! Normal force laws.

use super::contact::{Coefficients, Memory, Touch, nothing};
use super::powers::cube_root;
use crate::cube::*;

slot! {
    /// The registered normal laws.
    NormalLaw: Normal {
        hertz::Hertz,
        linear::Linear,
        hertz_stiffness::HertzStiffness,
        rve::Rve,
        luding::Luding,
        eepa::Eepa,
    }
    fn chosen_force(k: &Coefficients, c: Touch, m: Memory) -> NormalForce = force(k, c, m);
}

/// The force along the normal, positive in compression.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalForce {
    /// Spring \[N\], ≥ 0: what friction and rolling resistance act on, together with the dashpot.
    pub elastic: f32,
    /// Dashpot \[N\], positive in approach.
    pub viscous: f32,
    /// Tangent stiffness of the spring \[N/m\].
    pub stiffness: f32,
    /// Energy stored in the contact \[J\].
    pub energy: f32,
    /// Adhesion that is part of the law \[N\], ≥ 0; it pulls against the spring.
    pub pull: f32,
    /// Energy lost in this step to what the contact remembers now and did not before \[J\].
    pub lost: f32,
    /// What it remembers after the step.
    pub memory: Memory,
}

/// A normal force law.
#[cfg_attr(feature = "gpu", cube)]
pub trait Normal: Send + Sync + 'static {
    /// The force in a contact with `δ ≥ 0` that remembers `m`.
    fn force(k: &Coefficients, c: Touch, m: Memory) -> NormalForce;
}

/// The force of a law that neither pulls nor remembers.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn simple(elastic: f32, viscous: f32, stiffness: f32, energy: f32) -> NormalForce {
    NormalForce { elastic, viscous, stiffness, energy, pull: 0.0f32, lost: 0.0f32, memory: nothing() }
}

/// The force with its contact end: with `clip` = 1 the contact cannot pull, with 0 it can.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn ended(f: NormalForce, clip: f32) -> NormalForce {
    let total = f.elastic + f.viscous;
    let viscous = select(total < 0.0f32, f.viscous - clip * total, f.viscous);
    NormalForce {
        elastic: f.elastic,
        viscous,
        stiffness: f.stiffness,
        energy: f.energy,
        pull: f.pull,
        lost: f.lost,
        memory: f.memory,
    }
}
