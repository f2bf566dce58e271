//! Neighbour lists: particles binned, ordered and listed on the device.
//!
//! A rebuild is a fixed sequence of launches, in which only the worlds that need it take part. It reads one
//! half of every column and writes the other; [`commit`] exchanges the halves if all went well. Lists, which take more
//! than all columns, are there once: [`judge`] lets only those be written for which there is room, so that a rebuild that
//! has too little has changed nothing. What contacts remember is kept meanwhile, see [`super::keep`].

use cubecl::prelude::*;

use super::layout::{
    BLOCK, F4, NONE, PERIOD, RELIST, SECOND, SLICE, U4, cell_at, flag, float_at, halt, status, world,
};
use super::search;
use super::step::apart2;
use crate::setup::{SKIN_MAX, SKIN_MIN, SKIN_WIDER};
use crate::spec::Search;

/// Skin, as a share of the mean radius, up to which lists are to last for [`PERIOD`].
const WIDE: f32 = 0.4;
/// Lists that lasted fewer steps than this may take any skin.
const REBUILT_SOON: u32 = 12;
/// Lists that lasted longer than this do not need a skin above [`WIDE`].
const REBUILT_LATE: u32 = 2 * REBUILT_SOON;
/// What a skin that lasted shrinks by.
const NARROWER: f32 = 0.97;
/// What a skin above [`WIDE`] shrinks by after the flow for which it was widened.
const CALMER: f32 = 0.8;
/// Share that rounding may take of a cell.
const MARGIN: f32 = 1.0e-4;
/// The same of a size class's grid, whose windows may have hundreds of cells.
pub const SLACK: f32 = 2.0e-3;

/// Ends a group of launches: counts its steps and decides which worlds rebuild. One unit per world.
#[cube(launch_unchecked)]
pub fn begin(
    group: u32,
    count: u32,
    worlds: &Array<u32>,
    states: &mut Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    held: &mut Array<u32>,
    #[comptime] grids: bool,
) {
    let w = u32::cast_from(ABSOLUTE_POS);
    if w < count {
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let f = w * flag::WORDS;
        let stale = flags[(f + flag::STALE) as usize].load();
        let stopped = flags[(f + flag::HALT) as usize].load() != halt::NO;
        let base = states[(s + status::BASE) as usize];
        let left = states[(s + status::TARGET) as usize] - base;
        let asked = states[(s + status::ASKED) as usize];
        let before = states[(s + status::SINCE) as usize];
        let most = min(min(group, left), PERIOD - min(before, PERIOD));
        let done = select(stale != NONE, min(stale + 1u32, most), most);
        states[(s + status::BASE) as usize] = base + done;
        states[(s + status::PARITY) as usize] = (states[(s + status::PARITY) as usize] + done) & 1u32;
        let since = before + done;
        states[(s + status::SINCE) as usize] = since;
        if done > 0u32 {
            states[(s + status::PRIMED) as usize] = 1u32;
        }
        let early = stale != NONE && since < PERIOD;
        // The tables of a world that has no steps to do are not those of its lists.
        let ended = (early || since >= PERIOD) && left > 0u32;
        let rebuilds = (ended || asked > 0u32) && !stopped;
        states[(s + status::REBUILDING) as usize] = select(rebuilds, 1u32, 0u32);
        // What the host has put is kept already.
        if rebuilds && asked == 0u32 {
            held[w as usize] = 0u32;
        }
        if rebuilds {
            let mean = float_at(worlds, c + world::RADIUS_MEAN);
            let skin = float_at(states, s + status::SKIN);
            // The skin is to last just as long as lists do; of fast flows only where that costs less than rebuilds.
            let mut wanted = skin;
            if asked == 0u32 {
                let most = select(since < REBUILT_SOON, comptime!(SKIN_MAX as f32), WIDE);
                if early && since > REBUILT_LATE && skin > WIDE * mean {
                    wanted = f32::max(CALMER * skin, WIDE * mean);
                } else if early {
                    wanted = f32::max(skin, f32::min(comptime!(SKIN_WIDER as f32) * skin, most * mean));
                } else {
                    wanted = f32::max(NARROWER * skin, comptime!(SKIN_MIN as f32) * mean);
                }
            }
            states[(s + status::SKIN) as usize] = u32::reinterpret(wanted);
            let reach = 2.0f32 * float_at(worlds, c + world::RADIUS_MAX)
                + float_at(worlds, c + world::RANGE)
                + wanted;
            let cell = cell_at(worlds, c, base + done);
            #[unroll]
            for k in 0..3u32 {
                let height = float_at(worlds, cell + world::HEIGHT + k);
                let cells = f32::floor(height / (reach * (1.0f32 + MARGIN)));
                states[(s + status::CELLS + k) as usize] =
                    u32::cast_from(f32::clamp(cells, 1.0f32, 1.0e5f32));
            }
            if comptime!(grids) {
                let mut largest = float_at(worlds, c + world::RADIUS_MAX);
                for class in 0..worlds[(c + world::GRADES) as usize] {
                    let reach = 2.0f32 * largest + float_at(worlds, c + world::RANGE) + wanted;
                    #[unroll]
                    for k in 0..3u32 {
                        let height = float_at(worlds, cell + world::HEIGHT + k);
                        let cells = f32::floor(height / (reach * (1.0f32 + SLACK)));
                        states[(s + status::GRIDS + 3u32 * class + k) as usize] =
                            u32::cast_from(f32::clamp(cells, 1.0f32, 1.0e5f32));
                    }
                    largest *= 0.5f32;
                }
            }
        }
    }
}

