//! Scene and study files, meshes, particle files, writers and checkpoints of the glebe DEM engine.

#![forbid(unsafe_code)]

pub mod checkpoint;
mod input;
pub mod mesh;
pub mod output;
pub mod particles;
mod ply;
pub mod poses;
pub mod scene;
mod sheet;
pub mod study;
pub mod tool;
pub mod units;
mod vtk;

pub use input::free_memory;
pub use sheet::SheetError;
