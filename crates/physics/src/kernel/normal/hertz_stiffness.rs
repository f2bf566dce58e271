//! Hertz contact with the stiffness given by the user, as CHRONO has it:
//! `F = √(δ/D) (k̂ δ + m* γ̂ vₙ)`, with D = 4R* between spheres (2R for equal ones) and 2R on a wall.
//! Its restitution depends on speed.
//!
//! Coefficients: a = k̂ \[N/m\], b = γ̂ \[1/s\].

use super::{Coefficients, Memory, Normal, NormalForce, Touch, simple};
use crate::cube::*;
use crate::{
    Impact, Law, LawError, LawInfo, ParameterInfo, Preparation, equivalent_e_star, hertz_collision_time,
};

/// Hertz contact with given stiffness.
pub struct HertzStiffness;

impl Law for HertzStiffness {
    const INFO: LawInfo = LawInfo {
        name: "hertz-stiffness",
        summary: "Hertz contact with the stiffness and damping given instead of E and e",
        source: "Fang et al. 2021 (Chrono::GPU), section 2.1 and Table 4",
        parameters: &[
            ParameterInfo {
                name: "stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 1e5,
                summary: "normal stiffness k̂ at an overlap of one diameter",
            },
            ParameterInfo {
                name: "damping",
                unit: "1/s",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 1e3,
                summary: "normal damping γ̂ per effective mass",
            },
        ],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.value("stiffness"), p.value("damping"), 0.0, 0.0])
    }

    const FROM_MATERIAL: bool = false;

    fn collision_time(k: &[f64; 4], i: &Impact, speed: f64) -> f64 {
        hertz_collision_time(i.m_eff, i.r_eff, equivalent_e_star(k[0], i.diameter, i.r_eff), speed)
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Normal for HertzStiffness {
    #[inline(always)]
    fn force(k: &Coefficients, c: Touch, _m: Memory) -> NormalForce {
        let growth = root(c.delta / c.diameter);
        let elastic = k.a * growth * c.delta;
        simple(elastic, k.b * growth * c.m_eff * c.vn, 1.5f32 * k.a * growth, 0.4f32 * elastic * c.delta)
    }
}