/// Whether the world of this block is being rebuilt.
#[cube]
pub fn rebuilding(states: &Array<u32>, w: u32) -> bool {
    states[(w * status::WORDS + status::REBUILDING) as usize] == 1u32
}

/// Which grid of a world: that of all its particles, or that of a size class.
#[derive(CubeType, Clone, Copy)]
pub struct Part {
    /// Word of the states with its cells per window.
    pub cells: u32,
    /// First place in the table of cells.
    pub first: u32,
    /// Places.
    pub room: u32,
}

#[cube]
pub fn part(worlds: &Array<u32>, w: u32, class: u32, #[comptime] graded: bool) -> Part {
    let c = w * world::WORDS;
    let s = w * status::WORDS;
    let first = worlds[(c + world::CELLS) as usize];
    if comptime!(graded) {
        let from = worlds[(c + world::CLASSES + class) as usize];
        let to = worlds[(c + world::CLASSES + class + 1u32) as usize];
        Part { cells: s + status::GRIDS + 3u32 * class, first: first + from, room: to - from }
    } else {
        Part { cells: s + status::CELLS, first, room: worlds[(c + world::CELL_ROOM) as usize] }
    }
}

/// The size class of a radius.
#[cube]
fn class_of(worlds: &Array<u32>, w: u32, r: f32) -> u32 {
    let c = w * world::WORDS;
    let mut class = 0u32;
    let mut largest = float_at(worlds, c + world::RADIUS_MAX);
    for _ in 1..worlds[(c + world::GRADES) as usize] {
        largest *= 0.5f32;
        class += select(r <= largest, 1u32, 0u32);
    }
    class
}

/// Cell of a window's fraction.
#[cube]
fn within(lo: u32, cells: u32) -> u32 {
    let at = f32::cast_from(lo >> 8u32) * (1.0f32 / 16_777_216.0f32) * f32::cast_from(cells);
    min(u32::cast_from(at), cells - 1u32)
}

/// Cell along an axis; open axes end at the domain's last cell.
#[cube]
pub fn cell_of(worlds: &Array<u32>, states: &Array<u32>, w: u32, hi: u32, lo: u32, k: u32, p: Part) -> u32 {
    let cells = states[(p.cells + k) as usize];
    let windows = worlds[(w * world::WORDS + world::WINDOWS + k) as usize];
    let h = i32::cast_from(hi);
    let top = i32::cast_from(windows) - 1i32;
    let inside = clamp(h, 0i32, top);
    let at = u32::cast_from(inside) * cells + within(lo, cells);
    let low = select(h < 0i32, u32::cast_from(inside) * cells, at);
    select(h > top, u32::cast_from(inside) * cells + cells - 1u32, low)
}

