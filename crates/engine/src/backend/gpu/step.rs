//! A step: each particle sums its own contacts in the order of its list, and moves.

use cubecl::prelude::*;
use glebe_physics::IntegratorKind;
use glebe_physics::kernel::integrate::{
    Adams, Advance, Euler, Exact, Scheme, VelocityVerlet, locally_damped,
};
use glebe_physics::kernel::vector::{V3, dot, minus, plus, scaled};

use super::compensated::{sum, tidy};
use super::contacts::{COLUMNS, contacts_of, desk, seat};
use super::layout::{
    BLOCK, F4, INNER, LOOK, NONE, SIGHTS, SLOTS, SUMS, Signature, U4, active, boundary, cell_at, flag,
    float_at, gone, halt, inner, pose, quick, status, world,
};
use super::pair::inverse_inertia;
use super::surfaces::surfaces_of;
use crate::cell::STEP_GROWTH;

/// What a launch is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// A step.
    Step,
    /// Accelerations of the present configuration, before the first step of schemes that need them.
    Prime,
    /// Energies and counts of the present configuration.
    Observe,
}

/// Sums over the contacts of one particle.
#[derive(CubeType, Clone, Copy)]
pub struct Sums {
    /// Force \[N\].
    pub force: V3,
    /// Torque \[N m\].
    pub torque: V3,
    /// The dashpots' part of the force \[N\].
    pub dash: V3,
    /// The dashpots' part of the torque \[N m\].
    pub drag: V3,
    /// Torque of rolling resistance \[N m\].
    pub roll: V3,
    /// This particle's share of the contacts' energies and losses, see [`Effect`].
    pub energy_normal: f32,
    /// Energy of tangential springs \[J\].
    pub energy_tangential: f32,
    /// The same before the step's motion \[J\].
    pub energy_before: f32,
    /// Lost to friction \[J\].
    pub friction_loss: f32,
    /// Power of dashpots \[W\].
    pub dash_power: f32,
    /// Power of rolling resistance \[W\].
    pub roll_power: f32,
    /// Work of surfaces \[W\].
    pub work: f32,
    /// Largest overlap as a fraction of the smaller radius.
    pub worst: f32,
    /// Contacts with particles.
    pub contacts: u32,
    /// Contacts with surfaces.
    pub touches: u32,
    /// Contacts of the owner with particles, where a sample is looked at.
    pub partners: f32,
}

/// A rounding of small angles and such needs no sign of zero: the vector of zeros.
#[cube]
pub fn zero() -> V3 {
    V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 }
}

/// `a` if `second`, else `b`.
#[cube]
pub fn pick(second: bool, a: V3, b: V3) -> V3 {
    V3 { x: select(second, a.x, b.x), y: select(second, a.y, b.y), z: select(second, a.z, b.z) }
}

#[cube]
pub fn first3(q: F4) -> V3 {
    V3 { x: q[0], y: q[1], z: q[2] }
}

#[cube]
pub fn bits3(q: U4) -> V3 {
    V3 { x: f32::reinterpret(q[0]), y: f32::reinterpret(q[1]), z: f32::reinterpret(q[2]) }
}

#[cube]
pub fn four(a: f32, b: f32, c: f32, d: f32) -> F4 {
    let mut q = F4::empty();
    q[0] = a;
    q[1] = b;
    q[2] = c;
    q[3] = d;
    q
}

#[cube]
pub fn quad(a: u32, b: u32, c: u32, d: u32) -> U4 {
    let mut q = U4::empty();
    q[0] = a;
    q[1] = b;
    q[2] = c;
    q[3] = d;
    q
}

/// The square of a difference in units, in m², roughly.
#[cube]
pub fn square(worlds: &Array<u32>, c: u32, dx: i32, dy: i32, dz: i32, #[comptime] orthogonal: bool) -> f32 {
    let u = c + world::UNIT;
    let (x, y, z) = (f32::cast_from(dx), f32::cast_from(dy), f32::cast_from(dz));
    let m = turned(worlds, u, x, y, z, orthogonal);
    m.x * m.x + m.y * m.y + m.z * m.z
}

/// The square of the distance of two places, in m², roughly.
#[cube]
pub fn apart2(worlds: &Array<u32>, c: u32, a: U4, b: U4, #[comptime] orthogonal: bool) -> f32 {
    square(
        worlds,
        c,
        i32::cast_from(b[0] - a[0]),
        i32::cast_from(b[1] - a[1]),
        i32::cast_from(b[2] - a[2]),
        orthogonal,
    )
}

/// The product of the matrix at `at`, by rows, and a vector. Cells along the axes have diagonal matrices.
#[cube]
pub fn turned(worlds: &Array<u32>, at: u32, x: f32, y: f32, z: f32, #[comptime] orthogonal: bool) -> V3 {
    if comptime!(orthogonal) {
        V3 {
            x: float_at(worlds, at) * x,
            y: float_at(worlds, at + 4u32) * y,
            z: float_at(worlds, at + 8u32) * z,
        }
    } else {
        V3 {
            x: float_at(worlds, at) * x + float_at(worlds, at + 1u32) * y + float_at(worlds, at + 2u32) * z,
            y: float_at(worlds, at + 3u32) * x
                + float_at(worlds, at + 4u32) * y
                + float_at(worlds, at + 5u32) * z,
            z: float_at(worlds, at + 6u32) * x
                + float_at(worlds, at + 7u32) * y
                + float_at(worlds, at + 8u32) * z,
        }
    }
}

#[cube]
fn ahead(v: f32, a: f32, dt: f32, #[comptime] kind: IntegratorKind) -> Advance {
    match kind {
        IntegratorKind::Euler => Euler::before(v, a, dt),
        IntegratorKind::Exact => Exact::before(v, a, dt),
        IntegratorKind::Adams => Adams::before(v, a, dt),
        IntegratorKind::VelocityVerlet => VelocityVerlet::before(v, a, dt),
    }
}

