//! What a run leaves on disk, written so that a crash leaves no half file.
//!
//! Writers take plain columns (slices) in SI units; they know nothing of the engine.

mod atomic;
mod dir;
mod frames;
pub mod pvd;
pub mod series;
pub mod summary;
pub mod vtp;

pub use atomic::{OutputError, write_atomic};
pub use dir::{OutputDir, SVG_MARK};
pub use frames::FrameWriter;