/// Place of a cell in the world's table; where there are more cells than places they share them.
#[cube]
pub fn bin_of(worlds: &Array<u32>, states: &Array<u32>, w: u32, x: u32, y: u32, z: u32, p: Part) -> u32 {
    let c = w * world::WORDS;
    let s = p.cells;
    let nx = states[s as usize] * worlds[(c + world::WINDOWS) as usize];
    let ny = states[(s + 1u32) as usize] * worlds[(c + world::WINDOWS + 1u32) as usize];
    p.first + ((z * ny + y) * nx + x) % p.room
}

/// Where a particle is in the configuration that lists are made of.
#[derive(CubeType, Clone, Copy)]
struct Aim {
    /// Fractions and radius.
    lo: U4,
    /// Windows and number.
    hi: U4,
}

/// The present place of the particle at `mine` and `me`, or the reference that it has if the host asks for that.
#[cube]
fn aim(mine: u32, me: u32, kept: bool, place: &Array<U4>, own: &Array<U4>, refs: &Array<U4>) -> Aim {
    let mut lo = refs[(2u32 * mine) as usize];
    let mut hi = refs[(2u32 * mine + 1u32) as usize];
    if !kept {
        lo = place[me as usize];
        hi = own[(2u32 * mine) as usize];
    }
    Aim { lo, hi }
}

/// Counts particles per cell, or per box along the curve. Particles outside the domain stop the world.
#[cube(launch_unchecked)]
pub fn bin(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    place: &Array<U4>,
    own: &Array<U4>,
    refs: &Array<U4>,
    bins: &mut Array<u32>,
    counters: &mut Array<Atomic<u32>>,
    #[comptime] grids: bool,
    #[comptime] search: Search,
) {
    let w = world_of[CUBE_POS];
    if rebuilding(states, w) {
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let i = u32::cast_from(ABSOLUTE_POS);
        if i - worlds[(c + world::FIRST) as usize] < states[(s + status::COUNT) as usize] {
            let mine = states[(s + status::LISTED) as usize] * padded + i;
            let kept = states[(s + status::ASKED) as usize] == RELIST;
            let me = states[(s + status::PARITY) as usize] * padded + i;
            let at = aim(mine, me, kept, place, own, refs);
            let (lo, hi) = (at.lo, at.hi);
            if !kept {
                let mut out = false;
                #[unroll]
                for k in 0..3u32 {
                    if worlds[(c + world::PERIODIC + k) as usize] == 0u32 {
                        let window = i32::cast_from(hi[k as usize]);
                        let end_hi = i32::cast_from(worlds[(c + world::EXTENT + k) as usize]);
                        let end_lo = worlds[(c + world::EXTENT + 3u32 + k) as usize];
                        let beyond = window > end_hi || (window == end_hi && lo[k as usize] > end_lo);
                        out = out || window < 0i32 || beyond;
                    }
                }
                if out {
                    flags[(w * flag::WORDS + flag::HALT) as usize].fetch_max(halt::LEFT);
                }
            }
            let b = if comptime!(search == Search::Grid) {
                let class = if comptime!(grids) {
                    class_of(worlds, w, f32::reinterpret(lo[3]))
                } else {
                    0u32.runtime()
                };
                let p = part(worlds, w, class, grids);
                let x = cell_of(worlds, states, w, hi[0], lo[0], 0u32, p);
                let y = cell_of(worlds, states, w, hi[1], lo[1], 1u32, p);
                let z = cell_of(worlds, states, w, hi[2], lo[2], 2u32, p);
                bin_of(worlds, states, w, x, y, z, p)
            } else {
                let count = states[(s + status::COUNT) as usize];
                worlds[(c + world::CELLS) as usize] + search::code(worlds, w, count, lo, hi)
            };
            bins[i as usize] = b;
            counters[b as usize].fetch_add(1u32);
        }
    }
}

