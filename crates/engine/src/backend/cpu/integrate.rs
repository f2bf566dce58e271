//! Motion: the forces of each particle summed in a fixed order, and one step of the integrator.

use glebe_physics::kernel::integrate::{Scheme, locally_damped};

use super::super::common::runaway_distance;
use super::contacts::Space;
use super::list::{BLOCK, Block, Incoming, Quad, Share};
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
    /// Velocities.
    pub velocity: &'a mut [Velocity],
    /// Spins.
    pub spin: &'a mut [Spin],
    /// Accelerations of the step before, then of this one.
    pub acceleration: &'a mut [[f32; 3]],
    /// Angular accelerations.
    pub angular: &'a mut [[f32; 3]],
    /// Contact forces.
    pub force: &'a mut [[f32; 3]],
    /// Places at the last rebuild.
    pub lo_ref: &'a [[u32; 3]],
}

impl Columns<'_> {
    /// The same columns, of which a compiler sees that they are of one length: an index is checked once.
    #[inline(always)]
    fn even(&mut self) -> Columns<'_> {
        let n = self.place.len();
        Columns {
            first: self.first,
            place: &mut self.place[..n],
            hi: &mut self.hi[..n],
            rest: &mut self.rest[..n],
            velocity: &mut self.velocity[..n],
            spin: &mut self.spin[..n],
            acceleration: &mut self.acceleration[..n],
            angular: &mut self.angular[..n],
            force: &mut self.force[..n],
            lo_ref: &self.lo_ref[..n],
        }
    }
}

/// What is the same for all particles.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// Step \[s\].
    pub dt: f32,
    /// Gravity \[m/s²\].
    pub gravity: Quad,
    /// Local damping.
    pub damping: f32,
    /// Velocity gradient of the cell \[1/s\] by columns, if it deforms.
    pub gradient: Option<[Quad; 3]>,
    /// From metres to units, by columns.
    pub inverse: [Quad; 3],
    /// From units to metres, by columns.
    pub unit: [Quad; 3],
    /// Whether these two have nothing beside their diagonals.
    pub diagonal: bool,
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
        let f = |m: Vec3x3| [0, 1, 2].map(|k| quad(m.map(|row| row[k] as f32)));
        let far = runaway_distance(c);
        Self {
            dt: c.dt as f32,
            gravity: quad(c.spec.gravity.map(|x| x as f32)),
            damping: c.spec.local_damping as f32,
            gradient: space.gradient.map(f),
            inverse: f(space.lattice.inverse),
            unit: f(space.lattice.unit),
            diagonal: space.lattice.orthogonal,
            wrap: [0, 1, 2].map(|k| if c.lattice.periodic[k] { c.lattice.windows[k] as i32 } else { 0 }),
            fall: c.fall(),
            runaway: (far * far) as f32,
        }
    }
}

impl Step {
    /// `U v`, what a deforming cell takes from the acceleration of a particle with the velocity `v` \[m/s²\].
    #[inline(always)]
    pub fn carried(&self, v: Quad) -> Quad {
        self.gradient.map_or([0.0; 4], |u| product::<false>(&u, v))
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
    /// What all blocks have summed.
    pub sums: &'a [Share],
    /// Where the shares of each particle are.
    pub incoming: &'a Incoming,
    /// The dissipating part of `sums`; empty where no ledger is kept.
    pub drains: &'a [Share],
}

/// The shares of a block's particles.
pub struct Shares<'a> {
    /// Of all blocks.
    all: &'a [Share],
    /// What the block itself has summed for its particles.
    own: &'a [Share],
    /// Entries of the particle `local` are `start[local]..start[local + 1]`.
    start: &'a [u32],
    /// Where in `all` other blocks have summed for it.
    entry: &'a [u32],
}

impl<'a> Contacts<'a> {
    /// Those of `all`, which is `sums` or `drains`.
    pub fn shares(&self, all: &'a [Share]) -> Shares<'a> {
        let (first, count) = (self.block.first, self.block.count());
        let base = self.incoming.base[first / BLOCK] as usize;
        let start = &self.incoming.start[first..=first + count];
        Shares { all, own: &all[base..base + count], start, entry: &self.incoming.entry }
    }
}

impl Shares<'_> {
    /// The share of the particle `local` in its own block and those in other blocks, in their order.
    #[inline(always)]
    pub fn sum(&self, local: usize) -> Share {
        let mut sum = self.own[local];
        for &k in &self.entry[self.start[local] as usize..self.start[local + 1] as usize] {
            let share = &self.all[k as usize];
            for x in 0..4 {
                sum.force[x] += share.force[x];
                sum.torque[x] += share.torque[x];
            }
        }
        sum
    }
}