#[cube]
fn advanced(v: f32, a: f32, old: f32, dt: f32, #[comptime] kind: IntegratorKind) -> Advance {
    match kind {
        IntegratorKind::Euler => Euler::after(v, a, old, dt),
        IntegratorKind::Exact => Exact::after(v, a, old, dt),
        IntegratorKind::Adams => Adams::after(v, a, old, dt),
        IntegratorKind::VelocityVerlet => VelocityVerlet::after(v, a, old, dt),
    }
}

/// One component of the place after a displacement of `units`: fraction, rest and the windows crossed.
#[derive(CubeType, Clone, Copy)]
struct Shifted {
    lo: u32,
    rest: f32,
    carry: i32,
}

#[cube]
fn shifted(lo: u32, rest: f32, units: f32) -> Shifted {
    let moved = rest + units;
    let whole = f32::round(moved);
    let steps = i32::cast_from(whole);
    let now = lo + u32::cast_from(steps);
    let up = steps > 0i32 && now < lo;
    let down = steps < 0i32 && now > lo;
    Shifted { lo: now, rest: moved - whole, carry: select(up, 1i32, select(down, 0i32 - 1i32, 0i32)) }
}

/// The cell at a step of a job, see [`cell_at`]; the world's own words where it stands still.
#[cube]
fn cell_of_step(worlds: &Array<u32>, c: u32, t: u32, #[comptime] s: Signature) -> u32 {
    if comptime!(s.deforms) { cell_at(worlds, c, t) } else { c }
}

/// What a cell that deforms takes from the acceleration of a particle with velocity `v`.
#[cube]
fn carried(worlds: &Array<u32>, c: u32, v: V3) -> V3 {
    turned(worlds, c + world::GRADIENT, v.x, v.y, v.z, false)
}

/// What moving a particle ends with.
#[derive(CubeType, Clone, Copy)]
struct Landed {
    x: Shifted,
    y: Shifted,
    z: Shifted,
    /// Square of the displacement since the last rebuild \[m²\].
    away: f32,
}

#[cube]
fn displaced(
    worlds: &Array<u32>,
    c: u32,
    place: U4,
    rest: U4,
    lo_ref: U4,
    dx: V3,
    #[comptime] orthogonal: bool,
) -> Landed {
    let moved = turned(worlds, c + world::INVERSE, dx.x, dx.y, dx.z, orthogonal);
    let x = shifted(place[0], f32::reinterpret(rest[0]), moved.x);
    let y = shifted(place[1], f32::reinterpret(rest[1]), moved.y);
    let z = shifted(place[2], f32::reinterpret(rest[2]), moved.z);
    let away = square(
        worlds,
        c,
        i32::cast_from(x.lo - lo_ref[0]),
        i32::cast_from(y.lo - lo_ref[1]),
        i32::cast_from(z.lo - lo_ref[2]),
        orthogonal,
    );
    Landed { x, y, z, away }
}

/// Windows after crossing, wrapped on periodic axes.
#[cube]
fn crossed(worlds: &Array<u32>, c: u32, hi: u32, carry: i32, axis: u32) -> u32 {
    let windows = i32::cast_from(worlds[(c + world::WINDOWS + axis) as usize]);
    let periodic = worlds[(c + world::PERIODIC + axis) as usize] == 1u32;
    let now = i32::cast_from(hi) + carry;
    let above = select(now >= windows, now - windows, now);
    let within = select(above < 0i32, above + windows, above);
    u32::cast_from(select(periodic, within, now))
}

/// How many periods a crossing wrapped: 1 upwards, -1 downwards.
#[cube]
fn wraps(worlds: &Array<u32>, c: u32, hi: u32, carry: i32, axis: u32) -> f32 {
    let windows = i32::cast_from(worlds[(c + world::WINDOWS + axis) as usize]);
    let periodic = worlds[(c + world::PERIODIC + axis) as usize] == 1u32;
    let now = i32::cast_from(hi) + carry;
    let up = select(now >= windows, 1.0f32, 0.0f32);
    let down = select(now < 0i32, 1.0f32, 0.0f32);
    select(periodic, up - down, 0.0f32)
}

/// Windows and number of a particle that has landed in other windows.
#[cube]
fn landed(worlds: &Array<u32>, c: u32, home: U4, land: Landed) -> U4 {
    quad(
        crossed(worlds, c, home[0], land.x.carry, 0u32),
        crossed(worlds, c, home[1], land.y.carry, 1u32),
        crossed(worlds, c, home[2], land.z.carry, 2u32),
        home[3],
    )
}

/// What gravity's seams do on a particle of unit mass that has landed in other windows \[J/kg\].
#[cube]
fn seam_work(worlds: &Array<u32>, c: u32, home: U4, land: Landed) -> f32 {
    let e = c + world::WRAP;
    wraps(worlds, c, home[0], land.x.carry, 0u32) * float_at(worlds, e)
        + wraps(worlds, c, home[1], land.y.carry, 1u32) * float_at(worlds, e + 1u32)
        + wraps(worlds, c, home[2], land.z.carry, 2u32) * float_at(worlds, e + 2u32)
}

/// An acceleration with local damping.
#[cube]
fn damped(v: V3, a: V3, d: f32, dt: f32) -> V3 {
    V3 {
        x: locally_damped(v.x, a.x, d, dt),
        y: locally_damped(v.y, a.y, d, dt),
        z: locally_damped(v.z, a.z, d, dt),
    }
}

/// A particle's place along gravity, from the domain's origin \[m²/s²\].
#[cube]
fn height(worlds: &Array<u32>, c: u32, place: U4, home: U4, rest: U4) -> f32 {
    let x = far(home[0], place[0], rest[0]);
    let y = far(home[1], place[1], rest[1]);
    let z = far(home[2], place[2], rest[2]);
    let m = turned(worlds, c + world::UNIT, x, y, z, false);
    let g = c + world::GRAVITY;
    float_at(worlds, g) * m.x + float_at(worlds, g + 1u32) * m.y + float_at(worlds, g + 2u32) * m.z
}

