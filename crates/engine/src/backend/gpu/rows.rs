//! Which particles are near surfaces, and to which triangles: found once per rebuild.

use cubecl::prelude::*;
use glebe_physics::kernel::vector::V3;

use super::compensated::rounded;
use super::layout::{F4, IMAGE_BITS, NONE, SLOTS, Signature, U4, boundary, float_at, pose, status, world};
use super::round::round_facing;
use super::step::quad;
use super::surfaces::{
    Spot, at_hand, from_origin, height_above, into_body, roughly, roughly_into_body, within,
};

/// Nodes that a walk down a hierarchy may have waiting.
const STACK: u32 = 40;

/// Square of the distance of a point from a node's box.
#[cube]
fn gap2(lo: F4, hi: F4, x: V3) -> f32 {
    let a = f32::max(f32::max(lo[0] - x.x, x.x - hi[0]), 0.0f32);
    let b = f32::max(f32::max(lo[1] - x.y, x.y - hi[1]), 0.0f32);
    let c = f32::max(f32::max(lo[2] - x.z, x.z - hi[2]), 0.0f32);
    a * a + b * b + c * c
}

/// What single precision blurs of a distance, as a share of its components.
pub const ROUGH: f32 = 2.0e-6;

/// Whether a plane or the box around a mesh is within `reach` of a place, given from the origin of its pose.
// Variables of a kernel begin with a value, read or not.
#[allow(unused_assignments)]
#[cube]
fn may_meet(
    poses: &Array<u32>,
    at: u32,
    nodes: &Array<F4>,
    first_node: u32,
    plane: bool,
    x: V3,
    reach: f32,
) -> bool {
    let mut near = false;
    if plane {
        let n = at + pose::NORMAL;
        let height =
            float_at(poses, n) * x.x + float_at(poses, n + 1u32) * x.y + float_at(poses, n + 2u32) * x.z;
        near = height < reach;
    } else {
        let lo = nodes[(2u32 * first_node) as usize];
        let hi = nodes[(2u32 * first_node + 1u32) as usize];
        near = gap2(lo, hi, roughly_into_body(poses, at, x)) <= reach * reach;
    }
    near
}

#[cube]
fn write(facets: &mut Array<U4>, at: u32, triangle: u32, boundary: u32, image: u32, row: u32) {
    facets[at as usize] = quad(triangle, boundary, image, row);
}

