//! Worlds and batches, neighbour search, boundaries, stages and backends of the glebe DEM engine.
//!
//! Knows no file format.

pub mod backend;
pub mod batch;
pub mod cell;
pub mod classes;
pub mod exchange;
pub mod field;
pub mod frustum;
pub mod generate;
pub mod lattice;
pub mod measure;
pub mod poses;
pub mod spec;
pub mod state;
pub mod surface;
pub mod wear;

mod bonds;
mod bytes;
mod curve;
mod failure;
mod lacey;
mod setup;
mod speed;
mod survey;

pub use bytes::BytesError;
pub use failure::{Failure, SetupError};
pub use setup::{Boundary, BoundaryShape, Constants, StepLimits, prepare};