/// Units from the origin along an axis.
#[cube]
fn far(hi: u32, lo: u32, rest: u32) -> f32 {
    f32::cast_from(i32::cast_from(hi)) * 4_294_967_296.0f32 + f32::cast_from(lo) + f32::reinterpret(rest)
}

/// F4 that the sums of a row take.
pub const ROW_QUADS: u32 = 6;

/// The sums that [`surfaces`] left for a row; nothing for `NONE`.
#[cube]
fn on_surfaces(row_sums: &Array<F4>, row: u32) -> Sums {
    // Row 0 holds zeros: particles without a row read them.
    let at = select(row == NONE, 0u32, row + 1u32) * ROW_QUADS;
    let a = row_sums[at as usize];
    let b = row_sums[(at + 1u32) as usize];
    let c = row_sums[(at + 2u32) as usize];
    let d = row_sums[(at + 3u32) as usize];
    let e = row_sums[(at + 4u32) as usize];
    let f = row_sums[(at + 5u32) as usize];
    Sums {
        force: first3(a),
        torque: first3(b),
        dash: first3(c),
        drag: first3(d),
        roll: first3(e),
        energy_normal: a[3],
        energy_tangential: b[3],
        energy_before: c[3],
        friction_loss: d[3],
        dash_power: e[3],
        roll_power: f[0],
        work: f[1],
        worst: f[2],
        contacts: 0u32,
        touches: u32::cast_from(f[3]),
        partners: 0.0f32,
    }
}

/// Contacts of the particles that are near surfaces, where they do not ride along with [`step`]. One unit per
/// row.
#[cube(launch_unchecked, fast_math = quick())]
pub fn surfaces(
    k: u32,
    padded: u32,
    row_room: u32,
    facet_room: u32,
    names: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    pairs: &Array<F4>,
    place: &Array<U4>,
    vel: &Array<F4>,
    spin: &Array<U4>,
    own: &Array<U4>,
    refs: &Array<U4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    rows: &Array<u32>,
    facets: &Array<U4>,
    told: &Array<F4>,
    row_count: &mut Array<u32>,
    row_mem: &mut Array<F4>,
    push: &mut Array<F4>,
    row_sums: &mut Array<F4>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) {
    let w = world_of[CUBE_POS + (padded / BLOCK) as usize];
    let c = w * world::WORDS;
    let st = w * status::WORDS;
    let row = u32::cast_from(ABSOLUTE_POS);
    let in_use = row - worlds[(c + world::ROWS) as usize] < states[(st + status::ROWS) as usize];
    if runs(states, flags, w, k, purpose) {
        let parity = (states[(st + status::PARITY) as usize] + k) & 1u32;
        if in_use {
            let which = states[(st + status::LISTED) as usize];
            let t = states[(st + status::BASE) as usize] + k;
            let full = float_at(worlds, c + world::DT);
            let dt = if comptime!(purpose == Purpose::Step) { full } else { 0.0f32 * full };
            let i = rows[(2u32 * padded + 3u32 * (which * row_room + row) + 2u32) as usize];
            let q = surfaces_of(
                row, i, k, which, parity, padded, row_room, facet_room, t, w, dt, flags, worlds, place, vel,
                spin, own, refs, pairs, bounds, poses, tris, verts, rows, facets, told, row_count, row_mem,
                push, s, purpose,
            );
            let at = (row + 1u32) * ROW_QUADS;
            row_sums[at as usize] = four(q.force.x, q.force.y, q.force.z, q.energy_normal);
            row_sums[(at + 1u32) as usize] = four(q.torque.x, q.torque.y, q.torque.z, q.energy_tangential);
            row_sums[(at + 2u32) as usize] = four(q.dash.x, q.dash.y, q.dash.z, q.energy_before);
            row_sums[(at + 3u32) as usize] = four(q.drag.x, q.drag.y, q.drag.z, q.friction_loss);
            row_sums[(at + 4u32) as usize] = four(q.roll.x, q.roll.y, q.roll.z, q.dash_power);
            row_sums[(at + 5u32) as usize] = four(q.roll_power, q.work, q.worst, f32::cast_from(q.touches));
        }
        if comptime!(purpose == Purpose::Step) {
            let mut table = SharedMemory::<f32>::new(comptime!((6 * BLOCK) as usize));
            shared_push(
                &mut table,
                true,
                UNIT_POS,
                select(in_use, row, NONE),
                k * (row_room / BLOCK) + u32::cast_from(CUBE_POS),
                names,
                worlds[(c + world::SURFACES) as usize],
                row_room,
                parity,
                row_count,
                push,
                BLOCK,
                BLOCK,
            );
        }
    }
}

/// Whether a launch does anything in a world.
#[cube]
pub fn runs(
    states: &Array<u32>,
    flags: &Array<Atomic<u32>>,
    w: u32,
    k: u32,
    #[comptime] purpose: Purpose,
) -> bool {
    let unprimed = states[(w * status::WORDS + status::PRIMED) as usize] == 0u32;
    let asked = states[(w * status::WORDS + status::ASKED) as usize] == LOOK;
    match purpose {
        Purpose::Step => active(states, flags, w, k),
        Purpose::Prime => active(states, flags, w, k) && unprimed,
        Purpose::Observe => asked,
    }
}

/// No contacts.
#[cube]
pub fn nothing() -> Sums {
    Sums {
        force: zero(),
        torque: zero(),
        dash: zero(),
        drag: zero(),
        roll: zero(),
        energy_normal: 0.0f32,
        energy_tangential: 0.0f32,
        energy_before: 0.0f32,
        friction_loss: 0.0f32,
        dash_power: 0.0f32,
        roll_power: 0.0f32,
        work: 0.0f32,
        worst: 0.0f32,
        contacts: 0u32,
        touches: 0u32,
        partners: 0.0f32,
    }
}