/// Places particles in their cells, in any order.
#[cube(launch_unchecked)]
pub fn scatter(
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    bins: &Array<u32>,
    starts: &Array<u32>,
    counters: &mut Array<Atomic<u32>>,
    order: &mut Array<u32>,
) {
    let w = world_of[CUBE_POS];
    if rebuilding(states, w) {
        let c = w * world::WORDS;
        let first = worlds[(c + world::FIRST) as usize];
        let i = u32::cast_from(ABSOLUTE_POS);
        if i - first < states[(w * status::WORDS + status::COUNT) as usize] {
            let b = bins[i as usize];
            let begin = starts[worlds[(c + world::CELLS) as usize] as usize];
            // Counters are counted down: what is left is the place within the cell.
            let rank = counters[b as usize].fetch_add(NONE) - 1u32;
            let at = first + starts[b as usize] - begin + rank;
            order[at as usize] = i;
        }
    }
}

/// Sorts each cell by the particles' numbers. One unit per cell.
#[cube(launch_unchecked)]
pub fn sort(
    padded: u32,
    cells: u32,
    world_of_cell: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    own: &Array<U4>,
    order: &mut Array<u32>,
) {
    let b = u32::cast_from(ABSOLUTE_POS);
    if b < cells {
        let w = world_of_cell[(b / BLOCK) as usize];
        if rebuilding(states, w) {
            let c = w * world::WORDS;
            let listed = states[(w * status::WORDS + status::LISTED) as usize] * padded;
            let begin = starts[worlds[(c + world::CELLS) as usize] as usize];
            let first = worlds[(c + world::FIRST) as usize];
            let from = first + starts[b as usize] - begin;
            let to = first + starts[(b + 1u32) as usize] - begin;
            let mut k = from + 1u32;
            while k < to {
                let i = order[k as usize];
                let id = own[(2u32 * (listed + i)) as usize][3];
                let mut at = k;
                let mut going = true;
                while going && at > from {
                    let before = order[(at - 1u32) as usize];
                    if own[(2u32 * (listed + before)) as usize][3] > id {
                        order[at as usize] = before;
                        at -= 1u32;
                    } else {
                        going = false;
                    }
                }
                order[at as usize] = i;
                k += 1u32;
            }
        }
    }
}

/// Puts the columns into the new order, with the reference that the lists are made of.
#[cube(launch_unchecked)]
pub fn gather(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    order: &Array<u32>,
    place: &mut Array<U4>,
    vel: &mut Array<F4>,
    spin: &mut Array<U4>,
    own: &mut Array<U4>,
    refs: &mut Array<U4>,
    slow: &mut Array<F4>,
    renamed: &mut Array<u32>,
) {
    let w = world_of[CUBE_POS];
    if rebuilding(states, w) {
        let s = w * status::WORDS;
        let i = u32::cast_from(ABSOLUTE_POS);
        if i - worlds[(w * world::WORDS + world::FIRST) as usize] < states[(s + status::COUNT) as usize] {
            let old = order[i as usize];
            let parity = states[(s + status::PARITY) as usize];
            let listed = states[(s + status::LISTED) as usize];
            let from = (parity * padded + old) as usize;
            let to = ((1u32 - parity) * padded + i) as usize;
            place[to] = place[from];
            vel[to] = vel[from];
            spin[to] = spin[from];
            let a = listed * padded + old;
            let b = (1u32 - listed) * padded + i;
            let kept = states[(s + status::ASKED) as usize] == RELIST;
            let at = aim(a, parity * padded + old, kept, place, own, refs);
            refs[(2u32 * b) as usize] = at.lo;
            refs[(2u32 * b + 1u32) as usize] = at.hi;
            #[unroll]
            for k in 0..2u32 {
                own[(2u32 * b + k) as usize] = own[(2u32 * a + k) as usize];
            }
            #[unroll]
            for k in 0..3u32 {
                slow[(3u32 * b + k) as usize] = slow[(3u32 * a + k) as usize];
            }
            renamed[old as usize] = i;
        }
    }
}

