//! Simplified JKR: an attraction proportional to the area of contact, `F = κ A`, `A = 2π R* δ`, the circle in which two
//! spheres overlap, with the cohesion energy density κ.
//!
//! Coefficients: a = 2π κ \[Pa\].

use std::f64::consts::TAU;

use super::{Attraction, Coefficients, Cohesion, Memory, Touch, steady};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Simplified JKR.
pub struct Sjkr;

impl Law for Sjkr {
    const INFO: LawInfo = LawInfo {
        name: "sjkr",
        summary: "attraction proportional to the area in which bodies overlap",
        source: "Kloss et al. 2012 (LIGGGHTS), models sjkr and sjkr2",
        parameters: &[ParameterInfo {
            name: "energy_density",
            unit: "J/m^3",
            required: true,
            default: None,
            min: 0.0,
            typical: 1e4,
            summary: "cohesion energy density κ; times the cohesion of the pair",
        }],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([TAU * p.pair.cohesion * p.value("energy_density"), 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for Sjkr {
    #[inline(always)]
    fn attraction(k: &Coefficients, c: Touch, _m: Memory) -> Attraction {
        let force = k.a * c.r_eff * c.delta;
        steady(force, 0.0f32 - 0.5f32 * force * c.delta)
    }
}
