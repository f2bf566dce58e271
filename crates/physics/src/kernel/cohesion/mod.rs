//! Cohesion: an attraction added to any normal law.

use super::contact::{Coefficients, Touch};
use crate::cube::*;

slot! {
    /// The registered laws of cohesion.
    CohesionLaw: Cohesion {
        none::NoCohesion,
        constant::Constant,
    }
}

/// An attractive force and its potential.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attraction {
    /// Force pulling the bodies together \[N\], ≥ 0.
    pub force: f32,
    /// Potential energy \[J\], zero at δ = 0.
    pub energy: f32,
}

/// A law of cohesion.
#[cfg_attr(feature = "gpu", cube)]
pub trait Cohesion: Send + Sync + 'static {
    /// The attraction in a contact.
    fn attraction(k: &Coefficients, c: Touch) -> Attraction;
}
