//! What the kernel functions are written with: plain Rust, or CubeCL's prelude when they are expanded
//! for a device.

#[cfg(feature = "gpu")]
pub use cubecl::prelude::*;

#[cfg(not(feature = "gpu"))]
pub use crate::native::select;

/// √x for x ≥ 0; on devices through the reciprocal root, which is one instruction there, within 3 units in the last
/// place.
#[inline(always)]
pub fn root(x: f32) -> f32 {
    x.sqrt()
}

/// 1/√x, of 1e-37 for what is below that; on devices within 2 units in the last place.
#[inline(always)]
pub fn inverse_root(x: f32) -> f32 {
    1.0 / x.max(1e-37).sqrt()
}

/// What a call of [`inverse_root`](fn@inverse_root) becomes on a device.
#[cfg(feature = "gpu")]
#[allow(missing_docs)]
pub mod inverse_root {
    use cubecl::prelude::*;

    type Value = <f32 as CubeType>::ExpandType;

    pub fn expand(scope: &mut Scope, x: Value) -> Value {
        instruction::expand(scope, x)
    }

    #[cube]
    fn instruction(x: f32) -> f32 {
        f32::inverse_sqrt(f32::max(x, 1.0e-37f32))
    }
}

/// What a call of [`root`](fn@root) becomes on a device.
#[cfg(feature = "gpu")]
#[allow(missing_docs)]
pub mod root {
    use cubecl::prelude::*;

    type Value = <f32 as CubeType>::ExpandType;

    pub fn expand(scope: &mut Scope, x: Value) -> Value {
        by_reciprocal::expand(scope, x)
    }

    #[cube]
    fn by_reciprocal(x: f32) -> f32 {
        x * f32::inverse_sqrt(f32::max(x, 1.0e-37f32))
    }
}
