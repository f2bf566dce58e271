//! No tangential force.

use super::{Coefficients, NormalForce, Spring, Tangential, Touch};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// No tangential force.
pub struct Frictionless;

impl Law for Frictionless {
    const INFO: LawInfo =
        LawInfo { name: "none", summary: "no tangential force", source: "", parameters: &[] };

    fn prepare(_: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([0.0; 4])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Tangential for Frictionless {
    #[inline(always)]
    fn spring(_k: &Coefficients, _c: Touch, _n: NormalForce) -> Spring {
        Spring { stiffness: 0.0f32, damping: 0.0f32 }
    }
}
