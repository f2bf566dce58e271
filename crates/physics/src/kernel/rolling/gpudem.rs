//! GPUDEM's torque (eq. 28): `-μr Fₙ |pᵢ| ω̂ᵢ` against each particle's own spin, with `pᵢ` its lever arm.
//! Angular momentum is not conserved.
//!
//! Coefficients: a = μr.

use super::{Coefficients, Memory, Roll, Rolling, Torques, brakes, braking};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// GPUDEM's torque.
pub struct GpudemTorque;

impl Law for GpudemTorque {
    const INFO: LawInfo = LawInfo {
        name: "gpudem",
        summary: "torque against each particle's own spin (does not conserve angular momentum)",
        source: "Nagy et al. 2024 (GPUDEM), eq. 28",
        parameters: &[],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.pair.rolling_friction, 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for GpudemTorque {
    #[inline(always)]
    fn torques(k: &Coefficients, r: Roll, _m: Memory) -> Torques {
        let limit = k.a * r.load;
        brakes(
            braking(r.wi, limit * r.arm_i, r.inv_inertia_i, r.dt),
            braking(r.wj, limit * r.arm_j, f32::max(r.inv_inertia_j, 1.0e-30f32), r.dt),
        )
    }
}
