//! Neighbour lists of worlds with several size classes. Each class has a grid of its own, and a particle looks through
//! all of them, in each as far as it reaches there.
//!
//! A block has the particles of one slice, and [`LANES`] units share what a particle has to look through: around the
//! largest there are thousands of the smallest.

use cubecl::prelude::*;

use super::layout::{BLOCK, SLICE, U4, cell_at, float_at, status, world};
use super::lists::{Ends, SLACK, bin_of, cell_of, grid_of, list_begin, part, rebuilding, take};

/// Units that share a particle.
const LANES: u32 = BLOCK / SLICE;

/// Cells of an axis to look through: the first, how many, and how many of them lie beyond the end and begin anew.
#[derive(CubeType, Clone, Copy)]
struct Stretch {
    first: u32,
    count: u32,
    over: u32,
}

/// The cells of an axis within `reach` of the cell `at`, each once.
#[cube]
fn stretch(at: u32, reach: f32, deep: f32, n: u32, periodic: bool) -> Stretch {
    let span = min(u32::cast_from(f32::min(f32::ceil(reach / deep), 1.0e6f32)), n);
    let whole = periodic && 2u32 * span + 1u32 >= n;
    let low = select(periodic, (at + n - span) % n, at - min(span, at));
    let top = min(at + span, n - 1u32) + 1u32;
    let many = select(periodic, 2u32 * span + 1u32, top - min(low, top));
    let first = select(whole, 0u32, low);
    let count = select(whole, n, many);
    Stretch { first, count, over: first + count - min(first + count, n) }
}

/// Cell `k` of a stretch, upwards.
#[cube]
fn nth(s: Stretch, k: u32) -> u32 {
    select(k < s.over, k, s.first + k - s.over)
}

/// The least distance of what is in two cells of an axis.
#[cube]
fn clear(a: u32, b: u32, deep: f32, n: u32, periodic: bool) -> f32 {
    let d = max(a, b) - min(a, b);
    let near = select(periodic, min(d, n - d), d);
    f32::cast_from(max(near, 1u32) - 1u32) * deep
}

