//! Linear tangential spring and dashpot.
//!
//! Coefficients: a = kₜ \[N/m\], b = 2β√kₜ (0 if γₜ is given), c = γₜ \[N s/m\] (0 if not).

use super::{Coefficients, NormalForce, SPRING_HISTORY, Spring, Tangential, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation, linear_damping};

/// Linear tangential spring.
pub struct LinearTangential;

impl Law for LinearTangential {
    const INFO: LawInfo = LawInfo {
        name: "linear",
        summary: "linear tangential spring and dashpot, with history",
        source: "Cundall and Strack 1979",
        parameters: &[
            ParameterInfo {
                name: "stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 5e3,
                summary: "spring constant; 2/7 to 1 of the normal one is usual",
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
    const HISTORY: &'static [f64] = SPRING_HISTORY;

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        let k = p.value("stiffness");
        Ok(match p.parameter("damping") {
            Some(gamma) => [k, 0.0, gamma, 0.0],
            None => [k, linear_damping(p)? * k.sqrt(), 0.0, 0.0],
        })
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Tangential for LinearTangential {
    #[inline(always)]
    fn spring(k: &Coefficients, c: Touch, _n: NormalForce) -> Spring {
        Spring { stiffness: k.a, damping: k.b * root(c.m_eff) + k.c }
    }
}
