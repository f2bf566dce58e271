//! What a case is, and what it finds.

use std::collections::BTreeMap;

use glebe_engine::backend::Unavailable;
use glebe_engine::batch::Status;
use glebe_engine::{BytesError, SetupError};
use glebe_io::checkpoint::CheckpointError;
use glebe_study::calibrate::StudyError;
use serde::Serialize;

use super::trial::Trial;

/// A row of the table of cases.
pub struct Case {
    /// Short id, as in `A1`.
    pub id: &'static str,
    /// Name, in lower case with hyphens.
    pub name: &'static str,
    /// What it shows, in a line.
    pub shows: &'static str,
    /// Where the case and its expected outcome come from.
    pub source: &'static str,
    pub(super) run: fn(Trial<'_>) -> Result<Findings, CaseError>,
}

/// Why a case has no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaseError {
    /// The scene is wrong; each mistake with its place.
    #[error("its scene is wrong:\n{0}")]
    Scene(String),
    /// The engine refuses a world.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The device cannot run a world.
    #[error(transparent)]
    Device(#[from] Unavailable),
    /// A world was stopped.
    #[error("`{title}` {how}")]
    Stopped {
        /// The world.
        title: String,
        /// How it stands.
        how: String,
    },
    /// A checkpoint could not be written or read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The bytes of a state are none.
    #[error(transparent)]
    Bytes(#[from] BytesError),
    /// A study could not be run.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// A folder for checkpoints could not be made or removed.
    #[error("{0}")]
    Io(#[from] std::io::Error),
}

impl CaseError {
    pub(super) fn stopped(title: &str, status: &Status) -> Self {
        let how = match status {
            Status::Failed(failure) => format!("was stopped {failure}"),
            other => format!("is {other:?} where it should be done"),
        };
        Self::Stopped { title: title.to_owned(), how }
    }
}

/// A number with what it should be: it passes if `|value - reference| ≤ tolerance`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Metric {
    /// As found; null in JSON if it is not a finite number.
    pub value: f64,
    /// As expected.
    pub reference: f64,
    /// Largest difference allowed.
    pub tolerance: f64,
}

impl Metric {
    /// Whether the value is as expected; never for one that is not a number.
    pub fn passed(&self) -> bool {
        (self.value - self.reference).abs() <= self.tolerance
    }
}

/// What a case finds.
#[derive(Clone, Debug, Default)]
pub struct Findings {
    /// Numbers that must be right, by name.
    pub metrics: BTreeMap<String, Metric>,
    /// Numbers that nothing is asked of, by name.
    pub reported: BTreeMap<String, f64>,
    /// Figures, each with the end of its file name, as SVG.
    pub figures: Vec<(&'static str, String)>,
}

impl Findings {
    /// Asks that `value` is within `tolerance` of `reference`.
    pub(super) fn near(&mut self, name: impl Into<String>, value: f64, reference: f64, tolerance: f64) {
        self.metrics.insert(name.into(), Metric { value, reference, tolerance });
    }

    /// Asks that `value` is from `low` to `high`.
    pub(super) fn between(&mut self, name: impl Into<String>, value: f64, low: f64, high: f64) {
        self.near(name, value, 0.5 * (low + high), 0.5 * (high - low));
    }

    /// Asks that `value` is 0.
    pub(super) fn zero(&mut self, name: impl Into<String>, value: f64) {
        self.near(name, value, 0.0, 0.0);
    }

    /// Reports `value` without asking anything of it.
    pub(super) fn report(&mut self, name: impl Into<String>, value: f64) {
        self.reported.insert(name.into(), value);
    }
}

/// A case that has run.
pub struct Outcome {
    /// The case.
    pub case: &'static Case,
    /// What it found.
    pub findings: Findings,
    /// Wall time \[s\].
    pub seconds: f64,
}

impl Outcome {
    /// Whether every metric is as expected.
    pub fn passed(&self) -> bool {
        self.findings.metrics.values().all(Metric::passed)
    }
}
