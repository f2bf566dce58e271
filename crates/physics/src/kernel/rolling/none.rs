//! No rolling resistance.

use super::{Coefficients, Memory, Roll, Rolling, Torques, V3, brakes};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// No rolling resistance.
pub struct FreeRolling;

impl Law for FreeRolling {
    const INFO: LawInfo =
        LawInfo { name: "none", summary: "no rolling resistance", source: "", parameters: &[] };

    fn prepare(_: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([0.0; 4])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for FreeRolling {
    #[inline(always)]
    fn torques(_k: &Coefficients, _r: Roll, _m: Memory) -> Torques {
        let zero = V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 };
        brakes(zero, zero)
    }
}
