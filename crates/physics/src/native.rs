//! The native stand-in for CubeCL's `select`.

/// `a` if `condition`, else `b`, without a branch where the compiler can.
#[inline(always)]
pub fn select<T>(condition: bool, a: T, b: T) -> T {
    if condition { a } else { b }
}
