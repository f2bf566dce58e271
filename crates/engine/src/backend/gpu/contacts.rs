//! The contacts of a block's particles, one unit per contact.
//!
//! A block owns some particles, see [`Signature::owners`]. Its units first look which candidates of their lists are
//! near, then share the near ones out evenly, however many each particle has; then every owner sums its contacts
//! in the order of its list. So no lane waits for a particle with more contacts, small worlds have enough units
//! under way, and sums do not depend on who computed what. Where sizes differ much, lists do as well: units are then dealt
//! out to stretches of lists, and each adds up the contacts of its own first.

use cubecl::prelude::*;
use glebe_physics::Slot;
use glebe_physics::kernel::vector::{V3, cross, dot, plus, scaled};

use super::compensated::{Two3, gap, sum, whole};
use super::layout::{
    F4, NONE, PARTNER, SECOND, SLICE, Signature, TOUCHING, U4, flag, float_at, status, world,
};
use super::pair::{Meeting, interact, inverse_inertia};
use super::recall::{Floats, packed, recalled};
use super::step::{Purpose, Sums, apart2, bits3, first3, pick, see_contact, shared_push, turned, zero};
use super::surfaces::{metres, surfaces_of, too_deep};

/// Candidates of a list that are looked at together: as many as a word has bits.
const CHUNK: u32 = 32;
/// Candidates that a unit loads together where it looks at a particle's whole list; half as many where units share it.
const AHEAD: u32 = 4;
/// Added to the count of an owner whose list is longer than what was looked at so far.
const LONGER: u32 = 0x1_0000;
/// Counts that one unit adds up.
const STRIDE: u32 = 16;
/// Columns of the sums over a block at the end of a step.
pub const COLUMNS: u32 = 10;
/// Bytes that the table of contacts may take, so that a block needs less than 16 KiB.
const TABLE: u32 = 11_000;
/// Most contacts of one unit in the table. A processor's shared memory is taken from its cache.
const ROUNDS: u32 = 6;

/// What a block shares.
#[derive(CubeType, Clone, Copy)]
pub struct Desk {
    /// The particle of each owner, or `NONE`.
    pub who: SharedMemory<u32>,
    /// Its row among the particles near surfaces, where contacts with surfaces are summed here; else `NONE`.
    pub rows: SharedMemory<u32>,
    /// Where what is left of the owner's list begins.
    from: SharedMemory<u32>,
    /// Candidates left in it.
    many: SharedMemory<u32>,
    /// Owner and stretch that each unit looks at, or which candidates are near, by unit; then owner and place in the list
    /// of each contact.
    names: SharedMemory<u32>,
    /// Stretches of each owner's list; near candidates of each looker; where the sum of its contacts is.
    counts: SharedMemory<u32>,
    /// Sums over [`STRIDE`] counts; then the contacts in the table, and the lookers that have theirs there.
    totals: SharedMemory<u32>,
    /// What contacts hand to their owners, in columns; then the sums over the block.
    pub table: SharedMemory<f32>,
    /// Its sums over each owner's contacts so far.
    owned: SharedMemory<f32>,
}

/// Whether what dissipates is handed over as well.
fn accounts(s: Signature, purpose: Purpose) -> bool {
    s.ledger && purpose == Purpose::Step
}

/// Whether a sample is looked at.
fn measures(s: Signature, purpose: Purpose) -> bool {
    s.sample && purpose == Purpose::Observe
}

/// Columns that a contact fills, three for a vector: force and torque; where dissipation is accounted also the dashpots'
/// force and torque, and the torque of rolling resistance; where a sample is looked at, a vector whose first component
/// counts contacts.
fn columns(s: Signature, purpose: Purpose) -> u32 {
    if accounts(s, purpose) {
        15
    } else if measures(s, purpose) {
        9
    } else {
        6
    }
}

/// Contacts that the table holds.
fn room(s: Signature, purpose: Purpose) -> u32 {
    (TABLE / (columns(s, purpose) * s.shape.units * 4)).clamp(1, ROUNDS) * s.shape.units
}

/// Those who look at candidates on their own account: units where they are dealt out to lists, else owners, whose units
/// look for them.
fn lookers(s: Signature) -> u32 {
    if s.graded { s.shape.units } else { s.shape.owners }
}

