//! Neighbours without a grid: down a hierarchy of bounding volumes, or among all particles of a world.
//!
//! Particles stand along the curve of [`crate::curve`], world after world, so runs of successive ones are near each
//! other. [`LEAF`] of them are a leaf of a binary tree that lies in memory as a heap does: nodes `2n` and `2n + 1` are below
//! node `n`, and leaf `k` is node `leaves + k`. A node holds the box around its centres, in windows, and the largest radius.
//! It is built level by level and walked without a stack, from left to right: past a node whose index has ones at its end
//! lies the sibling of the ancestor that these ones lead to.
//!
//! After T. Karras, "Maximizing parallelism in the construction of BVHs, octrees, and k-d trees", High Performance Graphics
//! 2012, in the order of codes; the tree itself is not that of their prefixes, but balanced.

use cubecl::prelude::*;

use super::layout::{BLOCK, U4, cell_at, float_at, status, world};
use super::lists::{Ends, part, rebuilding, take};
use crate::curve;
use crate::spec::Search;

/// Particles of a leaf.
pub const LEAF: u32 = 8;

/// Share that a place in windows may be rounded by, of all windows along an axis.
const ROUNDED: f32 = 3.0e-7;
/// The same of a reach.
const MARGIN: f32 = 1.0e-5;

/// A place in windows.
#[cube]
fn windows(hi: u32, lo: u32) -> f32 {
    f32::cast_from(i32::cast_from(hi)) + f32::cast_from(lo) * (1.0f32 / 4_294_967_296.0f32)
}

/// The code of a place among `count` particles.
#[cube]
pub fn code(worlds: &Array<u32>, w: u32, count: u32, lo: U4, hi: U4) -> u32 {
    let c = w * world::WORDS;
    let mut share = U4::empty();
    #[unroll]
    for k in 0..3u32 {
        let periodic = worlds[(c + world::PERIODIC + k) as usize] == 1u32;
        let end = windows(
            worlds[(c + world::EXTENT + k) as usize],
            worlds[(c + world::EXTENT + 3u32 + k) as usize],
        );
        let all = select(periodic, f32::cast_from(worlds[(c + world::WINDOWS + k) as usize]), end);
        let at = f32::clamp(windows(hi[k as usize], lo[k as usize]) / all, 0.0f32, 0.999_999_9f32);
        share[k as usize] = u32::cast_from(at * 16_777_216.0f32) << 8u32;
    }
    let more = max(count, 1u32) - 1u32;
    let bits = min(33u32 - more.leading_zeros(), comptime!(curve::BITS));
    let mut code = 0u32;
    for t in 0..bits {
        let axes = worlds[(c + world::CURVE + t / 16u32) as usize];
        let axis = (axes >> (2u32 * (t % 16u32))) & 3u32;
        code = 2u32 * code + (share[axis as usize] >> 31u32);
        share[axis as usize] <<= 1u32;
    }
    code
}

/// The boxes of a level, 0 for leaves. One unit per leaf, of which every 2^level-th has something to do.
#[cube(launch_unchecked)]
pub fn grow(
    level: u32,
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    refs: &Array<U4>,
    tree: &mut Array<U4>,
) {
    let leaf = u32::cast_from(ABSOLUTE_POS);
    if leaf < padded / LEAF {
        let w = world_of[(leaf * LEAF / BLOCK) as usize];
        let c = w * world::WORDS;
        let s = w * status::WORDS;
        let first = worlds[(c + world::FIRST) as usize];
        let leaves = worlds[(c + world::LEAVES) as usize];
        let k = leaf - first / LEAF;
        let node = (leaves + k) >> level;
        let there = k < worlds[(c + world::BLOCKS) as usize] * comptime!(BLOCK / LEAF);
        if rebuilding(states, w) && there && (node << level) - leaves == k && leaves >> level > 0u32 {
            let mut low = U4::new(0u32);
            let mut high = U4::new(0u32);
            let base = worlds[(c + world::NODES) as usize];
            if level == 0u32 {
                let half = (1u32 - states[(s + status::LISTED) as usize]) * padded;
                let count = states[(s + status::COUNT) as usize];
                let end = min(k * LEAF + LEAF, count);
                for i in k * LEAF..end {
                    let at = 2u32 * (half + first + i);
                    let lo = refs[at as usize];
                    let hi = refs[(at + 1u32) as usize];
                    let begins = i == k * LEAF;
                    #[unroll]
                    for a in 0..3u32 {
                        let x = windows(hi[a as usize], lo[a as usize]);
                        let least = f32::min(f32::reinterpret(low[a as usize]), x);
                        let most = f32::max(f32::reinterpret(high[a as usize]), x);
                        low[a as usize] = u32::reinterpret(select(begins, x, least));
                        high[a as usize] = u32::reinterpret(select(begins, x, most));
                    }
                    // Radii are positive, and their bits are ordered as they are; a node without particles has none.
                    low[3] = max(low[3], lo[3]);
                }
            } else {
                for child in 0..2u32 {
                    let at = 2u32 * (base + 2u32 * node + child);
                    let lo = tree[at as usize];
                    let hi = tree[(at + 1u32) as usize];
                    let first = low[3] == 0u32;
                    if lo[3] > 0u32 {
                        #[unroll]
                        for a in 0..3u32 {
                            let x = f32::reinterpret(lo[a as usize]);
                            let y = f32::reinterpret(hi[a as usize]);
                            let least = f32::min(f32::reinterpret(low[a as usize]), x);
                            let most = f32::max(f32::reinterpret(high[a as usize]), y);
                            low[a as usize] = u32::reinterpret(select(first, x, least));
                            high[a as usize] = u32::reinterpret(select(first, y, most));
                        }
                        low[3] = max(low[3], lo[3]);
                    }
                }
            }
            let at = 2u32 * (base + node);
            tree[at as usize] = low;
            tree[(at + 1u32) as usize] = high;
        }
    }
}

