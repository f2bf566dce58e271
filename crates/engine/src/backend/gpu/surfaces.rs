//! Contacts of a particle with planes and meshes.
//!
//! Everything is taken in the mesh's own frame, to which the particle is carried in pairs of f32, so that
//! meshes of any size cost nothing to move and large triangles cost no digits.

use cubecl::prelude::*;
use glebe_physics::IntegratorKind;
use glebe_physics::kernel::triangle::closest_to_origin;
use glebe_physics::kernel::vector::{V3, cross, dot, length, minus, plus, scaled};

use super::compensated::{
    Gap, Two, Two3, along2, dot2, gap, minus2, minus23, plus2, rounded, sum, times2_loose,
};
use super::layout::{
    BLOCK, F4, IMAGE_BITS, IMAGE_ZERO, NONE, SLOTS, Signature, TOUCHED, U4, boundary, flag, float_at, halt,
    pose, quick, status, world,
};
use super::pair::{Meeting, interact, inverse_inertia};
use super::recall::{Floats, packed, recalled};
use super::round::round_facing;
use super::rows::ROUGH;
use super::step::{Purpose, Sums, bits3, first3, four, quad, runs, turned};

/// Facets of which it is told together whether they are close: as many as a word has bits.
const CHUNK: u32 = 32;

/// Metres per unit: entry `k` of the matrix by rows, of the world whose table begins at `c`.
#[cube]
pub fn unit_of(worlds: &Array<u32>, c: u32, k: u32) -> Two {
    Two { h: float_at(worlds, c + world::UNIT + k), l: float_at(worlds, c + world::UNIT + 9u32 + k) }
}

/// Metres of a difference in units, in the world whose table begins at `c`.
#[cube]
pub fn metres(
    worlds: &Array<u32>,
    c: u32,
    d: Two3,
    #[comptime] fused: bool,
    #[comptime] orthogonal: bool,
) -> Two3 {
    if comptime!(orthogonal) {
        Two3 {
            x: times2_loose(d.x, unit_of(worlds, c, 0u32), fused),
            y: times2_loose(d.y, unit_of(worlds, c, 4u32), fused),
            z: times2_loose(d.z, unit_of(worlds, c, 8u32), fused),
        }
    } else {
        Two3 {
            x: row_of(worlds, c, d, 0u32, fused),
            y: row_of(worlds, c, d, 3u32, fused),
            z: row_of(worlds, c, d, 6u32, fused),
        }
    }
}

/// The product of the matrix row that begins at entry `k` with `d`.
#[cube]
fn row_of(worlds: &Array<u32>, c: u32, d: Two3, k: u32, #[comptime] fused: bool) -> Two {
    let row =
        Two3 { x: unit_of(worlds, c, k), y: unit_of(worlds, c, k + 1u32), z: unit_of(worlds, c, k + 2u32) };
    dot2(d, row, fused)
}

/// Where a particle is, its windows not wrapped since the lists were made.
#[derive(CubeType, Clone, Copy)]
pub struct Spot {
    /// Windows.
    pub hi: U4,
    /// Fractions.
    pub lo: U4,
    /// Rests, as bits.
    pub rest: U4,
}

/// The windows that a particle has when it is followed from its reference without wrapping.
#[cube]
pub fn unwrapped(hi_ref: u32, lo_ref: u32, lo: u32) -> u32 {
    let moved = i32::cast_from(lo - lo_ref);
    let up = moved > 0i32 && lo < lo_ref;
    let down = moved < 0i32 && lo > lo_ref;
    hi_ref + select(up, 1u32, select(down, NONE, 0u32))
}

/// Where the particle at `me` of the columns of a step and `mine` of those of a rebuild is.
#[cube]
fn spot(place: &Array<U4>, own: &Array<U4>, refs: &Array<U4>, me: usize, mine: u32) -> Spot {
    let here = place[me];
    let lo = refs[(2u32 * mine) as usize];
    let hi = refs[(2u32 * mine + 1u32) as usize];
    Spot {
        hi: quad(
            unwrapped(hi[0], lo[0], here[0]),
            unwrapped(hi[1], lo[1], here[1]),
            unwrapped(hi[2], lo[2], here[2]),
            0u32,
        ),
        lo: here,
        rest: own[(2u32 * mine + 1u32) as usize],
    }
}

/// Units from the origin of a pose to a place, along one axis.
#[cube]
fn along_axis(poses: &Array<u32>, at: u32, hi: u32, lo: u32, rest: f32, k: u32) -> Two {
    let windows = f32::cast_from(i32::cast_from(hi - poses[(at + pose::ORIGIN + k) as usize]));
    let origin = poses[(at + pose::ORIGIN + 3u32 + k) as usize];
    let upper = (f32::cast_from(lo >> 16u32) - f32::cast_from(origin >> 16u32)) * 65_536.0f32;
    let lower = f32::cast_from(lo & 0xffffu32) - f32::cast_from(origin & 0xffffu32);
    let whole = plus2(sum(windows * 4_294_967_296.0f32, upper), sum(lower, 0.0f32));
    plus2(whole, sum(rest - float_at(poses, at + pose::ORIGIN + 6u32 + k), 0.0f32))
}

/// The windows of a particle's image `image`.
#[cube]
fn imaged(worlds: &Array<u32>, c: u32, hi: u32, image: u32, k: u32) -> u32 {
    let mask = comptime!((1u32 << IMAGE_BITS) - 1u32);
    let shift = i32::cast_from((image >> (k * IMAGE_BITS)) & mask) - IMAGE_ZERO;
    hi + u32::cast_from(shift * i32::cast_from(worlds[(c + world::WINDOWS + k) as usize]))
}