/// Counts the planes, triangles and parts of shells within reach of a particle's reference, or writes them.
#[cube]
fn near(
    w: u32,
    p: Spot,
    r: f32,
    row: u32,
    from: u32,
    worlds: &Array<u32>,
    states: &Array<u32>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    nodes: &Array<F4>,
    ordered: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    facets: &mut Array<U4>,
    #[comptime] writes: bool,
    #[comptime] s: Signature,
) -> u32 {
    let c = w * world::WORDS;
    let st = w * status::WORDS;
    let beyond = float_at(worlds, c + world::RANGE) + float_at(states, st + status::SKIN);
    let reach = r + beyond;
    let t = states[(st + status::BASE) as usize];
    let bound0 = worlds[(c + world::BOUNDARIES) as usize];
    let mut found = 0u32;
    for b in 0..worlds[(c + world::BOUNDARY_COUNT) as usize] {
        let bt = (bound0 + b) * boundary::WORDS;
        let at = bounds[(bt + boundary::POSE) as usize] + t * bounds[(bt + boundary::STRIDE) as usize];
        if poses[(at + pose::PRESENT) as usize] == 1u32 {
            let i = bt + boundary::IMAGES;
            let triangles = bounds[(bt + boundary::TRIANGLES) as usize];
            let vertices = bounds[(bt + boundary::VERTICES) as usize];
            let first_node = bounds[(bt + boundary::NODES) as usize];
            let order0 = bounds[(bt + boundary::ORDER) as usize];
            // Boxes are compared in plain f32 about the frame's origin: the reach covers their rounding.
            let far = reach + 4.0e-7f32 * float_at(bounds, bt + boundary::SIZE);
            for kz in bounds[(i + 2u32) as usize]..bounds[(i + 5u32) as usize] + 1u32 {
                for ky in bounds[(i + 1u32) as usize]..bounds[(i + 4u32) as usize] + 1u32 {
                    for kx in bounds[i as usize]..bounds[(i + 3u32) as usize] + 1u32 {
                        let image = kx | (ky << IMAGE_BITS) | (kz << comptime!(2 * IMAGE_BITS));
                        // Most particles are far from most boundaries, which a rough look tells.
                        let rough = roughly(worlds, c, poses, at, p, image, comptime!(s.orthogonal));
                        let blur = ROUGH * (f32::abs(rough.x) + f32::abs(rough.y) + f32::abs(rough.z));
                        let parts = if comptime!(s.rounds) {
                            bounds[(bt + boundary::PARTS) as usize]
                        } else {
                            0u32.runtime()
                        };
                        let mut meets = parts > 0u32;
                        if !meets {
                            meets =
                                may_meet(poses, at, nodes, first_node, triangles == NONE, rough, far + blur);
                        }
                        if meets {
                            let x = from_origin(
                                worlds,
                                c,
                                poses,
                                at,
                                p,
                                image,
                                comptime!(s.fused),
                                comptime!(s.orthogonal),
                            );
                            if parts > 0u32 {
                                for part in 0..parts {
                                    let f =
                                        round_facing(bounds, bt, poses, at, part, x, r, comptime!(s.fused));
                                    if f.gap.delta > 0.0f32 - beyond {
                                        if comptime!(writes) {
                                            write(facets, from + found, part, b, image, row);
                                        }
                                        found += 1u32;
                                    }
                                }
                            } else if triangles == NONE {
                                if height_above(poses, at, x, comptime!(s.fused)).h < reach {
                                    if comptime!(writes) {
                                        write(facets, from + found, 0u32, b, image, row);
                                    }
                                    found += 1u32;
                                }
                            } else {
                                let body = into_body(poses, at, x, comptime!(s.fused));
                                let y = rounded(body);
                                let mut stack = Array::<u32>::new(comptime!(STACK as usize));
                                stack[0] = 0u32;
                                let mut depth: u32 = 1u32;
                                while depth > 0u32 {
                                    depth -= 1u32;
                                    let node = stack[depth as usize];
                                    let lo = nodes[(2u32 * (first_node + node)) as usize];
                                    let hi = nodes[(2u32 * (first_node + node) + 1u32) as usize];
                                    if gap2(lo, hi, y) <= far * far {
                                        let link = u32::reinterpret(lo[3]);
                                        let leaf = u32::reinterpret(hi[3]);
                                        if leaf > 0u32 {
                                            for k in 0..leaf {
                                                let triangle = ordered[(order0 + link + k) as usize];
                                                let corners = tris[(triangles + triangle) as usize];
                                                let mut meets = at_hand(verts, corners, vertices, y, reach);
                                                if meets {
                                                    meets = within(verts, corners, vertices, y, reach);
                                                }
                                                if meets {
                                                    if comptime!(writes) {
                                                        write(facets, from + found, triangle, b, image, row);
                                                    }
                                                    found += 1u32;
                                                }
                                            }
                                        } else {
                                            stack[depth as usize] = link;
                                            stack[(depth + 1u32) as usize] = node + 1u32;
                                            depth += 2u32;
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    found
}

/// A particle in its reference configuration.
#[cube]
fn reference(refs: &Array<U4>, at: u32) -> Spot {
    Spot {
        hi: refs[(2u32 * at + 1u32) as usize],
        lo: refs[(2u32 * at) as usize],
        rest: quad(0u32, 0u32, 0u32, 0u32),
    }
}

/// Counts what each particle is near to.
#[cube(launch_unchecked)]
pub fn approach(
    padded: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    refs: &Array<U4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    nodes: &Array<F4>,
    ordered: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    facets: &mut Array<U4>,
    near_count: &mut Array<u32>,
    near_flag: &mut Array<u32>,
    #[comptime] s: Signature,
) {
    let w = world_of[CUBE_POS];
    let st = w * status::WORDS;
    if states[(st + status::REBUILDING) as usize] == 1u32 {
        let i = u32::cast_from(ABSOLUTE_POS);
        let mut n = 0u32;
        if i - worlds[(w * world::WORDS + world::FIRST) as usize] < states[(st + status::COUNT) as usize] {
            let at = (1u32 - states[(st + status::LISTED) as usize]) * padded + i;
            let p = reference(refs, at);
            let r = f32::reinterpret(p.lo[3]);
            n = near(
                w, p, r, NONE, 0u32, worlds, states, bounds, poses, nodes, ordered, tris, verts, facets,
                false, s,
            );
        }
        near_count[i as usize] = n;
        near_flag[i as usize] = select(n > 0u32, 1u32, 0u32);
    }
}

/// Writes the rows and gives contacts what they remember.
#[cube(launch_unchecked)]
pub fn settle(
    padded: u32,
    row_room: u32,
    facet_room: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    refs: &Array<U4>,
    order: &Array<u32>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    nodes: &Array<F4>,
    ordered: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    row_starts: &Array<u32>,
    facet_starts: &Array<u32>,
    rows: &mut Array<u32>,
    facets: &mut Array<U4>,
    row_count: &mut Array<u32>,
    row_mem: &mut Array<F4>,
    #[comptime] s: Signature,
) {
    let w = world_of[CUBE_POS];
    let st = w * status::WORDS;
    if states[(st + status::REBUILDING) as usize] == 1u32 {
        let c = w * world::WORDS;
        let i = u32::cast_from(ABSOLUTE_POS);
        let first = worlds[(c + world::FIRST) as usize];
        if i - first < states[(st + status::COUNT) as usize] {
            let old_half = states[(st + status::LISTED) as usize];
            let new_half = 1u32 - old_half;
            let row = row_starts[i as usize] - row_starts[first as usize];
            let begin = facet_starts[i as usize] - facet_starts[first as usize];
            let n = facet_starts[(i + 1u32) as usize] - facet_starts[i as usize];
            if n == 0u32 {
                rows[(new_half * padded + i) as usize] = NONE;
            } else {
                let at = new_half * padded + i;
                let p = reference(refs, at);
                let r = f32::reinterpret(p.lo[3]);
                let mine = worlds[(c + world::ROWS) as usize] + row;
                let from = worlds[(c + world::FACETS) as usize] + begin;
                rows[at as usize] = mine;
                let table = 2u32 * padded + 3u32 * (new_half * row_room + mine);
                rows[table as usize] = from;
                rows[(table + 1u32) as usize] = n;
                rows[(table + 2u32) as usize] = i;
                near(
                    w,
                    p,
                    r,
                    mine,
                    new_half * facet_room + from,
                    worlds,
                    states,
                    bounds,
                    poses,
                    nodes,
                    ordered,
                    tris,
                    verts,
                    facets,
                    true,
                    s,
                );
                let parity = states[(st + status::PARITY) as usize];
                let before = rows[(old_half * padded + order[i as usize]) as usize];
                let mut kept = 0u32;
                if before != NONE {
                    kept = row_count[(parity * row_room + before) as usize];
                    let a = (parity * row_room + before) * SLOTS * comptime!(s.row_quads());
                    let b = ((1u32 - parity) * row_room + mine) * SLOTS * comptime!(s.row_quads());
                    for k in 0..kept * comptime!(s.row_quads()) {
                        row_mem[(b + k) as usize] = row_mem[(a + k) as usize];
                    }
                }
                row_count[((1u32 - parity) * row_room + mine) as usize] = kept;
            }
        }
    }
}
