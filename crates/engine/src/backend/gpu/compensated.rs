//! Sums and products in pairs of f32: what distances are taken in, since kernels know no f64.
//!
//! A [`Two`] is the unevaluated sum of two f32, good for about 48 bits. The algorithms are Dekker's (1971).
//! The error of a product comes from one fused multiply-add where the device has it (`fused`); `fma` may be
//! a rounded product and a sum elsewhere, as WGSL allows, and factors are split by their bits then.

use cubecl::prelude::*;
use glebe_physics::kernel::vector::V3;

/// An unevaluated sum `h + l`, |l| ≤ ulp(h)/2.
#[derive(CubeType, Clone, Copy)]
pub struct Two {
    /// Leading part.
    pub h: f32,
    /// Rest.
    pub l: f32,
}

/// A vector of such sums.
#[derive(CubeType, Clone, Copy)]
pub struct Two3 {
    /// First component.
    pub x: Two,
    /// Second component.
    pub y: Two,
    /// Third component.
    pub z: Two,
}

/// `a + b` that no compiler can look into. Drivers are free to simplify `(a + b) - a`, and Mesa does; a factor
/// of one that is known at run time only, the depth of the grid, keeps them from it, and from taking the sum apart.
#[cube]
fn added(a: f32, b: f32) -> f32 {
    fma(a, f32::cast_from(CUBE_COUNT_Z), b)
}

/// `a b`, rounded. A compiler that takes it for exact and fuses it into a later sum (nvcc does) would have that sum lose
/// what rounding took; a zero that is known at run time only keeps it from that.
#[cube]
fn multiplied(a: f32, b: f32) -> f32 {
    fma(a, b, f32::cast_from(CUBE_COUNT_Z - 1))
}

/// `a + b`, exactly.
#[cube]
pub fn sum(a: f32, b: f32) -> Two {
    let h = added(a, b);
    let t = added(h, -a);
    Two { h, l: (a - (h - t)) + (b - t) }
}

/// The leading half of a number's digits.
#[cube]
fn leading(a: f32) -> f32 {
    f32::reinterpret(u32::reinterpret(a) & 0xffff_f000u32)
}

/// `a b`, exactly.
#[cube]
pub fn product(a: f32, b: f32, #[comptime] fused: bool) -> Two {
    let h = multiplied(a, b);
    let l = if comptime!(fused) {
        fma(a, b, -h)
    } else {
        // Products of half-long factors are exact, so nothing changes if a compiler fuses them after all.
        let (ah, bh) = (leading(a), leading(b));
        let (al, bl) = (a - ah, b - bh);
        ((ah * bh - h) + ah * bl + al * bh) + al * bl
    };
    Two { h, l }
}

/// `h + l` brought into form, for |l| well below |h|.
#[cube]
pub fn tidy(h: f32, l: f32) -> Two {
    let s = added(h, l);
    Two { h: s, l: l - (s - h) }
}

/// `a + b`
#[cube]
pub fn plus2(a: Two, b: Two) -> Two {
    let s = sum(a.h, b.h);
    tidy(s.h, s.l + (a.l + b.l))
}

/// `a - b`
#[cube]
pub fn minus2(a: Two, b: Two) -> Two {
    let s = sum(a.h, -b.h);
    tidy(s.h, s.l + (a.l - b.l))
}

/// `a b`
#[cube]
pub fn times2(a: Two, b: Two, #[comptime] fused: bool) -> Two {
    let p = product(a.h, b.h, fused);
    tidy(p.h, p.l + (a.h * b.l + a.l * b.h))
}

/// `a b`, the rest not brought into form.
#[cube]
pub fn times2_loose(a: Two, b: Two, #[comptime] fused: bool) -> Two {
    let p = product(a.h, b.h, fused);
    Two { h: p.h, l: p.l + (a.h * b.l + a.l * b.h) }
}

/// `a s` with a plain factor.
#[cube]
pub fn scaled2(a: Two, s: f32, #[comptime] fused: bool) -> Two {
    let p = product(a.h, s, fused);
    tidy(p.h, p.l + a.l * s)
}

/// `a · b`
#[cube]
pub fn dot2(a: Two3, b: Two3, #[comptime] fused: bool) -> Two {
    plus2(plus2(times2(a.x, b.x, fused), times2(a.y, b.y, fused)), times2(a.z, b.z, fused))
}

/// `a - b`
#[cube]
pub fn minus23(a: Two3, b: Two3) -> Two3 {
    Two3 { x: minus2(a.x, b.x), y: minus2(a.y, b.y), z: minus2(a.z, b.z) }
}

/// `a + s b`
#[cube]
pub fn along2(a: Two3, b: Two3, s: f32, #[comptime] fused: bool) -> Two3 {
    Two3 {
        x: plus2(a.x, scaled2(b.x, s, fused)),
        y: plus2(a.y, scaled2(b.y, s, fused)),
        z: plus2(a.z, scaled2(b.z, s, fused)),
    }
}

/// The same vector in plain f32.
#[cube]
pub fn rounded(a: Two3) -> V3 {
    V3 { x: a.x.h, y: a.y.h, z: a.z.h }
}

/// A whole number below 2³¹ in size, exactly.
#[cube]
pub fn whole(n: i32) -> Two {
    let h = f32::cast_from(n);
    Two { h, l: f32::cast_from(n - i32::cast_from(h)) }
}

/// How far two bodies are apart, whose surfaces would touch at the distance `reach`, and `d` from the first
/// to the second.
#[derive(CubeType, Clone, Copy)]
pub struct Gap {
    /// Unit vector along `d`.
    pub n: V3,
    /// `|d|`
    pub distance: f32,
    /// `reach - |d|`, with all its digits: `(reach² - d²)/(reach + |d|)`.
    pub delta: f32,
}

/// `a - b` for 0 ≤ b ≤ a, exactly.
#[cube]
fn less(a: f32, b: f32) -> Two {
    let h = added(a, -b);
    Two { h, l: (a - h) - b }
}

/// `a²`
#[cube]
fn squared(a: Two, #[comptime] fused: bool) -> Two {
    let p = product(a.h, a.h, fused);
    Two { h: p.h, l: p.l + 2.0f32 * a.h * a.l }
}

/// See [`Gap`].
#[cube]
pub fn gap(d: Two3, reach: Two, #[comptime] fused: bool) -> Gap {
    let (x, y, z) = (squared(d.x, fused), squared(d.y, fused), squared(d.z, fused));
    let reach2 = squared(reach, fused);
    let d2 = x.h + y.h + z.h;
    // Where bodies touch no square is larger than what it is taken from; elsewhere the digits do not matter.
    let a = less(reach2.h, x.h);
    let b = less(a.h, y.h);
    let c = less(b.h, z.h);
    let rests = ((a.l + b.l) + c.l) + ((reach2.l - x.l) - (y.l + z.l));
    let inverse = f32::inverse_sqrt(f32::max(d2, 1.0e-37f32));
    let distance = d2 * inverse;
    Gap {
        n: V3 { x: d.x.h * inverse, y: d.y.h * inverse, z: d.z.h * inverse },
        distance,
        delta: (c.h + rests) / (reach.h + distance),
    }
}
