//! No bonds.

use super::{Bond, Coefficients, Held, Hold, Parting, scaled};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// No bonds.
pub struct NoBond;

impl Law for NoBond {
    const INFO: LawInfo =
        LawInfo { name: "none", summary: "no bonds between particles", source: "", parameters: &[] };

    fn prepare(_p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([0.0; 4])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Bond for NoBond {
    #[inline(always)]
    fn hold(_k: &Coefficients, _strength: Coefficients, p: Parting, h: Held) -> Hold {
        let none = scaled(p.n, 0.0f32);
        Hold { force: none, moment: none, energy: 0.0f32, lost: 0.0f32, broke: 0.0f32, held: h }
    }
}
