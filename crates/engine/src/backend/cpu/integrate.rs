//! Motion: the forces of each particle summed in a fixed order, and one step of the integrator.

use glebe_physics::kernel::integrate::{Scheme, locally_damped};

use super::super::common::runaway_distance;
use super::contacts::{Space, SurfacePull};
use super::list::{BLOCK, Block, Incoming, Pull};
use crate::lattice::Vec3x3;
use crate::setup::Constants;
use crate::state::{Place, Spin, Velocity};

/// The columns of a block's particles, as one step changes them.
pub struct Columns<'a> {
    /// First particle.
    pub first: usize,
    /// See [`crate::state::Particles`].
    pub place: &'a mut [Place],
    /// Windows.
    pub hi: &'a mut [[i32; 3]],
    /// Rest below one unit.
    pub rest: &'a mut [[f32; 3]],
    /// Velocities before the step.
    pub velocity: &'a [Velocity],
    /// Spins before the step.
    pub spin: &'a [Spin],
    /// Velocities after the step.
    pub velocity_new: &'a mut [Velocity],
    /// Spins after the step.
    pub spin_new: &'a mut [Spin],
    /// Accelerations of the step before, then of this one.
    pub acceleration: &'a mut [[f32; 3]],
    /// Angular accelerations.
    pub angular: &'a mut [[f32; 3]],
    /// Contact forces.
    pub force: &'a mut [[f32; 3]],
    /// Places at the last rebuild.
    pub lo_ref: &'a [[u32; 3]],
}

/// What is the same for all particles.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Step \[s\].
    pub dt: f32,
    /// Gravity \[m/s²\].
    pub gravity: [f32; 3],
    /// Local damping.
    pub damping: f32,
    /// Velocity gradient of the cell \[1/s\], if it deforms.
    pub gradient: Option<[[f32; 3]; 3]>,
    /// From metres to units.
    pub inverse: [[f32; 3]; 3],
    /// From units to metres.
    pub unit: [[f32; 3]; 3],
    /// Windows along each periodic axis, 0 where the axis is open.
    pub wrap: [i32; 3],
    /// What gravity does over a period of each axis that wraps \[J/kg\].
    pub fall: [f64; 3],
    /// Square of the displacement in one step that is too much \[m²\].
    pub runaway: f32,
}

impl Step {
    /// The step of a world.
    pub fn new(c: &Constants, space: &Space) -> Self {
        let f = |m: Vec3x3| m.map(|r| r.map(|x| x as f32));
        let far = runaway_distance(c);
        Self {
            dt: c.dt as f32,
            gravity: c.spec.gravity.map(|x| x as f32),
            damping: c.spec.local_damping as f32,
            gradient: space.gradient.map(f),
            inverse: f(space.lattice.inverse),
            unit: f(space.lattice.unit),
            wrap: [0, 1, 2].map(|k| if c.lattice.periodic[k] { c.lattice.windows[k] as i32 } else { 0 }),
            fall: c.fall(),
            runaway: (far * far) as f32,
        }
    }
}

impl Step {
    /// `U v`, what a deforming cell takes from the acceleration of a particle with the velocity `v` \[m/s²\].
    #[inline(always)]
    pub fn carried(&self, v: [f32; 3]) -> [f32; 3] {
        self.gradient.map_or([0.0; 3], |u| u.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2]))
    }
}

/// What a block's step finds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moved {
    /// Largest square of a displacement since the last rebuild \[m²\].
    pub displacement: f32,
    /// Lowest particle that moved too far in one step, or is not a number.
    pub runaway: Option<u32>,
    /// Work of seams on particles that crossed them, and of a deforming cell on the motion of particles \[J\].
    pub lifted: f64,
    /// Lost to local damping \[J\].
    pub damped: f64,
    /// Dissipating forces times changes of velocity \[W\].
    pub drain: f64,
}

