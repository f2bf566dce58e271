//! Tangential spring with the stiffness given by the user, as CHRONO has it: `Sₜ = √(δ/D) k̂ₜ`,
//! `γₜ = √(δ/D) m* γ̂ₜ`, D as for the normal law of the same name.
//!
//! Coefficients: a = k̂ₜ \[N/m\], b = γ̂ₜ \[1/s\].

use super::{Coefficients, NormalForce, SPRING_HISTORY, Spring, Tangential, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, ParameterInfo, Preparation};

/// Tangential spring with given stiffness.
pub struct HertzStiffnessTangential;

impl Law for HertzStiffnessTangential {
    const INFO: LawInfo = LawInfo {
        name: "hertz-stiffness",
        summary: "tangential stiffness and damping given by the user, growing with the contact's size",
        source: "Fang et al. 2021 (Chrono::GPU), section 2.1 and Table 4",
        parameters: &[
            ParameterInfo {
                name: "stiffness",
                unit: "N/m",
                required: true,
                default: None,
                min: f64::MIN_POSITIVE,
                typical: 8e4,
                summary: "tangential stiffness k̂ₜ at an overlap of one diameter",
            },
            ParameterInfo {
                name: "damping",
                unit: "1/s",
                required: false,
                default: Some(0.0),
                min: 0.0,
                typical: 1e3,
                summary: "tangential damping γ̂ₜ per effective mass",
            },
        ],
    };
    const HISTORY: &'static [f64] = SPRING_HISTORY;

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.value("stiffness"), p.value("damping"), 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Tangential for HertzStiffnessTangential {
    #[inline(always)]
    fn spring(k: &Coefficients, c: Touch, _n: NormalForce) -> Spring {
        let growth = root(c.delta / c.diameter);
        Spring { stiffness: k.a * growth, damping: k.b * growth * c.m_eff }
    }
}