/// Takes the memory.
#[cube]
pub fn desk(#[comptime] s: Signature, #[comptime] purpose: Purpose) -> Desk {
    let shape = comptime!(s.shape);
    let room = comptime!(room(s, purpose));
    let lookers = comptime!(lookers(s));
    Desk {
        who: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        rows: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        from: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        many: SharedMemory::<u32>::new(comptime!(shape.owners as usize)),
        names: SharedMemory::<u32>::new(comptime!(room as usize)),
        counts: SharedMemory::<u32>::new(comptime!(lookers as usize)),
        totals: SharedMemory::<u32>::new(comptime!((lookers / STRIDE + 2) as usize)),
        table: SharedMemory::<f32>::new(comptime!(
            (columns(s, purpose) * room).max(COLUMNS * shape.units) as usize
        )),
        owned: SharedMemory::<f32>::new(comptime!((columns(s, purpose) * shape.owners) as usize)),
    }
}

/// The place of a block's unit among those of so many blocks. Where the largest particles come first, and have the most
/// contacts, an eighth of the units take one each of those, so that no block has many.
#[cube]
fn dealt(block: u32, unit: u32, blocks: u32, #[comptime] units: u32) -> u32 {
    let single = comptime!(units / 8);
    select(unit < single, unit * blocks + block, single * blocks + block * (units - single) + unit - single)
}

/// Where the list of a particle begins.
#[cube]
pub fn list_of(i: u32, padded: u32, lists: &Array<u32>) -> u32 {
    lists[(padded + i / SLICE) as usize] + i % SLICE
}

/// Gives each owner its particle: `block` has `owners` of them from the particle or, behind `padded`, the row of that
/// number on.
#[cube]
pub fn seat(
    desk: &mut Desk,
    block: u32,
    padded: u32,
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
        let owners = comptime!(s.shape.owners);
        let first = worlds[(c + world::FIRST) as usize];
        let count = states[(st + status::COUNT) as usize];
        let slot = block * owners + UNIT_POS;
        let mut i = slot;
        let mut there = slot - first < count;
        if comptime!(s.graded) {
            let (at, blocks) = (block - first / owners, (count + owners - 1u32) / owners);
            let place = dealt(at, UNIT_POS, blocks, owners);
            i = first + place;
            there = at < blocks && place < count;
        }
        let mut row = NONE.runtime();
        if comptime!(s.near_blocks()) {
            // Particles near surfaces have blocks of their own behind the others, so that no block waits for
            // units that look at triangles unless it must.
            if slot < padded {
                if there {
                    there = rows[(which * padded + i) as usize] == NONE;
                }
            } else {
                let near = comptime!(s.shape.near);
                let first_row = worlds[(c + world::ROWS) as usize];
                let in_use = states[(st + status::ROWS) as usize];
                let at = block - padded / owners;
                row = at * near + UNIT_POS;
                there = UNIT_POS < near && row - first_row < in_use;
                if comptime!(s.graded) {
                    let (mine, blocks) = (at - first_row / near, (in_use + near - 1u32) / near);
                    let place = dealt(mine, UNIT_POS, blocks, near);
                    row = first_row + place;
                    there = UNIT_POS < near && mine < blocks && place < in_use;
                }
                if there {
                    i = rows[(2u32 * padded + 3u32 * (which * row_room + row) + 2u32) as usize];
                }
            }
        }
        let mut many = 0u32;
        let mut from = 0u32;
        if there {
            many = lists[i as usize];
            from = list_of(i, padded, lists);
        }
        desk.who[UNIT_POS as usize] = select(there, i, NONE);
        desk.rows[UNIT_POS as usize] = select(there, row, NONE);
        desk.many[UNIT_POS as usize] = many;
        desk.from[UNIT_POS as usize] = from;
    }
    sync_cube();
}

/// The owner and stretch of a list that this unit looks at, and how many do. Units are dealt out in the order of owners, one
/// to each stretch of `look` candidates.
#[derive(CubeType, Clone, Copy)]
struct Deal {
    owner: u32,
    stretch: u32,
    /// Whether this unit looks at anything.
    busy: bool,
    /// The first unit that looks at the list of the owner that this unit is, and how many do.
    first: u32,
    count: u32,
    /// Whether lists are longer than what all units look at.
    more: bool,
}

