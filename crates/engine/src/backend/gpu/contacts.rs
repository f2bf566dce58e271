//! The contacts of a block's particles, one unit per contact.
//!
//! A block owns some particles, see [`Signature::owners`]. Its units first look which candidates of their lists are
//! near, then share the near ones out evenly, however many each particle has; then every owner sums its contacts
//! in the order of its list. So no lane waits for a particle with more contacts, small worlds have enough units
//! under way, and sums do not depend on who computed what.

use cubecl::prelude::*;
use glebe_physics::kernel::vector::{V3, cross, dot, plus, scaled};

use super::compensated::{Two3, gap, sum, whole};
use super::layout::{
    F4, NONE, PARTNER, SECOND, SLICE, Shape, Signature, TOUCHING, U4, float_at, status, world,
};
use super::pair::{Meeting, interact};
use super::step::{Purpose, Sums, apart2, bits3, first3, four, pick, see_contact, shared_push, turned, zero};
use super::surfaces::{metres, surfaces_of, too_deep};

/// Candidates of a list that are looked at together: as many as a word has bits.
const CHUNK: u32 = 32;
/// Candidates that a unit loads together where it looks at a particle's whole list; half as many where units share it.
const AHEAD: u32 = 4;
/// Added to the count of an owner whose list is longer than what was looked at so far.
const LONGER: u32 = 0x1_0000;
/// Owners whose counts one unit adds up.
const STRIDE: u32 = 16;
/// Columns of the shared table: for what units hand to owners, and for the sums over a block at the end of a step.
pub const COLUMNS: u32 = 10;

/// What a block shares.
#[derive(CubeType, Clone, Copy)]
pub struct Desk {
    /// The particle of each owner, or `NONE`.
    pub who: SharedMemory<u32>,
    /// Its row among the particles near surfaces, where contacts with surfaces are summed here; else `NONE`.
    pub rows: SharedMemory<u32>,
    /// Where the owner's list begins.
    from: SharedMemory<u32>,
    /// Its length.
    many: SharedMemory<u32>,
    /// Which candidates are near, by unit; then owner and place in the list of each contact.
    bits: SharedMemory<u32>,
    /// Near candidates of each owner.
    counts: SharedMemory<u32>,
    /// Sums over [`STRIDE`] owners.
    totals: SharedMemory<u32>,
    /// Columns of floats.
    pub table: SharedMemory<f32>,
}

/// Takes the memory.
#[cube]
pub fn desk(#[comptime] shape: Shape) -> Desk {
    Desk {
        who: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        rows: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        from: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        many: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        bits: SharedMemory::<u32>::new(comptime!(shape.units as usize)),
        counts: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        totals: SharedMemory::<u32>::new(comptime!((shape.owners / STRIDE) as usize)),
        table: SharedMemory::<f32>::new(comptime!((COLUMNS * shape.units) as usize)),
    }
}

/// Gives each owner its particle: `block` has `owners` of them from the particle or, behind `padded`, the row of that
/// number on.
#[cube]
pub fn seat(
    desk: &mut Desk,
    block: u32,
    padded: u32,
    list_room: u32,
    row_room: u32,
    w: u32,
    which: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    lists: &Array<u32>,
    rows: &Array<u32>,
    #[comptime] s: Signature,
) {
    if UNIT_POS < comptime!(s.shape.owners) {
        let c = w * world::WORDS;
        let st = w * status::WORDS;
        let slot = block * comptime!(s.shape.owners) + UNIT_POS;
        let mut i = slot;
        let mut row = NONE.runtime();
        let mut there = slot - worlds[(c + world::FIRST) as usize] < states[(st + status::COUNT) as usize];
        if comptime!(s.near_blocks()) {
            // Particles near surfaces have blocks of their own behind the others, so that no block waits for
            // units that look at triangles unless it must.
            if slot < padded {
                if there {
                    there = rows[(which * padded + slot) as usize] == NONE;
                }
            } else {
                let near = comptime!(s.shape.near);
                row = (block - padded / comptime!(s.shape.owners)) * near + UNIT_POS;
                there = UNIT_POS < near
                    && row - worlds[(c + world::ROWS) as usize] < states[(st + status::ROWS) as usize];
                if there {
                    i = rows[(2u32 * padded + 3u32 * (which * row_room + row) + 2u32) as usize];
                }
            }
        }
        let mut many = 0u32;
        let mut from = 0u32;
        if there {
            many = lists[(which * padded + i) as usize];
            from = which * list_room
                + lists[(2u32 * padded + which * (padded / SLICE) + i / SLICE) as usize]
                + i % SLICE;
        }
        desk.who[UNIT_POS as usize] = select(there, i, NONE);
        desk.rows[UNIT_POS as usize] = select(there, row, NONE);
        desk.many[UNIT_POS as usize] = many;
        desk.from[UNIT_POS as usize] = from;
    }
    sync_cube();
}

