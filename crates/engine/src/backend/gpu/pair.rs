//! One contact: the laws that a kernel is specialised for, applied to two bodies that touch.

use cubecl::prelude::*;
use glebe_physics::Slot;
use glebe_physics::kernel::bond::{Held, Hold, Parting};
use glebe_physics::kernel::cohesion::within;
use glebe_physics::kernel::contact::{
    Coefficients, Memory, Touch, lagging_spin, pressed, relative_velocity, tangential_part,
};
use glebe_physics::kernel::normal::ended;
use glebe_physics::kernel::rolling::Roll;
use glebe_physics::kernel::tangential::{Friction, TangentialLaw, carried, slide};
use glebe_physics::kernel::vector::{V3, cross, dot, minus, plus, scaled};

use super::choices::{self, Choices, second};
use super::layout::{F4, PAIR_QUADS};
use super::recall::Recall;
use super::step::zero;

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
    /// What the contact remembers.
    pub memory: Recall,
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
    /// Torque of rolling resistance on a, springs left out \[N m\].
    pub roll_a: V3,
    /// Torque of rolling resistance on b, springs left out \[N m\].
    pub roll_b: V3,
    /// What the contact remembers after the step.
    pub memory: Recall,
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: f32,
    /// Energy of normal spring and cohesion \[J\].
    pub energy_normal: f32,
    /// Energy of the tangential and the rolling springs \[J\].
    pub energy_tangential: f32,
    /// Its energy before this step's motion \[J\].
    pub energy_before: f32,
    /// Lost in this step to friction, and where contacts yield and part \[J\].
    pub friction_loss: f32,
    /// Power of the dashpots \[W\].
    pub dash_power: f32,
    /// Power of rolling resistance, slipping springs included \[W\].
    pub roll_power: f32,
    /// 1 if their bond broke in this step.
    pub broke: f32,
}