#[cube]
fn deal(desk: &mut Desk, #[comptime] look: u32, #[comptime] s: Signature) -> Deal {
    let owners = comptime!(s.shape.owners);
    let units = comptime!(s.shape.units);
    let mut count = 0u32;
    if UNIT_POS < owners {
        count = (desk.many[UNIT_POS as usize] + look - 1u32) / look;
        desk.counts[UNIT_POS as usize] = count;
    }
    let total = summed(desk, owners);
    let mut first = 0u32;
    if UNIT_POS < owners {
        first = before(desk, owners);
        count = min(first + count, units) - min(first, units);
        for k in 0..count {
            desk.names[(first + k) as usize] = UNIT_POS | (k << 8u32);
        }
    }
    sync_cube();
    let busy = UNIT_POS < total;
    let name = select(busy, desk.names[UNIT_POS as usize], 0u32);
    sync_cube();
    Deal { owner: name & 0xffu32, stretch: name >> 8u32, busy, first, count, more: total > units }
}

/// The sum of the counts of so many.
#[cube]
fn summed(desk: &mut Desk, #[comptime] many: u32) -> u32 {
    sync_cube();
    if UNIT_POS < comptime!(many / STRIDE) {
        let mut n = 0u32;
        #[unroll]
        for q in 0..STRIDE {
            n += desk.counts[(UNIT_POS * STRIDE + q) as usize];
        }
        desk.totals[UNIT_POS as usize] = n;
    }
    sync_cube();
    let mut total = 0u32;
    #[unroll]
    for q in 0..comptime!(many / STRIDE) {
        total += desk.totals[q as usize];
    }
    total
}

/// Which of the next `many` candidates of owner `o` are near, at most [`CHUNK`]: bits of those that this unit looks at, all
/// where units are dealt out, else every `groups`th one. Contacts that are no longer near are forgotten.
#[cube]
fn near(
    desk: &Desk,
    o: u32,
    from: u32,
    many: u32,
    half: u32,
    c: u32,
    cell: u32,
    worlds: &Array<u32>,
    place: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) -> u32 {
    let groups = comptime!(if s.graded { 1 } else { s.shape.units / s.shape.owners });
    let ahead = comptime!(if groups == 1 { AHEAD } else { AHEAD / 2 });
    let mut bits = 0u32;
    let mut gone = 0u32;
    let mut q = if comptime!(s.graded) { 0u32.runtime() } else { UNIT_POS / comptime!(s.shape.owners) };
    let end = min(many, CHUNK);
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
                let bit = select(at < end, 1u32 << (at % CHUNK), 0u32);
                let close = apart2(worlds, cell, here, there, comptime!(s.orthogonal)) < reach * reach;
                bits |= select(close, bit, 0u32);
                gone |= select(!close && entries[k as usize] & TOUCHING != 0u32, bit, 0u32);
            }
            q += comptime!(ahead * groups);
        }
    }
    if comptime!(purpose == Purpose::Step) {
        while gone != 0u32 {
            let at = (from + (gone.find_first_set() - 1u32) * SLICE) as usize;
            gone &= gone - 1u32;
            nbr[at] = nbr[at] & comptime!(!TOUCHING);
        }
    }
    bits
}

/// The exclusive sum of the counts before this unit's.
// Written out: nvcc takes far more registers for the whole kernel where it unrolls such loops itself.
#[cube]
fn before(desk: &Desk, #[comptime] many: u32) -> u32 {
    let mut sum = 0u32;
    let stride = UNIT_POS / STRIDE;
    #[unroll]
    for k in 0..comptime!(many / STRIDE) {
        sum += select(k < stride, desk.totals[k as usize], 0u32);
    }
    #[unroll]
    for k in 0..STRIDE {
        sum += select(k < UNIT_POS % STRIDE, desk.counts[(stride * STRIDE + k) as usize], 0u32);
    }
    sum % LONGER
}

/// Puts a vector into row `row` of the three columns from `column` on.
#[cube]
fn hand(desk: &mut Desk, row: u32, x: V3, #[comptime] column: u32, #[comptime] room: u32) {
    desk.table[(column * room + row) as usize] = x.x;
    desk.table[((column + 1u32) * room + row) as usize] = x.y;
    desk.table[((column + 2u32) * room + row) as usize] = x.z;
}

