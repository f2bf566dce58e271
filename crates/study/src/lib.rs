//! Many worlds of the glebe DEM engine.
//!
//! [`drive`] takes the worlds of a batch through their stages: a single run is a batch of one. It keeps settled
//! beds, so that worlds which share their first stages settle once. [`sample`] chooses the worlds of a study, [`sweep`]
//! runs them, [`fit`] draws curves through what they measured. [`rve`] makes, consolidates and loads periodic samples.
//! [`search`] looks for the least cost and for distributions, [`calibrate`] finds parameters for which worlds measure what
//! was measured.
//!
//! ```no_run
//! use std::path::Path;
//! use glebe_io::study::Study;
//! use glebe_study::drive::Silent;
//! use glebe_study::sweep::{Plan, Settings, run};
//!
//! let study = Study::load(Path::new("study.toml"), &[]).map_err(|errors| format!("{errors:?}"))?;
//! let plan = Plan::new(study, || false)?.ok_or("interrupted")?;
//! let summary = run(&plan, &Settings::new("out"), &mut Silent)?;
//! println!("{} worlds done", summary.counts.done);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

mod beds;
pub mod calibrate;
mod capture;
mod digest;
pub mod drive;
mod ensemble;
pub mod fit;
pub mod rve;
pub mod sample;
pub mod search;
pub mod series;
pub mod sweep;

pub use beds::default_folder as default_bed_folder;
pub use digest::scene_hash;
