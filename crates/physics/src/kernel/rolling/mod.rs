//! Rolling resistance.

use super::contact::Coefficients;
use super::vector::{V3, dot, length, minus, plus, scaled};
use crate::cube::*;

slot! {
    /// The registered laws of rolling resistance.
    RollingLaw: Rolling {
        none::FreeRolling,
        constant_torque::ConstantTorque,
        chrono::ChronoTorque,
        gpudem::GpudemTorque,
    }
    fn chosen_torques(k: &Coefficients, r: Roll) -> Torques = torques(k, r);
}

/// What a rolling law sees of a contact.
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Roll {
    /// Unit vector from i to j.
    pub n: V3,
    /// Angular velocities \[rad/s\].
    pub wi: V3,
    /// Angular velocity of body j \[rad/s\].
    pub wj: V3,
    /// Torque `n × Fₜ` that the tangential force exerts, per unit of lever arm \[N\].
    pub couple: V3,
    /// Lever arms \[m\]; 0 for a wall.
    pub arm_i: f32,
    /// Lever arm of body j \[m\].
    pub arm_j: f32,
    /// Radius of body i \[m\].
    pub r_i: f32,
    /// Radius of body j \[m\]; 0 for a wall.
    pub r_j: f32,
    /// Inverse moments of inertia \[1/(kg m²)\]; 0 for a wall.
    pub inv_inertia_i: f32,
    /// Inverse moment of inertia of body j.
    pub inv_inertia_j: f32,
    /// Effective radius R* \[m\].
    pub r_eff: f32,
    /// Normal force, ≥ 0, without cohesion \[N\].
    pub load: f32,
    /// Time step \[s\].
    pub dt: f32,
}

/// Torques on the two bodies \[N m\].
#[cfg_attr(feature = "gpu", derive(CubeType))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Torques {
    /// On body i.
    pub on_i: V3,
    /// On body j.
    pub on_j: V3,
}

/// A law of rolling resistance.
#[cfg_attr(feature = "gpu", cube)]
pub trait Rolling: Send + Sync + 'static {
    /// The torques in a contact.
    fn torques(k: &Coefficients, r: Roll) -> Torques;
}

/// Angular velocity of i relative to j without its twist about n, as it would be after the step under
/// the tangential force of this contact alone \[rad/s\].
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn rolling_rate(r: Roll) -> V3 {
    let gain = r.dt * (r.arm_i * r.inv_inertia_i - r.arm_j * r.inv_inertia_j);
    let w = plus(minus(r.wi, r.wj), scaled(r.couple, gain));
    minus(w, scaled(r.n, dot(w, r.n)))
}

/// `-limit w/|w|`, but no more than stops a body of inverse inertia `inv` within the step.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn braking(w: V3, limit: f32, inv: f32, dt: f32) -> V3 {
    scaled(w, 0.0f32 - f32::min(limit * inverse_root(dot(w, w)), 1.0f32 / (dt * inv)))
}
