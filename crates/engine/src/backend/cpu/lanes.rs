//! Contacts side by side: the laws evaluated over lanes of contacts, in loops that vectorise.
//!
//! All contacts in the lanes belong to one pair of materials, so laws and coefficients are the same for all
//! of them and the choice of law is made once per loop.

use glebe_physics::kernel::bond::{self, Bond, Held, Parting};
use glebe_physics::kernel::cohesion::{self, Cohesion, within};
use glebe_physics::kernel::contact::{
    Coefficients, Memory, Touch, lagging_spin, pressed, relative_velocity, tangential_part,
};
use glebe_physics::kernel::normal::{self, Normal};
use glebe_physics::kernel::rolling::{self, Roll, Rolling};
use glebe_physics::kernel::tangential::{self, Friction, Tangential, carried, slide};
use glebe_physics::kernel::vector::{V3, cross, dot, minus, plus, scaled};
use glebe_physics::{Law, Laws, Layout, PairCoefficients, Slot};

use crate::setup::MEMORY;

/// Contacts evaluated together.
pub const LANES: usize = 64;

/// One number per lane.
pub type Lane = [f32; LANES];
/// One vector per lane.
pub type Lane3 = [Lane; 3];

/// Coefficients of a pair in the precision of kernels.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    laws: Laws,
    normal: Coefficients,
    tangential: Coefficients,
    rolling: Coefficients,
    cohesion: Coefficients,
    bond: Coefficients,
    strength: Coefficients,
    friction: Friction,
    clip: f32,
    range: f32,
}

impl Pair {
    /// Rounds the coefficients of a pair.
    pub fn new(p: &PairCoefficients) -> Self {
        let k = |c: [f64; 4]| Coefficients { a: c[0] as f32, b: c[1] as f32, c: c[2] as f32, d: c[3] as f32 };
        Self {
            laws: p.laws,
            normal: k(p.normal),
            tangential: k(p.tangential),
            rolling: k(p.rolling),
            cohesion: k(p.cohesion),
            bond: k(p.bond),
            strength: k(p.strength),
            friction: Friction {
                sliding: p.friction[0] as f32,
                sticking: p.friction[1] as f32,
                remember: p.remember as f32,
                truncate: p.truncate as f32,
            },
            clip: p.clip as f32,
            range: p.range as f32,
        }
    }
}

/// Contacts side by side: what they are given and what the laws find.
pub struct Lanes {
    /// Distance of a surface \[m\].
    pub distance: [f64; LANES],
    /// Radii \[m\]; 0 for a surface.
    pub radius: [Lane; 2],
    /// Inverse masses \[1/kg\]; 0 for a surface.
    pub inv_mass: [Lane; 2],
    /// Velocities \[m/s\]; a surface's at the contact point.
    pub v: [Lane3; 2],
    /// Angular velocities \[rad/s\].
    pub w: [Lane3; 2],
    /// History, before and after.
    pub history: [Lane; MEMORY],

    /// Unit vector from i to j, or into the surface.
    pub n: Lane3,
    /// Overlap \[m\].
    pub delta: Lane,
    /// Lever arms \[m\].
    pub arm: [Lane; 2],
    r_eff: Lane,
    m_eff: Lane,
    diameter: Lane,
    vn: Lane,
    /// Tangential velocity of i against j where they touch \[m/s\].
    pub vt: Lane3,
    elastic: Lane,
    viscous: Lane,
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: Lane,
    attraction: Lane,
    /// Lost where contacts yield and part \[J\]; only where laws do so.
    lost: Lane,
    spring_stiffness: Lane,
    spring_damping: Lane,

