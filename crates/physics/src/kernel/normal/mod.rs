//! Normal force laws.

use super::contact::{Coefficients, Touch};
use crate::cube::*;

slot! {
    /// The registered normal laws.
    NormalLaw: Normal {
        hertz::Hertz,
        linear::Linear,
        hertz_stiffness::HertzStiffness,
    }
    fn chosen_force(k: &Coefficients, c: Touch) -> NormalForce = force(k, c);
}

/// The force along the normal, positive in compression.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NormalForce {
    /// Spring \[N\], ≥ 0.
    pub elastic: f32,
    /// Dashpot \[N\], positive in approach.
    pub viscous: f32,
    /// Tangent stiffness of the spring \[N/m\].
    pub stiffness: f32,
    /// Energy stored in the spring \[J\].
    pub energy: f32,
}

/// A normal force law.
#[cfg_attr(feature = "gpu", cube)]
pub trait Normal: Send + Sync + 'static {
    /// The force in a contact with `δ > 0`.
    fn force(k: &Coefficients, c: Touch) -> NormalForce;
}

/// The force with its contact end: with `clip` = 1 the contact cannot pull, with 0 it can.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn ended(f: NormalForce, clip: f32) -> NormalForce {
    let total = f.elastic + f.viscous;
    let viscous = select(total < 0.0f32, f.viscous - clip * total, f.viscous);
    NormalForce { elastic: f.elastic, viscous, stiffness: f.stiffness, energy: f.energy }
}