/// Half of what a contact adds to the sums of a sample, see [`inner`]; the other half is seen from the other side.
#[cube]
pub fn see_contact(sights: &mut Array<f32>, n: V3, distance: f32, force: V3, stiffness: f32) {
    let half = 0.5f32 * distance;
    // `force` acts on the first, sums are of that on the second.
    sights[0] -= half * n.x * force.x;
    sights[1] -= half * n.x * force.y;
    sights[2] -= half * n.x * force.z;
    sights[3] -= half * n.y * force.x;
    sights[4] -= half * n.y * force.y;
    sights[5] -= half * n.y * force.z;
    sights[6] -= half * n.z * force.x;
    sights[7] -= half * n.z * force.y;
    sights[8] -= half * n.z * force.z;
    square_of(sights, inner::FABRIC, n, 0.5f32);
    sights[inner::STIFFNESS as usize] += half * distance * stiffness;
}

/// Adds `s v⊗v`: xx, yy, zz, xy, yz, zx.
#[cube]
fn square_of(sights: &mut Array<f32>, #[comptime] at: u32, v: V3, s: f32) {
    sights[at as usize] += s * v.x * v.x;
    sights[comptime!(at + 1) as usize] += s * v.y * v.y;
    sights[comptime!(at + 2) as usize] += s * v.z * v.z;
    sights[comptime!(at + 3) as usize] += s * v.x * v.y;
    sights[comptime!(at + 4) as usize] += s * v.y * v.z;
    sights[comptime!(at + 5) as usize] += s * v.z * v.x;
}

/// The sums of columns of `shared` (`columns` of one value per unit) left in the first entry of each.
#[cube]
fn fold(shared: &mut SharedMemory<f32>, #[comptime] columns: u32, #[comptime] units: u32) {
    let mut width = comptime!(units / 2).runtime();
    sync_cube();
    while width > 0u32 {
        if UNIT_POS < width {
            #[unroll]
            for q in 0..columns {
                let at = q * units + UNIT_POS;
                let other = shared[(at + width) as usize];
                shared[at as usize] += other;
            }
        }
        sync_cube();
        width /= 2u32;
    }
}

/// Adds `x` to the pair of f32 at `at`.
#[cube]
fn accumulate(sums: &mut Array<f32>, at: u32, x: f32) {
    let s = sum(sums[at as usize], x);
    let total = tidy(s.h, sums[(at + 1u32) as usize] + s.l);
    sums[at as usize] = total.h;
    sums[(at + 1u32) as usize] = total.l;
}

/// Moves particles ahead of the force, for schemes that do.
#[cube(launch_unchecked)]
pub fn drift(
    k: u32,
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    place: &mut Array<U4>,
    vel: &mut Array<F4>,
    spin: &mut Array<U4>,
    own: &mut Array<U4>,
    refs: &Array<U4>,
    slow: &Array<F4>,
    #[comptime] s: Signature,
) {
    let w = world_of[CUBE_POS];
    if active(states, flags, w, k) {
        let c = w * world::WORDS;
        let st = w * status::WORDS;
        let first = worlds[(c + world::FIRST) as usize];
        let i = u32::cast_from(ABSOLUTE_POS);
        if i - first < states[(st + status::COUNT) as usize] {
            let dt = float_at(worlds, c + world::DT);
            let half = ((states[(st + status::PARITY) as usize] + k) & 1u32) * padded;
            let listed = states[(st + status::LISTED) as usize] * padded;
            let me = (half + i) as usize;
            let v = vel[me];
            let turn = spin[me];
            let w3 = bits3(turn);
            let mine = listed + i;
            let a = slow[(3u32 * mine) as usize];
            let b = slow[(3u32 * mine + 1u32) as usize];
            let x = ahead(v[0], a[0], dt, comptime!(s.integrator));
            let y = ahead(v[1], a[1], dt, comptime!(s.integrator));
            let z = ahead(v[2], a[2], dt, comptime!(s.integrator));
            let wx = ahead(w3.x, b[0], dt, comptime!(s.integrator));
            let wy = ahead(w3.y, b[1], dt, comptime!(s.integrator));
            let wz = ahead(w3.z, b[2], dt, comptime!(s.integrator));
            vel[me] = four(x.v, y.v, z.v, v[3]);
            spin[me] = quad(u32::reinterpret(wx.v), u32::reinterpret(wy.v), u32::reinterpret(wz.v), turn[3]);
            let here = place[me];
            let home = own[(2u32 * mine) as usize];
            let rest = own[(2u32 * mine + 1u32) as usize];
            let land = displaced(
                worlds,
                cell_of_step(worlds, c, states[(st + status::BASE) as usize] + k, s),
                here,
                rest,
                refs[(2u32 * mine) as usize],
                V3 { x: x.dx, y: y.dx, z: z.dx },
                comptime!(s.orthogonal),
            );
            place[me] = quad(land.x.lo, land.y.lo, land.z.lo, here[3]);
            let mut wrapped = 0.0f32;
            if land.x.carry != 0i32 || land.y.carry != 0i32 || land.z.carry != 0i32 {
                own[(2u32 * mine) as usize] = landed(worlds, c, home, land);
                wrapped += seam_work(worlds, c, home, land) / v[3];
            }
            own[(2u32 * mine + 1u32) as usize] = quad(
                u32::reinterpret(land.x.rest),
                u32::reinterpret(land.y.rest),
                u32::reinterpret(land.z.rest),
                u32::reinterpret(wrapped),
            );
        }
    }
}

