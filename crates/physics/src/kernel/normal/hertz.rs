//! Hertz contact with the dashpot that makes restitution independent of speed (GPUDEM eq. 15-20):
//! `F = 4/3 E* √(R*δ) δ + 2√(5/6) β √(Sₙ m*) vₙ`, `Sₙ = 2 E* √(R*δ)`.
//!
//! Coefficients: a = 2 E* \[Pa\], b = 2√(5/6) β.

use super::{Coefficients, Memory, Normal, NormalForce, Touch, simple};
use crate::cube::*;
use crate::{Impact, Law, LawError, LawInfo, Preparation, hertz_collision_time, hertz_damping};

/// Hertz contact.
pub struct Hertz;

impl Law for Hertz {
    const INFO: LawInfo = LawInfo {
        name: "hertz",
        summary: "elastic spheres with a dashpot; restitution equals e at every speed",
        source: "Nagy et al. 2024 (GPUDEM), eq. 15-20; Tsuji et al. 1992",
        parameters: &[],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([2.0 * p.pair.e_star, hertz_damping(p, 1.5)?, 0.0, 0.0])
    }

    fn collision_time(k: &[f64; 4], i: &Impact, speed: f64) -> f64 {
        hertz_collision_time(i.m_eff, i.r_eff, 0.5 * k[0], speed)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for Hertz {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, _m: Memory) -> NormalForce {
        let stiffness = k.a * root(c.r_eff * c.delta);
        let elastic = (2.0f32 / 3.0f32) * stiffness * c.delta;
        simple(elastic, k.b * root(stiffness * c.m_eff) * c.vn, stiffness, 0.4f32 * elastic * c.delta)
    }
}