/// Which candidates of owner `o` are near: bits of every `groups`th one of those from `begin` on. Contacts that are no
/// longer near are forgotten.
#[cube]
fn near(
    desk: &Desk,
    o: u32,
    begin: u32,
    half: u32,
    c: u32,
    cell: u32,
    worlds: &Array<u32>,
    place: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) -> u32 {
    let groups = comptime!(s.shape.units / s.shape.owners);
    let ahead = comptime!(if groups == 1 { AHEAD } else { AHEAD / 2 });
    let mut bits = 0u32;
    let mut gone = 0u32;
    let many = desk.many[o as usize];
    let mut q = begin + UNIT_POS / comptime!(s.shape.owners);
    let end = min(many, begin + CHUNK);
    let from = desk.from[o as usize];
    if q < end {
        let here = place[(half + desk.who[o as usize]) as usize];
        let reach_i = (f32::reinterpret(here[3]) + float_at(worlds, c + world::RANGE)) * 1.000_001f32;
        while q < end {
            // Several at a time, so that their loads are under way together.
            let mut entries = Array::<u32>::new(comptime!(ahead as usize));
            let mut places = Array::<U4>::new(comptime!(ahead as usize));
            #[unroll]
            for k in 0..ahead {
                entries[k as usize] = nbr[(from + min(q + k * groups, end - 1u32) * SLICE) as usize];
            }
            #[unroll]
            for k in 0..ahead {
                places[k as usize] = place[(half + (entries[k as usize] & PARTNER)) as usize];
            }
            #[unroll]
            for k in 0..ahead {
                let at = q + k * groups;
                let there = places[k as usize];
                let reach = reach_i + f32::reinterpret(there[3]) * 1.000_001f32;
                let bit = select(at < end, 1u32 << ((at - begin) % CHUNK), 0u32);
                let close = apart2(worlds, cell, here, there, comptime!(s.orthogonal)) < reach * reach;
                bits |= select(close, bit, 0u32);
                gone |= select(!close && entries[k as usize] & TOUCHING != 0u32, bit, 0u32);
            }
            q += comptime!(ahead * groups);
        }
    }
    if comptime!(purpose == Purpose::Step) {
        while gone != 0u32 {
            let at = (from + (begin + gone.find_first_set() - 1u32) * SLICE) as usize;
            gone &= gone - 1u32;
            nbr[at] = nbr[at] & comptime!(!TOUCHING);
        }
    }
    bits
}

/// The exclusive sum of the counts of the owners before this unit.
#[cube]
fn before(desk: &Desk) -> u32 {
    let mut sum = 0u32;
    let stride = UNIT_POS / STRIDE;
    for k in 0..stride {
        sum += desk.totals[k as usize];
    }
    for k in stride * STRIDE..UNIT_POS {
        sum += desk.counts[k as usize];
    }
    sum % LONGER
}

/// Two vectors in the table.
#[cube]
fn hand(desk: &mut Desk, a: V3, b: V3, #[comptime] units: u32) {
    desk.table[UNIT_POS as usize] = a.x;
    desk.table[(units + UNIT_POS) as usize] = a.y;
    desk.table[(2u32 * units + UNIT_POS) as usize] = a.z;
    desk.table[(3u32 * units + UNIT_POS) as usize] = b.x;
    desk.table[(4u32 * units + UNIT_POS) as usize] = b.y;
    desk.table[(5u32 * units + UNIT_POS) as usize] = b.z;
}

