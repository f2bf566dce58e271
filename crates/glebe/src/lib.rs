//! glebe: a Discrete Element Method engine.
//!
//! [`engine`] runs worlds, [`physics`] holds their laws, [`io`] reads scenes and writes results, and
//! [`run`] puts the three together: a prepared world in, an output folder out.
//!
//! ```no_run
//! use std::path::Path;
//! use glebe::io::scene::Scene;
//! use glebe::run::{Settings, Silent, run};
//!
//! let path = Path::new("scene.toml");
//! let scene = Scene::load(path, &[]).map_err(|errors| format!("{errors:?}"))?;
//! let built = scene.build(Path::new(".")).map_err(|errors| format!("{errors:?}"))?;
//! let summary = run(built.world, &Settings::new("out"), &mut Silent)?;
//! println!("{}", summary.state_hash);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub use glebe_engine as engine;
pub use glebe_io as io;
pub use glebe_physics as physics;
pub use glebe_report as report;
pub use glebe_study as study;

pub mod bench;
#[doc(hidden)]
pub mod cli;
pub mod device;
pub mod run;
pub mod templates;
pub mod validate;
