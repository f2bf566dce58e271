//! What pairs remember while their lists are made anew: kept pair by pair, by the particles' places in the old order.

use cubecl::prelude::*;

use super::contacts::{list_of, plane};
use super::layout::{BLOCK, F4, NONE, PARTNER, SECOND, SLICE, TOUCHING, status, world};
use super::lists::rebuilding;
use super::scan::within_block;

/// Pairs that there is room to keep: as many as there are entries for, of which each pair has two.
pub fn room(list_room: u32) -> u32 {
    list_room / 2
}

/// Keeps the pairs that touch, each told by its particle of the lower number: those of the worlds that are being rebuilt,
/// or of the world `only`. In which order they come differs from run to run.
#[cube(launch_unchecked)]
pub fn keep(
    padded: u32,
    list_room: u32,
    only: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    lists: &Array<u32>,
    nbr: &Array<u32>,
    hist: &Array<F4>,
    held: &mut Array<Atomic<u32>>,
    kept: &mut Array<u32>,
    kept_hist: &mut Array<F4>,
    #[comptime] quads: u32,
) {
    let mut shared = SharedMemory::<u32>::new(comptime!(BLOCK as usize));
    let mut base = SharedMemory::<u32>::new(1usize);
    let w = world_of[CUBE_POS];
    let c = w * world::WORDS;
    let s = w * status::WORDS;
    let asked = states[(s + status::ASKED) as usize] != 0u32;
    let takes_part = select(only == NONE, rebuilding(states, w) && !asked, w == only);
    let i = u32::cast_from(ABSOLUTE_POS);
    let there = i - worlds[(c + world::FIRST) as usize] < states[(s + status::COUNT) as usize];
    let mut n = 0u32;
    let mut many = 0u32;
    let mut from = 0u32;
    if takes_part && there {
        many = lists[i as usize];
        from = list_of(i, padded, lists);
    }
    for k in 0..many {
        let entry = nbr[(from + k * SLICE) as usize];
        n += select(entry & comptime!(TOUCHING | SECOND) == TOUCHING, 1u32, 0u32);
    }
    let before = within_block(&mut shared, n);
    if UNIT_POS == BLOCK - 1u32 {
        let all = shared[UNIT_POS as usize];
        let first = worlds[(c + world::LISTS) as usize] / 2u32;
        if all > 0u32 {
            base[0] = first + held[w as usize].fetch_add(all);
        }
    }
    sync_cube();
    if n > 0u32 {
        let mut to = base[0] + before;
        for k in 0..many {
            let at = from + k * SLICE;
            let entry = nbr[at as usize];
            if entry & comptime!(TOUCHING | SECOND) == TOUCHING {
                kept[(2u32 * to) as usize] = i;
                kept[(2u32 * to + 1u32) as usize] = entry & PARTNER;
                #[unroll]
                for q in 0..quads {
                    let memory = hist[plane(list_room, at, q) as usize];
                    kept_hist[plane(list_room / 2u32, to, q) as usize] = memory;
                }
                to += 1u32;
            }
        }
    }
}

/// Gives both entries of each pair that was kept what it remembers. One unit per pair.
#[cube(launch_unchecked)]
pub fn restore(
    padded: u32,
    list_room: u32,
    blocks: u32,
    world_of_kept: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    lists: &Array<u32>,
    renamed: &Array<u32>,
    held: &Array<u32>,
    kept: &Array<u32>,
    kept_hist: &Array<F4>,
    nbr: &mut Array<u32>,
    hist: &mut Array<F4>,
    #[comptime] quads: u32,
    #[comptime] graded: bool,
) {
    // A grid of rows has blocks beyond those asked for.
    let launched = u32::cast_from(CUBE_POS);
    let w = world_of_kept[min(launched, blocks - 1u32) as usize];
    let first = worlds[(w * world::WORDS + world::LISTS) as usize] / 2u32;
    let k = u32::cast_from(ABSOLUTE_POS);
    if launched < blocks && rebuilding(states, w) && k - first < held[w as usize] {
        let a = renamed[kept[(2u32 * k) as usize] as usize];
        let b = renamed[kept[(2u32 * k + 1u32) as usize] as usize];
        #[unroll]
        for side in 0..2u32 {
            let (i, j) = if comptime!(side == 0) { (a, b) } else { (b, a) };
            let from = list_of(i, padded, lists);
            let q = place_of(j, from, lists[i as usize], nbr, graded);
            if q != NONE {
                let to = from + q * SLICE;
                nbr[to as usize] = nbr[to as usize] | TOUCHING;
                #[unroll]
                for q in 0..quads {
                    let memory = kept_hist[plane(list_room / 2u32, k, q) as usize];
                    hist[plane(list_room, to, q) as usize] = memory;
                }
            }
        }
    }
}

/// The partner at place `q` of the list from `from` on.
#[cube]
fn partner(from: u32, q: u32, nbr: &Array<u32>) -> u32 {
    nbr[(from + q * SLICE) as usize] & PARTNER
}

/// Where `j` stands in the list of `n` from `from` on, or `NONE`. Long lists are looked through by halves: neighbours that
/// touch come in the order of storage and the others after them in the opposite one, but where cells share places.
#[cube]
fn place_of(j: u32, from: u32, n: u32, nbr: &Array<u32>, #[comptime] long: bool) -> u32 {
    let mut found = NONE.runtime();
    if comptime!(long) {
        // The largest of all stands where the order turns.
        let mut low = 0u32;
        let mut high = n;
        while low + 1u32 < high {
            let q = low + (high - low) / 2u32;
            let rises = partner(from, q, nbr) > partner(from, q - 1u32, nbr);
            low = select(rises, q, low);
            high = select(rises, high, q);
        }
        let turn = min(low + 1u32, n);
        low = 0u32;
        high = turn;
        while low < high {
            let q = low + (high - low) / 2u32;
            let there = partner(from, q, nbr);
            found = select(there == j, q, found);
            low = select(there < j, q + 1u32, low);
            high = select(there < j, high, q);
        }
        low = turn;
        high = select(found == NONE, n, turn);
        while low < high {
            let q = low + (high - low) / 2u32;
            let there = partner(from, q, nbr);
            found = select(there == j, q, found);
            low = select(there > j, q + 1u32, low);
            high = select(there > j, high, q);
        }
    }
    let mut q = 0u32;
    while q < select(found == NONE, n, 0u32) {
        found = select(partner(from, q, nbr) == j, q, found);
        q += 1u32;
    }
    found
}
