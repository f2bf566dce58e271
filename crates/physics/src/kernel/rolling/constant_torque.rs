//! Constant torque against the relative rolling velocity: `M = -μr R* Fₙ ω̂`, with ω the relative angular
//! velocity without its twist, equal and opposite on both bodies, so angular momentum is conserved.
//! The torque never reverses ω within a step, and it is zero at rest.
//!
//! Coefficients: a = μr.

use super::{Coefficients, Memory, Roll, Rolling, Torques, brakes, braking, rolling_rate, scaled};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// Constant torque, equal and opposite.
pub struct ConstantTorque;

impl Law for ConstantTorque {
    const INFO: LawInfo = LawInfo {
        name: "constant-torque",
        summary: "constant torque against the relative rolling velocity, equal and opposite",
        source: "Zhou et al. 1999, model A; Ai et al. 2011",
        parameters: &[],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.pair.rolling_friction, 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for ConstantTorque {
    #[inline(always)]
    fn torques(k: &Coefficients, r: Roll, _m: Memory) -> Torques {
        let w = rolling_rate(r);
        let on_i = braking(w, k.a * r.r_eff * r.load, r.inv_inertia_i + r.inv_inertia_j, r.dt);
        brakes(on_i, scaled(on_i, 0.0f32 - 1.0f32))
    }
}