/// The difference of two places in windows along an axis, to the nearest image, roughly.
#[cube]
fn windows_apart(worlds: &Array<u32>, c: u32, hi_a: u32, lo_a: u32, hi_b: u32, lo_b: u32, k: u32) -> f32 {
    let windows = i32::cast_from(worlds[(c + world::WINDOWS + k) as usize]);
    let periodic = worlds[(c + world::PERIODIC + k) as usize] == 1u32;
    let fraction = (f32::cast_from(lo_b) - f32::cast_from(lo_a)) * (1.0f32 / 4_294_967_296.0f32);
    let d = i32::cast_from(hi_b - hi_a);
    let near = f32::cast_from(d) + fraction;
    let span = f32::cast_from(windows);
    let low = select(near < 0.0f32 - 0.5f32 * span, near + span, near);
    let nearest = select(low > 0.5f32 * span, low - span, low);
    select(periodic, nearest, near)
}

/// Whether `b` may be a neighbour of `a` and not a particle one window further, which fractions alone do not tell.
#[cube]
fn beside(worlds: &Array<u32>, c: u32, lo_a: U4, hi_a: U4, lo_b: U4, hi_b: U4) -> bool {
    let x = windows_apart(worlds, c, hi_a[0], lo_a[0], hi_b[0], lo_b[0], 0u32);
    let y = windows_apart(worlds, c, hi_a[1], lo_a[1], hi_b[1], lo_b[1], 1u32);
    let z = windows_apart(worlds, c, hi_a[2], lo_a[2], hi_b[2], lo_b[2], 2u32);
    f32::abs(x) < 0.49f32 && f32::abs(y) < 0.49f32 && f32::abs(z) < 0.49f32
}

/// The world's grid as it is now.
#[derive(CubeType, Clone, Copy)]
pub struct Grid {
    pub nx: u32,
    pub ny: u32,
    pub nz: u32,
    pub px: bool,
    pub py: bool,
    pub pz: bool,
    /// Whether every cell has a place of its own.
    pub plain: bool,
    /// Whether a particle of a neighbouring cell that seems to be near is: windows of three cells tell, since what
    /// seems to be a window nearer than it is lies a cell away even so.
    pub sure: bool,
}

#[cube]
pub fn grid_of(worlds: &Array<u32>, states: &Array<u32>, w: u32, p: Part) -> Grid {
    let c = w * world::WORDS;
    let s = p.cells;
    let (x, y, z) = (states[s as usize], states[(s + 1u32) as usize], states[(s + 2u32) as usize]);
    let nx = x * worlds[(c + world::WINDOWS) as usize];
    let ny = y * worlds[(c + world::WINDOWS + 1u32) as usize];
    let nz = z * worlds[(c + world::WINDOWS + 2u32) as usize];
    let cells = f32::cast_from(nx) * f32::cast_from(ny) * f32::cast_from(nz);
    let room = f32::cast_from(p.room);
    Grid {
        nx,
        ny,
        nz,
        px: worlds[(c + world::PERIODIC) as usize] == 1u32,
        py: worlds[(c + world::PERIODIC + 1u32) as usize] == 1u32,
        pz: worlds[(c + world::PERIODIC + 2u32) as usize] == 1u32,
        plain: cells <= room * (1.0f32 - MARGIN),
        sure: x > 2u32 && y > 2u32 && z > 2u32,
    }
}

/// The ends of a list under way: neighbours that touch fill it from the front, the others from the back.
#[derive(CubeType, Clone, Copy)]
pub struct Ends {
    pub front: u32,
    pub back: u32,
}

