//! Worlds and batches, neighbour search, boundaries, stages and backends of the glebe DEM engine.
//!
//! Knows no file format.

pub mod spec;
