//! Sums over the blocks of each world.

use cubecl::prelude::*;

use super::compensated::{Two, plus2, sum, tidy};
use super::layout::{BLOCK, Signature, world};

/// Place of the largest overlap among the sums of an observation. It is no sum.
pub const OVERLAP: u32 = 7;
/// Place of the largest squared speed, no sum either.
pub const SPEED: u32 = 8;

/// Sums the quantities that blocks have left, `quantities` of each, over the blocks of each world, in a fixed order. One
/// block per world and quantity. Blocks leave pairs of f32 if `pairs` is set, else one; the sums are pairs. `far` blocks
/// are of particles, those of particles near surfaces follow.
#[cube(launch_unchecked)]
pub fn over_blocks(
    count: u32,
    far: u32,
    worlds: &Array<u32>,
    blocks: &Array<f32>,
    out: &mut Array<f32>,
    #[comptime] quantities: u32,
    #[comptime] pairs: bool,
    #[comptime] s: Signature,
) {
    let me = u32::cast_from(CUBE_POS);
    let w = me / quantities;
    let q = me % quantities;
    let mut high = SharedMemory::<f32>::new(comptime!(BLOCK as usize));
    let mut low = SharedMemory::<f32>::new(comptime!(BLOCK as usize));
    if w < count {
        let c = w * world::WORDS;
        let first = worlds[(c + world::FIRST) as usize] / s.shape.owners;
        let own = worlds[(c + world::BLOCKS) as usize] * BLOCK / s.shape.owners;
        let mut near = 0u32;
        let mut first_near = far;
        if comptime!(s.near_blocks()) {
            near = worlds[(c + world::ROW_ROOM) as usize] / s.shape.near;
            first_near = far + worlds[(c + world::ROWS) as usize] / s.shape.near;
        }
        let largest = comptime!(!pairs) && (q == OVERLAP || q == SPEED);
        let mut h = 0.0f32;
        let mut l = 0.0f32;
        let mut k = UNIT_POS;
        while k < own + near {
            let block = select(k < own, first + k, first_near + k - own);
            let at = block * quantities + q;
            if comptime!(pairs) {
                let both = plus2(
                    Two { h, l },
                    Two { h: blocks[(2u32 * at) as usize], l: blocks[(2u32 * at + 1u32) as usize] },
                );
                h = both.h;
                l = both.l;
            } else {
                let x = blocks[at as usize];
                let s = sum(h, x);
                let both = tidy(s.h, l + s.l);
                l = select(largest, 0.0f32, both.l);
                h = select(largest, f32::max(h, x), both.h);
            }
            k += BLOCK;
        }
        high[UNIT_POS as usize] = h;
        low[UNIT_POS as usize] = l;
        sync_cube();
        let mut width = comptime!(BLOCK / 2).runtime();
        while width > 0u32 {
            if UNIT_POS < width {
                let a = Two { h: high[UNIT_POS as usize], l: low[UNIT_POS as usize] };
                let b = Two { h: high[(UNIT_POS + width) as usize], l: low[(UNIT_POS + width) as usize] };
                let both = plus2(a, b);
                high[UNIT_POS as usize] = select(largest, f32::max(a.h, b.h), both.h);
                low[UNIT_POS as usize] = select(largest, 0.0f32, both.l);
            }
            sync_cube();
            width /= 2u32;
        }
        if UNIT_POS == 0u32 {
            out[(2u32 * me) as usize] = high[0];
            out[(2u32 * me + 1u32) as usize] = low[0];
        }
    }
}