/// Takes the neighbours of `i` among the particles from `begin` to `end`; where cells share places only those of the
/// cell at `x`, `y`, `z`.
// Three of them are decided when the kernel is expanded.
#[allow(clippy::fn_params_excessive_bools)]
#[cube]
pub fn take(
    begin: u32,
    end: u32,
    x: u32,
    y: u32,
    z: u32,
    ends: Ends,
    i: u32,
    w: u32,
    half: u32,
    from: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    nbr: &mut Array<u32>,
    p: Part,
    sure: bool,
    #[comptime] shared: bool,
    #[comptime] writes: bool,
    #[comptime] orthogonal: bool,
) -> Ends {
    let c = w * world::WORDS;
    let cell = if comptime!(orthogonal) {
        c
    } else {
        cell_at(worlds, c, states[(w * status::WORDS + status::BASE) as usize])
    };
    let lo = refs[(2u32 * (half + i)) as usize];
    let r = f32::reinterpret(lo[3]) + float_at(worlds, c + world::RANGE);
    let skin = float_at(states, w * status::WORDS + status::SKIN);
    let mut front = ends.front;
    let mut back = ends.back;
    for j in begin..end {
        let there = half + j;
        let lo_j = refs[(2u32 * there) as usize];
        let d2 = apart2(worlds, cell, lo, lo_j, orthogonal);
        let touch = r + f32::reinterpret(lo_j[3]);
        let reach = (touch + skin) * 1.000_001f32;
        let mut listed = d2 < reach * reach && j != i;
        if listed && !sure {
            let hi = refs[(2u32 * (half + i) + 1u32) as usize];
            let hi_j = refs[(2u32 * there + 1u32) as usize];
            listed = beside(worlds, c, lo, hi, lo_j, hi_j);
            if comptime!(shared) {
                let here = cell_of(worlds, states, w, hi_j[0], lo_j[0], 0u32, p) == x
                    && cell_of(worlds, states, w, hi_j[1], lo_j[1], 1u32, p) == y
                    && cell_of(worlds, states, w, hi_j[2], lo_j[2], 2u32, p) == z;
                listed = listed && here;
            }
        }
        if listed {
            let touches = d2 < touch * touch;
            back -= select(touches, 0u32, 1u32);
            if comptime!(writes) {
                let second = own[(2u32 * there) as usize][3] < own[(2u32 * (half + i)) as usize][3];
                let place = select(touches, front, back);
                nbr[(from + place * SLICE) as usize] = j | select(second, SECOND, 0u32);
            }
            front += select(touches, 1u32, 0u32);
        }
    }
    Ends { front, back }
}

/// Counts neighbours, or writes them: those that touch first, so that the forces' loads lie together.
#[cube]
fn neighbours(
    i: u32,
    w: u32,
    half: u32,
    from: u32,
    room: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] writes: bool,
    #[comptime] orthogonal: bool,
) -> u32 {
    let c = w * world::WORDS;
    let lo = refs[(2u32 * (half + i)) as usize];
    let hi = refs[(2u32 * (half + i) + 1u32) as usize];
    let base = worlds[(c + world::CELLS) as usize];
    // Places of particles are counted from the world's first.
    let shift = worlds[(c + world::FIRST) as usize] - starts[base as usize];
    let p = part(worlds, w, 0u32, false);
    let cx = cell_of(worlds, states, w, hi[0], lo[0], 0u32, p);
    let cy = cell_of(worlds, states, w, hi[1], lo[1], 1u32, p);
    let cz = cell_of(worlds, states, w, hi[2], lo[2], 2u32, p);
    let g = grid_of(worlds, states, w, p);
    let inner = !g.px || (cx > 0u32 && cx + 1u32 < g.nx);
    let mut front = 0u32;
    let mut back = room;
    for a in 0..3u32 {
        let z = stepped(cz, a, g.nz, g.pz);
        for b in 0..3u32 {
            let y = stepped(cy, b, g.ny, g.py);
            if y != NONE && z != NONE {
                if g.plain && inner {
                    // Cells along x lie beside each other, and so do their particles.
                    let row = base + (z * g.ny + y) * g.nx;
                    let begin = starts[(row + max(cx, 1u32) - 1u32) as usize] + shift;
                    let end = starts[(row + min(cx + 2u32, g.nx)) as usize] + shift;
                    let e = take(
                        begin,
                        end,
                        cx,
                        y,
                        z,
                        Ends { front, back },
                        i,
                        w,
                        half,
                        from,
                        worlds,
                        states,
                        refs,
                        own,
                        nbr,
                        p,
                        g.sure,
                        false,
                        writes,
                        orthogonal,
                    );
                    front = e.front;
                    back = e.back;
                } else {
                    for d in 0..3u32 {
                        let x = stepped(cx, d, g.nx, g.px);
                        if x != NONE {
                            let bin = bin_of(worlds, states, w, x, y, z, p);
                            let begin = starts[bin as usize] + shift;
                            let end = starts[(bin + 1u32) as usize] + shift;
                            let e = take(
                                begin,
                                end,
                                x,
                                y,
                                z,
                                Ends { front, back },
                                i,
                                w,
                                half,
                                from,
                                worlds,
                                states,
                                refs,
                                own,
                                nbr,
                                p,
                                false,
                                true,
                                writes,
                                orthogonal,
                            );
                            front = e.front;
                            back = e.back;
                        }
                    }
                }
            }
        }
    }
    front + (room - back)
}