/// What an owner takes from the table.
#[derive(CubeType, Clone, Copy)]
struct Taken {
    a: V3,
    b: V3,
}

/// The sums of the table's rows from `first` to `last`, and of row `extra` if that is not `NONE`.
#[cube]
fn taken(desk: &Desk, first: u32, last: u32, extra: u32, #[comptime] units: u32) -> Taken {
    let mut ax = 0.0f32;
    let mut ay = 0.0f32;
    let mut az = 0.0f32;
    let mut bx = 0.0f32;
    let mut by = 0.0f32;
    let mut bz = 0.0f32;
    // One more turn for the row apart.
    let turns = last - first + select(extra != NONE, 1u32, 0u32);
    for k in 0..turns {
        let row = select(first + k < last, first + k, extra);
        ax += desk.table[row as usize];
        ay += desk.table[(units + row) as usize];
        az += desk.table[(2u32 * units + row) as usize];
        bx += desk.table[(3u32 * units + row) as usize];
        by += desk.table[(4u32 * units + row) as usize];
        bz += desk.table[(5u32 * units + row) as usize];
    }
    Taken { a: V3 { x: ax, y: ay, z: az }, b: V3 { x: bx, y: by, z: bz } }
}

/// The sums of the contacts of the block's particles. Vectors are those of the owner that a unit is; energies, losses
/// and counts are those of the contacts that the unit looked at, whose owners are in its block.
// Variables of a kernel begin with a value, read or not.
#[allow(unused_assignments)]
#[cube]
pub fn contacts_of(
    desk: &mut Desk,
    block: u32,
    k: u32,
    padded: u32,
    row_room: u32,
    facet_room: u32,
    names: u32,
    w: u32,
    which: u32,
    parity: u32,
    t: u32,
    cell: u32,
    dt: f32,
    flags: &mut Array<Atomic<u32>>,
    worlds: &Array<u32>,
    pairs: &Array<F4>,
    place: &Array<U4>,
    vel: &Array<F4>,
    spin: &Array<U4>,
    own: &Array<U4>,
    refs: &Array<U4>,
    nbr: &mut Array<u32>,
    hist: &mut Array<F4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    rows: &Array<u32>,
    facets: &Array<u32>,
    row_count: &mut Array<u32>,
    row_mem: &mut Array<F4>,
    push: &mut Array<F4>,
    sights: &mut Array<f32>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) -> Sums {
    let c = w * world::WORDS;
    let owners = comptime!(s.shape.owners);
    let half = parity * padded;
    let listed = which * padded;
    let range = float_at(worlds, c + world::RANGE);
    let limit = float_at(worlds, c + world::OVERLAP);
    let materials = worlds[(c + world::MATERIALS) as usize];
    let table = worlds[(c + world::PAIRS) as usize];
    let accounts = comptime!(s.ledger && purpose == Purpose::Step);
    let weighs = comptime!(s.ledger || purpose == Purpose::Observe);
    let measures = comptime!(s.sample && purpose == Purpose::Observe);
    let merged = comptime!(s.near_blocks());
    // The last units of a block of particles near surfaces look at those.
    let units = comptime!(s.shape.units);
    let near_owners = comptime!(s.shape.near);
    let near_block = merged && block * owners >= padded;
    let width = select(near_block, units - near_owners, units.runtime());

    let mut fx = 0.0f32;
    let mut fy = 0.0f32;
    let mut fz = 0.0f32;
    let mut tx = 0.0f32;
    let mut ty = 0.0f32;
    let mut tz = 0.0f32;
    let mut dx = 0.0f32;
    let mut dy = 0.0f32;
    let mut dz = 0.0f32;
    let mut gx = 0.0f32;
    let mut gy = 0.0f32;
    let mut gz = 0.0f32;
    let mut rx = 0.0f32;
    let mut ry = 0.0f32;
    let mut rz = 0.0f32;
    let mut energy_normal = 0.0f32;
    let mut energy_tangential = 0.0f32;
    let mut energy_before = 0.0f32;
    let mut friction_loss = 0.0f32;
    let mut dash_power = 0.0f32;
    let mut roll_power = 0.0f32;
    let mut work = 0.0f32;
    let mut worst = 0.0f32;
    let mut contacts = 0u32;
    let mut touches = 0u32;
    let mut partners = 0.0f32;

    let mut begin = 0u32;
    let mut more = true;
    while more {
        let bits = near(desk, UNIT_POS % owners, begin, half, c, cell, worlds, place, nbr, s, purpose);
        desk.bits[UNIT_POS as usize] = bits;
        sync_cube();
        let mut left = 0u32;
        if UNIT_POS < owners {
            for g in 0..comptime!(s.shape.units / s.shape.owners).runtime() {
                left |= desk.bits[(g * owners + UNIT_POS) as usize];
            }
            desk.counts[UNIT_POS as usize] =
                left.count_ones() + select(desk.many[UNIT_POS as usize] > begin + CHUNK, LONGER, 0u32);
        }
        sync_cube();
        if UNIT_POS < comptime!(s.shape.owners / STRIDE) {
            let mut n = 0u32;
            for q in UNIT_POS * STRIDE..(UNIT_POS + 1u32) * STRIDE {
                n += desk.counts[q as usize];
            }
            desk.totals[UNIT_POS as usize] = n;
        }
        sync_cube();
        let mut total = 0u32;
        for q in 0..comptime!(s.shape.owners / STRIDE).runtime() {
            total += desk.totals[q as usize];
        }
        more = total >= LONGER;
        total %= LONGER;
        let mut next = 0u32;
        let mut summed = 0u32;
        let mut end = 0u32;
        if UNIT_POS < owners {
            next = before(desk);
            summed = next;
            end = next + left.count_ones();
        }

        let mut window = 0u32;
        // Units of a block near surfaces have something to do without any contact.
        let due = max(total, select(near_block && begin == 0u32, 1u32, 0u32));
        while window < due {
            while left != 0u32 && next < window + width {
                let q = left.find_first_set() - 1u32;
                left &= left - 1u32;
                desk.bits[(next - window) as usize] = UNIT_POS | (q << 8u32);
                next += 1u32;
            }
            sync_cube();
            let mut hx = 0.0f32;
            let mut hy = 0.0f32;
            let mut hz = 0.0f32;
            let mut ux = 0.0f32;
            let mut uy = 0.0f32;
            let mut uz = 0.0f32;
            let mut qx = 0.0f32;
            let mut qy = 0.0f32;
            let mut qz = 0.0f32;
            if UNIT_POS < width && window + UNIT_POS < total {
                let name = desk.bits[UNIT_POS as usize];
                let o = name & 0xffu32;
                let at = desk.from[o as usize] + (begin + (name >> 8u32)) * SLICE;
                let i = desk.who[o as usize];
                let entry = nbr[at as usize];
                let j = entry & PARTNER;
                let touched = entry & TOUCHING != 0u32;
                // Both particles evaluate the pair in the same order, that of their numbers, so that what they
                // find is the same to the bit.
                let second = entry & SECOND != 0u32;
                let a = (half + select(second, j, i)) as usize;
                let b = (half + select(second, i, j)) as usize;
                // All that a contact needs is asked for at once: what is near nearly always touches.
                let (place_a, place_b) = (place[a], place[b]);
                let (vel_a, vel_b) = (vel[a], vel[b]);
                let (spin_a, spin_b) = (spin[a], spin[b]);
                let before = hist[at as usize];
                let r_a = f32::reinterpret(place_a[3]);
                let r_b = f32::reinterpret(place_b[3]);
                let apart = Two3 {
                    x: whole(i32::cast_from(place_b[0] - place_a[0])),
                    y: whole(i32::cast_from(place_b[1] - place_a[1])),
                    z: whole(i32::cast_from(place_b[2] - place_a[2])),
                };
                let d = metres(worlds, cell, apart, comptime!(s.fused), comptime!(s.orthogonal));
                let g = gap(d, sum(r_a, r_b), comptime!(s.fused));
                let mut force = V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 };
                let mut torque = V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 };
                if g.delta > 0.0f32 - range {
                    let r_eff = r_a * r_b / (r_a + r_b);
                    let arm_a = r_a - 0.5f32 * g.delta;
                    let arm_b = r_b - 0.5f32 * g.delta;
                    // An image moves with the cell.
                    let flow = if comptime!(s.deforms) {
                        turned(worlds, c + world::GRADIENT, d.x.h, d.y.h, d.z.h, false)
                    } else {
                        zero()
                    };
                    let v_b = if comptime!(s.deforms) { plus(first3(vel_b), flow) } else { first3(vel_b) };
                    let e = interact(
                        Meeting {
                            n: g.n,
                            delta: g.delta,
                            r_eff,
                            diameter: 4.0f32 * r_eff,
                            r_a,
                            r_b,
                            arm_a,
                            arm_b,
                            im_a: vel_a[3],
                            im_b: vel_b[3],
                            v_a: first3(vel_a),
                            v_b,
                            w_a: bits3(spin_a),
                            w_b: bits3(spin_b),
                            stretch: V3 {
                                x: select(touched, before[0], 0.0f32),
                                y: select(touched, before[1], 0.0f32),
                                z: select(touched, before[2], 0.0f32),
                            },
                            slip: select(touched, before[3], 0.0f32),
                        },
                        pairs,
                        table + spin_a[3] * materials + spin_b[3],
                        dt,
                        comptime!(s.laws),
                    );
                    let sign = select(second, 0.0f32 - 1.0f32, 1.0f32);
                    let on = scaled(e.force, sign);
                    let turn = pick(second, e.torque_b, e.torque_a);
                    force.x = on.x;
                    force.y = on.y;
                    force.z = on.z;
                    torque.x = turn.x;
                    torque.y = turn.y;
                    torque.z = turn.z;
                    let deep = g.delta / f32::min(r_a, r_b);
                    worst = f32::max(worst, deep);
                    if comptime!(purpose == Purpose::Step) {
                        if deep > limit {
                            too_deep(w, k, own[(2u32 * (listed + i)) as usize][3], flags);
                        }
                    }
                    contacts += 1u32;
                    if comptime!(measures) {
                        // Where nothing is accounted this column is free: how many contacts each owner has.
                        hx = 1.0f32;
                        see_contact(sights, g.n, g.distance, e.force, e.stiffness);
                    }
                    if comptime!(accounts) {
                        let dash = scaled(e.dash, sign);
                        let roll = pick(second, e.roll_b, e.roll_a);
                        let around = scaled(cross(g.n, e.dash), select(second, arm_b, arm_a));
                        hx = dash.x;
                        hy = dash.y;
                        hz = dash.z;
                        ux = around.x;
                        uy = around.y;
                        uz = around.z;
                        qx = roll.x;
                        qy = roll.y;
                        qz = roll.z;
                    }
                    if comptime!(weighs) {
                        energy_normal += 0.5f32 * e.energy_normal;
                        energy_tangential += 0.5f32 * e.energy_tangential;
                        energy_before += 0.5f32 * e.energy_before;
                        friction_loss += 0.5f32 * e.friction_loss;
                        dash_power += 0.5f32 * e.dash_power;
                        roll_power += 0.5f32 * e.roll_power;
                        if comptime!(s.deforms) {
                            work += 0.5f32 * dot(e.force, flow);
                        }
                    }
                    if comptime!(purpose == Purpose::Step) {
                        hist[at as usize] = four(e.stretch.x, e.stretch.y, e.stretch.z, e.slip);
                        if !touched {
                            nbr[at as usize] = entry | TOUCHING;
                        }
                    }
                } else {
                    if comptime!(purpose == Purpose::Step) {
                        if touched {
                            nbr[at as usize] = entry & comptime!(!TOUCHING);
                        }
                    }
                }
                hand(desk, force, torque, units);
            }
            if comptime!(merged) {
                if near_block && begin + window == 0u32 && UNIT_POS >= width {
                    let o = UNIT_POS - width;
                    if desk.who[o as usize] != NONE {
                        let e = surfaces_of(
                            desk.rows[o as usize],
                            desk.who[o as usize],
                            k,
                            which,
                            parity,
                            padded,
                            row_room,
                            facet_room,
                            t,
                            w,
                            dt,
                            flags,
                            worlds,
                            place,
                            vel,
                            spin,
                            own,
                            refs,
                            pairs,
                            bounds,
                            poses,
                            tris,
                            verts,
                            rows,
                            facets,
                            row_count,
                            row_mem,
                            push,
                            s,
                            purpose,
                        );
                        hand(desk, e.force, e.torque, units);
                        if comptime!(accounts) {
                            hx = e.dash.x;
                            hy = e.dash.y;
                            hz = e.dash.z;
                            ux = e.drag.x;
                            uy = e.drag.y;
                            uz = e.drag.z;
                            qx = e.roll.x;
                            qy = e.roll.y;
                            qz = e.roll.z;
                        }
                        energy_normal += e.energy_normal;
                        energy_tangential += e.energy_tangential;
                        energy_before += e.energy_before;
                        friction_loss += e.friction_loss;
                        dash_power += e.dash_power;
                        roll_power += e.roll_power;
                        work += e.work;
                        touches += e.touches;
                        worst = f32::max(worst, e.worst);
                    }
                }
            }
            sync_cube();
            let first = summed - window;
            let last = max(summed, min(end, window + width));
            summed = last;
            let mut extra = NONE.runtime();
            if near_block && begin + window == 0u32 && UNIT_POS < near_owners {
                extra = select(desk.who[UNIT_POS as usize] != NONE, width + UNIT_POS, NONE);
            }
            if UNIT_POS < owners {
                let p = taken(desk, first, last - window, extra, units);
                fx += p.a.x;
                fy += p.a.y;
                fz += p.a.z;
                tx += p.b.x;
                ty += p.b.y;
                tz += p.b.z;
            }
            if comptime!(accounts) {
                sync_cube();
                hand(desk, V3 { x: hx, y: hy, z: hz }, V3 { x: ux, y: uy, z: uz }, units);
                sync_cube();
                if UNIT_POS < owners {
                    let p = taken(desk, first, last - window, extra, units);
                    dx += p.a.x;
                    dy += p.a.y;
                    dz += p.a.z;
                    gx += p.b.x;
                    gy += p.b.y;
                    gz += p.b.z;
                }
                sync_cube();
                hand(desk, V3 { x: qx, y: qy, z: qz }, V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 }, units);
                sync_cube();
                if UNIT_POS < owners {
                    let p = taken(desk, first, last - window, extra, units);
                    rx += p.a.x;
                    ry += p.a.y;
                    rz += p.a.z;
                }
            }
            if comptime!(measures) {
                sync_cube();
                hand(desk, V3 { x: hx, y: hy, z: hz }, V3 { x: ux, y: uy, z: uz }, units);
                sync_cube();
                if UNIT_POS < owners {
                    partners += taken(desk, first, last - window, extra, units).a.x;
                }
            }
            window += width;
        }
        begin += CHUNK;
    }
    if comptime!(merged && purpose == Purpose::Step) {
        if near_block {
            let lane = UNIT_POS - width;
            let mut row = NONE.runtime();
            if UNIT_POS >= width {
                row = desk.rows[lane as usize];
            }
            shared_push(
                &mut desk.table,
                UNIT_POS >= width,
                lane,
                row,
                block - padded / owners,
                names,
                worlds[(c + world::SURFACES) as usize],
                row_room,
                parity,
                row_count,
                push,
                near_owners,
                units,
            );
        }
    }
    Sums {
        force: V3 { x: fx, y: fy, z: fz },
        torque: V3 { x: tx, y: ty, z: tz },
        dash: V3 { x: dx, y: dy, z: dz },
        drag: V3 { x: gx, y: gy, z: gz },
        roll: V3 { x: rx, y: ry, z: rz },
        energy_normal,
        energy_tangential,
        energy_before,
        friction_loss,
        dash_power,
        roll_power,
        work,
        worst,
        contacts,
        touches,
        partners,
    }
}
