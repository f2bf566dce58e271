//! The physics that runs once per contact and per particle, on every device.
//!
//! Plain functions on `f32`. Compiled as they are they form the CPU backend's inner loops; with the
//! feature `gpu` CubeCL expands the same source into GPU kernels. `crate::kernel64` is this source with
//! the scalar type exchanged (`build.rs`): the reference backend runs on it.
//!
//! Laws sit in four slots, each a folder: [`normal`], [`tangential`], [`rolling`], [`cohesion`]. The order
//! of evaluation is the same everywhere: [`contact`], cohesion, normal, tangential, rolling.
//!
//! Nothing here branches on data where `select` will do, so that loops over contacts vectorise, and
//! nothing calls into a maths library but for the square root: results do not depend on the platform.

pub mod bond;
pub mod cohesion;
pub mod contact;
pub mod integrate;
pub mod normal;
pub mod powers;
pub mod rolling;
pub mod tangential;
pub mod triangle;
pub mod vector;
