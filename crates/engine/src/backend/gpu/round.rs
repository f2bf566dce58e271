//! Cylinders and cones: where they are closest to a sphere. See `crate::frustum`.

use cubecl::prelude::*;
use glebe_physics::kernel::vector::V3;

use super::compensated::{Gap, Two, Two3, dot2, gap, minus2, minus23, product, rounded, sum, tidy, times2};
use super::layout::{boundary, float_at};
use super::surfaces::{Facing, normal_of};

/// Number `k` of the line that begins at `at`.
#[cube]
fn number(bounds: &Array<u32>, at: u32, k: u32) -> Two {
    Two { h: float_at(bounds, at + 2u32 * k), l: float_at(bounds, at + 2u32 * k + 1u32) }
}

/// `√a` for a ≥ 0: the root of the leading part, and what is missing to first order.
#[cube]
fn root2(a: Two, #[comptime] fused: bool) -> Two {
    let root = a.h * f32::inverse_sqrt(f32::max(a.h, 1.0e-37f32));
    let square = product(root, root, fused);
    let missing = (a.h - square.h) + (a.l - square.l);
    tidy(root, 0.5f32 * missing / f32::max(root, 1.0e-18f32))
}

/// A unit vector across `a`.
#[cube]
fn across(a: V3) -> V3 {
    // Across the axis of the least component.
    let (x, y, z) = (f32::abs(a.x), f32::abs(a.y), f32::abs(a.z));
    let first = x <= y && x <= z;
    let second = !first && y <= z;
    let px = select(first, 0.0f32, select(second, 0.0f32 - a.z, a.y));
    let py = select(first, a.z, select(second, 0.0f32, 0.0f32 - a.x));
    let pz = select(first, 0.0f32 - a.y, select(second, a.x, 0.0f32));
    let inverse = f32::inverse_sqrt(px * px + py * py + pz * pz);
    V3 { x: px * inverse, y: py * inverse, z: pz * inverse }
}

/// Where a part of the shell of the boundary at `bt`, whose pose is at `at`, is closest to a sphere of radius `r`, whose
/// centre is at `x` from the pose's origin; all in the world.
#[cube]
pub fn round_facing(
    bounds: &Array<u32>,
    bt: u32,
    poses: &Array<u32>,
    at: u32,
    part: u32,
    x: Two3,
    r: f32,
    #[comptime] fused: bool,
) -> Facing {
    let axis = normal_of(poses, at);
    let h = dot2(x, axis, fused);
    let away = minus23(
        x,
        Two3 { x: times2(h, axis.x, fused), y: times2(h, axis.y, fused), z: times2(h, axis.z, fused) },
    );
    let rho = root2(dot2(away, away, fused), fused);
    let side = select(part == 1u32, 0.0f32 - 1.0f32, 1.0f32);
    let (a, w) = (rounded(axis), rounded(away));
    let other = across(a);
    let inverse = 1.0f32 / f32::max(rho.h, 1.0e-18f32);
    let on_axis = rho.h < 1.0e-17f32;
    let ox = side * select(on_axis, other.x, w.x * inverse);
    let oy = side * select(on_axis, other.y, w.y * inverse);
    let oz = side * select(on_axis, other.z, w.z * inverse);

    // Of the line's number: the shell is both sides' first.
    let line = bt + boundary::LINES + boundary::LINE * select(part == 0u32, 0u32, part - 1u32);
    let dr = minus2(Two { h: side * rho.h, l: side * rho.l }, number(bounds, line, 0u32));
    let dh = minus2(h, number(bounds, line, 1u32));
    let tr = number(bounds, line, 2u32);
    let th = number(bounds, line, 3u32);
    let size = number(bounds, line, 4u32);
    let along = dr.h * tr.h + dh.h * th.h;
    let face = along >= 0.0f32 && along <= size.h;

    let height = minus2(times2(dr, th, fused), times2(dh, tr, fused));
    let sign = select(height.h > 0.0f32, 1.0f32, 0.0f32 - 1.0f32);
    let face_delta = minus2(sum(r, 0.0f32), Two { h: sign * height.h, l: sign * height.l }).h;

    let ended = select(along > 0.0f32, 1.0f32, 0.0f32);
    let end = Two { h: ended * size.h, l: ended * size.l };
    let rim = gap(
        Two3 {
            x: minus2(times2(tr, end, fused), dr),
            y: minus2(times2(th, end, fused), dh),
            z: Two { h: 0.0f32 * r, l: 0.0f32 * r },
        },
        sum(r, 0.0f32),
        fused,
    );
    let nr = select(face, 0.0f32 - sign * th.h, rim.n.x);
    let nh = select(face, sign * tr.h, rim.n.y);
    Facing {
        gap: Gap {
            n: V3 { x: ox * nr + a.x * nh, y: oy * nr + a.y * nh, z: oz * nr + a.z * nh },
            distance: select(face, sign * height.h, rim.distance),
            delta: select(face, face_delta, rim.delta),
        },
        rank: select(face, 0u32, 1u32),
    }
}