/// How far a place lies from a range along an axis, in windows, over the seam where that is nearer.
#[cube]
fn away(x: f32, low: f32, high: f32, span: f32, periodic: bool) -> f32 {
    let direct = f32::max(low - x, x - high);
    let above = f32::max(low - x - span, x + span - high);
    let below = f32::max(low - x + span, x - span - high);
    let near = select(periodic, f32::min(direct, f32::min(above, below)), direct);
    f32::max(near - ROUNDED * span, 0.0f32)
}

/// The neighbours of `i`, counted or written as [`super::lists`] does.
#[cube]
pub fn neighbours(
    i: u32,
    w: u32,
    half: u32,
    from: u32,
    room: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    refs: &Array<U4>,
    own: &Array<U4>,
    tree: &Array<U4>,
    nbr: &mut Array<u32>,
    #[comptime] search: Search,
    #[comptime] writes: bool,
    #[comptime] orthogonal: bool,
) -> u32 {
    let c = w * world::WORDS;
    let s = w * status::WORDS;
    let first = worlds[(c + world::FIRST) as usize];
    let end = first + states[(s + status::COUNT) as usize];
    let p = part(worlds, w, 0u32, false);
    let mut front = 0u32;
    let mut back = room;
    if comptime!(search == Search::Bvh) {
        let lo = refs[(2u32 * (half + i)) as usize];
        let hi = refs[(2u32 * (half + i) + 1u32) as usize];
        let x = windows(hi[0], lo[0]);
        let y = windows(hi[1], lo[1]);
        let z = windows(hi[2], lo[2]);
        let sx = f32::cast_from(worlds[(c + world::WINDOWS) as usize]);
        let sy = f32::cast_from(worlds[(c + world::WINDOWS + 1u32) as usize]);
        let sz = f32::cast_from(worlds[(c + world::WINDOWS + 2u32) as usize]);
        let px = worlds[(c + world::PERIODIC) as usize] == 1u32;
        let py = worlds[(c + world::PERIODIC + 1u32) as usize] == 1u32;
        let pz = worlds[(c + world::PERIODIC + 2u32) as usize] == 1u32;
        let height = cell_at(worlds, c, states[(s + status::BASE) as usize]) + world::HEIGHT;
        let hx = float_at(worlds, height);
        let hy = float_at(worlds, height + 1u32);
        let hz = float_at(worlds, height + 2u32);
        let mine =
            f32::reinterpret(lo[3]) + float_at(worlds, c + world::RANGE) + float_at(states, s + status::SKIN);
        let leaves = worlds[(c + world::LEAVES) as usize];
        let base = worlds[(c + world::NODES) as usize];
        let mut node = 1u32;
        while node > 0u32 {
            let at = 2u32 * (base + node);
            let low = tree[at as usize];
            let high = tree[(at + 1u32) as usize];
            let ax = hx * away(x, f32::reinterpret(low[0]), f32::reinterpret(high[0]), sx, px);
            let ay = hy * away(y, f32::reinterpret(low[1]), f32::reinterpret(high[1]), sy, py);
            let az = hz * away(z, f32::reinterpret(low[2]), f32::reinterpret(high[2]), sz, pz);
            let reach = (mine + f32::reinterpret(low[3])) * (1.0f32 + MARGIN);
            let far = if comptime!(orthogonal) {
                ax * ax + ay * ay + az * az > reach * reach
            } else {
                f32::max(ax, f32::max(ay, az)) > reach
            };
            let near = low[3] > 0u32 && !far;
            let past = node + 1u32;
            let beside = past >> (past.find_first_set() - 1u32);
            let mut next = select(beside == 1u32, 0u32, beside);
            if near {
                if node < leaves {
                    next = 2u32 * node;
                } else {
                    let begin = first + (node - leaves) * LEAF;
                    let e = take(
                        begin,
                        min(begin + LEAF, end),
                        0u32,
                        0u32,
                        0u32,
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
            }
            node = next;
        }
    } else {
        let e = take(
            first,
            end,
            0u32,
            0u32,
            0u32,
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
    front + (room - back)
}
