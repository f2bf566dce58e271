//! The laws of one contact.

use glebe_physics::kernel64::bond::{self, Bond, BondLaw, Held, Hold, Parting};
use glebe_physics::kernel64::cohesion::{self, Attraction, Cohesion, CohesionLaw, within};
use glebe_physics::kernel64::contact::{
    Coefficients, Memory, Touch, lagging_spin, nothing, pressed, relative_velocity, tangential_part,
};
use glebe_physics::kernel64::normal::{self, Normal, NormalForce, NormalLaw, ended};
use glebe_physics::kernel64::rolling::{self, Roll, Rolling, RollingLaw, Torques};
use glebe_physics::kernel64::tangential::{
    self, Friction, Spring, Tangential, TangentialForce, TangentialLaw, carried, slide,
};
use glebe_physics::kernel64::vector::{V3, cross, dot, minus, plus, scaled};
use glebe_physics::{Layout, PairCoefficients, Slot};

/// Two bodies that touch, as laws see them.
pub struct Meeting {
    /// Unit vector from i to j.
    pub n: V3,
    /// Overlap \[m\].
    pub delta: f64,
    /// Distances of the centres from the contact point \[m\]; 0 for a surface, here and below.
    pub arm: [f64; 2],
    /// Radii \[m\].
    pub radius: [f64; 2],
    /// Inverse masses \[1/kg\].
    pub inv_mass: [f64; 2],
    /// Inverse moments of inertia \[1/(kg m²)\].
    pub inv_inertia: [f64; 2],
    /// Velocities \[m/s\]; a surface's at the contact point.
    pub v: [V3; 2],
    /// Angular velocities \[rad/s\].
    pub w: [V3; 2],
    /// Effective radius \[m\]; R on a surface.
    pub r_eff: f64,
    /// 4R* between spheres, 2R on a surface \[m\].
    pub diameter: f64,
    /// By how much velocities are behind the places, over the distance of the centres \[s/m\]; 0 on a surface.
    pub lag: f64,
}

/// What the laws find for a contact.
pub struct Pull {
    /// Force on i \[N\].
    pub force: V3,
    /// Torques on i and j \[N m\].
    pub torque: [V3; 2],
    /// The dashpots' part of the force \[N\].
    pub dash: V3,
    /// The rolling part of the torques \[N m\].
    pub roll: [V3; 2],
    /// The part of it that dissipates \[N m\].
    pub brake: [V3; 2],
    /// Lost in this step where rolling springs slip \[J\].
    pub roll_lost: f64,
    /// Lost in this step where contacts yield and part \[J\].
    pub lost: f64,
    /// Energy of normal spring, cohesion and bond \[J\].
    pub energy_normal: f64,
    /// Whether the bond broke in this step.
    pub broke: bool,
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: f64,
    /// Of the tangential spring.
    pub tangential: TangentialForce,
    /// Energy of the tangential and the rolling springs after the step, and before its motion \[J\].
    pub energy_tangential: [f64; 2],
}

