//! Contact laws, materials, integrators and geometry of the glebe DEM engine.
//!
//! No I/O, no thread, no allocation in laws, no device but the optional expansion for CubeCL.

mod material;
mod model;

pub use material::*;
pub use model::*;

/// The slots that laws sit in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// Normal force.
    Normal,
    /// Tangential force.
    Tangential,
    /// Rolling torque.
    Rolling,
    /// Cohesive force.
    Cohesion,
}

/// Every registered law of a slot, in the order of the registry.
pub fn laws(_slot: Slot) -> &'static [LawInfo] {
    &[]
}
