//! Mindlin's spring with history (GPUDEM eq. 14, 17, 19, 21): `Sₜ = 8 G* √(R*δ)`,
//! `γₜ = 2√(5/6) β √(Sₜ m*)`.
//!
//! Coefficients: a = 8 G* \[Pa\], b = 2√(5/6) β.

use super::{Coefficients, NormalForce, SPRING_HISTORY, Spring, Tangential, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation, hertz_damping};

/// Mindlin's spring.
pub struct Mindlin;

impl Law for Mindlin {
    const INFO: LawInfo = LawInfo {
        name: "mindlin",
        summary: "tangential stiffness from the shear moduli and the contact's size, with history",
        source: "Nagy et al. 2024 (GPUDEM), eq. 14, 17, 19, 21; Mindlin and Deresiewicz 1953",
        parameters: &[],
    };
    const HISTORY: &'static [f64] = SPRING_HISTORY;

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([8.0 * p.pair.g_star, hertz_damping(p, 1.5)?, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Tangential for Mindlin {
    #[inline(always)]
    fn spring(k: &Coefficients, c: Touch, _n: NormalForce) -> Spring {
        let stiffness = k.a * root(c.r_eff * c.delta);
        Spring { stiffness, damping: k.b * root(stiffness * c.m_eff) }
    }
}
