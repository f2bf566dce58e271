//! Cohesion: an attraction added to any normal law.

use super::contact::{Coefficients, Memory, Touch, nothing};
use super::powers::cube_root;
use crate::cube::*;

slot! {
    /// The registered laws of cohesion.
    CohesionLaw: Cohesion {
        none::NoCohesion,
        constant::Constant,
        jkr::Jkr,
        sjkr::Sjkr,
        dmt::Dmt,
        capillary::Capillary,
    }
    fn chosen_attraction(k: &Coefficients, c: Touch, m: Memory) -> Attraction = attraction(k, c, m);
}

/// An attractive force and its potential.
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attraction {
    /// Force pulling the bodies together \[N\], ≥ 0.
    pub force: f32,
    /// Potential energy \[J\], zero where the attraction begins: at `δ = 0`, or at the law's range.
    pub energy: f32,
    /// Energy lost in this step to what the contact remembers now and did not before \[J\].
    pub lost: f32,
    /// What it remembers after the step.
    pub memory: Memory,
}

/// A law of cohesion.
#[cfg_attr(feature = "gpu", cube)]
pub trait Cohesion: Send + Sync + 'static {
    /// The attraction in a contact that remembers `m`; with `δ < 0` of bodies as far apart as the law's range.
    fn attraction(k: &Coefficients, c: Touch, m: Memory) -> Attraction;
}

/// The attraction of a law that remembers nothing.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn steady(force: f32, energy: f32) -> Attraction {
    Attraction { force, energy, lost: 0.0f32, memory: nothing() }
}

/// The attraction within `range` \[m\] beyond touch, and none farther: bodies meet as far apart as the longest
/// range of all materials, the law acts as far as its own of the pair.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn within(a: Attraction, c: Touch, range: f32) -> Attraction {
    let near = c.delta + range >= 0.0f32;
    Attraction {
        force: select(near, a.force, 0.0f32),
        energy: select(near, a.energy, 0.0f32),
        lost: a.lost,
        memory: a.memory,
    }
}