/// The cell `offset - 1` beside `at`, or `NONE` beyond the domain or where it was visited before.
#[cube]
fn stepped(at: u32, offset: u32, n: u32, periodic: bool) -> u32 {
    let up = at + offset;
    let low = up == 0u32;
    let high = up > n;
    let plain = select(low || high, NONE, up - 1u32);
    let wrapped = select(low, n - 1u32, select(high, 0u32, up - 1u32));
    // Two cells: the one below is the one above. One cell: both are the cell itself.
    let twice = (n == 2u32 && offset == 0u32) || (n == 1u32 && offset != 1u32);
    select(periodic, select(twice, NONE, wrapped), plain)
}

/// Counts or writes neighbours as the world's search finds them.
#[cube]
fn found(
    i: u32,
    w: u32,
    half: u32,
    from: u32,
    room: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    tree: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] search: Search,
    #[comptime] writes: bool,
    #[comptime] orthogonal: bool,
) -> u32 {
    if comptime!(search == Search::Grid) {
        neighbours(i, w, half, from, room, worlds, states, starts, refs, own, nbr, writes, orthogonal)
    } else {
        search::neighbours(
            i, w, half, from, room, worlds, states, refs, own, tree, nbr, search, writes, orthogonal,
        )
    }
}

/// Counts the neighbours of each particle; the longest list of a slice decides its width.
#[cube(launch_unchecked)]
pub fn measure(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    tree: &Array<U4>,
    listed: &mut Array<u32>,
    widths: &mut Array<u32>,
    nbr: &mut Array<u32>,
    #[comptime] search: Search,
    #[comptime] orthogonal: bool,
) {
    let w = world_of[CUBE_POS];
    let mut counts = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let takes_part = rebuilding(states, w);
    let i = u32::cast_from(ABSOLUTE_POS);
    let mut n = 0u32;
    if takes_part {
        let s = w * status::WORDS;
        let half = (1u32 - states[(s + status::LISTED) as usize]) * padded;
        if i - worlds[(w * world::WORDS + world::FIRST) as usize] < states[(s + status::COUNT) as usize] {
            n = found(
                i, w, half, 0u32, 0u32, worlds, states, starts, refs, own, tree, nbr, search, false,
                orthogonal,
            );
        }
        listed[i as usize] = n;
    }
    counts[UNIT_POS as usize] = n;
    sync_cube();
    if UNIT_POS % SLICE == 0u32 {
        let mut width = 0u32;
        for k in 0..SLICE {
            width = max(width, counts[(UNIT_POS + k) as usize]);
        }
        widths[(i / SLICE) as usize] = width * SLICE;
    }
}

/// Whether there is room for what a rebuild is about to write; a world that lacks some asks the host for it and goes on
/// with what it has. One unit per world.
#[cube(launch_unchecked)]
pub fn judge(
    count: u32,
    worlds: &Array<u32>,
    states: &mut Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    widths: &Array<u32>,
    row_starts: &Array<u32>,
    facet_starts: &Array<u32>,
    #[comptime] surfaces: bool,
) {
    let w = u32::cast_from(ABSOLUTE_POS);
    if w < count && rebuilding(states, w) {
        let c = w * world::WORDS;
        let f = w * flag::WORDS;
        let padded = worlds[(c + world::BLOCKS) as usize] * BLOCK;
        let slice = worlds[(c + world::SLICES) as usize];
        let lists = widths[(slice + padded / SLICE) as usize] - widths[slice as usize];
        let mut lacks = lists > worlds[(c + world::LIST_ROOM) as usize];
        if lacks {
            flags[(f + flag::NEED) as usize].fetch_max(lists);
        }
        if comptime!(surfaces) {
            let first = worlds[(c + world::FIRST) as usize];
            let end = (first + padded) as usize;
            let rows = row_starts[end] - row_starts[first as usize];
            let facets = facet_starts[end] - facet_starts[first as usize];
            if rows > worlds[(c + world::ROW_ROOM) as usize]
                || facets > worlds[(c + world::FACET_ROOM) as usize]
            {
                lacks = true;
                flags[(f + flag::NEED + 1u32) as usize].fetch_max(rows);
                flags[(f + flag::NEED + 2u32) as usize].fetch_max(facets);
            }
        }
        if lacks {
            flags[(f + flag::HALT) as usize].fetch_max(halt::ROOM);
        }
        if flags[(f + flag::HALT) as usize].load() != halt::NO {
            states[(w * status::WORDS + status::REBUILDING) as usize] = 0u32;
        }
    }
}

