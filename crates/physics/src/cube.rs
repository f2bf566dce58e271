//! What the kernel functions are written with: plain Rust, or CubeCL's prelude when they are expanded
//! for a device.

#[cfg(feature = "gpu")]
pub use cubecl::prelude::*;

#[cfg(not(feature = "gpu"))]
pub use crate::native::select;