/// From the origin of a pose to a particle's image `image` \[m\], in single precision.
#[cube]
pub fn roughly(
    worlds: &Array<u32>,
    c: u32,
    poses: &Array<u32>,
    at: u32,
    p: Spot,
    image: u32,
    #[comptime] orthogonal: bool,
) -> V3 {
    let x = roughly_along(poses, at, imaged(worlds, c, p.hi[0], image, 0u32), p.lo[0], 0u32);
    let y = roughly_along(poses, at, imaged(worlds, c, p.hi[1], image, 1u32), p.lo[1], 1u32);
    let z = roughly_along(poses, at, imaged(worlds, c, p.hi[2], image, 2u32), p.lo[2], 2u32);
    turned(worlds, c + world::UNIT, x, y, z, orthogonal)
}

#[cube]
fn roughly_along(poses: &Array<u32>, at: u32, hi: u32, lo: u32, k: u32) -> f32 {
    let windows = f32::cast_from(i32::cast_from(hi - poses[(at + pose::ORIGIN + k) as usize]));
    let origin = poses[(at + pose::ORIGIN + 3u32 + k) as usize];
    windows * 4_294_967_296.0f32 + (f32::cast_from(lo) - f32::cast_from(origin))
}

/// A world vector in the frame of a pose, in single precision.
#[cube]
pub fn roughly_into_body(poses: &Array<u32>, at: u32, x: V3) -> V3 {
    let r = at + pose::ROTATION;
    V3 {
        x: float_at(poses, r) * x.x + float_at(poses, r + 3u32) * x.y + float_at(poses, r + 6u32) * x.z,
        y: float_at(poses, r + 1u32) * x.x
            + float_at(poses, r + 4u32) * x.y
            + float_at(poses, r + 7u32) * x.z,
        z: float_at(poses, r + 2u32) * x.x
            + float_at(poses, r + 5u32) * x.y
            + float_at(poses, r + 8u32) * x.z,
    }
}

/// From the origin of a pose to a particle's image `image` \[m\].
#[cube]
pub fn from_origin(
    worlds: &Array<u32>,
    c: u32,
    poses: &Array<u32>,
    at: u32,
    p: Spot,
    image: u32,
    #[comptime] fused: bool,
    #[comptime] orthogonal: bool,
) -> Two3 {
    let x = along_axis(
        poses,
        at,
        imaged(worlds, c, p.hi[0], image, 0u32),
        p.lo[0],
        f32::reinterpret(p.rest[0]),
        0u32,
    );
    let y = along_axis(
        poses,
        at,
        imaged(worlds, c, p.hi[1], image, 1u32),
        p.lo[1],
        f32::reinterpret(p.rest[1]),
        1u32,
    );
    let z = along_axis(
        poses,
        at,
        imaged(worlds, c, p.hi[2], image, 2u32),
        p.lo[2],
        f32::reinterpret(p.rest[2]),
        2u32,
    );
    metres(worlds, c, Two3 { x, y, z }, fused, orthogonal)
}

/// Entry `k` of a pose's rotation by rows.
#[cube]
fn turn_of(poses: &Array<u32>, at: u32, k: u32) -> Two {
    Two { h: float_at(poses, at + pose::ROTATION + k), l: float_at(poses, at + pose::ROTATION + 9u32 + k) }
}

/// A world vector in the frame of a pose.
#[cube]
pub fn into_body(poses: &Array<u32>, at: u32, x: Two3, #[comptime] fused: bool) -> Two3 {
    Two3 {
        x: dot2(x, column_of(poses, at, 0u32), fused),
        y: dot2(x, column_of(poses, at, 1u32), fused),
        z: dot2(x, column_of(poses, at, 2u32), fused),
    }
}

/// Column `k` of a pose's rotation.
#[cube]
fn column_of(poses: &Array<u32>, at: u32, k: u32) -> Two3 {
    Two3 { x: turn_of(poses, at, k), y: turn_of(poses, at, k + 3u32), z: turn_of(poses, at, k + 6u32) }
}

/// A direction of the frame in the world.
#[cube]
fn into_world(poses: &Array<u32>, at: u32, n: V3) -> V3 {
    let r = at + pose::ROTATION;
    V3 {
        x: float_at(poses, r) * n.x + float_at(poses, r + 1u32) * n.y + float_at(poses, r + 2u32) * n.z,
        y: float_at(poses, r + 3u32) * n.x
            + float_at(poses, r + 4u32) * n.y
            + float_at(poses, r + 5u32) * n.z,
        z: float_at(poses, r + 6u32) * n.x
            + float_at(poses, r + 7u32) * n.y
            + float_at(poses, r + 8u32) * n.z,
    }
}

/// The normal of a plane, or the axis of a shell of revolution.
#[cube]
pub fn normal_of(poses: &Array<u32>, at: u32) -> Two3 {
    let n = at + pose::NORMAL;
    Two3 {
        x: Two { h: float_at(poses, n), l: float_at(poses, n + 3u32) },
        y: Two { h: float_at(poses, n + 1u32), l: float_at(poses, n + 4u32) },
        z: Two { h: float_at(poses, n + 2u32), l: float_at(poses, n + 5u32) },
    }
}

/// Height of a place above a plane \[m\], from its origin.
#[cube]
pub fn height_above(poses: &Array<u32>, at: u32, x: Two3, #[comptime] fused: bool) -> Two {
    dot2(x, normal_of(poses, at), fused)
}

