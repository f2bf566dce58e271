//! Adhesion of small stiff bodies (DMT): `F = 2π w R*` while they touch, with the work of adhesion w. The pull-off force is
//! the same.
//!
//! Coefficients: a = 2π w \[N/m\].

use std::f64::consts::TAU;

use super::{Attraction, Coefficients, Cohesion, Memory, Touch, steady};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// DMT's adhesion.
pub struct Dmt;

impl Law for Dmt {
    const INFO: LawInfo = LawInfo {
        name: "dmt",
        summary: "adhesion of small stiff bodies, 2π w R* in touch",
        source: "Derjaguin, Muller and Toporov 1975",
        parameters: &[ParameterInfo {
            name: "work_of_adhesion",
            unit: "J/m^2",
            required: true,
            default: None,
            min: 0.0,
            typical: 0.05,
            summary: "energy w to part a unit of area; times the cohesion of the pair",
        }],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([TAU * p.pair.cohesion * p.value("work_of_adhesion"), 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for Dmt {
    #[inline(always)]
    fn attraction(k: &Coefficients, c: Touch, _m: Memory) -> Attraction {
        let force = k.a * c.r_eff;
        steady(force, 0.0f32 - force * c.delta)
    }
}