    /// Force on i \[N\].
    pub force: Lane3,
    /// Torque on i and on j \[N m\].
    pub torque: [Lane3; 2],
    /// The dashpots' part of the force on i \[N\].
    pub dash: Lane3,
    /// Torques of dashpots and rolling resistance on i and on j \[N m\].
    pub drain: [Lane3; 2],
    /// Power of the dashpots \[W\].
    pub dash_power: Lane,
    /// Power of rolling resistance \[W\].
    pub roll_power: Lane,
    /// Lost where rolling springs slip \[J\].
    pub roll_lost: Lane,
    /// Energy of normal spring, cohesion and bond \[J\].
    pub energy_normal: Lane,
    /// Energy of the tangential spring \[J\].
    pub energy_tangential: Lane,
    /// Its energy before this step's motion, at the present stiffness \[J\].
    pub energy_before: Lane,
    /// Lost to friction in this step \[J\].
    pub friction_loss: Lane,
    /// Overlap as a fraction of the smaller radius.
    pub ratio: Lane,
    /// 1 where the bond broke in this step; only where pairs have bonds.
    pub broke: Lane,
}

impl Default for Lanes {
    fn default() -> Self {
        let l = [0.0; LANES];
        let l3 = [l; 3];
        Self {
            distance: [0.0; LANES],
            radius: [l; 2],
            inv_mass: [l; 2],
            v: [l3; 2],
            w: [l3; 2],
            history: [l; MEMORY],
            n: l3,
            delta: l,
            arm: [l; 2],
            r_eff: l,
            m_eff: l,
            diameter: l,
            vn: l,
            vt: l3,
            elastic: l,
            viscous: l,
            stiffness: l,
            attraction: l,
            lost: l,
            spring_stiffness: l,
            spring_damping: l,
            force: l3,
            torque: [l3; 2],
            dash: l3,
            drain: [l3; 2],
            dash_power: l,
            roll_power: l,
            roll_lost: l,
            energy_normal: l,
            energy_tangential: l,
            energy_before: l,
            friction_loss: l,
            ratio: l,
            broke: l,
        }
    }
}

#[inline(always)]
fn at(a: &Lane3, l: usize) -> V3 {
    V3 { x: a[0][l], y: a[1][l], z: a[2][l] }
}

#[inline(always)]
fn put(a: &mut Lane3, l: usize, v: V3) {
    a[0][l] = v.x;
    a[1][l] = v.y;
    a[2][l] = v.z;
}

/// Lanes in whole vectors of any width. Those beyond `used` hold what was there before: it is evaluated too, and
/// nobody looks at it.
#[inline(always)]
pub fn whole(used: usize) -> usize {
    used.next_multiple_of(16).min(LANES)
}

impl Lanes {
    /// Normal, overlap and lever arms of pairs of spheres; `d` tells the difference of the places of a lane \[m\].
    /// Distances are taken in f64 from exact differences: an overlap of 1e-8 of the radius keeps its digits.
    #[inline(always)]
    pub fn between_spheres(&mut self, used: usize, d: impl Fn(usize) -> [f64; 3]) {
        let used = whole(used);
        for l in 0..used {
            let [x, y, z] = d(l);
            let (ri, rj) = (self.radius[0][l], self.radius[1][l]);
            let s = f64::from(ri) + f64::from(rj);
            let d2 = x * x + y * y + z * z;
            let distance = d2.sqrt();
            let inverse = 1.0 / distance;
            self.n[0][l] = (x * inverse) as f32;
            self.n[1][l] = (y * inverse) as f32;
            self.n[2][l] = (z * inverse) as f32;
            let delta = (s - distance) as f32;
            self.delta[l] = delta;
            self.arm[0][l] = ri - 0.5 * delta;
            self.arm[1][l] = rj - 0.5 * delta;
            let r_eff = ri * rj / (ri + rj);
            self.r_eff[l] = r_eff;
            self.diameter[l] = 4.0 * r_eff;
        }
    }

    /// The same for spheres on surfaces, whose normal and distance are known.
    #[inline(always)]
    pub fn on_surfaces(&mut self, used: usize) {
        let used = whole(used);
        for l in 0..used {
            let ri = self.radius[0][l];
            self.delta[l] = (f64::from(ri) - self.distance[l]) as f32;
            self.arm[0][l] = self.distance[l] as f32;
            self.arm[1][l] = 0.0;
            self.r_eff[l] = ri;
            self.diameter[l] = 2.0 * ri;
        }
    }