/// Puts the sum of the rows from `first` to `last` into the first, in the three columns from `column` on.
#[cube]
fn gather(desk: &mut Desk, first: u32, last: u32, #[comptime] column: u32, #[comptime] room: u32) {
    if first < last {
        let mut x = 0.0f32;
        let mut y = 0.0f32;
        let mut z = 0.0f32;
        let mut row = first;
        while row < last {
            let at = column * room + row;
            x += desk.table[at as usize];
            y += desk.table[(room + at) as usize];
            z += desk.table[(2u32 * room + at) as usize];
            row += 1u32;
        }
        hand(desk, first, V3 { x, y, z }, column, room);
    }
}

/// Adds the rows from `first` to `last`, and row `extra` if that is not `NONE`, to the owner's sums in the three columns
/// from `column` on; where rows are `counted`, those that the counts from `first` to `last` name, `NONE` among them.
// The sums are kept in shared memory and the loop is one that compilers cannot count: nvcc would unroll it, and both
// would take so many registers that fewer blocks run.
#[cube]
fn add_up(
    desk: &mut Desk,
    first: u32,
    last: u32,
    extra: u32,
    #[comptime] column: u32,
    #[comptime] room: u32,
    #[comptime] owners: u32,
    #[comptime] counted: bool,
) {
    let mut x = 0.0f32;
    let mut y = 0.0f32;
    let mut z = 0.0f32;
    if comptime!(counted) {
        let mut next = first;
        while next <= last {
            let mut row = extra;
            if next < last {
                row = desk.counts[next as usize];
            }
            if row != NONE {
                let at = column * room + row;
                x += desk.table[at as usize];
                y += desk.table[(room + at) as usize];
                z += desk.table[(2u32 * room + at) as usize];
            }
            next += 1u32;
        }
    } else {
        let mut row = select(first < last, first, extra);
        while row != NONE {
            let at = column * room + row;
            x += desk.table[at as usize];
            y += desk.table[(room + at) as usize];
            z += desk.table[(2u32 * room + at) as usize];
            row = select(row + 1u32 < last, row + 1u32, select(row == extra, NONE, extra));
        }
    }
    let mine = column * owners + UNIT_POS;
    desk.owned[mine as usize] += x;
    desk.owned[(owners + mine) as usize] += y;
    desk.owned[(2u32 * owners + mine) as usize] += z;
}

/// The owner's sums in three columns; zero for units that own nothing.
#[cube]
fn owned(desk: &Desk, #[comptime] column: u32, #[comptime] owners: u32) -> V3 {
    let mut x = 0.0f32;
    let mut y = 0.0f32;
    let mut z = 0.0f32;
    if UNIT_POS < owners {
        let mine = column * owners + UNIT_POS;
        x = desk.owned[mine as usize];
        y = desk.owned[(owners + mine) as usize];
        z = desk.owned[(2u32 * owners + mine) as usize];
    }
    V3 { x, y, z }
}