#[cube]
fn vertex(verts: &Array<F4>, at: u32) -> Two3 {
    let h = verts[(2u32 * at) as usize];
    let l = verts[(2u32 * at + 1u32) as usize];
    Two3 { x: Two { h: h[0], l: l[0] }, y: Two { h: h[1], l: l[1] }, z: Two { h: h[2], l: l[2] } }
}

/// A place where a triangle is closest to a sphere's centre, in the mesh's frame, or a part of a shell, in the world.
#[derive(CubeType, Clone, Copy)]
pub struct Facing {
    /// Where, and how far.
    pub gap: Gap,
    /// 0 face, 1 edge, 2 vertex.
    pub rank: u32,
}

/// Whether a triangle may be within `reach` of the place `x` of its frame: whether the box around it is, in single
/// precision and with as much room as that leaves open.
#[cube]
pub fn at_hand(verts: &Array<F4>, corners: U4, first: u32, x: V3, reach: f32) -> bool {
    let a = verts[(2u32 * (first + corners[0])) as usize];
    let b = verts[(2u32 * (first + corners[1])) as usize];
    let c = verts[(2u32 * (first + corners[2])) as usize];
    let apart = V3 {
        x: outside(a[0], b[0], c[0], x.x),
        y: outside(a[1], b[1], c[1], x.y),
        z: outside(a[2], b[2], c[2], x.z),
    };
    let open = reach + 1.0e-6f32 * (f32::abs(x.x) + f32::abs(x.y) + f32::abs(x.z) + reach);
    dot(apart, apart) <= open * open
}

/// How far `x` is from what `a`, `b` and `c` span.
#[cube]
fn outside(a: f32, b: f32, c: f32, x: f32) -> f32 {
    let low = f32::min(a, f32::min(b, c));
    let high = f32::max(a, f32::max(b, c));
    f32::max(f32::max(low - x, x - high), 0.0f32)
}

/// Whether a triangle may be within `reach` of the place `x` of its frame: whether its closest point is, in single precision
/// and with as much room as that leaves open.
#[cube]
pub fn within(verts: &Array<F4>, corners: U4, first: u32, x: V3, reach: f32) -> bool {
    let a = minus(first3(verts[(2u32 * (first + corners[0])) as usize]), x);
    let b = minus(first3(verts[(2u32 * (first + corners[1])) as usize]), x);
    let c = minus(first3(verts[(2u32 * (first + corners[2])) as usize]), x);
    let closest = closest_to_origin(a, b, c);
    let ab = minus(b, a);
    let ac = minus(c, a);
    let about = plus(a, plus(scaled(ab, closest.s), scaled(ac, closest.t)));
    let blurred = length(x) + length(a) + length(ab) + length(ac);
    let open = reach + 1.0e-6f32 * blurred;
    dot(about, about) <= open * open
}

/// The point of a triangle closest to the place `x` of its frame, seen by a sphere of radius `r` there. What is clearly
/// further than `range` from the sphere is only told to be so: with an overlap of `-1e30`.
///
/// The region of the triangle and the weights are found in f32; the point is then evaluated in pairs, and
/// what the rounded weights left of it along the face or the edge is taken off.
#[cube]
pub fn facing(
    verts: &Array<F4>,
    corners: U4,
    first: u32,
    x: Two3,
    r: f32,
    range: f32,
    #[comptime] fused: bool,
) -> Facing {
    let va = vertex(verts, first + corners[0]);
    let vb = vertex(verts, first + corners[1]);
    let vc = vertex(verts, first + corners[2]);
    let a = minus23(va, x);
    let ab2 = minus23(vb, va);
    let ac2 = minus23(vc, va);
    let closest = closest_to_origin(rounded(a), rounded(minus23(vb, x)), rounded(minus23(vc, x)));
    let ab = rounded(ab2);
    let ac = rounded(ac2);
    let rank = select(closest.feature == 0u32, 0u32, select(closest.feature < 4u32, 1u32, 2u32));
    let mut nx = 0.0f32;
    let mut ny = 0.0f32;
    let mut nz = 0.0f32;
    let mut distance = 0.0f32;
    let mut delta = (0.0f32 - 1.0e30f32).runtime();
    let about = plus(rounded(a), plus(scaled(ab, closest.s), scaled(ac, closest.t)));
    let open = r + range + 1.0e-6f32 * (length(rounded(a)) + length(ab) + length(ac));
    if dot(about, about) <= open * open {
        let point = along2(along2(a, ab2, closest.s, fused), ac2, closest.t, fused);
        // Two directions across the normal of the feature; along them the point may still be off.
        let on_bc = closest.feature == 2u32;
        let on_ca = closest.feature == 3u32;
        let bc = minus(ac, ab);
        let edge = V3 {
            x: select(on_bc, bc.x, select(on_ca, ac.x, ab.x)),
            y: select(on_bc, bc.y, select(on_ca, ac.y, ab.y)),
            z: select(on_bc, bc.z, select(on_ca, ac.z, ab.z)),
        };
        let u = scaled(edge, 1.0f32 / length(edge));
        let across = minus(ac, scaled(u, dot(ac, u)));
        let w = scaled(across, 1.0f32 / f32::max(length(across), 1.0e-30f32));
        let p = rounded(point);
        let off_u = select(rank < 2u32, dot(p, u), 0.0f32);
        let off_w = select(rank == 0u32, dot(p, w), 0.0f32);
        let settled = Two3 {
            x: less(point.x, off_u * u.x, off_w * w.x),
            y: less(point.y, off_u * u.y, off_w * w.y),
            z: less(point.z, off_u * u.z, off_w * w.z),
        };
        let g = gap(settled, sum(r, 0.0f32), fused);
        nx = g.n.x;
        ny = g.n.y;
        nz = g.n.z;
        distance = g.distance;
        delta = g.delta;
    }
    Facing { gap: Gap { n: V3 { x: nx, y: ny, z: nz }, distance, delta }, rank }
}

