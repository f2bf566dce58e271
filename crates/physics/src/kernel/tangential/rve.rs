//! The tangential spring that belongs to the normal law of the same name (RVE eq. 1-2): `Kₜ = ν Kₙ`, without a dashpot.
//! Poisson's ratio of a pair is the mean.
//!
//! Coefficients: a = 2 ν E \[Pa\].

use super::{Coefficients, NormalForce, SPRING_HISTORY, Spring, Tangential, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// Linear tangential spring that grows with the particles.
pub struct RveTangential;

impl Law for RveTangential {
    const INFO: LawInfo = LawInfo {
        name: "rve",
        summary: "linear tangential spring of stiffness 2 ν E R*, without a dashpot, with history",
        source: "Lubbe et al. 2022 (RVE), eq. 1-3",
        parameters: &[],
    };
    const HISTORY: &'static [f64] = SPRING_HISTORY;

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([2.0 * p.pair.poissons_ratio.max(0.0) * p.pair.youngs_modulus, 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Tangential for RveTangential {
    #[inline(always)]
    fn spring(k: &Coefficients, c: Touch, _n: NormalForce) -> Spring {
        Spring { stiffness: k.a * c.r_eff, damping: 0.0f32 }
    }
}