    /// Finds the overlaps' ratios; returns the first lane with the largest, if that is more than `worst`.
    #[inline(always)]
    pub fn worse_overlap(&mut self, used: usize, worst: f32) -> Option<usize> {
        let used = used.min(LANES);
        let mut most = 0;
        for l in 0..LANES {
            let (ri, rj) = (self.radius[0][l], self.radius[1][l]);
            let smaller = if rj > 0.0 { ri.min(rj) } else { ri };
            self.ratio[l] = self.delta[l] / smaller;
        }
        for ratio in &self.ratio[..used] {
            // Positive numbers are ordered as their bits are, and integers are compared many at once.
            most = most.max(if *ratio > 0.0 { ratio.to_bits() } else { 0 });
        }
        let worse = f32::from_bits(most) > worst;
        if worse { self.ratio[..used].iter().position(|r| r.to_bits() == most) } else { None }
    }

    /// Evaluates the laws of a pair of materials for a step `dt` \[s\]; energies and what dissipates only if it
    /// `accounts` for them. Velocities of spheres are behind their places by `lag` \[s\]; 0 for surfaces.
    #[inline(always)]
    pub fn evaluate(
        &mut self,
        used: usize,
        layout: Layout,
        pair: &Pair,
        [dt, lag]: [f32; 2],
        accounts: bool,
    ) {
        let used = whole(used);
        if lag > 0.0 {
            self.kinematics::<true>(used, lag);
        } else {
            self.kinematics::<false>(used, lag);
        }
        if accounts {
            self.evaluated::<true>(used, layout, pair, dt);
        } else {
            self.evaluated::<false>(used, layout, pair, dt);
        }
    }

    #[inline(always)]
    fn evaluated<const ACCOUNTS: bool>(&mut self, used: usize, layout: Layout, pair: &Pair, dt: f32) {
        let laws = pair.laws;
        let yields = !(laws.normal.history().is_empty() && laws.cohesion.history().is_empty());
        if yields {
            self.lost = [0.0; LANES];
        }
        laws.cohesion.visit(CohesionLoop(self, used, pair, layout.place(Slot::Cohesion).start));
        laws.normal.visit(NormalLoop(self, used, pair, layout.place(Slot::Normal).start));
        laws.tangential.visit(TangentialLoop(self, used, pair));
        if laws.tangential.history().is_empty() {
            self.without_friction(used);
        } else {
            self.slide::<ACCOUNTS>(used, layout.place(Slot::Tangential).start, &pair.friction, dt);
        }
        if ACCOUNTS && yields {
            for l in 0..used {
                self.friction_loss[l] += self.lost[l];
            }
        }
        let rolling = layout.place(Slot::Rolling).start;
        laws.rolling.visit(RollingLoop::<ACCOUNTS>(self, used, &pair.rolling, rolling, dt));
        let bonds = layout.place(Slot::Bond);
        if !bonds.is_empty() {
            laws.bond.visit(BondLoop::<ACCOUNTS>(self, used, pair, bonds.start, dt));
        }
    }

    #[inline(always)]
    fn kinematics<const LAGS: bool>(&mut self, used: usize, lag: f32) {
        for l in 0..used {
            let n = at(&self.n, l);
            let (vi, vj) = (at(&self.v[0], l), at(&self.v[1], l));
            let (wi, wj) = (at(&self.w[0], l), at(&self.w[1], l));
            let (arm_i, arm_j) = (self.arm[0][l], self.arm[1][l]);
            let u = relative_velocity(vi, vj, wi, wj, n, arm_i, arm_j);
            self.vn[l] = dot(u, n);
            let slips = if LAGS {
                plus(u, lagging_spin(vi, vj, wi, wj, arm_i, arm_j, lag / (arm_i + arm_j)))
            } else {
                u
            };
            put(&mut self.vt, l, tangential_part(slips, n));
            self.m_eff[l] = 1.0 / (self.inv_mass[0][l] + self.inv_mass[1][l]);
        }
    }