#[cube]
fn less(a: Two, b: f32, c: f32) -> Two {
    minus2(minus2(a, sum(b, 0.0f32)), sum(c, 0.0f32))
}

/// Stops the world for an overlap of particle `id` above the limit.
#[cube]
pub fn too_deep(w: u32, k: u32, id: u32, flags: &mut Array<Atomic<u32>>) {
    let f = w * flag::WORDS;
    flags[(f + flag::HALT) as usize].fetch_max(halt::OVERLAP);
    flags[(f + flag::WHO) as usize].fetch_min(id);
    flags[(f + flag::STALE) as usize].fetch_min(k);
}

/// Where a particle is in the frame of a mesh, or from the origin of a plane or shell.
#[cube]
fn in_frame(
    worlds: &Array<u32>,
    c: u32,
    bounds: &Array<u32>,
    bt: u32,
    poses: &Array<u32>,
    at: u32,
    p: Spot,
    image: u32,
    #[comptime] s: Signature,
) -> Two3 {
    let x = from_origin(worlds, c, poses, at, p, image, comptime!(s.fused), comptime!(s.orthogonal));
    let mut xh = x.x.h;
    let mut xl = x.x.l;
    let mut yh = x.y.h;
    let mut yl = x.y.l;
    let mut zh = x.z.h;
    let mut zl = x.z.l;
    if parts_of(bounds, bt, s) == 0u32 && bounds[(bt + boundary::TRIANGLES) as usize] != NONE {
        let body = into_body(poses, at, x, comptime!(s.fused));
        xh = body.x.h;
        xl = body.x.l;
        yh = body.y.h;
        yl = body.y.l;
        zh = body.z.h;
        zl = body.z.l;
    }
    Two3 { x: Two { h: xh, l: xl }, y: Two { h: yh, l: yl }, z: Two { h: zh, l: zl } }
}

/// Parts of a shell; 0 of other boundaries.
#[cube]
fn parts_of(bounds: &Array<u32>, bt: u32, #[comptime] s: Signature) -> u32 {
    if comptime!(s.rounds) { bounds[(bt + boundary::PARTS) as usize] } else { 0u32.runtime() }
}

/// The point of a facet closest to a sphere of radius `r` at the place `x` of [`in_frame`], with the normal in the world.
// Variables of a kernel begin with a value, read or not.
#[allow(unused_assignments)]
#[cube]
fn faces(
    bounds: &Array<u32>,
    bt: u32,
    poses: &Array<u32>,
    at: u32,
    tris: &Array<U4>,
    verts: &Array<F4>,
    triangle: u32,
    x: Two3,
    r: f32,
    range: f32,
    #[comptime] s: Signature,
) -> Facing {
    let triangles = bounds[(bt + boundary::TRIANGLES) as usize];
    let mut ux = 0.0f32;
    let mut uy = 0.0f32;
    let mut uz = 0.0f32;
    let mut distance = 0.0f32;
    let mut delta = (0.0f32 - 1.0e30f32).runtime();
    let mut rank = 0u32;
    if parts_of(bounds, bt, s) > 0u32 {
        let f = round_facing(bounds, bt, poses, at, triangle, x, r, comptime!(s.fused));
        ux = f.gap.n.x;
        uy = f.gap.n.y;
        uz = f.gap.n.z;
        distance = f.gap.distance;
        delta = f.gap.delta;
        rank = f.rank;
    } else if triangles == NONE {
        let h = height_above(poses, at, x, comptime!(s.fused));
        distance = f32::abs(h.h);
        let sign = select(h.h > 0.0f32, 1.0f32, 0.0f32 - 1.0f32);
        delta = minus2(sum(r, 0.0f32), Two { h: h.h * sign, l: h.l * sign }).h;
        let normal = at + pose::NORMAL;
        ux = 0.0f32 - sign * float_at(poses, normal);
        uy = 0.0f32 - sign * float_at(poses, normal + 1u32);
        uz = 0.0f32 - sign * float_at(poses, normal + 2u32);
    } else {
        let vertices = bounds[(bt + boundary::VERTICES) as usize];
        let corners = tris[(triangles + triangle) as usize];
        let f = facing(verts, corners, vertices, x, r, range, comptime!(s.fused));
        let n = into_world(poses, at, f.gap.n);
        ux = n.x;
        uy = n.y;
        uz = n.z;
        distance = f.gap.distance;
        delta = f.gap.delta;
        rank = f.rank;
    }
    Facing { gap: Gap { n: V3 { x: ux, y: uy, z: uz }, distance, delta }, rank }
}

/// What single precision knows of a particle beside a boundary.
#[derive(CubeType, Clone, Copy)]
struct Rough {
    /// Where it is in the frame of a mesh, or its height above a plane.
    x: V3,
    /// How far a facet may seem that it touches.
    open: f32,
    /// Whether the boundary is there.
    there: bool,
}

