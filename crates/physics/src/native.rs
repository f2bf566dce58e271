//! The native stand-ins for what kernel functions are written with.

/// `a` if `condition`, else `b`, without a branch where the compiler can.
#[inline(always)]
pub fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}

/// √x for x ≥ 0.
#[inline(always)]
pub fn root(x: f64) -> f64 {
    x.sqrt()
}

/// 1/√x, of 1e-37 for what is below that.
#[inline(always)]
pub fn inverse_root(x: f64) -> f64 {
    1.0 / x.max(1e-37).sqrt()
}