/// The contacts of a block's particles.
#[derive(Clone, Copy)]
pub struct Contacts<'a> {
    /// The block.
    pub block: &'a Block,
    /// What was found for the candidates of all blocks.
    pub pull: &'a [Pull],
    /// Transposed lists.
    pub incoming: &'a Incoming,
    /// The dissipating part of `pull`; empty where no ledger is kept.
    pub drain: &'a [Pull],
    /// The block's contacts with surfaces.
    pub surface: &'a [SurfacePull],
}

impl Contacts<'_> {
    /// Force and torque on the particle `local` of the block: its contacts as first of a pair in the order of
    /// candidates, as second in the order of the transposed lists, then surfaces from `at` on. Pairs that do
    /// not touch add zero.
    #[inline(always)]
    pub fn sum(&self, local: usize, at: &mut usize) -> Sums {
        let mut s = Sums::default();
        s.add(self, self.pull, local, 0);
        if !self.drain.is_empty() {
            s.add(self, self.drain, local, 2);
        }
        while *at < self.surface.len() && self.surface[*at].local as usize == local {
            let q = &self.surface[*at];
            for x in 0..3 {
                s.0[0][x] += q.force[x];
                s.0[1][x] += q.torque[x];
                s.0[2][x] += q.drain[0][x];
                s.0[3][x] += q.drain[1][x];
            }
            *at += 1;
        }
        s
    }
}

/// Force and torque of a particle, and the dissipating part of both \[N\], \[N m\].
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums(pub [[f32; 3]; 4]);

impl Sums {
    #[inline(always)]
    fn add(&mut self, c: &Contacts<'_>, pull: &[Pull], local: usize, to: usize) {
        let mut f = [0.0_f32; 3];
        let mut t = [0.0_f32; 3];
        let base = c.incoming.base[c.block.first / BLOCK];
        let own = (base + c.block.start[local]) as usize..(base + c.block.start[local + 1]) as usize;
        for q in &pull[own] {
            for x in 0..3 {
                f[x] += q.force[x];
                t[x] += q.torque[x];
            }
        }
        let j = c.block.first + local;
        let others = c.incoming.start[j] as usize..c.incoming.start[j + 1] as usize;
        for &k in &c.incoming.entry[others] {
            let q = &pull[k as usize];
            for x in 0..3 {
                f[x] -= q.force[x];
                t[x] += q.torque_other[x];
            }
        }
        self.0[to] = f;
        self.0[to + 1] = t;
    }
}

/// One block's motion: ahead of the force, or with the forces of its contacts.
#[inline(always)]
pub fn advance<S: Scheme>(
    c: &mut Columns<'_>,
    s: &Step,
    moved: &mut Moved,
    contacts: Option<Contacts<'_>>,
    first: bool,
) {
    let Some(contacts) = contacts else { return before::<S>(c, s, moved) };
    let mut at = 0;
    for i in 0..c.place.len() {
        let sums = contacts.sum(i, &mut at);
        after::<S>(c, s, i, sums.0[0], sums.0[1], first, moved);
        if contacts.drain.is_empty() {
            continue;
        }
        // The power of the dissipating forces was taken with velocities before the step; this adds what the
        // change of velocity makes of it.
        let (v, w) = (&c.velocity[i].v, &c.spin[i].w);
        let (v_new, w_new) = (&c.velocity_new[i].v, &c.spin_new[i].w);
        for k in 0..3 {
            moved.drain += f64::from(sums.0[2][k] * (v_new[k] - v[k]) + sums.0[3][k] * (w_new[k] - w[k]));
        }
    }
}

/// Ahead of the force: schemes that move with the acceleration of the step before.
#[inline(always)]
fn before<S: Scheme>(c: &mut Columns<'_>, s: &Step, moved: &mut Moved) {
    for i in 0..c.place.len() {
        let mut dx = [0.0; 3];
        let (v, w) = (c.velocity[i], c.spin[i]);
        c.velocity_new[i] = v;
        c.spin_new[i] = w;
        for k in 0..3 {
            let a = S::before(v.v[k], c.acceleration[i][k], s.dt);
            c.velocity_new[i].v[k] = a.v;
            dx[k] = a.dx;
            c.spin_new[i].w[k] = S::before(w.w[k], c.angular[i][k], s.dt).v;
        }
        displace(c, s, i, dx, moved);
    }
}

