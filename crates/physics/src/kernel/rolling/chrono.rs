//! CHRONO's constant torque: `μr rᵢ Fₙ` on body i against `v_rot = rⱼ ωⱼ×n - rᵢ ωᵢ×n`. Bodies of unequal
//! size get unequal torques: angular momentum is not conserved.
//!
//! Coefficients: a = μr.

use super::{Coefficients, Memory, Roll, Rolling, Torques, brakes, braking, dot, minus, scaled};
use crate::cube::*;
use crate::{Law, LawError, LawInfo, Preparation};

/// CHRONO's constant torque.
pub struct ChronoTorque;

impl Law for ChronoTorque {
    const INFO: LawInfo = LawInfo {
        name: "chrono",
        summary: "constant torque scaled by each body's own radius (does not conserve angular momentum)",
        source: "Fang et al. 2021 (Chrono::GPU), section 2.1",
        parameters: &[],
    };

    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError> {
        Ok([p.pair.rolling_friction, 0.0, 0.0, 0.0])
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl Rolling for ChronoTorque {
    #[inline(always)]
    fn torques(k: &Coefficients, r: Roll, _m: Memory) -> Torques {
        // n × v_rot, divided by the larger radius to become a rate that `braking` can bound.
        let size = f32::max(r.r_i, r.r_j);
        let roll = minus(scaled(r.wi, r.r_i / size), scaled(r.wj, r.r_j / size));
        let w = minus(roll, scaled(r.n, dot(roll, r.n)));
        let inv = r.inv_inertia_i + r.inv_inertia_j;
        brakes(
            braking(w, k.a * r.r_i * r.load, inv, r.dt),
            scaled(braking(w, k.a * r.r_j * r.load, inv, r.dt), 0.0f32 - 1.0f32),
        )
    }
}