/// Where F4 `q` of what entry `at` remembers stands: each has room for all entries.
#[cube]
pub fn plane(list_room: u32, at: u32, #[comptime] q: u32) -> u32 {
    at + q * list_room
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
    list_room: u32,
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
    facets: &Array<U4>,
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
    let accounts = comptime!(accounts(s, purpose));
    let measures = comptime!(measures(s, purpose));
    let room = comptime!(room(s, purpose));
    let weighs = comptime!(s.ledger || purpose == Purpose::Observe);
    let merged = comptime!(s.near_blocks());
    // The last units of a block of particles near surfaces look at those.
    let units = comptime!(s.shape.units);
    let near_owners = comptime!(s.shape.near);
    let near_block = merged && block * owners >= padded;
    let width = select(near_block, units - near_owners, units.runtime());
    // Their rows are the last of the table.
    let free = select(near_block, room - near_owners, room.runtime());

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

    if UNIT_POS < owners {
        #[unroll]
        for q in 0..comptime!(columns(s, purpose)) {
            desk.owned[(q * owners + UNIT_POS) as usize] = 0.0f32;
        }
    }
    let lookers = comptime!(lookers(s));
    // Candidates that a unit looks at where they are dealt out.
    let look = comptime!(CHUNK * s.shape.owners / s.shape.units);
    let held_at = comptime!((lookers / STRIDE) as usize);
    let mut first_round = true;
    let mut more = true;
    while more {
        let mut o = UNIT_POS % owners;
        let mut skipped = 0u32;
        let mut many = 0u32;
        let mut longer = false;
        // The first of the units that look at what this owner has, and how many do.
        let mut first_looker = 0u32;
        let mut own_lookers = 0u32;
        if comptime!(s.graded) {
            let d = deal(desk, look, s);
            o = d.owner;
            skipped = d.stretch * look;
            many = select(d.busy, min(desk.many[o as usize] - skipped, look), 0u32);
            longer = d.more;
            first_looker = d.first;
            own_lookers = d.count;
        } else {
            many = desk.many[o as usize];
        }
        let from = desk.from[o as usize] + skipped * SLICE;
        let mut left = near(desk, o, from, many, half, c, cell, worlds, place, nbr, s, purpose);
        if comptime!(s.shape.units > s.shape.owners && !s.graded) {
            desk.names[UNIT_POS as usize] = left;
            sync_cube();
            left = 0u32;
            if UNIT_POS < owners {
                for g in 0..comptime!(s.shape.units / s.shape.owners).runtime() {
                    left |= desk.names[(g * owners + UNIT_POS) as usize];
                }
            }
        }
        let number = left.count_ones();
        if UNIT_POS < lookers {
            desk.counts[UNIT_POS as usize] = number + select(many > CHUNK, LONGER, 0u32);
        }
        let total = summed(desk, lookers);
        more = total >= LONGER || total > free || longer;
        // Those whose contacts do not fit into the table any more wait for the next round.
        let mut first = 0u32;
        let mut served = false;
        if UNIT_POS < lookers {
            first = before(desk, lookers);
            served = first + number <= free;
            if served {
                let mut after = LONGER.runtime();
                if UNIT_POS + 1u32 < lookers {
                    after = desk.counts[(UNIT_POS + 1u32) as usize] % LONGER;
                }
                if first + number + after > free {
                    desk.totals[held_at] = first + number;
                    if comptime!(s.graded) {
                        desk.totals[comptime!(held_at + 1)] = UNIT_POS + 1u32;
                    }
                }
                let mut at = first;
                while left != 0u32 {
                    let q = left.find_first_set() - 1u32;
                    left &= left - 1u32;
                    desk.names[at as usize] = o | ((skipped + q) << 8u32);
                    at += 1u32;
                }
            }
        }
        sync_cube();
        let held = desk.totals[held_at];
        let mut row = select(UNIT_POS < width, UNIT_POS, NONE);
        while row < held {
            let name = desk.names[row as usize];
            let o = name & 0xffu32;
            let at = desk.from[o as usize] + (name >> 8u32) * SLICE;
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
            // Without memory anything of that shape serves, since nobody reads it.
            let before = if comptime!(s.quads() > 0) { hist[at as usize] } else { vel_a };
            let next =
                if comptime!(s.quads() > 1) { hist[plane(list_room, at, 1u32) as usize] } else { before };
            let last =
                if comptime!(s.quads() > 2) { hist[plane(list_room, at, 2u32) as usize] } else { before };
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
            let mut hx = 0.0f32;
            let mut hy = 0.0f32;
            let mut hz = 0.0f32;
            let mut ux = 0.0f32;
            let mut uy = 0.0f32;
            let mut uz = 0.0f32;
            let mut qx = 0.0f32;
            let mut qy = 0.0f32;
            let mut qz = 0.0f32;
            if g.delta > 0.0f32 - range {
                let both = 1.0f32 / (r_a * r_b);
                let (curved_a, curved_b) = (both * r_b, both * r_a);
                let r_eff = 1.0f32 / (curved_a + curved_b);
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
                        ii_a: inverse_inertia(vel_a[3], curved_a),
                        ii_b: inverse_inertia(vel_b[3], curved_b),
                        v_a: first3(vel_a),
                        v_b,
                        w_a: bits3(spin_a),
                        w_b: bits3(spin_b),
                        memory: recalled(
                            Floats {
                                x: select(touched, before[0], 0.0f32),
                                y: select(touched, before[1], 0.0f32),
                                z: select(touched, before[2], 0.0f32),
                                w: select(touched, before[3], 0.0f32),
                                second: next,
                                third: last,
                                known: touched,
                            },
                            comptime!(s.laws.layout),
                        ),
                    },
                    pairs,
                    table + spin_a[3] * materials + spin_b[3],
                    dt,
                    comptime!(s.laws),
                    comptime!(s.integrator.lags()),
                    true,
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
                let deep = g.delta * f32::max(curved_a, curved_b);
                worst = f32::max(worst, deep);
                if comptime!(purpose == Purpose::Step) {
                    if deep > limit {
                        too_deep(w, k, own[(2u32 * (listed + i)) as usize][3], flags);
                    }
                }
                contacts += 1u32;
                if comptime!(measures) {
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
                    if comptime!(s.quads() > 0) {
                        hist[at as usize] = packed(e.memory, comptime!(s.laws.layout), 0usize);
                    }
                    if comptime!(s.quads() > 1) {
                        hist[plane(list_room, at, 1u32) as usize] =
                            packed(e.memory, comptime!(s.laws.layout), 1usize);
                    }
                    if comptime!(s.quads() > 2) {
                        hist[plane(list_room, at, 2u32) as usize] =
                            packed(e.memory, comptime!(s.laws.layout), 2usize);
                    }
                    if comptime!(!s.laws.layout.place(Slot::Bond).is_empty()) {
                        // Both sides see it break; one counts.
                        if e.broke > 0.0f32 && !second {
                            flags[(w * flag::WORDS + flag::BROKEN) as usize].fetch_add(1u32);
                        }
                    }
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
            hand(desk, row, force, 0u32, room);
            hand(desk, row, torque, 3u32, room);
            if comptime!(accounts || measures) {
                hand(desk, row, V3 { x: hx, y: hy, z: hz }, 6u32, room);
            }
            if comptime!(accounts) {
                hand(desk, row, V3 { x: ux, y: uy, z: uz }, 9u32, room);
                hand(desk, row, V3 { x: qx, y: qy, z: qz }, 12u32, room);
            }
            row += width;
        }
        if comptime!(merged) {
            if near_block && first_round && UNIT_POS >= width {
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
                        // Nothing was told before.
                        verts,
                        row_count,
                        row_mem,
                        push,
                        s,
                        purpose,
                    );
                    let row = free + o;
                    hand(desk, row, e.force, 0u32, room);
                    hand(desk, row, e.torque, 3u32, room);
                    if comptime!(measures) {
                        hand(desk, row, zero(), 6u32, room);
                    }
                    if comptime!(accounts) {
                        hand(desk, row, e.dash, 6u32, room);
                        hand(desk, row, e.drag, 9u32, room);
                        hand(desk, row, e.roll, 12u32, room);
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
        let mut shown = first;
        let mut last = select(served, first + number, 0u32);
        let mut done = select(served, CHUNK, 0u32);
        if comptime!(s.graded) {
            // Each adds up what it looked at, and owners what those found who looked for them.
            #[unroll]
            for q in 0..comptime!(columns(s, purpose) / 3) {
                gather(desk, first, last, 3u32 * q, room);
            }
            desk.counts[UNIT_POS as usize] = select(first < last, first, NONE);
            sync_cube();
            let ready = desk.totals[comptime!(held_at + 1)];
            let ours = min(first_looker + own_lookers, ready) - min(first_looker, ready);
            shown = first_looker;
            last = first_looker + ours;
            done = ours * look;
        }
        if UNIT_POS < owners {
            // Owners that wait have nothing in the table yet, but perhaps a row of what surfaces do.
            let mut extra = NONE.runtime();
            if near_block && first_round && UNIT_POS < near_owners {
                extra = select(desk.who[UNIT_POS as usize] != NONE, free + UNIT_POS, NONE);
            }
            #[unroll]
            for q in 0..comptime!(columns(s, purpose) / 3) {
                add_up(desk, shown, last, extra, 3u32 * q, room, owners, comptime!(s.graded));
            }
            desk.from[UNIT_POS as usize] += done * SLICE;
            desk.many[UNIT_POS as usize] -= min(desk.many[UNIT_POS as usize], done);
        }
        first_round = false;
        sync_cube();
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
                k * (row_room / near_owners) + block - padded / owners,
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
    let counted = if comptime!(measures) { owned(desk, 6u32, owners) } else { zero() };
    Sums {
        force: owned(desk, 0u32, owners),
        torque: owned(desk, 3u32, owners),
        dash: if comptime!(accounts) { owned(desk, 6u32, owners) } else { zero() },
        drag: if comptime!(accounts) { owned(desk, 9u32, owners) } else { zero() },
        roll: if comptime!(accounts) { owned(desk, 12u32, owners) } else { zero() },
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
        partners: counted.x,
    }
}