/// Takes this lane's share of the neighbours of `i` in a class: rows of cells in the order of storage.
#[cube]
fn walk(
    i: u32,
    lane: u32,
    class: u32,
    ends: Ends,
    w: u32,
    half: u32,
    from: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] writes: bool,
    #[comptime] orthogonal: bool,
) -> Ends {
    let c = w * world::WORDS;
    let s = w * status::WORDS;
    let lo = refs[(2u32 * (half + i)) as usize];
    let hi = refs[(2u32 * (half + i) + 1u32) as usize];
    let shift = worlds[(c + world::FIRST) as usize] - starts[worlds[(c + world::CELLS) as usize] as usize];
    let height = cell_at(worlds, c, states[(s + status::BASE) as usize]) + world::HEIGHT;
    let p = part(worlds, w, class, true);
    let g = grid_of(worlds, states, w, p);
    let largest = float_at(worlds, c + world::RADIUS_MAX) / f32::cast_from(1u32 << class);
    let beyond = float_at(worlds, c + world::RANGE) + float_at(states, s + status::SKIN);
    // Less than what cells are wider, so that rounding does not make one cell two.
    let reach = (f32::reinterpret(lo[3]) + largest + beyond) * (1.0f32 + 0.5f32 * SLACK);
    let ax = cell_of(worlds, states, w, hi[0], lo[0], 0u32, p);
    let ay = cell_of(worlds, states, w, hi[1], lo[1], 1u32, p);
    let az = cell_of(worlds, states, w, hi[2], lo[2], 2u32, p);
    let dx = float_at(worlds, height) / f32::cast_from(states[p.cells as usize]);
    let dy = float_at(worlds, height + 1u32) / f32::cast_from(states[(p.cells + 1u32) as usize]);
    let dz = float_at(worlds, height + 2u32) / f32::cast_from(states[(p.cells + 2u32) as usize]);
    let ys = stretch(ay, reach, dy, g.ny, g.py);
    let zs = stretch(az, reach, dz, g.nz, g.pz);
    let rows = ys.count * zs.count;
    let mut front = ends.front;
    let mut back = ends.back;
    for row in rows * lane / LANES..rows * (lane + 1u32) / LANES {
        let y = nth(ys, row % ys.count);
        let z = nth(zs, row / ys.count);
        let mut left = reach * reach;
        if comptime!(orthogonal) {
            // What is farther than it reaches in these two directions alone is no neighbour.
            let away_y = clear(ay, y, dy, g.ny, g.py);
            let away_z = clear(az, z, dz, g.nz, g.pz);
            left -= away_y * away_y + away_z * away_z;
        }
        if left > 0.0f32 {
            let xs = stretch(ax, f32::sqrt(left), dx, g.nx, g.px);
            if g.plain {
                let first = p.first + (z * g.ny + y) * g.nx;
                // What begins anew comes first.
                for run in select(xs.over > 0u32, 0u32, 1u32)..2u32 {
                    let anew = run == 0u32;
                    let begin = first + select(anew, 0u32, xs.first);
                    let end = first + select(anew, xs.over, xs.first + xs.count - xs.over);
                    let e = take(
                        starts[begin as usize] + shift,
                        starts[end as usize] + shift,
                        ax,
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
                        false,
                        writes,
                        orthogonal,
                    );
                    front = e.front;
                    back = e.back;
                }
            } else {
                for d in 0..xs.count {
                    let x = nth(xs, d);
                    let bin = bin_of(worlds, states, w, x, y, z, p);
                    let e = take(
                        starts[bin as usize] + shift,
                        starts[(bin + 1u32) as usize] + shift,
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
    Ends { front, back }
}

/// As [`super::lists::measure`].
#[cube(launch_unchecked)]
pub fn measure(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    listed: &mut Array<u32>,
    widths: &mut Array<u32>,
    nbr: &mut Array<u32>,
    #[comptime] orthogonal: bool,
) {
    let mut counts = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    // A grid of rows has blocks beyond those asked for.
    let slice = u32::cast_from(CUBE_POS);
    if slice < padded / SLICE {
        let w = world_of[(slice / LANES) as usize];
        let s = w * status::WORDS;
        let i = slice * SLICE + UNIT_POS % SLICE;
        let half = (1u32 - states[(s + status::LISTED) as usize]) * padded;
        let takes_part = rebuilding(states, w);
        let there =
            i - worlds[(w * world::WORDS + world::FIRST) as usize] < states[(s + status::COUNT) as usize];
        let mut n = 0u32;
        if takes_part && there {
            for class in 0..worlds[(w * world::WORDS + world::GRADES) as usize] {
                let none = Ends { front: 0u32, back: 0u32 };
                let e = walk(
                    i,
                    UNIT_POS / SLICE,
                    class,
                    none,
                    w,
                    half,
                    0u32,
                    worlds,
                    states,
                    starts,
                    refs,
                    own,
                    nbr,
                    false,
                    orthogonal,
                );
                n += e.front - e.back;
            }
        }
        counts[UNIT_POS as usize] = n;
        sync_cube();
        if UNIT_POS < SLICE {
            n = 0u32;
            for lane in 0..LANES {
                n += counts[(lane * SLICE + UNIT_POS) as usize];
            }
            if takes_part {
                listed[i as usize] = n;
            }
            counts[UNIT_POS as usize] = n;
        }
        sync_cube();
        if UNIT_POS == 0u32 {
            let mut width = 0u32;
            for k in 0..SLICE {
                width = max(width, counts[k as usize]);
            }
            widths[slice as usize] = width * SLICE;
        }
    }
}

/// As [`super::lists::fill`].
#[cube(launch_unchecked)]
pub fn fill(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    starts: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    listed: &Array<u32>,
    widths: &Array<u32>,
    lists: &mut Array<u32>,
    nbr: &mut Array<u32>,
    #[comptime] orthogonal: bool,
) {
    let mut touching = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let mut others = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let launched = u32::cast_from(CUBE_POS);
    let slice = min(launched, padded / SLICE - 1u32);
    let w = world_of[(slice / LANES) as usize];
    if launched == slice && rebuilding(states, w) {
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let lane = UNIT_POS / SLICE;
        let i = slice * SLICE + UNIT_POS % SLICE;
        let half = (1u32 - states[(s + status::LISTED) as usize]) * padded;
        let begins = list_begin(worlds, c, slice, widths);
        if UNIT_POS == 0u32 {
            lists[(padded + slice) as usize] = begins;
        }
        let from = begins + i % SLICE;
        let there = i - worlds[(c + world::FIRST) as usize] < states[(s + status::COUNT) as usize];
        let n = select(there, listed[i as usize], 0u32);
        if there && lane == 0u32 {
            lists[i as usize] = n;
        }
        let mut front = 0u32;
        let mut back = n;
        for class in 0..worlds[(c + world::GRADES) as usize] {
            // What the lanes before this one find comes before what it finds.
            let mut found_touching = 0u32;
            let mut found_others = 0u32;
            if there {
                let none = Ends { front: 0u32, back: 0u32 };
                let e = walk(
                    i, lane, class, none, w, half, from, worlds, states, starts, refs, own, nbr, false,
                    orthogonal,
                );
                found_touching = e.front;
                found_others = 0u32 - e.back;
            }
            touching[UNIT_POS as usize] = found_touching;
            others[UNIT_POS as usize] = found_others;
            sync_cube();
            let mut mine_front = front;
            let mut mine_back = back;
            for k in 0..LANES {
                let at = k * SLICE + UNIT_POS % SLICE;
                front += touching[at as usize];
                back -= others[at as usize];
                mine_front += select(k < lane, touching[at as usize], 0u32);
                mine_back -= select(k < lane, others[at as usize], 0u32);
            }
            if there {
                walk(
                    i,
                    lane,
                    class,
                    Ends { front: mine_front, back: mine_back },
                    w,
                    half,
                    from,
                    worlds,
                    states,
                    starts,
                    refs,
                    own,
                    nbr,
                    true,
                    orthogonal,
                );
            }
            sync_cube();
        }
    }
}
