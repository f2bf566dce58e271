//! The frictional law of periodic samples (RVE eq. 1-2): a linear spring whose stiffness grows with the particles,
//! `Kₙ = E 2 rᵢ rⱼ / (rᵢ + rⱼ) = 2 E R*`, without a dashpot. Young's modulus of a pair is the harmonic mean, as of two
//! springs one behind the other.
//!
//! Coefficients: a = 2 E \[Pa\].

use super::{Coefficients, Memory, Normal, NormalForce, Touch, simple};
use crate::cube::*;
use crate::{Impact, Law, LawError, LawInfo, Preparation, linear_collision_time};

/// Linear spring that grows with the particles.
pub struct Rve;

impl Law for Rve {
    const INFO: LawInfo = LawInfo {
        name: "rve",
        summary: "linear spring of stiffness 2 E R*, without a dashpot",
        source: "Lubbe et al. 2022 (RVE), eq. 1-2",
        parameters: &[],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([2.0 * p.pair.youngs_modulus, 0.0, 0.0, 0.0])
    }

    fn collision_time(k: &[f64; 4], i: &Impact, _speed: f64) -> f64 {
        linear_collision_time(i.m_eff, k[0] * i.r_eff)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for Rve {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, _m: Memory) -> NormalForce {
        let stiffness = k.a * c.r_eff;
        let elastic = stiffness * c.delta;
        simple(elastic, 0.0f32, stiffness, 0.5f32 * elastic * c.delta)
    }
}
