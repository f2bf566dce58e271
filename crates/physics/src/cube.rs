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