/// Writes the lists.
#[cube(launch_unchecked)]
pub fn fill(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    tree: &Array<U4>,
    listed: &Array<u32>,
    widths: &Array<u32>,
    lists: &mut Array<u32>,
    nbr: &mut Array<u32>,
    #[comptime] search: Search,
    #[comptime] orthogonal: bool,
) {
    let w = world_of[CUBE_POS];
    if rebuilding(states, w) {
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let i = u32::cast_from(ABSOLUTE_POS);
        let half = (1u32 - states[(s + status::LISTED) as usize]) * padded;
        let slice = i / SLICE;
        let begins = list_begin(worlds, c, slice, widths);
        if UNIT_POS % SLICE == 0u32 {
            lists[(padded + slice) as usize] = begins;
        }
        if i - worlds[(c + world::FIRST) as usize] < states[(s + status::COUNT) as usize] {
            let n = listed[i as usize];
            lists[i as usize] = n;
            let from = begins + i % SLICE;
            found(
                i, w, half, from, n, worlds, states, starts, refs, own, tree, nbr, search, true, orthogonal,
            );
        }
    }
}

/// Where the lists of a slice are to begin.
#[cube]
pub fn list_begin(worlds: &Array<u32>, c: u32, slice: u32, widths: &Array<u32>) -> u32 {
    worlds[(c + world::LISTS) as usize] + widths[slice as usize]
        - widths[worlds[(c + world::SLICES) as usize] as usize]
}

/// Ends a rebuild: exchanges the halves, or waits for the host's help. One unit per world.
#[cube(launch_unchecked)]
pub fn commit(
    count: u32,
    worlds: &Array<u32>,
    states: &mut Array<u32>,
    flags: &mut Array<Atomic<u32>>,
    row_starts: &Array<u32>,
    facet_starts: &Array<u32>,
    #[comptime] surfaces: bool,
) {
    let w = u32::cast_from(ABSOLUTE_POS);
    if w < count {
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let f = w * flag::WORDS;
        let stopped = flags[(f + flag::HALT) as usize].load() != halt::NO;
        if stopped {
            states[(s + status::TARGET) as usize] = states[(s + status::BASE) as usize];
        } else {
            if states[(s + status::REBUILDING) as usize] == 1u32 {
                states[(s + status::PARITY) as usize] = 1u32 - states[(s + status::PARITY) as usize];
                states[(s + status::LISTED) as usize] = 1u32 - states[(s + status::LISTED) as usize];
                states[(s + status::SINCE) as usize] = select(
                    states[(s + status::ASKED) as usize] == RELIST,
                    states[(s + status::SINCE) as usize],
                    0u32,
                );
                if states[(s + status::ASKED) as usize] == 0u32 {
                    states[(s + status::REBUILDS) as usize] += 1u32;
                    states[(s + status::REBUILT) as usize] = states[(s + status::BASE) as usize];
                }
                if comptime!(surfaces) {
                    let first = worlds[(c + world::FIRST) as usize];
                    let end = first + worlds[(c + world::BLOCKS) as usize] * BLOCK;
                    states[(s + status::ROWS) as usize] =
                        row_starts[end as usize] - row_starts[first as usize];
                    states[(s + status::FACETS) as usize] =
                        facet_starts[end as usize] - facet_starts[first as usize];
                }
            }
            flags[(f + flag::STALE) as usize].store(NONE);
        }
        states[(s + status::ASKED) as usize] = 0u32;
        states[(s + status::REBUILDING) as usize] = 0u32;
    }
}