/// With the force `f` and torque `t` of particle `i` of the block.
#[inline(always)]
fn after<S: Scheme>(
    c: &mut Columns<'_>,
    s: &Step,
    i: usize,
    f: [f32; 3],
    t: [f32; 3],
    first: bool,
    moved: &mut Moved,
) {
    let (v, w) = (c.velocity[i], c.spin[i]);
    let radius = c.place[i].radius;
    let inv_inertia = 2.5 * v.inv_mass / (radius * radius);
    let mut dx = [0.0; 3];
    c.velocity_new[i] = v;
    c.spin_new[i] = w;
    c.force[i] = f;
    let carried = s.carried(v.v);
    for k in 0..3 {
        let free = f[k] * v.inv_mass + s.gravity[k];
        let turning = t[k] * inv_inertia;
        let (mut a, mut b) = (free, turning);
        if s.damping > 0.0 {
            a = locally_damped(v.v[k], free, s.damping, s.dt);
            b = locally_damped(w.w[k], turning, s.damping, s.dt);
        }
        let braked = a;
        a -= carried[k];
        let old = if first { [a, b] } else { [c.acceleration[i][k], c.angular[i][k]] };
        let x = S::after(v.v[k], a, old[0], s.dt);
        let y = S::after(w.w[k], b, old[1], s.dt);
        if s.damping > 0.0 {
            let mass = 1.0 / f64::from(v.inv_mass);
            let inertia = 1.0 / f64::from(inv_inertia);
            let mid = |p: f32, q: f32| 0.5 * (f64::from(p) + f64::from(q)) * f64::from(s.dt);
            moved.damped += mass * f64::from(free - braked) * mid(v.v[k], x.v)
                + inertia * f64::from(turning - b) * mid(w.w[k], y.v);
        }
        if s.gradient.is_some() {
            let mid = 0.5 * (f64::from(v.v[k]) + f64::from(x.v)) * f64::from(s.dt);
            moved.lifted -= f64::from(carried[k]) * mid / f64::from(v.inv_mass);
        }
        c.velocity_new[i].v[k] = x.v;
        c.spin_new[i].w[k] = y.v;
        dx[k] = x.dx;
        c.acceleration[i][k] = a;
        c.angular[i][k] = b;
    }
    displace(c, s, i, dx, moved);
}

/// Moves a particle by `dx` \[m\].
#[inline(always)]
fn displace(c: &mut Columns<'_>, s: &Step, i: usize, dx: [f32; 3], moved: &mut Moved) {
    let d2 = dx[0] * dx[0] + dx[1] * dx[1] + dx[2] * dx[2];
    if d2.is_nan() || d2 > s.runaway {
        moved.runaway.get_or_insert((c.first + i) as u32);
        return;
    }
    let mut away = [0.0; 3];
    for k in 0..3 {
        let units = s.inverse[k][0] * dx[0] + s.inverse[k][1] * dx[1] + s.inverse[k][2] * dx[2];
        let sum = c.rest[i][k] + units;
        let whole = sum.round_ties_even();
        c.rest[i][k] = sum - whole;
        let lo = i64::from(c.place[i].lo[k]) + i64::from(whole as i32);
        c.place[i].lo[k] = lo as u32;
        let carry = (lo >> 32) as i32;
        if carry != 0 {
            let hi = c.hi[i][k] + carry;
            c.hi[i][k] = hi;
            if s.wrap[k] > 0 {
                c.hi[i][k] = hi.rem_euclid(s.wrap[k]);
                let turns = (hi - c.hi[i][k]) / s.wrap[k];
                moved.lifted += f64::from(turns) * s.fall[k] / f64::from(c.velocity[i].inv_mass);
            }
        }
        away[k] = c.place[i].lo[k].wrapping_sub(c.lo_ref[i][k]) as i32 as f32;
    }
    let u = &s.unit;
    let mut square = 0.0;
    for k in 0..3 {
        let m = u[k][0] * away[0] + u[k][1] * away[1] + u[k][2] * away[2];
        square += m * m;
    }
    moved.displacement = moved.displacement.max(square);
}