/// One step, or a look at the present configuration.
#[cube(launch_unchecked, fast_math = quick())]
pub fn step(
    k: u32,
    blocks: u32,
    padded: u32,
    list_room: u32,
    row_room: u32,
    facet_room: u32,
    names: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    pairs: &Array<F4>,
    place: &mut Array<U4>,
    vel: &mut Array<F4>,
    spin: &mut Array<U4>,
    own: &mut Array<U4>,
    refs: &Array<U4>,
    slow: &mut Array<F4>,
    lists: &Array<u32>,
    nbr: &mut Array<u32>,
    hist: &mut Array<F4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    rows: &Array<u32>,
    facets: &Array<U4>,
    row_count: &mut Array<u32>,
    row_mem: &mut Array<F4>,
    push: &mut Array<F4>,
    row_sums: &Array<F4>,
    sums: &mut Array<f32>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) {
    // A grid of rows has blocks beyond those asked for.
    let launched = min(u32::cast_from(CUBE_POS), blocks - 1u32);
    // Particles near surfaces take longest, so their blocks come first.
    let far = padded / comptime!(s.shape.owners);
    let near = blocks - far;
    let block = select(launched < near, launched + far, launched - near);
    let w = world_of[select(
        block < far,
        block * comptime!(s.shape.owners) / BLOCK,
        padded / BLOCK + (max(block, far) - far) * comptime!(s.shape.near) / BLOCK,
    ) as usize];
    if u32::cast_from(CUBE_POS) < blocks && runs(states, flags, w, k, purpose) {
        let c = w * world::WORDS;
        let st = w * status::WORDS;
        let f = w * flag::WORDS;
        let first = worlds[(c + world::FIRST) as usize];
        let base = states[(st + status::BASE) as usize];
        let parity = (states[(st + status::PARITY) as usize] + k) & 1u32;
        let which = states[(st + status::LISTED) as usize];
        let half = parity * padded;
        let ahead_half = (1u32 - parity) * padded;
        let listed = which * padded;
        let full = float_at(worlds, c + world::DT);
        let moves = comptime!(purpose == Purpose::Step);
        let dt = select(moves, full, 0.0f32);
        let t = base + k;
        // Forces of schemes that move before them belong to the end of the step.
        let late = comptime!(u32::from(moves && s.integrator == IntegratorKind::VelocityVerlet));
        let cell = cell_of_step(worlds, c, t + late, s);
        let mut out = Array::<f32>::new(comptime!(COLUMNS as usize));
        #[unroll]
        for q in 0..COLUMNS {
            out[q as usize] = 0.0f32;
        }
        let mut sight = Array::<f32>::new(comptime!(INNER as usize));
        if comptime!(s.sample && purpose == Purpose::Observe) {
            #[unroll]
            for q in 0..INNER {
                sight[q as usize] = 0.0f32;
            }
        }
        let mut desk = desk(s, purpose);
        seat(&mut desk, block, padded, row_room, w, which, worlds, states, lists, rows, s);
        let p = contacts_of(
            &mut desk, block, k, padded, list_room, row_room, facet_room, names, w, which, parity, t, cell,
            dt, flags, worlds, pairs, place, vel, spin, own, refs, nbr, hist, bounds, poses, tris, verts,
            rows, facets, row_count, row_mem, push, &mut sight, s, purpose,
        );
        // Energies and losses are those of the contacts that this unit looked at.
        if comptime!(purpose == Purpose::Observe) {
            out[3] = p.energy_normal;
            out[4] = p.energy_before;
            out[5] = f32::cast_from(p.contacts);
            out[6] = f32::cast_from(p.touches);
            out[7] = p.worst;
        }
        if comptime!(s.ledger && purpose == Purpose::Step) {
            out[0] = p.friction_loss;
            out[1] = 0.0f32 - dt * p.dash_power;
            out[2] = 0.0f32 - dt * p.roll_power;
            out[4] = dt * p.work;
            out[5] = p.energy_before;
            out[6] = p.energy_tangential;
        }
        let mut worst = p.worst;
        let mut i = NONE.runtime();
        if UNIT_POS < comptime!(s.shape.owners) {
            i = desk.who[UNIT_POS as usize];
        }
        if i != NONE {
            let me = (half + i) as usize;
            let mine = listed + i;
            let here = place[me];
            let v4 = vel[me];
            let turn = spin[me];
            let v = first3(v4);
            let w3 = bits3(turn);
            let im = v4[3];
            let r = f32::reinterpret(here[3]);
            let home = own[(2u32 * mine) as usize];
            let rest = own[(2u32 * mine + 1u32) as usize];
            let lo_ref = refs[(2u32 * mine) as usize];
            let q = if comptime!(s.surfaces && !s.merged) {
                on_surfaces(row_sums, rows[mine as usize])
            } else {
                nothing()
            };
            worst = f32::max(worst, q.worst);
            let force = plus(p.force, q.force);
            let torque = plus(p.torque, q.torque);
            let inv_inertia = inverse_inertia(im, 1.0f32 / r);
            let g = c + world::GRAVITY;
            let free = V3 {
                x: force.x * im + float_at(worlds, g),
                y: force.y * im + float_at(worlds, g + 1u32),
                z: force.z * im + float_at(worlds, g + 2u32),
            };
            let turning = scaled(torque, inv_inertia);
            if comptime!(purpose == Purpose::Observe) {
                out[0] = 0.5f32 * dot(v, v) / im;
                out[1] = 0.2f32 * r * r * dot(w3, w3) / im;
                out[2] = 0.0f32 - height(worlds, c, here, home, rest) / im;
                out[3] += q.energy_normal;
                out[4] += q.energy_before;
                out[6] += f32::cast_from(q.touches);
                out[7] = worst;
                out[8] = dot(v, v);
                if comptime!(s.sample) {
                    square_of(&mut sight, inner::KINETIC, v, 1.0f32 / im);
                    sight[inner::CUBES as usize] = r * r * r;
                    sight[inner::RATTLERS as usize] = select(p.partners == 0.0f32, 1.0f32, 0.0f32);
                    sight[comptime!(inner::RATTLERS + 1) as usize] =
                        select(p.partners == 1.0f32, 1.0f32, 0.0f32);
                }
            } else if comptime!(purpose == Purpose::Prime) {
                let a = if comptime!(s.deforms) { minus(free, carried(worlds, c, v)) } else { free };
                slow[(3u32 * mine) as usize] = four(a.x, a.y, a.z, 0.0f32);
                slow[(3u32 * mine + 1u32) as usize] = four(turning.x, turning.y, turning.z, 0.0f32);
            } else {
                let d = float_at(worlds, c + world::DAMPING);
                let braked = if comptime!(s.damping) { damped(v, free, d, dt) } else { free };
                let a = if comptime!(s.deforms) { minus(braked, carried(worlds, c, v)) } else { braked };
                let b = if comptime!(s.damping) { damped(w3, turning, d, dt) } else { turning };
                let known = states[(st + status::PRIMED) as usize] == 1u32 || t > 0u32;
                let old_a = if comptime!(s.integrator == IntegratorKind::Adams) {
                    pick(known, first3(slow[(3u32 * mine) as usize]), a)
                } else {
                    a
                };
                let old_b = if comptime!(s.integrator == IntegratorKind::Adams) {
                    pick(known, first3(slow[(3u32 * mine + 1u32) as usize]), b)
                } else {
                    b
                };
                let x = advanced(v.x, a.x, old_a.x, dt, comptime!(s.integrator));
                let y = advanced(v.y, a.y, old_a.y, dt, comptime!(s.integrator));
                let z = advanced(v.z, a.z, old_a.z, dt, comptime!(s.integrator));
                let wx = advanced(w3.x, b.x, old_b.x, dt, comptime!(s.integrator));
                let wy = advanced(w3.y, b.y, old_b.y, dt, comptime!(s.integrator));
                let wz = advanced(w3.z, b.z, old_b.z, dt, comptime!(s.integrator));
                let dx = V3 { x: x.dx, y: y.dx, z: z.dx };
                let d2 = dot(dx, dx);
                let fine = d2 <= float_at(worlds, c + world::RUNAWAY);
                let held = pick(fine, dx, zero());
                let land = displaced(worlds, cell, here, rest, lo_ref, held, comptime!(s.orthogonal));
                let next = (ahead_half + i) as usize;
                place[next] = quad(land.x.lo, land.y.lo, land.z.lo, here[3]);
                vel[next] = four(x.v, y.v, z.v, im);
                spin[next] =
                    quad(u32::reinterpret(wx.v), u32::reinterpret(wy.v), u32::reinterpret(wz.v), turn[3]);
                own[(2u32 * mine + 1u32) as usize] = quad(
                    u32::reinterpret(land.x.rest),
                    u32::reinterpret(land.y.rest),
                    u32::reinterpret(land.z.rest),
                    0u32,
                );
                // What the particle did ahead of the force was left beside its rest.
                let mut wrapped = f32::reinterpret(rest[3]);
                if land.x.carry != 0i32 || land.y.carry != 0i32 || land.z.carry != 0i32 {
                    own[(2u32 * mine) as usize] = landed(worlds, c, home, land);
                    wrapped += seam_work(worlds, c, home, land) / im;
                }
                // Accelerations are remembered by schemes that need them, and at the end of a job.
                let keeps =
                    comptime!(matches!(s.integrator, IntegratorKind::Adams | IntegratorKind::VelocityVerlet));
                let last = t + 1u32 == states[(st + status::TARGET) as usize];
                if keeps || last {
                    slow[(3u32 * mine) as usize] = four(a.x, a.y, a.z, 0.0f32);
                    slow[(3u32 * mine + 1u32) as usize] = four(b.x, b.y, b.z, 0.0f32);
                    slow[(3u32 * mine + 2u32) as usize] = four(force.x, force.y, force.z, 0.0f32);
                }
                // Lists serve until a particle has moved half the skin; schemes that move before the force
                // will do so with the velocity that they have now.
                let skin = float_at(states, st + status::SKIN);
                let mut away = land.away;
                if comptime!(s.integrator == IntegratorKind::VelocityVerlet) {
                    let ax = ahead(x.v, a.x, dt, comptime!(s.integrator));
                    let ay = ahead(y.v, a.y, dt, comptime!(s.integrator));
                    let az = ahead(z.v, a.z, dt, comptime!(s.integrator));
                    let next_dx = V3 { x: ax.dx, y: ay.dx, z: az.dx };
                    let reach = f32::sqrt(land.away) + f32::sqrt(dot(next_dx, next_dx));
                    away = reach * reach;
                }
                let mut outdated = away > 0.25f32 * skin * skin;
                if comptime!(s.deforms) {
                    let rebuilt = states[(st + status::REBUILT) as usize];
                    let known = rebuilt != NONE;
                    let then = cell_at(worlds, c, select(known, rebuilt, 0u32)) + world::PATH;
                    let since = worlds[select(known, then, c + world::REFERENCE) as usize];
                    // The next forces are those of the cell one step later.
                    let now = worlds[(cell_at(worlds, c, t + late + 1u32) + world::PATH) as usize];
                    let touch =
                        2.0f32 * float_at(worlds, c + world::RADIUS_MAX) + float_at(worlds, c + world::RANGE);
                    let left = skin - gone(since, now) * (touch + skin);
                    let growth = comptime!((STEP_GROWTH * STEP_GROWTH) as f32);
                    outdated = left <= 0.0f32 || growth * away > 0.25f32 * left * left;
                }
                if outdated {
                    flags[(f + flag::STALE) as usize].fetch_min(k);
                }
                if !fine {
                    flags[(f + flag::HALT) as usize].fetch_max(halt::RUNAWAY);
                    flags[(f + flag::WHO) as usize].fetch_min(home[3]);
                    flags[(f + flag::STALE) as usize].fetch_min(k);
                }
                if comptime!(s.ledger) {
                    // Dissipating forces act over the step with the mean of old and new velocity; in a split
                    // step the new one is already in the middle.
                    let share = comptime!(if s.integrator == IntegratorKind::VelocityVerlet {
                        1.0f32
                    } else {
                        0.5f32
                    });
                    let dv = V3 { x: x.v - v.x, y: y.v - v.y, z: z.v - v.z };
                    let dw = V3 { x: wx.v - w3.x, y: wy.v - w3.y, z: wz.v - w3.z };
                    let dash = plus(p.dash, q.dash);
                    let drag = plus(p.drag, q.drag);
                    let roll = plus(p.roll, q.roll);
                    out[0] += q.friction_loss;
                    out[1] -= dt * (q.dash_power + share * (dot(dash, dv) + dot(drag, dw)));
                    out[2] -= dt * (q.roll_power + share * dot(roll, dw));
                    if comptime!(s.damping) {
                        let lost = minus(free, braked);
                        let spun = V3 { x: turning.x - b.x, y: turning.y - b.y, z: turning.z - b.z };
                        let mid =
                            V3 { x: 0.5f32 * (v.x + x.v), y: 0.5f32 * (v.y + y.v), z: 0.5f32 * (v.z + z.v) };
                        let mid_w = V3 {
                            x: 0.5f32 * (w3.x + wx.v),
                            y: 0.5f32 * (w3.y + wy.v),
                            z: 0.5f32 * (w3.z + wz.v),
                        };
                        out[3] = dt * (dot(lost, mid) / im + dot(spun, mid_w) / inv_inertia);
                    }
                    out[4] += dt * q.work + wrapped;
                    if comptime!(s.deforms) {
                        out[4] -=
                            0.5f32 * dt * dot(carried(worlds, c, v), plus(v, V3 { x: x.v, y: y.v, z: z.v }))
                                / im;
                    }
                    out[5] += q.energy_before;
                    out[6] += q.energy_tangential;
                }
            }
        }
        if comptime!(purpose == Purpose::Observe) {
            sync_cube();
            #[unroll]
            for q in 0..SIGHTS {
                desk.table[(q * s.shape.units + UNIT_POS) as usize] = out[q as usize];
            }
            sync_cube();
            if UNIT_POS == 0u32 {
                let mut worst = 0.0f32;
                let mut speed = 0.0f32;
                for q in 0..comptime!(s.shape.units).runtime() {
                    worst = f32::max(worst, desk.table[(7u32 * s.shape.units + q) as usize]);
                    speed = f32::max(speed, desk.table[(8u32 * s.shape.units + q) as usize]);
                }
                let row = block * comptime!(s.sights());
                sums[(row + 7u32) as usize] = worst;
                sums[(row + 8u32) as usize] = speed;
            }
            fold(&mut desk.table, 7u32, s.shape.units);
            let row = block * comptime!(s.sights());
            if UNIT_POS < 7u32 {
                sums[(row + UNIT_POS) as usize] = desk.table[(UNIT_POS * s.shape.units) as usize];
            }
            if comptime!(s.sample) {
                #[unroll]
                for part in 0..3u32 {
                    sync_cube();
                    #[unroll]
                    for q in 0..comptime!(INNER / 3) {
                        desk.table[(q * s.shape.units + UNIT_POS) as usize] =
                            sight[comptime!(part * (INNER / 3) + q) as usize];
                    }
                    fold(&mut desk.table, comptime!(INNER / 3), s.shape.units);
                    if UNIT_POS < comptime!(INNER / 3) {
                        sums[(row + comptime!(SIGHTS + part * (INNER / 3)) + UNIT_POS) as usize] =
                            desk.table[(UNIT_POS * s.shape.units) as usize];
                    }
                }
            }
        }
        if comptime!(purpose == Purpose::Step) {
            if u32::reinterpret(worst) > flags[(f + flag::WORST) as usize].load() {
                flags[(f + flag::WORST) as usize].fetch_max(u32::reinterpret(worst));
            }
            if block * comptime!(s.shape.owners) == first {
                if UNIT_POS == 0u32 {
                    flags[(f + flag::BEATS) as usize].fetch_add(1u32);
                }
                if comptime!(s.surfaces) {
                    outrun(c, st, f, k, t, worlds, states, flags, bounds, poses, s.shape.units);
                }
            }
        }
        if comptime!(s.ledger && purpose == Purpose::Step) {
            sync_cube();
            #[unroll]
            for q in 0..SUMS {
                desk.table[(q * s.shape.units + UNIT_POS) as usize] = out[q as usize];
            }
            fold(&mut desk.table, SUMS, s.shape.units);
            if UNIT_POS < 7u32 {
                let at = (block * SUMS + UNIT_POS) * 2u32;
                accumulate(sums, at, desk.table[(UNIT_POS * s.shape.units) as usize]);
            }
            if UNIT_POS == 7u32 {
                // Tangential springs at the end of the step, not summed over steps.
                let at = (block * SUMS + 7u32) * 2u32;
                sums[at as usize] = desk.table[(6u32 * s.shape.units) as usize];
            }
        }
    }
}

