//! Roots that the machine has no instruction for.

use crate::cube::*;

/// ∛x for x ≥ 0, from square roots and four of Newton's steps: the same on every platform.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn cube_root(x: f32) -> f32 {
    // x^(1/4 + 1/16 + 1/64 + 1/256): within 5 % of the root for all that contacts hold.
    let a = root(root(x));
    let b = root(root(a));
    let c = root(root(b));
    let d = root(root(c));
    let y = nearer(a * b * c * d, x);
    let y = nearer(y, x);
    let y = nearer(y, x);
    nearer(y, x)
}

/// One of Newton's steps towards ∛x.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn nearer(y: f32, x: f32) -> f32 {
    y - (y - x / f32::max(y * y, 1.0e-30f32)) * (1.0f32 / 3.0f32)
}
