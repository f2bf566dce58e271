//! What contacts remember: floats of the slots, one after the other, in as many F4 as they need. A kernel is made
//! for their number; most worlds remember a tangential spring, which is one F4.

use cubecl::prelude::*;
use glebe_physics::kernel::contact::Memory;
use glebe_physics::kernel::vector::V3;
use glebe_physics::{Layout, Slot};

use super::layout::F4;
use super::step::four;

/// What the laws of a contact remember.
#[derive(CubeType, Clone, Copy)]
pub struct Recall {
    /// Stretch of the tangential spring \[m\].
    pub stretch: V3,
    /// 1 if it slips.
    pub slip: f32,
    /// Of the rolling law.
    pub rolling: Memory,
    /// Of the normal law.
    pub normal: Memory,
    /// Of the law of cohesion.
    pub cohesion: Memory,
    /// Of a bond: rest length and shear.
    pub shear: Memory,
    /// Of a bond: bending and twist.
    pub bend: Memory,
}

/// The slots in the order of [`Recall`], and which of their floats come first there.
const SLOTS: [(Slot, usize); 6] = [
    (Slot::Tangential, 0),
    (Slot::Rolling, 0),
    (Slot::Normal, 0),
    (Slot::Cohesion, 0),
    (Slot::Bond, 0),
    (Slot::Bond, FLOATS),
];
/// Floats of each, at most.
const FLOATS: usize = 4;

/// Where float `k` of a slot stands; beyond all where the law has none such.
fn place(layout: Layout, slot: usize, k: usize) -> usize {
    let (slot, first) = SLOTS[slot];
    let place = layout.place(slot);
    if first + k < place.len() { place.start + first + k } else { usize::MAX }
}

/// Which float of [`Recall`] stands at `at`, counted by [`FLOATS`]; beyond all if none does.
fn holder(layout: Layout, at: usize) -> usize {
    let all = SLOTS.len() * FLOATS;
    (0..all).find(|q| place(layout, q / FLOATS, q % FLOATS) == at).unwrap_or(all)
}

/// Floats of a contact as they are read: the first four, and further F4, which count if `known`.
#[derive(CubeType, Clone, Copy)]
pub struct Floats {
    /// First.
    pub x: f32,
    /// Second.
    pub y: f32,
    /// Third.
    pub z: f32,
    /// Fourth.
    pub w: f32,
    /// The next four.
    pub second: F4,
    /// The last four.
    pub third: F4,
    /// Whether they are of this contact.
    pub known: bool,
}

#[cube]
fn of_quad(q: F4, known: bool, #[comptime] k: usize) -> f32 {
    let x = if comptime!(k == 0) {
        q[0]
    } else if comptime!(k == 1) {
        q[1]
    } else if comptime!(k == 2) {
        q[2]
    } else {
        q[3]
    };
    select(known, x, 0.0f32)
}

#[cube]
fn float(f: Floats, #[comptime] at: usize) -> f32 {
    if comptime!(at == 0) {
        f.x
    } else if comptime!(at == 1) {
        f.y
    } else if comptime!(at == 2) {
        f.z
    } else if comptime!(at == 3) {
        f.w
    } else if comptime!(at < 8) {
        of_quad(f.second, f.known, comptime!(at - 4))
    } else if comptime!(at < 12) {
        of_quad(f.third, f.known, comptime!(at - 8))
    } else {
        0.0f32.runtime()
    }
}

#[cube]
fn memory(f: Floats, #[comptime] layout: Layout, #[comptime] slot: usize) -> Memory {
    if comptime!(layout.place(SLOTS[slot].0).is_empty()) {
        Memory { a: 0.0f32, b: 0.0f32, c: 0.0f32, d: 0.0f32 }
    } else {
        Memory {
            a: float(f, comptime!(place(layout, slot, 0))),
            b: float(f, comptime!(place(layout, slot, 1))),
            c: float(f, comptime!(place(layout, slot, 2))),
            d: float(f, comptime!(place(layout, slot, 3))),
        }
    }
}

/// What the laws find in the floats of a contact.
#[cube]
pub fn recalled(f: Floats, #[comptime] layout: Layout) -> Recall {
    let spring = comptime!(!layout.place(Slot::Tangential).is_empty());
    Recall {
        stretch: if comptime!(spring) {
            V3 { x: f.x, y: f.y, z: f.z }
        } else {
            V3 { x: 0.0f32, y: 0.0f32, z: 0.0f32 }
        },
        slip: if comptime!(spring) { f.w } else { 0.0f32.runtime() },
        rolling: memory(f, layout, 1usize),
        normal: memory(f, layout, 2usize),
        cohesion: memory(f, layout, 3usize),
        shear: memory(f, layout, 4usize),
        bend: memory(f, layout, 5usize),
    }
}

/// What stands at `at` of the floats of a contact.
#[cube]
pub fn remembered(m: Recall, #[comptime] layout: Layout, #[comptime] at: usize) -> f32 {
    let holder = comptime!(holder(layout, at));
    if comptime!(holder < 4) {
        if comptime!(holder == 0) {
            m.stretch.x
        } else if comptime!(holder == 1) {
            m.stretch.y
        } else if comptime!(holder == 2) {
            m.stretch.z
        } else {
            m.slip
        }
    } else if comptime!(holder < 8) {
        part(m.rolling, comptime!(holder - 4))
    } else if comptime!(holder < 12) {
        part(m.normal, comptime!(holder - 8))
    } else if comptime!(holder < 16) {
        part(m.cohesion, comptime!(holder - 12))
    } else if comptime!(holder < 20) {
        part(m.shear, comptime!(holder - 16))
    } else if comptime!(holder < 24) {
        part(m.bend, comptime!(holder - 20))
    } else {
        0.0f32.runtime()
    }
}

#[cube]
fn part(m: Memory, #[comptime] k: usize) -> f32 {
    if comptime!(k == 0) {
        m.a
    } else if comptime!(k == 1) {
        m.b
    } else if comptime!(k == 2) {
        m.c
    } else {
        m.d
    }
}

/// The floats of a contact as F4 `q`.
#[cube]
pub fn packed(m: Recall, #[comptime] layout: Layout, #[comptime] q: usize) -> F4 {
    four(
        remembered(m, layout, comptime!(4 * q)),
        remembered(m, layout, comptime!(4 * q + 1)),
        remembered(m, layout, comptime!(4 * q + 2)),
        remembered(m, layout, comptime!(4 * q + 3)),
    )
}