    #[inline(always)]
    fn touch(&self, l: usize) -> Touch {
        Touch {
            delta: self.delta[l],
            vn: self.vn[l],
            r_eff: self.r_eff[l],
            m_eff: self.m_eff[l],
            diameter: self.diameter[l],
        }
    }

    /// What the law `L` remembers, whose floats begin at `from`.
    #[inline(always)]
    fn recalled<L: Law>(&self, from: usize, l: usize) -> Memory {
        let at = |k: usize| if k < L::HISTORY.len() { self.history[from + k][l] } else { 0.0 };
        Memory { a: at(0), b: at(1), c: at(2), d: at(3) }
    }

    /// Puts what the law `L` remembers where it was; nothing unless `on`.
    #[inline(always)]
    fn keep<L: Law>(&mut self, from: usize, l: usize, m: Memory, on: bool) {
        for (k, x) in [m.a, m.b, m.c, m.d].into_iter().enumerate().take(L::HISTORY.len()) {
            self.history[from + k][l] = if on { x } else { 0.0 };
        }
    }

    /// The normal force without cohesion, which friction and rolling resistance act on.
    #[inline(always)]
    fn load(&self, l: usize) -> f32 {
        self.elastic[l] + self.viscous[l]
    }

    #[inline(always)]
    fn without_friction(&mut self, used: usize) {
        for l in 0..used {
            let n = at(&self.n, l);
            let load = self.load(l);
            put(&mut self.force, l, scaled(n, self.attraction[l] - load));
            put(&mut self.dash, l, scaled(n, -self.viscous[l]));
            self.dash_power[l] = -self.viscous[l] * self.vn[l];
            for k in 0..3 {
                self.torque[0][k][l] = 0.0;
                self.torque[1][k][l] = 0.0;
                self.drain[0][k][l] = 0.0;
                self.drain[1][k][l] = 0.0;
            }
            self.energy_tangential[l] = 0.0;
            self.energy_before[l] = 0.0;
            self.friction_loss[l] = 0.0;
        }
    }

    #[inline(always)]
    fn slide<const ACCOUNTS: bool>(&mut self, used: usize, offset: usize, friction: &Friction, dt: f32) {
        // Copies: where the spring stands in the lanes' history is not known when this is compiled, and a loop that writes
        // to such a place, or reads what such a write might change, does not vectorise.
        let mut history = [[0.0; LANES]; 4];
        history.copy_from_slice(&self.history[offset..offset + 4]);
        let friction = *friction;
        for l in 0..used {
            let n = V3 { x: self.n[0][l], y: self.n[1][l], z: self.n[2][l] };
            let spin = plus(at(&self.w[0], l), at(&self.w[1], l));
            let stretch = V3 { x: history[0][l], y: history[1][l], z: history[2][l] };
            let stretch = carried(stretch, n, 0.5 * dt * dot(spin, n));
            let spring =
                tangential::Spring { stiffness: self.spring_stiffness[l], damping: self.spring_damping[l] };
            let load = self.elastic[l] + self.viscous[l];
            let t = slide(stretch, history[3][l], spring, friction, load, at(&self.vt, l), dt);
            let touch = self.delta[l] >= 0.0;
            let spring = [t.stretch.x, t.stretch.y, t.stretch.z, t.slip];
            for (lane, x) in history.iter_mut().zip(spring) {
                lane[l] = if touch { x } else { 0.0 };
            }
            let couple = cross(n, t.force);
            put(&mut self.force, l, plus(scaled(n, self.attraction[l] - load), t.force));
            put(&mut self.torque[0], l, scaled(couple, self.arm[0][l]));
            put(&mut self.torque[1], l, scaled(couple, self.arm[1][l]));
            if !ACCOUNTS {
                continue;
            }
            let dash = minus(t.force, t.spring);
            self.dash_power[l] = dot(dash, at(&self.vt, l)) - self.viscous[l] * self.vn[l];
            put(&mut self.dash, l, plus(scaled(n, -self.viscous[l]), dash));
            let drag = cross(n, dash);
            put(&mut self.drain[0], l, scaled(drag, self.arm[0][l]));
            put(&mut self.drain[1], l, scaled(drag, self.arm[1][l]));
            self.energy_tangential[l] = t.energy;
            self.energy_before[l] = t.energy_before;
            self.friction_loss[l] = t.friction_loss;
        }
        self.history[offset..offset + 4].copy_from_slice(&history);
    }
}