#[cube]
fn rough(
    worlds: &Array<u32>,
    c: u32,
    bounds: &Array<u32>,
    bt: u32,
    poses: &Array<u32>,
    at: u32,
    p: Spot,
    image: u32,
    reach: f32,
    #[comptime] s: Signature,
) -> Rough {
    let x = roughly(worlds, c, poses, at, p, image, comptime!(s.orthogonal));
    let body = roughly_into_body(poses, at, x);
    let mut along = body.x;
    if bounds[(bt + boundary::TRIANGLES) as usize] == NONE {
        let n = at + pose::NORMAL;
        along = float_at(poses, n) * x.x + float_at(poses, n + 1u32) * x.y + float_at(poses, n + 2u32) * x.z;
    }
    Rough {
        x: V3 { x: along, y: body.y, z: body.z },
        open: reach + ROUGH * (f32::abs(x.x) + f32::abs(x.y) + f32::abs(x.z)),
        there: poses[(at + pose::PRESENT) as usize] == 1u32,
    }
}

/// Whether a facet is worth a close look.
#[cube]
fn seems_near(
    bounds: &Array<u32>,
    bt: u32,
    tris: &Array<U4>,
    verts: &Array<F4>,
    triangle: u32,
    q: Rough,
    #[comptime] s: Signature,
) -> bool {
    let mut near = q.there;
    if q.there && parts_of(bounds, bt, s) == 0u32 {
        let triangles = bounds[(bt + boundary::TRIANGLES) as usize];
        if triangles == NONE {
            near = f32::abs(q.x.x) <= q.open;
        } else {
            let corners = tris[(triangles + triangle) as usize];
            let vertices = bounds[(bt + boundary::VERTICES) as usize];
            near = at_hand(verts, corners, vertices, q.x, q.open);
            if near {
                near = within(verts, corners, vertices, q.x, q.open);
            }
        }
    }
    near
}

/// The reach of a particle in single precision, with room for what that blurs.
#[cube]
fn rough_reach(worlds: &Array<u32>, c: u32, r: f32) -> f32 {
    let height = c + world::HEIGHT;
    let windows =
        float_at(worlds, height) + float_at(worlds, height + 1u32) + float_at(worlds, height + 2u32);
    1.001f32 * (r + float_at(worlds, c + world::RANGE)) + ROUGH * windows
}

/// Poses of a launch's step: forces that are taken after the motion meet surfaces where they are then.
fn later(s: Signature, purpose: Purpose) -> u32 {
    u32::from(s.integrator == IntegratorKind::VelocityVerlet && purpose == Purpose::Step)
}

/// How close facets are to the particles that they are listed for, told side by side before those of a particle are compared:
/// of each overlap, distance and rank, then the normal unless it is clearly far. One unit per facet.
#[cube(launch_unchecked, fast_math = quick())]
pub fn tell(
    k: u32,
    padded: u32,
    row_room: u32,
    facet_room: u32,
    world_of: &Array<u32>,
    worlds: &Array<u32>,
    states: &Array<u32>,
    flags: &Array<Atomic<u32>>,
    place: &Array<U4>,
    own: &Array<U4>,
    refs: &Array<U4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    rows: &Array<u32>,
    facets: &Array<U4>,
    told: &mut Array<F4>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) {
    let w = world_of[CUBE_POS + ((padded + row_room) / BLOCK) as usize];
    let c = w * world::WORDS;
    let st = w * status::WORDS;
    let e = u32::cast_from(ABSOLUTE_POS);
    let in_use = e - worlds[(c + world::FACETS) as usize] < states[(st + status::FACETS) as usize];
    if in_use && runs(states, flags, w, k, purpose) {
        let parity = (states[(st + status::PARITY) as usize] + k) & 1u32;
        let which = states[(st + status::LISTED) as usize];
        let now = states[(st + status::BASE) as usize] + k + comptime!(later(s, purpose));
        let facet = facets[(which * facet_room + e) as usize];
        let i = rows[(2u32 * padded + 3u32 * (which * row_room + facet[3]) + 2u32) as usize];
        let me = (parity * padded + i) as usize;
        let p = spot(place, own, refs, me, which * padded + i);
        let r = f32::reinterpret(place[me][3]);
        let bt = (worlds[(c + world::BOUNDARIES) as usize] + facet[1]) * boundary::WORDS;
        let at = bounds[(bt + boundary::POSE) as usize] + now * bounds[(bt + boundary::STRIDE) as usize];
        let about = rough(worlds, c, bounds, bt, poses, at, p, facet[2], rough_reach(worlds, c, r), s);
        let mut delta = (0.0f32 - 1.0e30f32).runtime();
        let mut distance = 0.0f32;
        let mut rank = 0u32;
        if seems_near(bounds, bt, tris, verts, facet[0], about, s) {
            let range = float_at(worlds, c + world::RANGE);
            let x = in_frame(worlds, c, bounds, bt, poses, at, p, facet[2], s);
            let f = faces(bounds, bt, poses, at, tris, verts, facet[0], x, r, range, s);
            delta = f.gap.delta;
            distance = f.gap.distance;
            rank = f.rank;
            told[(2u32 * e + 1u32) as usize] = four(f.gap.n.x, f.gap.n.y, f.gap.n.z, 0.0f32);
        }
        told[(2u32 * e) as usize] = four(delta, distance, f32::cast_from(rank), 0.0f32);
    }
}

