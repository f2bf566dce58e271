//! Linear spring and dashpot: `F = k δ + γ vₙ`; without γ, `γ = 2 β √(k m*)` gives the restitution e.
//!
//! Coefficients: a = k \[N/m\], b = 2β√k (0 if γ is given), c = γ \[N s/m\] (0 if not).

use super::{Coefficients, Memory, Normal, NormalForce, Touch, simple};
use crate::cube::*;
use crate::{
    Impact, Law, LawError, LawInfo, ParameterInfo, Preparation, linear_collision_time, linear_damping,
};

/// Linear spring and dashpot.
pub struct Linear;

impl Law for Linear {
    const INFO: LawInfo = LawInfo {
        name: "linear",
        summary: "linear spring and dashpot",
        source: "Cundall and Strack 1979",
        parameters: &[
            ParameterInfo {
                name: "stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 1e4,
                summary: "spring constant k",
            },
            ParameterInfo {
                name: "damping",
                unit: "N s/m",
                required: false,
                default: None,
                min: 0.0,
                typical: 0.1,
                summary: "dashpot constant; left out, it follows from the restitution",
            },
        ],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let k = p.value("stiffness");
        Ok(match p.parameter("damping") {
            Some(gamma) => [k, 0.0, gamma, 0.0],
            None => [k, linear_damping(p)? * k.sqrt(), 0.0, 0.0],
        })
    }

    const FROM_MATERIAL: bool = false;

    fn collision_time(k: &[f64; 4], i: &Impact, _speed: f64) -> f64 {
        linear_collision_time(i.m_eff, k[0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for Linear {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, _m: Memory) -> NormalForce {
        let elastic = k.a * c.delta;
        simple(elastic, (k.b * root(c.m_eff) + k.c) * c.vn, k.a, 0.5f32 * elastic * c.delta)
    }
}