impl Meeting {
    /// What the laws find in a step `dt` \[s\]: kinematics, cohesion, normal, tangential, rolling. The history
    /// moves on.
    pub fn pull(&self, layout: Layout, pair: &PairCoefficients, history: &mut [f64], dt: f64) -> Pull {
        let (m, laws) = (self, pair.laws);
        let ([vi, vj], [wi, wj]) = (m.v, m.w);
        let u = relative_velocity(vi, vj, wi, wj, m.n, m.arm[0], m.arm[1]);
        let vt = tangential_part(plus(u, lagging_spin(vi, vj, wi, wj, m.arm[0], m.arm[1], m.lag)), m.n);
        let touch = Touch {
            delta: m.delta,
            vn: dot(u, m.n),
            r_eff: m.r_eff,
            m_eff: 1.0 / (m.inv_mass[0] + m.inv_mass[1]),
            diameter: m.diameter,
        };
        let touches = m.delta >= 0.0;
        let memory = recalled(&history[layout.place(Slot::Cohesion)]);
        let law = CohesionLaw::ALL[laws.cohesion as usize];
        let attraction = law.visit(CohesionOf(&coefficients(pair.cohesion), touch, memory));
        let attraction = within(attraction, touch, pair.range);
        keep(&mut history[layout.place(Slot::Cohesion)], attraction.memory);
        let touch = pressed(touch);
        let memory = recalled(&history[layout.place(Slot::Normal)]);
        let law = NormalLaw::ALL[laws.normal as usize];
        let normal = law.visit(NormalOf(&coefficients(pair.normal), touch, memory));
        // Bodies that do not touch remember nothing but their cohesion.
        keep(&mut history[layout.place(Slot::Normal)], if touches { normal.memory } else { nothing() });
        let normal = ended(normal, pair.clip);
        let load = normal.elastic + normal.viscous;

        let law = TangentialLaw::ALL[laws.tangential as usize];
        let spring = law.visit(SpringOf(&coefficients(pair.tangential), touch, normal));
        let mut t = TangentialForce::default();
        if !law.history().is_empty() {
            let h = &mut history[layout.place(Slot::Tangential)];
            let twist = 0.5 * dt * dot(plus(wi, wj), m.n);
            let stretch = carried(V3 { x: h[0], y: h[1], z: h[2] }, m.n, twist);
            let friction = Friction {
                sliding: pair.friction[0],
                sticking: pair.friction[1],
                remember: pair.remember,
                truncate: pair.truncate,
            };
            t = slide(stretch, h[3], spring, friction, load, vt, dt);
            let spring = [t.stretch.x, t.stretch.y, t.stretch.z, t.slip];
            h.copy_from_slice(&if touches { spring } else { [0.0; 4] });
        }
        let couple = cross(m.n, t.force);
        let roll = Roll {
            n: m.n,
            wi,
            wj,
            couple,
            arm_i: m.arm[0],
            arm_j: m.arm[1],
            r_i: m.radius[0],
            r_j: m.radius[1],
            inv_inertia_i: m.inv_inertia[0],
            inv_inertia_j: m.inv_inertia[1],
            r_eff: m.r_eff,
            load: load.max(0.0),
            stiffness: normal.stiffness,
            shear_stiffness: spring.stiffness,
            dt,
        };
        let memory = recalled(&history[layout.place(Slot::Rolling)]);
        let law = RollingLaw::ALL[laws.rolling as usize];
        let r = law.visit(RollingOf(&coefficients(pair.rolling), roll, memory));
        keep(&mut history[layout.place(Slot::Rolling)], if touches { r.memory } else { nothing() });
        let parting = Parting { n: m.n, delta: m.delta, r_i: m.radius[0], r_j: m.radius[1], vt, wi, wj, dt };
        let h = &mut history[layout.place(Slot::Bond)];
        let law = BondLaw::ALL[laws.bond as usize];
        let b = law.visit(HoldOf(&coefficients(pair.bond), coefficients(pair.strength), parting, held(h)));
        if !law.history().is_empty() {
            h.copy_from_slice(&[
                b.held.rest,
                b.held.shear.x,
                b.held.shear.y,
                b.held.shear.z,
                b.held.bend.x,
                b.held.bend.y,
                b.held.bend.z,
                b.held.twist,
            ]);
        }
        let across = plus(couple, cross(m.n, b.force));
        let torque = |arm: f64, rolling: V3, moment: V3| plus(plus(scaled(across, arm), rolling), moment);
        Pull {
            force: plus(plus(scaled(m.n, attraction.force + normal.pull - load), t.force), b.force),
            torque: [torque(m.arm[0], r.on_i, b.moment), torque(m.arm[1], r.on_j, scaled(b.moment, -1.0))],
            dash: plus(scaled(m.n, -normal.viscous), minus(t.force, t.spring)),
            roll: [r.on_i, r.on_j],
            brake: [r.brake_i, r.brake_j],
            roll_lost: r.lost,
            lost: attraction.lost + b.lost + if touches { normal.lost } else { 0.0 },
            energy_normal: normal.energy + attraction.energy + b.energy,
            broke: b.broke > 0.0,
            stiffness: normal.stiffness,
            energy_tangential: [t.energy + r.energy, t.energy_before + r.energy_before],
            tangential: t,
        }
    }
}

struct NormalOf<'a>(&'a Coefficients, Touch, Memory);

impl normal::Visitor for NormalOf<'_> {
    type Output = NormalForce;
    fn visit<L: Normal>(self) -> NormalForce {
        L::force(self.0, self.1, self.2)
    }
}

struct CohesionOf<'a>(&'a Coefficients, Touch, Memory);

impl cohesion::Visitor for CohesionOf<'_> {
    type Output = Attraction;
    fn visit<L: Cohesion>(self) -> Attraction {
        L::attraction(self.0, self.1, self.2)
    }
}

struct SpringOf<'a>(&'a Coefficients, Touch, NormalForce);

impl tangential::Visitor for SpringOf<'_> {
    type Output = Spring;
    fn visit<L: Tangential>(self) -> Spring {
        L::spring(self.0, self.1, self.2)
    }
}

struct RollingOf<'a>(&'a Coefficients, Roll, Memory);

impl rolling::Visitor for RollingOf<'_> {
    type Output = Torques;
    fn visit<L: Rolling>(self) -> Torques {
        L::torques(self.0, self.1, self.2)
    }
}

struct HoldOf<'a>(&'a Coefficients, Coefficients, Parting, Held);

impl bond::Visitor for HoldOf<'_> {
    type Output = Hold;
    fn visit<L: Bond>(self) -> Hold {
        L::hold(self.0, self.1, self.2, self.3)
    }
}

/// What a bond finds in its floats.
fn held(floats: &[f64]) -> Held {
    let at = |k: usize| floats.get(k).copied().unwrap_or_default();
    let three = |k: usize| V3 { x: at(k), y: at(k + 1), z: at(k + 2) };
    Held { rest: at(0), shear: three(1), bend: three(4), twist: at(7) }
}

/// What a law finds in its floats.
fn recalled(floats: &[f64]) -> Memory {
    let at = |k: usize| floats.get(k).copied().unwrap_or_default();
    Memory { a: at(0), b: at(1), c: at(2), d: at(3) }
}

/// Puts what a law remembers into its floats.
fn keep(floats: &mut [f64], m: Memory) {
    floats.iter_mut().zip([m.a, m.b, m.c, m.d]).for_each(|(float, x)| *float = x);
}

fn coefficients([a, b, c, d]: [f64; 4]) -> Coefficients {
    Coefficients { a, b, c, d }
}
