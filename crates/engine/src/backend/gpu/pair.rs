//! One contact: the laws that a kernel is specialised for, applied to two bodies that touch.

use cubecl::prelude::*;
use glebe_physics::Laws;
use glebe_physics::kernel::cohesion::{chosen_attraction, within};
use glebe_physics::kernel::contact::{Coefficients, Touch, pressed, relative_velocity, tangential_part};
use glebe_physics::kernel::normal::{chosen_force, ended};
use glebe_physics::kernel::rolling::{Roll, chosen_torques};
use glebe_physics::kernel::tangential::{Friction, carried, chosen_spring, slide};
use glebe_physics::kernel::vector::{V3, cross, dot, minus, plus, scaled};

use super::layout::{F4, PAIR_QUADS};

/// Two bodies that touch. Body b may be a surface: radius and inverse mass 0.
#[derive(CubeType, Clone, Copy)]
pub struct Meeting {
    /// Unit vector from a to b, or into the surface.
    pub n: V3,
    /// Overlap \[m\].
    pub delta: f32,
    /// Effective radius \[m\].
    pub r_eff: f32,
    /// What CHRONO measures overlaps by \[m\].
    pub diameter: f32,
    /// Radii \[m\].
    pub r_a: f32,
    /// Radius of b \[m\].
    pub r_b: f32,
    /// Lever arms \[m\].
    pub arm_a: f32,
    /// Lever arm of b \[m\].
    pub arm_b: f32,
    /// Inverse masses \[1/kg\].
    pub im_a: f32,
    /// Inverse mass of b \[1/kg\].
    pub im_b: f32,
    /// Inverse moments of inertia \[1/(kg m²)\].
    pub ii_a: f32,
    /// Inverse moment of inertia of b \[1/(kg m²)\].
    pub ii_b: f32,
    /// Velocities \[m/s\]; a surface's at the contact point.
    pub v_a: V3,
    /// Velocity of b \[m/s\].
    pub v_b: V3,
    /// Angular velocities \[rad/s\].
    pub w_a: V3,
    /// Angular velocity of b \[rad/s\].
    pub w_b: V3,
    /// Stretch of the tangential spring \[m\].
    pub stretch: V3,
    /// 1 if it slips.
    pub slip: f32,
}

/// What the laws make of it.
#[derive(CubeType, Clone, Copy)]
pub struct Effect {
    /// Force on a \[N\].
    pub force: V3,
    /// Torque on a \[N m\].
    pub torque_a: V3,
    /// Torque on b \[N m\].
    pub torque_b: V3,
    /// The dashpots' part of the force on a \[N\].
    pub dash: V3,
    /// Torque of rolling resistance on a \[N m\].
    pub roll_a: V3,
    /// Torque of rolling resistance on b \[N m\].
    pub roll_b: V3,
    /// Stretch after the step \[m\].
    pub stretch: V3,
    /// 1 if it slips.
    pub slip: f32,
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: f32,
    /// Energy of normal spring and cohesion \[J\].
    pub energy_normal: f32,
    /// Energy of the tangential spring \[J\].
    pub energy_tangential: f32,
    /// Its energy before this step's motion \[J\].
    pub energy_before: f32,
    /// Lost to friction in this step \[J\].
    pub friction_loss: f32,
    /// Power of the dashpots \[W\].
    pub dash_power: f32,
    /// Power of rolling resistance \[W\].
    pub roll_power: f32,
}

#[cube]
fn coefficients(pairs: &Array<F4>, at: u32) -> Coefficients {
    let q = pairs[at as usize];
    Coefficients { a: q[0], b: q[1], c: q[2], d: q[3] }
}

/// Inverse moment of inertia of a sphere \[1/(kg m²)\], from its inverse mass and inverse radius \[1/m\].
#[cube]
pub fn inverse_inertia(inverse_mass: f32, curvature: f32) -> f32 {
    2.5f32 * inverse_mass * curvature * curvature
}

/// Applies the laws with the coefficients at `pair`.
#[cube]
pub fn interact(m: Meeting, pairs: &Array<F4>, pair: u32, dt: f32, #[comptime] laws: Laws) -> Effect {
    let base = pair * PAIR_QUADS;
    let friction4 = pairs[(base + 4u32) as usize];
    let rest = pairs[(base + 5u32) as usize];
    let clip = rest[0];
    let u = relative_velocity(m.v_a, m.v_b, m.w_a, m.w_b, m.n, m.arm_a, m.arm_b);
    let vn = dot(u, m.n);
    let vt = tangential_part(u, m.n);
    let touch =
        Touch { delta: m.delta, vn, r_eff: m.r_eff, m_eff: 1.0f32 / (m.im_a + m.im_b), diameter: m.diameter };
    let attraction =
        within(chosen_attraction(laws.cohesion, &coefficients(pairs, base + 3u32), touch), touch, rest[1]);
    let contact = pressed(touch);
    let normal = ended(chosen_force(laws.normal, &coefficients(pairs, base), contact), clip);
    let load = normal.elastic + normal.viscous;
    let along = scaled(m.n, attraction.force - load);
    let damped = scaled(m.n, 0.0f32 - normal.viscous);

    let spring = chosen_spring(laws.tangential, &coefficients(pairs, base + 1u32), contact, normal);
    let spin = plus(m.w_a, m.w_b);
    let stretch = carried(m.stretch, m.n, 0.5f32 * dt * dot(spin, m.n));
    let friction = Friction {
        sliding: friction4[0],
        sticking: friction4[1],
        remember: friction4[2],
        truncate: friction4[3],
    };
    let t = slide(stretch, m.slip, spring, friction, load, vt, dt);
    let holds = comptime!(!laws.tangential.history().is_empty());
    let on = select(holds, 1.0f32, 0.0f32);
    let kept = select(m.delta < 0.0f32, 0.0f32, on);
    let force_t = scaled(t.force, on);
    let dash_t = scaled(minus(t.force, t.spring), on);
    let couple = cross(m.n, force_t);
    let r = chosen_torques(
        laws.rolling,
        &coefficients(pairs, base + 2u32),
        Roll {
            n: m.n,
            wi: m.w_a,
            wj: m.w_b,
            couple,
            arm_i: m.arm_a,
            arm_j: m.arm_b,
            r_i: m.r_a,
            r_j: m.r_b,
            inv_inertia_i: m.ii_a,
            inv_inertia_j: m.ii_b,
            r_eff: m.r_eff,
            load: f32::max(load, 0.0f32),
            dt,
        },
    );
    Effect {
        force: plus(along, force_t),
        torque_a: plus(scaled(couple, m.arm_a), r.on_i),
        torque_b: plus(scaled(couple, m.arm_b), r.on_j),
        dash: plus(damped, dash_t),
        roll_a: r.on_i,
        roll_b: r.on_j,
        stretch: scaled(t.stretch, kept),
        slip: t.slip * kept,
        stiffness: normal.stiffness,
        energy_normal: normal.energy + attraction.energy,
        energy_tangential: t.energy * on,
        energy_before: t.energy_before * on,
        friction_loss: t.friction_loss * on,
        dash_power: dot(dash_t, vt) - normal.viscous * vn,
        roll_power: dot(r.on_i, m.w_a) + dot(r.on_j, m.w_b),
    }
}