struct CohesionLoop<'a>(&'a mut Lanes, usize, &'a Pair, usize);

impl cohesion::Visitor for CohesionLoop<'_> {
    type Output = ();
    #[inline(always)]
    fn visit<L: Cohesion + Law>(self) {
        let Self(lanes, used, pair, from) = self;
        for l in 0..used {
            let touch = lanes.touch(l);
            let m = lanes.recalled::<L>(from, l);
            let a = within(L::attraction(&pair.cohesion, touch, m), touch, pair.range);
            if !L::HISTORY.is_empty() {
                lanes.keep::<L>(from, l, a.memory, true);
                lanes.lost[l] = a.lost;
            }
            lanes.attraction[l] = a.force;
            lanes.energy_normal[l] = a.energy;
        }
    }
}

struct NormalLoop<'a>(&'a mut Lanes, usize, &'a Pair, usize);

impl normal::Visitor for NormalLoop<'_> {
    type Output = ();
    #[inline(always)]
    fn visit<L: Normal + Law>(self) {
        let Self(lanes, used, pair, from) = self;
        for l in 0..used {
            let m = lanes.recalled::<L>(from, l);
            let f = normal::ended(L::force(&pair.normal, pressed(lanes.touch(l)), m), pair.clip);
            if !L::HISTORY.is_empty() {
                // Bodies that do not touch remember nothing but their cohesion.
                let touches = lanes.delta[l] >= 0.0;
                lanes.keep::<L>(from, l, f.memory, touches);
                lanes.lost[l] += if touches { f.lost } else { 0.0 };
                lanes.attraction[l] += f.pull;
            }
            lanes.elastic[l] = f.elastic;
            lanes.viscous[l] = f.viscous;
            lanes.stiffness[l] = f.stiffness;
            lanes.energy_normal[l] += f.energy;
        }
    }
}

struct TangentialLoop<'a>(&'a mut Lanes, usize, &'a Pair);

impl tangential::Visitor for TangentialLoop<'_> {
    type Output = ();
    #[inline(always)]
    fn visit<L: Tangential>(self) {
        let Self(lanes, used, pair) = self;
        for l in 0..used {
            let n = normal::simple(
                lanes.elastic[l],
                lanes.viscous[l],
                lanes.stiffness[l],
                lanes.energy_normal[l],
            );
            let s = L::spring(&pair.tangential, pressed(lanes.touch(l)), n);
            lanes.spring_stiffness[l] = s.stiffness;
            lanes.spring_damping[l] = s.damping;
        }
    }
}

struct RollingLoop<'a, const ACCOUNTS: bool>(&'a mut Lanes, usize, &'a Coefficients, usize, f32);