/// The bond of two spheres, where there are bonds.
#[cube]
fn bond(
    m: Meeting,
    vt: V3,
    pairs: &Array<F4>,
    base: u32,
    which: u32,
    dt: f32,
    #[comptime] laws: Choices,
    #[comptime] bonds: bool,
) -> Hold {
    if comptime!(bonds) {
        let held = Held {
            rest: m.memory.shear.a,
            shear: V3 { x: m.memory.shear.b, y: m.memory.shear.c, z: m.memory.shear.d },
            bend: V3 { x: m.memory.bend.a, y: m.memory.bend.b, z: m.memory.bend.c },
            twist: m.memory.bend.d,
        };
        let parting =
            Parting { n: m.n, delta: m.delta, r_i: m.r_a, r_j: m.r_b, vt, wi: m.w_a, wj: m.w_b, dt };
        choices::hold(
            &coefficients(pairs, base + 6u32),
            coefficients(pairs, base + 7u32),
            parting,
            held,
            which,
            comptime!(laws.bond),
        )
    } else {
        Hold {
            force: zero(),
            moment: zero(),
            energy: 0.0f32,
            lost: 0.0f32,
            broke: 0.0f32,
            held: Held { rest: 0.0f32, shear: zero(), bend: zero(), twist: 0.0f32 },
        }
    }
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

/// What bodies remember that touch; those that do not remember nothing but their cohesion.
#[cube]
fn touching(m: Memory, delta: f32, #[comptime] remembers: bool) -> Memory {
    if comptime!(remembers) {
        let apart = delta < 0.0f32;
        Memory {
            a: select(apart, 0.0f32, m.a),
            b: select(apart, 0.0f32, m.b),
            c: select(apart, 0.0f32, m.c),
            d: select(apart, 0.0f32, m.d),
        }
    } else {
        m
    }
}

/// 1 for a law with a spring, else 0: what there is no spring for is not remembered.
fn grips(law: TangentialLaw) -> f32 {
    if law.history().is_empty() { 0.0 } else { 1.0 }
}

/// Applies the laws with the coefficients at `pair`. Only spheres may be bonded, and between them velocities may lag half a
/// step behind places.
#[cube]
pub fn interact(
    m: Meeting,
    pairs: &Array<F4>,
    pair: u32,
    dt: f32,
    #[comptime] laws: Choices,
    #[comptime] lags: bool,
    #[comptime] spheres: bool,
) -> Effect {
    let base = pair * PAIR_QUADS;
    let friction4 = pairs[(base + 4u32) as usize];
    let rest = pairs[(base + 5u32) as usize];
    let clip = rest[0];
    let which = u32::cast_from(rest[2]);
    let u = relative_velocity(m.v_a, m.v_b, m.w_a, m.w_b, m.n, m.arm_a, m.arm_b);
    let vn = dot(u, m.n);
    let vt = if comptime!(lags) {
        let lag = 0.5f32 * dt / (m.arm_a + m.arm_b);
        let late = lagging_spin(m.v_a, m.v_b, m.w_a, m.w_b, m.arm_a, m.arm_b, lag);
        tangential_part(plus(u, late), m.n)
    } else {
        tangential_part(u, m.n)
    };
    let touch =
        Touch { delta: m.delta, vn, r_eff: m.r_eff, m_eff: 1.0f32 / (m.im_a + m.im_b), diameter: m.diameter };
    let attraction = within(
        choices::attraction(
            &coefficients(pairs, base + 3u32),
            touch,
            m.memory.cohesion,
            which,
            comptime!(laws.cohesion),
        ),
        touch,
        rest[1],
    );
    let contact = pressed(touch);
    let normal = ended(
        choices::force(&coefficients(pairs, base), contact, m.memory.normal, which, comptime!(laws.normal)),
        clip,
    );
    let load = normal.elastic + normal.viscous;
    let adhesive = comptime!(!laws.layout.place(Slot::Normal).is_empty());
    let pull = if comptime!(adhesive) { attraction.force + normal.pull } else { attraction.force };
    let along = scaled(m.n, pull - load);
    let damped = scaled(m.n, 0.0f32 - normal.viscous);

    let spring = choices::spring(
        &coefficients(pairs, base + 1u32),
        contact,
        normal,
        which,
        comptime!(laws.tangential),
    );
    let spin = plus(m.w_a, m.w_b);
    let stretch = carried(m.memory.stretch, m.n, 0.5f32 * dt * dot(spin, m.n));
    let friction = Friction {
        sliding: friction4[0],
        sticking: friction4[1],
        remember: friction4[2],
        truncate: friction4[3],
    };
    let t = slide(stretch, m.memory.slip, spring, friction, load, vt, dt);
    let on = if comptime!(laws.tangential[0] == laws.tangential[1]) {
        comptime!(grips(laws.tangential[0])).runtime()
    } else {
        select(
            second(which, 1u32),
            comptime!(grips(laws.tangential[1])),
            comptime!(grips(laws.tangential[0])),
        )
    };
    let kept = select(m.delta < 0.0f32, 0.0f32, on);
    let force_t = scaled(t.force, on);
    let dash_t = scaled(minus(t.force, t.spring), on);
    let couple = cross(m.n, force_t);
    let r = choices::torques(
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
            stiffness: normal.stiffness,
            shear_stiffness: spring.stiffness,
            dt,
        },
        m.memory.rolling,
        which,
        comptime!(laws.rolling),
    );
    let springs = comptime!(!laws.layout.place(Slot::Rolling).is_empty());
    let yields = comptime!(adhesive || !laws.layout.place(Slot::Cohesion).is_empty());
    let bonds = comptime!(spheres && !laws.layout.place(Slot::Bond).is_empty());
    let held = bond(m, vt, pairs, base, which, dt, laws, bonds);
    let slipped =
        if comptime!(springs) { select(dt > 0.0f32, r.lost / f32::max(dt, 1.0e-30f32), 0.0f32) } else { dt };
    let yielded = if comptime!(yields) {
        attraction.lost + select(m.delta < 0.0f32, 0.0f32, normal.lost)
    } else {
        0.0f32.runtime()
    };
    let lost = if comptime!(bonds) { yielded + held.lost } else { yielded };
    let energy = normal.energy + attraction.energy;
    let force = plus(along, force_t);
    let across = if comptime!(bonds) { plus(couple, cross(m.n, held.force)) } else { couple };
    let torque_a = plus(scaled(across, m.arm_a), r.on_i);
    let torque_b = plus(scaled(across, m.arm_b), r.on_j);
    Effect {
        force: if comptime!(bonds) { plus(force, held.force) } else { force },
        torque_a: if comptime!(bonds) { plus(torque_a, held.moment) } else { torque_a },
        torque_b: if comptime!(bonds) { minus(torque_b, held.moment) } else { torque_b },
        dash: plus(damped, dash_t),
        roll_a: r.brake_i,
        roll_b: r.brake_j,
        memory: Recall {
            stretch: scaled(t.stretch, kept),
            slip: t.slip * kept,
            rolling: touching(r.memory, m.delta, springs),
            normal: touching(normal.memory, m.delta, adhesive),
            cohesion: attraction.memory,
            shear: Memory {
                a: held.held.rest,
                b: held.held.shear.x,
                c: held.held.shear.y,
                d: held.held.shear.z,
            },
            bend: Memory {
                a: held.held.bend.x,
                b: held.held.bend.y,
                c: held.held.bend.z,
                d: held.held.twist,
            },
        },
        stiffness: normal.stiffness,
        energy_normal: if comptime!(bonds) { energy + held.energy } else { energy },
        energy_tangential: if comptime!(springs) { t.energy * on + r.energy } else { t.energy * on },
        energy_before: if comptime!(springs) {
            t.energy_before * on + r.energy_before
        } else {
            t.energy_before * on
        },
        friction_loss: if comptime!(yields || bonds) {
            t.friction_loss * on + lost
        } else {
            t.friction_loss * on
        },
        dash_power: dot(dash_t, vt) - normal.viscous * vn,
        roll_power: if comptime!(springs) {
            dot(r.brake_i, m.w_a) + dot(r.brake_j, m.w_b) - slipped
        } else {
            dot(r.brake_i, m.w_a) + dot(r.brake_j, m.w_b)
        },
        broke: held.broke,
    }
}
