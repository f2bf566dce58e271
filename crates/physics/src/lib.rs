//! Contact laws, materials, integrators and geometry of the glebe DEM engine.
//!
//! No I/O, no thread, no allocation in laws, no device but the optional expansion for CubeCL.

// CubeCL's expansion is not ours to forbid it.
#![cfg_attr(not(feature = "gpu"), forbid(unsafe_code))]
// What CubeCL makes of the kernel functions carries no documentation.
#![cfg_attr(feature = "gpu", allow(missing_docs))]

mod cube;
mod damping;
mod laws;
mod material;
mod model;
mod native;
mod timestep;
#[macro_use]
mod slot;

// The kernel's prelude is CubeCL's with the feature `gpu`, and a single function without.
#[allow(unused_imports, clippy::wildcard_imports)]
pub mod kernel;
/// [`kernel`] in f64, derived from its source by `build.rs`: what the reference backend runs on.
#[allow(clippy::all, clippy::pedantic)]
pub mod kernel64 {
    include!(concat!(env!("OUT_DIR"), "/kernel64.rs"));
}

pub use damping::*;
pub use laws::*;
pub use material::*;
pub use model::*;
pub use timestep::*;