impl<const ACCOUNTS: bool> rolling::Visitor for RollingLoop<'_, ACCOUNTS> {
    type Output = ();
    #[inline(always)]
    fn visit<L: Rolling + Law>(self) {
        let Self(lanes, used, k, from, dt) = self;
        let remembers = !L::HISTORY.is_empty();
        for l in 0..used {
            let n = at(&lanes.n, l);
            let tangential = tangential_part(at(&lanes.force, l), n);
            let inertia = |s: usize| {
                let r = lanes.radius[s][l];
                let inverse = 2.5 * lanes.inv_mass[s][l] / (r * r);
                if r > 0.0 { inverse } else { 0.0 }
            };
            let t = L::torques(
                k,
                Roll {
                    n,
                    wi: at(&lanes.w[0], l),
                    wj: at(&lanes.w[1], l),
                    couple: cross(n, tangential),
                    arm_i: lanes.arm[0][l],
                    arm_j: lanes.arm[1][l],
                    r_i: lanes.radius[0][l],
                    r_j: lanes.radius[1][l],
                    inv_inertia_i: inertia(0),
                    inv_inertia_j: inertia(1),
                    r_eff: lanes.r_eff[l],
                    load: f32::max(lanes.load(l), 0.0),
                    stiffness: lanes.stiffness[l],
                    shear_stiffness: lanes.spring_stiffness[l],
                    dt,
                },
                lanes.recalled::<L>(from, l),
            );
            if remembers {
                let touches = lanes.delta[l] >= 0.0;
                lanes.keep::<L>(from, l, t.memory, touches);
            }
            for (s, (on, brake)) in [(t.on_i, t.brake_i), (t.on_j, t.brake_j)].into_iter().enumerate() {
                let torque = plus(at(&lanes.torque[s], l), on);
                put(&mut lanes.torque[s], l, torque);
                if ACCOUNTS {
                    let drain = plus(at(&lanes.drain[s], l), brake);
                    put(&mut lanes.drain[s], l, drain);
                }
            }
            if ACCOUNTS {
                lanes.roll_power[l] = dot(t.brake_i, at(&lanes.w[0], l)) + dot(t.brake_j, at(&lanes.w[1], l));
                lanes.roll_lost[l] = t.lost;
                if remembers {
                    lanes.energy_tangential[l] += t.energy;
                    lanes.energy_before[l] += t.energy_before;
                }
            }
        }
    }
}

struct BondLoop<'a, const ACCOUNTS: bool>(&'a mut Lanes, usize, &'a Pair, usize, f32);

impl<const ACCOUNTS: bool> bond::Visitor for BondLoop<'_, ACCOUNTS> {
    type Output = ();
    #[inline(always)]
    fn visit<L: Bond + Law>(self) {
        let Self(lanes, used, pair, from, dt) = self;
        lanes.broke = [0.0; LANES];
        if L::HISTORY.is_empty() {
            return;
        }
        for l in 0..used {
            let n = at(&lanes.n, l);
            let h = |k: usize| lanes.history[from + k][l];
            let held = Held {
                rest: h(0),
                shear: V3 { x: h(1), y: h(2), z: h(3) },
                bend: V3 { x: h(4), y: h(5), z: h(6) },
                twist: h(7),
            };
            let parting = Parting {
                n,
                delta: lanes.delta[l],
                r_i: lanes.radius[0][l],
                r_j: lanes.radius[1][l],
                vt: at(&lanes.vt, l),
                wi: at(&lanes.w[0], l),
                wj: at(&lanes.w[1], l),
                dt,
            };
            let b = L::hold(&pair.bond, pair.strength, parting, held);
            let Held { rest, shear, bend, twist } = b.held;
            let floats = [rest, shear.x, shear.y, shear.z, bend.x, bend.y, bend.z, twist];
            for (lane, x) in lanes.history[from..].iter_mut().zip(floats) {
                lane[l] = x;
            }
            let force = plus(at(&lanes.force, l), b.force);
            put(&mut lanes.force, l, force);
            let couple = cross(n, b.force);
            for (s, sign) in [1.0, -1.0].into_iter().enumerate() {
                let on = plus(scaled(couple, lanes.arm[s][l]), scaled(b.moment, sign));
                let torque = plus(at(&lanes.torque[s], l), on);
                put(&mut lanes.torque[s], l, torque);
            }
            lanes.broke[l] = b.broke;
            if ACCOUNTS {
                lanes.energy_normal[l] += b.energy;
                lanes.friction_loss[l] += b.lost;
            }
        }
    }
}
