//! Many worlds of the glebe DEM engine.
//!
//! [`drive`] takes the worlds of a batch through their stages: a single run is a batch of one. It keeps settled
//! beds, so that worlds which share their first stages settle once. [`sample`] chooses the worlds of a study, [`sweep`]
//! runs them, [`fit`] draws curves through what they measured.

mod beds;
mod digest;
pub mod drive;
pub mod fit;
pub mod sample;
pub mod sweep;

pub use beds::default_folder as default_bed_folder;
pub use digest::scene_hash;
