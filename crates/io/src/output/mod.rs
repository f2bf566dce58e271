//! What a run leaves on disk, written so that a crash leaves no half file.
//!
//! Writers take plain columns (slices) in SI units; they know nothing of the engine.

mod atomic;
pub mod columns;
mod dir;
mod frames;
mod journal;
mod lock;
pub mod pvd;
pub mod series;
pub mod summary;
mod table;
pub mod vti;
pub mod vtp;
mod xml;

pub use atomic::{OutputError, write_atomic};
pub use dir::{Existing, OutputDir, SVG_MARK, file_word};
pub use frames::{Collection, FrameWriter};
pub use journal::Journal;
pub use table::{Cell, write_table};