/// The sums of the contacts of particle `i`, which has `row`, with surfaces. An overlap above the limit stops the world.
// Variables of a kernel begin with a value, read or not.
#[allow(unused_assignments)]
#[cube]
pub fn surfaces_of(
    row: u32,
    i: u32,
    k: u32,
    which: u32,
    parity: u32,
    padded: u32,
    row_room: u32,
    facet_room: u32,
    t: u32,
    world: u32,
    dt: f32,
    flags: &mut Array<Atomic<u32>>,
    worlds: &Array<u32>,
    place: &Array<U4>,
    vel: &Array<F4>,
    spin: &Array<U4>,
    own: &Array<U4>,
    refs: &Array<U4>,
    pairs: &Array<F4>,
    bounds: &Array<u32>,
    poses: &Array<u32>,
    tris: &Array<U4>,
    verts: &Array<F4>,
    rows: &Array<u32>,
    facets: &Array<U4>,
    told: &Array<F4>,
    row_count: &mut Array<u32>,
    row_mem: &mut Array<F4>,
    push: &mut Array<F4>,
    #[comptime] s: Signature,
    #[comptime] purpose: Purpose,
) -> Sums {
    let c = world * world::WORDS;
    let stops = world * flag::WORDS;
    let range = float_at(worlds, c + world::RANGE);
    let materials = worlds[(c + world::MATERIALS) as usize];
    let table = worlds[(c + world::PAIRS) as usize];
    let bound0 = worlds[(c + world::BOUNDARIES) as usize];
    let now = t + comptime!(later(s, purpose));
    let mine = which * padded + i;
    let me = (parity * padded + i) as usize;
    // What is needed seldom is loaded where it is, so that it takes no registers in between.
    let r = f32::reinterpret(place[me][3]);
    let table_row = 2u32 * padded + 3u32 * (which * row_room + row);
    let slot = rows[table_row as usize];
    let first = which * facet_room + slot;
    let entries = rows[(table_row + 1u32) as usize];
    let old_n = row_count[(parity * row_room + row) as usize];
    let old = (parity * row_room + row) * SLOTS;
    let new = ((1u32 - parity) * row_room + row) * SLOTS;

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
    let mut slots = 0u32;

    let mut nx = Array::<f32>::new(comptime!(TOUCHED as usize));
    let mut ny = Array::<f32>::new(comptime!(TOUCHED as usize));
    let mut nz = Array::<f32>::new(comptime!(TOUCHED as usize));
    let mut far = Array::<f32>::new(comptime!(TOUCHED as usize));
    let mut deep = Array::<f32>::new(comptime!(TOUCHED as usize));
    let mut rank = Array::<u32>::new(comptime!(TOUCHED as usize));
    let mut image = Array::<u32>::new(comptime!(TOUCHED as usize));

    let mut bound = Array::<u32>::new(comptime!(TOUCHED as usize));
    let mut m = 0u32;
    // Of more facets than there is room for, as around a point where many triangles meet, the first in the order below are
    // held. The others come after those, so that they change nothing if they belong to a contact that was accepted, which
    // a second look tells.
    let mut used = 0u32;
    let mut kept = 0u32;
    let reach = rough_reach(worlds, c, r);
    let mut wanted: u32 = 1u32;
    let mut looks: u32 = 0u32;
    while looks < wanted {
        let mut done: u32 = 0u32;
        while done < entries {
            // Units of a warp that look closely wait for each other: which facets are worth it is told beforehand.
            let mut close = 0u32;
            let mut of = NONE.runtime();
            let mut through = NONE.runtime();
            let mut xh = 0.0f32;
            let mut yh = 0.0f32;
            let mut zh = 0.0f32;
            let mut open = 0.0f32;
            let mut there = false;
            for q in 0..min(entries - done, CHUNK) {
                let mut near = false;
                if comptime!(s.told) {
                    near = told[(2u32 * (slot + done + q)) as usize][0] > 0.0f32 - range;
                } else {
                    let facet = facets[(first + done + q) as usize];
                    let bt = (bound0 + facet[1]) * boundary::WORDS;
                    if facet[1] != of || facet[2] != through {
                        of = facet[1];
                        through = facet[2];
                        let at = bounds[(bt + boundary::POSE) as usize]
                            + now * bounds[(bt + boundary::STRIDE) as usize];
                        let p = spot(place, own, refs, me, mine);
                        let about = rough(worlds, c, bounds, bt, poses, at, p, through, reach, s);
                        xh = about.x.x;
                        yh = about.x.y;
                        zh = about.x.z;
                        open = about.open;
                        there = about.there;
                    }
                    let about = Rough { x: V3 { x: xh, y: yh, z: zh }, open, there };
                    near = seems_near(bounds, bt, tris, verts, facet[0], about, s);
                }
                close |= select(near, 1u32 << q, 0u32);
            }
            // Facets of a boundary stand together: where the particle is, in the frame that it wants, is found once.
            of = NONE.runtime();
            let mut xl = 0.0f32;
            let mut yl = 0.0f32;
            let mut zl = 0.0f32;
            for _look in 0..close.count_ones() {
                let e = done + close.find_first_set() - 1u32;
                close &= close - 1u32;
                let facet = facets[(first + e) as usize];
                let b = facet[1];
                let seen = facet[2];
                let mut ux = 0.0f32;
                let mut uy = 0.0f32;
                let mut uz = 0.0f32;
                let mut size = 0.0f32;
                let mut delta = (0.0f32 - 1.0e30f32).runtime();
                let mut order = 0u32;
                if comptime!(s.told) {
                    let at = (2u32 * (slot + e)) as usize;
                    let (how, n) = (told[at], told[at + 1usize]);
                    ux = n[0];
                    uy = n[1];
                    uz = n[2];
                    delta = how[0];
                    size = how[1];
                    order = u32::cast_from(how[2]);
                } else {
                    let bt = (bound0 + b) * boundary::WORDS;
                    let at = bounds[(bt + boundary::POSE) as usize]
                        + now * bounds[(bt + boundary::STRIDE) as usize];
                    if b != of || seen != through {
                        of = b;
                        through = seen;
                        let p = spot(place, own, refs, me, mine);
                        let x = in_frame(worlds, c, bounds, bt, poses, at, p, seen, s);
                        xh = x.x.h;
                        xl = x.x.l;
                        yh = x.y.h;
                        yl = x.y.l;
                        zh = x.z.h;
                        zl = x.z.l;
                    }
                    let x =
                        Two3 { x: Two { h: xh, l: xl }, y: Two { h: yh, l: yl }, z: Two { h: zh, l: zl } };
                    let f = faces(bounds, bt, poses, at, tris, verts, facet[0], x, r, range, s);
                    ux = f.gap.n.x;
                    uy = f.gap.n.y;
                    uz = f.gap.n.z;
                    size = f.gap.distance;
                    delta = f.gap.delta;
                    order = f.rank;
                }
                if delta > 0.0f32 - range {
                    if looks == 1u32 {
                        let mut shadowed = false;
                        for q in 0..m {
                            let cosine = nx[q as usize] * ux + ny[q as usize] * uy + nz[q as usize] * uz;
                            let height = far[q as usize] - size * cosine;
                            let accepted = (kept >> q) & 1u32 == 1u32 && bound[q as usize] == b;
                            shadowed =
                                shadowed || (accepted && height <= f32::max(deep[q as usize], 1.0e-6f32 * r));
                        }
                        if !shadowed {
                            flags[(stops + flag::HALT) as usize].fetch_max(halt::CONTACTS);
                            flags[(stops + flag::WHO) as usize]
                                .fetch_min(refs[(2u32 * mine + 1u32) as usize][3]);
                        }
                    } else {
                        let mut to = m;
                        if m < TOUCHED {
                            m += 1u32;
                        } else {
                            // The last in the order below makes room, if it is not this one.
                            wanted = 2u32;
                            let mut last_rank = order;
                            let mut last_far = size;
                            for q in 0..m {
                                let higher = rank[q as usize] > last_rank;
                                let farther = rank[q as usize] == last_rank && far[q as usize] > last_far;
                                if higher || farther {
                                    to = q;
                                    last_rank = rank[q as usize];
                                    last_far = far[q as usize];
                                }
                            }
                        }
                        if to < TOUCHED {
                            nx[to as usize] = ux;
                            ny[to as usize] = uy;
                            nz[to as usize] = uz;
                            far[to as usize] = size;
                            deep[to as usize] = delta;
                            rank[to as usize] = order;
                            image[to as usize] = seen;
                            bound[to as usize] = b;
                        }
                    }
                }
            }
            done += CHUNK;
        }
        if looks == 0u32 {
            // Face beats edge beats vertex, then the closer; what lies on or below the plane of an accepted
            // contact belongs to it.
            let mut waiting = (1u32 << m) - 1u32;
            // Counted loops only: the optimiser of CubeCL 0.10 turns nested `while` loops over the bits of one word
            // into loops that do not end.
            for _round in 0..m {
                let mut best = 0u32;
                let mut best_rank = 3u32;
                let mut best_far = 0.0f32;
                for q in 0..m {
                    let open = (waiting >> q) & 1u32 == 1u32;
                    let lower = rank[q as usize] < best_rank;
                    let closer = rank[q as usize] == best_rank && far[q as usize] < best_far;
                    if open && (lower || closer) {
                        best = q;
                        best_rank = rank[q as usize];
                        best_far = far[q as usize];
                    }
                }
                waiting &= !(1u32 << best);
                let b = bound[best as usize];
                let bt = (bound0 + b) * boundary::WORDS;
                let at =
                    bounds[(bt + boundary::POSE) as usize] + now * bounds[(bt + boundary::STRIDE) as usize];
                let n = V3 { x: nx[best as usize], y: ny[best as usize], z: nz[best as usize] };
                let distance = far[best as usize];
                let mut shadowed = false;
                for q in 0..m {
                    let accepted = (kept >> q) & 1u32 == 1u32 && bound[q as usize] == b;
                    let cosine = nx[q as usize] * n.x + ny[q as usize] * n.y + nz[q as usize] * n.z;
                    let height = far[q as usize] - distance * cosine;
                    shadowed = shadowed || (accepted && height <= f32::max(deep[q as usize], 1.0e-6f32 * r));
                }
                if !shadowed {
                    kept |= 1u32 << best;
                    let (moving, turn) = (vel[me], spin[me]);
                    // What this contact remembers: that of the nearest normal of the step before.
                    let mut kin = NONE.runtime();
                    let mut closest = 0.5f32;
                    for q in 0..old_n {
                        let before = row_mem[(comptime!(s.row_quads()) * (old + q)) as usize];
                        let cosine = before[0] * n.x + before[1] * n.y + before[2] * n.z;
                        let mine = u32::cast_from(before[3]) == b && (used >> q) & 1u32 == 0u32;
                        if mine && cosine > closest {
                            closest = cosine;
                            kin = q;
                        }
                    }
                    let mut sx = 0.0f32;
                    let mut sy = 0.0f32;
                    let mut sz = 0.0f32;
                    let mut slip = 0.0f32;
                    if kin != NONE {
                        used |= 1u32 << kin;
                        if comptime!(s.quads() > 0) {
                            let h = row_mem[(comptime!(s.row_quads()) * (old + kin) + 1u32) as usize];
                            sx = h[0];
                            sy = h[1];
                            sz = h[2];
                            slip = h[3];
                        }
                    }
                    // Nobody reads what stands in where there is nothing more.
                    let next = if comptime!(s.quads() > 1) {
                        row_mem[(comptime!(s.row_quads()) * (old + select(kin == NONE, 0u32, kin)) + 2u32)
                            as usize]
                    } else {
                        moving
                    };
                    let last = if comptime!(s.quads() > 2) {
                        row_mem[(comptime!(s.row_quads()) * (old + select(kin == NONE, 0u32, kin)) + 3u32)
                            as usize]
                    } else {
                        moving
                    };
                    let known = if comptime!(s.quads() > 1) { kin != NONE } else { true.runtime() };
                    let delta = deep[best as usize];
                    let p = spot(place, own, refs, me, mine);
                    let x = rounded(from_origin(
                        worlds,
                        c,
                        poses,
                        at,
                        p,
                        image[best as usize],
                        comptime!(s.fused),
                        comptime!(s.orthogonal),
                    ));
                    let arm = plus(x, scaled(n, distance));
                    let u = at + pose::VELOCITY;
                    let turning = V3 {
                        x: float_at(poses, u + 3u32),
                        y: float_at(poses, u + 4u32),
                        z: float_at(poses, u + 5u32),
                    };
                    let drift = V3 {
                        x: float_at(poses, u),
                        y: float_at(poses, u + 1u32),
                        z: float_at(poses, u + 2u32),
                    };
                    let v_b = plus(drift, cross(turning, arm));
                    let partner = bounds[(bt + boundary::MATERIAL) as usize];
                    let curvature = 1.0f32 / r;
                    let f = interact(
                        Meeting {
                            n,
                            delta,
                            r_eff: r,
                            diameter: 2.0f32 * r,
                            r_a: r,
                            r_b: 0.0f32,
                            arm_a: distance,
                            arm_b: 0.0f32,
                            im_a: moving[3],
                            im_b: 0.0f32,
                            ii_a: inverse_inertia(moving[3], curvature),
                            ii_b: 0.0f32,
                            v_a: first3(moving),
                            v_b,
                            w_a: bits3(turn),
                            w_b: turning,
                            memory: recalled(
                                Floats { x: sx, y: sy, z: sz, w: slip, second: next, third: last, known },
                                comptime!(s.laws.layout),
                            ),
                        },
                        pairs,
                        table + turn[3] * materials + partner,
                        dt,
                        comptime!(s.laws),
                        false,
                        false,
                    );
                    fx += f.force.x;
                    fy += f.force.y;
                    fz += f.force.z;
                    tx += f.torque_a.x;
                    ty += f.torque_a.y;
                    tz += f.torque_a.z;
                    worst = f32::max(worst, delta * curvature);
                    if comptime!(s.ledger || purpose == Purpose::Observe) {
                        let around = scaled(cross(n, f.dash), distance);
                        dx += f.dash.x;
                        dy += f.dash.y;
                        dz += f.dash.z;
                        gx += around.x;
                        gy += around.y;
                        gz += around.z;
                        rx += f.roll_a.x;
                        ry += f.roll_a.y;
                        rz += f.roll_a.z;
                        energy_normal += f.energy_normal;
                        energy_tangential += f.energy_tangential;
                        energy_before += f.energy_before;
                        friction_loss += f.friction_loss;
                        dash_power += f.dash_power;
                        roll_power += f.roll_power;
                        work += dot(f.force, v_b) - dot(f.torque_b, turning);
                    }
                    if slots < SLOTS {
                        if comptime!(purpose == Purpose::Step) {
                            let slot = new + slots;
                            let at = comptime!(s.row_quads()) * slot;
                            row_mem[at as usize] = four(n.x, n.y, n.z, f32::cast_from(b));
                            if comptime!(s.quads() > 0) {
                                row_mem[(at + 1u32) as usize] =
                                    packed(f.memory, comptime!(s.laws.layout), 0usize);
                            }
                            if comptime!(s.quads() > 1) {
                                row_mem[(at + 2u32) as usize] =
                                    packed(f.memory, comptime!(s.laws.layout), 1usize);
                            }
                            if comptime!(s.quads() > 2) {
                                row_mem[(at + 3u32) as usize] =
                                    packed(f.memory, comptime!(s.laws.layout), 2usize);
                            }
                            let surface = bounds[(bt + boundary::SURFACE) as usize];
                            let named = select(surface == NONE, 0.0f32, f32::cast_from(surface + 1u32));
                            let on = scaled(f.force, 0.0f32 - 1.0f32);
                            let torque = plus(cross(arm, on), f.torque_b);
                            let out = (row * SLOTS + slots) * 2u32;
                            push[out as usize] = four(on.x, on.y, on.z, named);
                            push[(out + 1u32) as usize] = four(torque.x, torque.y, torque.z, 0.0f32);
                        }
                    } else {
                        flags[(stops + flag::HALT) as usize].fetch_max(halt::CONTACTS);
                        flags[(stops + flag::WHO) as usize].fetch_min(refs[(2u32 * mine + 1u32) as usize][3]);
                    }
                    slots += 1u32;
                }
            }
        }
        looks += 1u32;
    }
    if comptime!(purpose == Purpose::Step) {
        row_count[((1u32 - parity) * row_room + row) as usize] = min(slots, SLOTS);
        if worst > float_at(worlds, c + world::OVERLAP) {
            too_deep(world, k, refs[(2u32 * mine + 1u32) as usize][3], flags);
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
        contacts: 0u32,
        touches: slots,
        partners: 0.0f32,
    }
}