/// One block's motion: ahead of the force, or with the forces of its contacts. `dx` is room to work in.
#[inline(always)]
pub fn advance<S: Scheme>(
    c: &mut Columns<'_>,
    s: &Step,
    moved: &mut Moved,
    contacts: Option<Contacts<'_>>,
    first: bool,
    dx: &mut Displacements,
) {
    let c = &mut c.even();
    match contacts.map(|contacts| (contacts, s.damping > 0.0, s.gradient.is_some())) {
        None => before::<S>(c, s, dx),
        Some((contacts, false, false)) => forced::<S, false, false>(c, s, moved, contacts, first, dx),
        Some((contacts, false, true)) => forced::<S, false, true>(c, s, moved, contacts, first, dx),
        Some((contacts, true, false)) => forced::<S, true, false>(c, s, moved, contacts, first, dx),
        Some((contacts, true, true)) => forced::<S, true, true>(c, s, moved, contacts, first, dx),
    }
    if s.diagonal {
        displace::<true>(c, s, dx, moved);
    } else {
        displace::<false>(c, s, dx, moved);
    }
}

/// Displacements of a block's particles in a step \[m\].
pub type Displacements = [Quad; BLOCK];

/// With the forces of contacts.
#[inline(always)]
fn forced<S: Scheme, const DAMPED: bool, const DEFORMS: bool>(
    c: &mut Columns<'_>,
    s: &Step,
    moved: &mut Moved,
    contacts: Contacts<'_>,
    first: bool,
    dx: &mut Displacements,
) {
    let sums = contacts.shares(contacts.sums);
    let drains = (!contacts.drains.is_empty()).then(|| contacts.shares(contacts.drains));
    let n = c.place.len().min(sums.own.len());
    for (i, dx) in dx[..n].iter_mut().enumerate() {
        let before = drains.is_some().then(|| (c.velocity[i].v, c.spin[i].w));
        *dx = after::<S, DAMPED, DEFORMS>(c, s, i, sums.sum(i), first, moved);
        if let (Some(drains), Some((v, w))) = (&drains, before) {
            // The power of the dissipating forces was taken with velocities before the step; this adds what the
            // change of velocity makes of it.
            let drain = drains.sum(i);
            let (v_new, w_new) = (&c.velocity[i].v, &c.spin[i].w);
            for k in 0..3 {
                let [f, t] = [drain.force[k], drain.torque[k]];
                moved.drain += f64::from(f * (v_new[k] - v[k]) + t * (w_new[k] - w[k]));
            }
        }
    }
}

/// Three numbers and a nought.
#[inline(always)]
pub fn quad([x, y, z]: [f32; 3]) -> Quad {
    [x, y, z, 0.0]
}

/// The first three.
#[inline(always)]
fn three([x, y, z, _]: Quad) -> [f32; 3] {
    [x, y, z]
}

/// Four numbers, one by one.
#[inline(always)]
fn four<T>(f: impl Fn(usize) -> T) -> [T; 4] {
    [f(0), f(1), f(2), f(3)]
}

/// The integer that a whole number is, of which the last 32 bits count. A sum with 1.5·2⁵² has them as its own last bits;
/// a cast would look for numbers that no integer is, one by one.
#[inline(always)]
fn integer(whole: f32) -> i32 {
    const LAST_BITS: f64 = 6_755_399_441_055_744.0;
    (f64::from(whole) + LAST_BITS).to_bits() as i32
}

/// The product of a matrix, given by columns, and a vector.
#[inline(always)]
fn product<const DIAGONAL: bool>(columns: &[Quad; 3], v: Quad) -> Quad {
    if DIAGONAL {
        [columns[0][0] * v[0], columns[1][1] * v[1], columns[2][2] * v[2], 0.0]
    } else {
        four(|k| columns[0][k] * v[0] + columns[1][k] * v[1] + columns[2][k] * v[2])
    }
}

/// Ahead of the force: schemes that move with the acceleration of the step before.
#[inline(always)]
fn before<S: Scheme>(c: &mut Columns<'_>, s: &Step, dx: &mut Displacements) {
    for (i, dx) in dx[..c.place.len()].iter_mut().enumerate() {
        let (v, w) = (c.velocity[i], c.spin[i]);
        let (linear, angular) = (quad(c.acceleration[i]), quad(c.angular[i]));
        let (old, spin) = (quad(v.v), quad(w.w));
        let x = four(|k| S::before(old[k], linear[k], s.dt));
        c.velocity[i] = Velocity { v: three(x.map(|x| x.v)), ..v };
        c.spin[i] = Spin { w: three(four(|k| S::before(spin[k], angular[k], s.dt).v)), ..w };
        *dx = x.map(|x| x.dx);
    }
}

