//! Plots of what a run left on disk: SVG text from plain columns.
//!
//! [`Plot`] draws lines, dashes and points on linear or logarithmic axes; [`draught_force`], [`energies`]
//! and [`Profile::plot`] are the plots that a tillage run comes with.

#![forbid(unsafe_code)]

mod axis;
mod frame;
mod furrow;
mod plot;
mod plots;
mod rose;
mod svg;

pub use axis::{Axis, Scale};
pub use furrow::{FurrowView, Profile, furrow_profile};
pub use plot::{Band, Mark, Plot, Series, Style, Window};
pub use plots::{Draught, draught_force, energies};
pub use rose::rose;
