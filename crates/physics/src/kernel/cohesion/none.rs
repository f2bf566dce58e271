//! No cohesion.

use super::{Attraction, Coefficients, Cohesion, Memory, Touch, steady};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// No cohesion.
pub struct NoCohesion;

impl Law for NoCohesion {
    const INFO: LawInfo =
        LawInfo { name: "none", summary: "no attraction between bodies", source: "", parameters: &[] };

    fn prepare(_: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([0.0; 4])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Cohesion for NoCohesion {
    #[inline(always)]
    fn attraction(_k: &Coefficients, _c: Touch, _m: Memory) -> Attraction {
        steady(0.0f32, 0.0f32)
    }
}
