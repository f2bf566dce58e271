//! Running sums: `out[k]` is the sum of the first k inputs, k = 0 ..= n.

use cubecl::prelude::*;

use super::layout::BLOCK;

/// Values that a unit takes.
pub const EACH: u32 = 8;
/// Values that a block takes.
pub const TILE: u32 = BLOCK * EACH;

/// The exclusive sum of `x` over the units of a block, and of all of them in `shared[BLOCK - 1]`'s inclusive
/// form.
#[cube]
pub fn within_block(shared: &mut SharedMemory<u32>, x: u32) -> u32 {
    shared[UNIT_POS as usize] = x;
    sync_cube();
    let mut reach = 1u32;
    while reach < BLOCK {
        let mut other = 0u32;
        if UNIT_POS >= reach {
            other = shared[(UNIT_POS - reach) as usize];
        }
        sync_cube();
        shared[UNIT_POS as usize] += other;
        sync_cube();
        reach *= 2u32;
    }
    shared[UNIT_POS as usize] - x
}

/// Sums within tiles. Inputs are read as counters, which some of them are.
#[cube(launch_unchecked)]
pub fn tiles(n: u32, input: &Array<Atomic<u32>>, out: &mut Array<u32>, totals: &mut Array<u32>) {
    let mut shared = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let begin = u32::cast_from(ABSOLUTE_POS) * EACH;
    let mut values = Array::<u32>::new(comptime!(EACH as usize));
    let mut own = 0u32;
    #[unroll]
    for k in 0..EACH {
        let mut x = 0u32;
        if begin + k < n {
            x = input[(begin + k) as usize].load();
        }
        values[k as usize] = x;
        own += x;
    }
    let mut running = within_block(&mut shared, own);
    #[unroll]
    for k in 0..EACH {
        if begin + k < n {
            out[(begin + k) as usize] = running;
        }
        running += values[k as usize];
    }
    if UNIT_POS == BLOCK - 1u32 {
        totals[CUBE_POS] = shared[UNIT_POS as usize];
    }
}

/// Sums over tiles; one block. The total goes to `totals[tiles]`.
#[cube(launch_unchecked)]
pub fn join(tiles: u32, totals: &mut Array<u32>) {
    let mut shared = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let mut carried = 0u32;
    let mut at = 0u32;
    while at < tiles {
        let k = at + UNIT_POS;
        let mut x = 0u32;
        if k < tiles {
            x = totals[k as usize];
        }
        let before = within_block(&mut shared, x);
        if k < tiles {
            totals[k as usize] = carried + before;
        }
        carried += shared[comptime!((BLOCK - 1) as usize)];
        sync_cube();
        at += BLOCK;
    }
    if UNIT_POS == 0u32 {
        totals[tiles as usize] = carried;
    }
}

/// Adds the sums over tiles.
#[cube(launch_unchecked)]
pub fn spread(n: u32, tiles: u32, totals: &Array<u32>, out: &mut Array<u32>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        let before = totals[(i / TILE) as usize];
        out[i as usize] += before;
    }
    if i == n {
        out[i as usize] = totals[tiles as usize];
    }
}