/// Sums what the particles of a block do to each surface whose forces are kept, and leaves it behind the rows of
/// `push`, as block `nb` of all launches of the group. `lane` counts the units that have a row, or could have.
#[cube]
pub fn shared_push(
    table: &mut SharedMemory<f32>,
    takes_part: bool,
    lane: u32,
    row: u32,
    nb: u32,
    names: u32,
    surfaces: u32,
    row_room: u32,
    parity: u32,
    row_count: &mut Array<u32>,
    push: &mut Array<F4>,
    #[comptime] lanes: u32,
    #[comptime] units: u32,
) {
    for s in 0..surfaces {
        sync_cube();
        if takes_part {
            let mut fx = 0.0f32;
            let mut fy = 0.0f32;
            let mut fz = 0.0f32;
            let mut tx = 0.0f32;
            let mut ty = 0.0f32;
            let mut tz = 0.0f32;
            if row != NONE {
                for slot in 0..row_count[((1u32 - parity) * row_room + row) as usize] {
                    let at = (row * SLOTS + slot) * 2u32;
                    let f = push[at as usize];
                    if u32::cast_from(f[3]) == s + 1u32 {
                        let m = push[(at + 1u32) as usize];
                        fx += f[0];
                        fy += f[1];
                        fz += f[2];
                        tx += m[0];
                        ty += m[1];
                        tz += m[2];
                    }
                }
            }
            table[lane as usize] = fx;
            table[(units + lane) as usize] = fy;
            table[(2u32 * units + lane) as usize] = fz;
            table[(3u32 * units + lane) as usize] = tx;
            table[(4u32 * units + lane) as usize] = ty;
            table[(5u32 * units + lane) as usize] = tz;
        }
        sync_cube();
        let mut width = comptime!(lanes / 2).runtime();
        while width > 0u32 {
            if takes_part && lane < width {
                #[unroll]
                for q in 0..6u32 {
                    let at = q * units + lane;
                    let other = table[(at + width) as usize];
                    table[at as usize] += other;
                }
            }
            sync_cube();
            width /= 2u32;
        }
        if takes_part && lane == 0u32 {
            let at = 2u32 * (row_room * SLOTS + nb * names + s);
            push[at as usize] = four(table[0], table[units as usize], table[(2u32 * units) as usize], 0.0f32);
            push[(at + 1u32) as usize] = four(
                table[(3u32 * units) as usize],
                table[(4u32 * units) as usize],
                table[(5u32 * units) as usize],
                0.0f32,
            );
        }
    }
}

