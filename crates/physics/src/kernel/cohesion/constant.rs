//! A constant attraction while bodies touch, as CHRONO has it.
//!
//! Coefficients: a = force F_c \[N\].

use super::{Attraction, Coefficients, Cohesion, Memory, Touch, steady};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Constant cohesion.
pub struct Constant;

impl Law for Constant {
    const INFO: LawInfo = LawInfo {
        name: "constant",
        summary: "a constant attraction while bodies touch",
        source: "Fang et al. 2021 (Chrono::GPU), section 2.1",
        parameters: &[ParameterInfo {
            name: "force",
            unit: "N",
            required: true,
            default: None,
            min: 0.0,
            typical: 1e-3,
            summary: "attraction in every contact; times the cohesion of the pair",
        }],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.pair.cohesion * p.value("force"), 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for Constant {
    #[inline(always)]
    fn attraction(k: &Coefficients, c: Touch, _m: Memory) -> Attraction {
        steady(k.a, 0.0f32 - k.a * c.delta)
    }
}
