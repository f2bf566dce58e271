//! placeholder

pub mod checkpoint;
pub mod mesh;
pub mod output;
pub mod particles;
pub mod scene;
pub mod tool;
pub mod units;