/// Finds surfaces that have moved out of reach of the lists by the end of step `t`, launch `k` of its group: all units of
/// a block look.
#[cube]
fn outrun(
    c: u32,
    st: u32,
    f: u32,
    k: u32,
    t: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    #[comptime] units: u32,
) {
    let rebuilt = states[(st + status::REBUILT) as usize];
    let known = rebuilt != NONE;
    let skin = float_at(states, st + status::SKIN);
    let mut b = UNIT_POS;
    while b < worlds[(c + world::BOUNDARY_COUNT) as usize] {
        let bt = (worlds[(c + world::BOUNDARIES) as usize] + b) * boundary::WORDS;
        let stride = bounds[(bt + boundary::STRIDE) as usize];
        let pose0 = bounds[(bt + boundary::POSE) as usize];
        if poses[(pose0 + pose::PRESENT) as usize] == 1u32 {
            let at = pose0 + pose::PATH;
            // Without a rebuild in this job paths count from the last one before it.
            let since = select(known, poses[(at + select(known, rebuilt, 0u32) * stride) as usize], 0u32);
            let moved = gone(since, poses[(at + (t + 1u32) * stride) as usize]);
            if moved * float_at(worlds, c + world::RADIUS_MEAN) > 0.5f32 * skin {
                flags[(f + flag::STALE) as usize].fetch_min(k);
            }
        }
        b += units;
    }
}