/// With the force and torque on particle `i` of the block; returns its displacement \[m\].
#[inline(always)]
fn after<S: Scheme, const DAMPED: bool, const DEFORMS: bool>(
    c: &mut Columns<'_>,
    s: &Step,
    i: usize,
    pull: Share,
    first: bool,
    moved: &mut Moved,
) -> Quad {
    let (velocity, spin) = (c.velocity[i], c.spin[i]);
    let radius = c.place[i].radius;
    let inv_mass = velocity.inv_mass;
    let inv_inertia = 2.5 * inv_mass / (radius * radius);
    let (v, w) = (quad(velocity.v), quad(spin.w));
    let free = four(|k| pull.force[k] * inv_mass + s.gravity[k]);
    let turning = four(|k| pull.torque[k] * inv_inertia);
    let (mut a, mut b) = (free, turning);
    if DAMPED {
        a = four(|k| locally_damped(v[k], free[k], s.damping, s.dt));
        b = four(|k| locally_damped(w[k], turning[k], s.damping, s.dt));
    }
    let braked = a;
    let carried = s.carried(v);
    if DEFORMS {
        a = four(|k| braked[k] - carried[k]);
    }
    let old = if first { [a, b] } else { [quad(c.acceleration[i]), quad(c.angular[i])] };
    let x = four(|k| S::after(v[k], a[k], old[0][k], s.dt));
    let y = four(|k| S::after(w[k], b[k], old[1][k], s.dt));
    if DAMPED {
        let mass = 1.0 / f64::from(inv_mass);
        let inertia = 1.0 / f64::from(inv_inertia);
        let mid = |p: f32, q: f32| 0.5 * (f64::from(p) + f64::from(q)) * f64::from(s.dt);
        for k in 0..3 {
            moved.damped += mass * f64::from(free[k] - braked[k]) * mid(v[k], x[k].v)
                + inertia * f64::from(turning[k] - b[k]) * mid(w[k], y[k].v);
        }
    }
    if DEFORMS {
        for k in 0..3 {
            let mid = 0.5 * (f64::from(v[k]) + f64::from(x[k].v)) * f64::from(s.dt);
            moved.lifted -= f64::from(carried[k]) * mid / f64::from(inv_mass);
        }
    }
    c.velocity[i] = Velocity { v: three(x.map(|x| x.v)), inv_mass };
    c.spin[i] = Spin { w: three(y.map(|y| y.v)), ..spin };
    c.force[i] = three(pull.force);
    c.acceleration[i] = three(a);
    c.angular[i] = three(b);
    x.map(|x| x.dx)
}

/// Moves the particles of a block.
#[inline(always)]
fn displace<const DIAGONAL: bool>(c: &mut Columns<'_>, s: &Step, dx: &Displacements, moved: &mut Moved) {
    let mut furthest = moved.displacement;
    for (i, &dx) in dx[..c.place.len()].iter().enumerate() {
        let d2 = dx[0] * dx[0] + dx[1] * dx[1] + dx[2] * dx[2];
        if d2.is_nan() || d2 > s.runaway {
            moved.runaway.get_or_insert((c.first + i) as u32);
            continue;
        }
        let (rest, units) = (quad(c.rest[i]), product::<DIAGONAL>(&s.inverse, dx));
        let sum = four(|k| rest[k] + units[k]);
        let whole = sum.map(f32::round_ties_even);
        c.rest[i] = three(four(|k| sum[k] - whole[k]));
        let place = c.place[i];
        let [x, y, z] = place.lo;
        let lo = [x, y, z, 0];
        let by = whole.map(integer);
        let new = four(|k| lo[k].wrapping_add(by[k] as u32));
        c.place[i] = Place { lo: [new[0], new[1], new[2]], ..place };
        // One more window where the sum is past its end, one less where a negative step has not made it smaller.
        let carry = four(|k| i32::from(new[k] < lo[k]) - i32::from(by[k] < 0));
        if carry[0] | carry[1] | carry[2] != 0 {
            for k in 0..3 {
                let hi = c.hi[i][k] + carry[k];
                c.hi[i][k] = hi;
                if s.wrap[k] > 0 {
                    c.hi[i][k] = hi.rem_euclid(s.wrap[k]);
                    let turns = (hi - c.hi[i][k]) / s.wrap[k];
                    moved.lifted += f64::from(turns) * s.fall[k] / f64::from(c.velocity[i].inv_mass);
                }
            }
        }
        let [x, y, z] = c.lo_ref[i];
        let from = [x, y, z, 0];
        let away = product::<DIAGONAL>(&s.unit, four(|k| new[k].wrapping_sub(from[k]) as i32 as f32));
        let square = away[0] * away[0] + away[1] * away[1] + away[2] * away[2];
        furthest = furthest.max(square);
    }
    moved.displacement = furthest;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_become_their_integers() {
        for x in [0.0, -0.0, 1.0, -1.0, 12_345_678.0, -16_777_216.0, 2_147_483_520.0, -2_147_483_648.0_f32] {
            assert_eq!(integer(x), x as i32, "{x}");
        }
    }
}
