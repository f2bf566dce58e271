//! Rolling resistance.

use super::contact::{Coefficients, Memory, nothing};
use super::tangential::{Friction, Spring, TangentialForce, carried, slide};
use super::vector::{V3, dot, length, minus, plus, scaled};
use crate::cube::*;

slot! {
    /// The registered laws of rolling resistance.
    RollingLaw: Rolling {
        none::FreeRolling,
        constant_torque::ConstantTorque,
        chrono::ChronoTorque,
        gpudem::GpudemTorque,
        epsd::Epsd,
        moment_rotation::MomentRotation,
    }
    fn chosen_torques(k: &Coefficients, r: Roll, m: Memory) -> Torques = torques(k, r, m);
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
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: f32,
    /// Stiffness of the tangential spring \[N/m\].
    pub shear_stiffness: f32,
    /// Time step \[s\].
    pub dt: f32,
}

/// Torques on the two bodies \[N m\].
#[cfg_attr(feature = "gpu", derive(CubeType, CubeTypeMut))]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Torques {
    /// On body i.
    pub on_i: V3,
    /// On body j.
    pub on_j: V3,
    /// The part of `on_i` that dissipates, springs left out.
    pub brake_i: V3,
    /// The part of `on_j` that dissipates.
    pub brake_j: V3,
    /// Energy of the springs \[J\].
    pub energy: f32,
    /// Energy that they would have held at the present stiffness without moving on \[J\].
    pub energy_before: f32,
    /// Energy lost in this step where springs slip \[J\].
    pub lost: f32,
    /// What the contact remembers after the step.
    pub memory: Memory,
}

/// Torques that only brake.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn brakes(on_i: V3, on_j: V3) -> Torques {
    Torques {
        on_i,
        on_j,
        brake_i: on_i,
        brake_j: on_j,
        energy: 0.0f32,
        energy_before: 0.0f32,
        lost: 0.0f32,
        memory: nothing(),
    }
}

/// A law of rolling resistance.
#[cfg_attr(feature = "gpu", cube)]
pub trait Rolling: Send + Sync + 'static {
    /// The torques in a contact that remembers `m`.
    fn torques(k: &Coefficients, r: Roll, m: Memory) -> Torques;
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

/// One step of a spring against rolling, which is that of a tangential spring with angles for lengths and torques for
/// forces: `angle` \[rad\] is what the contact remembers, `stiffness` \[N m/rad\], `damping` \[N m s/rad\]; the torque
/// on body i is at most `arm` \[m\] times the load.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn rolled(r: Roll, angle: V3, stiffness: f32, damping: f32, arm: f32) -> TangentialForce {
    let w = minus(r.wi, r.wj);
    let rate = minus(w, scaled(r.n, dot(w, r.n)));
    let turned = carried(angle, r.n, 0.5f32 * r.dt * dot(plus(r.wi, r.wj), r.n));
    let limit = Friction { sliding: arm, sticking: arm, remember: 1.0f32, truncate: 1.0f32 };
    slide(turned, 0.0f32, Spring { stiffness, damping }, limit, r.load, rate, r.dt)
}

/// `-limit w/|w|`, but no more than stops a body of inverse inertia `inv` within the step.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn braking(w: V3, limit: f32, inv: f32, dt: f32) -> V3 {
    scaled(w, 0.0f32 - f32::min(limit * inverse_root(dot(w, w)), 1.0f32 / (dt * inv)))
}