/// Sums the forces on surfaces of each step of a group of `launches`, in a fixed order. One block per step and world.
#[cube(launch_unchecked)]
pub fn collect(
    launches: u32,
    worlds_in_all: u32,
    blocks: u32,
    row_room: u32,
    names: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &Array<Atomic<u32>>,
    push: &Array<F4>,
    series: &mut Array<f32>,
    #[comptime] span: u32,
) {
    let k = u32::cast_from(CUBE_POS) / worlds_in_all;
    let w = u32::cast_from(CUBE_POS) % worlds_in_all;
    // Launches that did nothing left nothing.
    let ran = k < launches && active(states, flags, w, min(k, launches - 1u32));
    if ran {
        let c = w * world::WORDS;
        let st = w * status::WORDS;
        let surfaces = worlds[(c + world::SURFACES) as usize];
        let rows = states[(st + status::ROWS) as usize];
        let first = worlds[(c + world::ROWS) as usize];
        let t = states[(st + status::BASE) as usize] + k;
        let mut shared = SharedMemory::<f32>::new(comptime!((12 * BLOCK) as usize));
        for s in 0..surfaces {
            let mut total = Array::<f32>::new(12usize);
            #[unroll]
            for q in 0..12u32 {
                total[q as usize] = 0.0f32;
            }
            let mut block = UNIT_POS;
            while block * span < rows {
                let at = 2u32 * (row_room * SLOTS + (k * blocks + first / span + block) * names + s);
                let f = push[at as usize];
                let m = push[(at + 1u32) as usize];
                #[unroll]
                for q in 0..3u32 {
                    let a = sum(total[(2u32 * q) as usize], f[q as usize]);
                    total[(2u32 * q) as usize] = a.h;
                    total[(2u32 * q + 1u32) as usize] += a.l;
                    let b = sum(total[(6u32 + 2u32 * q) as usize], m[q as usize]);
                    total[(6u32 + 2u32 * q) as usize] = b.h;
                    total[(6u32 + 2u32 * q + 1u32) as usize] += b.l;
                }
                block += BLOCK;
            }
            #[unroll]
            for q in 0..12u32 {
                shared[(q * BLOCK + UNIT_POS) as usize] = total[q as usize];
            }
            sync_cube();
            let mut width = comptime!(BLOCK / 2).runtime();
            while width > 0u32 {
                if UNIT_POS < width {
                    #[unroll]
                    for q in 0..6u32 {
                        let at = 2u32 * q * BLOCK + UNIT_POS;
                        let a = sum(shared[at as usize], shared[(at + width) as usize]);
                        let l = shared[(at + BLOCK) as usize] + shared[(at + BLOCK + width) as usize] + a.l;
                        shared[at as usize] = a.h;
                        shared[(at + BLOCK) as usize] = l;
                    }
                }
                sync_cube();
                width /= 2u32;
            }
            if UNIT_POS < 12u32 {
                let at = worlds[(c + world::SERIES) as usize] + (t * surfaces + s) * 12u32 + UNIT_POS;
                series[at as usize] = shared[(UNIT_POS * BLOCK) as usize];
            }
            sync_cube();
        }
    }
}
