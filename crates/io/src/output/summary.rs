//! `summary.json`: what a run was, how it went and what it measured. The names are fixed, for scripts.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::atomic::{OutputError, write_atomic};

/// The content of `summary.json`. Numbers that are not finite are written as `null`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Title of the scene.
    #[serde(default)]
    pub title: String,
    /// How the run ended.
    pub status: Status,
    /// Why it failed or was interrupted; absent if it is done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What made these results.
    pub provenance: Provenance,
    /// The device that computed, as `glebe devices` names it.
    pub device: String,
    /// Hex digest of the complete final state: equal runs have equal hashes. Empty if the state was lost with the
    /// device.
    pub state_hash: String,
    /// What became of the particles.
    pub particles: Particles,
    /// The stages that ran, in order.
    pub stages: Vec<Stage>,
    /// How fast it was.
    pub performance: Performance,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What was done that the scene does not say, such as taking a settled bed from an earlier run.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Status {
    /// All stages ended.
    #[default]
    Done,
    /// A guard stopped it.
    Failed,
    /// It is a world of a study that cannot be set up.
    Refused,
    /// The user stopped it; `--resume` continues.
    Interrupted,
}

/// What made the results.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// glebe's version.
    pub version: String,
    /// The commit it was built from, if known.
    pub commit: Option<String>,
    /// Hex digest of the scene with everything that it refers to.
    pub scene_hash: String,
    /// Seed of everything random.
    pub seed: u64,
}

/// What became of the particles.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Particles {
    /// Number at the end.
    pub count: u64,
    /// Those that left through an open side, in order of time.
    pub lost: Vec<Lost>,
    /// Number removed on purpose (trimmed).
    #[serde(default)]
    pub removed: u64,
}

/// A particle that left the domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lost {
    /// Its persistent id.
    pub id: u32,
    /// When it was found outside \[s\].
    #[serde(with = "nullable")]
    pub time: f64,
    /// Where it was then \[m\].
    pub position: [f64; 3],
    /// The side it left through: `-x`, `+x`, … `+z`.
    pub side: String,
}

/// A stage that ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// What ended it.
    pub ended_by: String,
    /// Simulated time at its beginning \[s\].
    pub start: f64,
    /// Simulated time that it took \[s\].
    pub duration: f64,
    /// What it measured, by name.
    pub measures: BTreeMap<String, Measure>,
}

/// A measured quantity, in SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// Mean of the samples; not a number without samples.
    #[serde(with = "nullable")]
    pub mean: f64,
    /// Standard deviation of the samples.
    #[serde(with = "nullable")]
    pub std: f64,
    /// Number of samples.
    pub n: u64,
}

/// How fast a run was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Performance {
    /// Particles × steps per second of wall time, everything included.
    #[serde(with = "nullable")]
    pub particle_steps_per_second: f64,
    /// Wall time \[s\].
    pub wall_s: f64,
    /// Steps computed.
    #[serde(default)]
    pub steps: u64,
    /// Wall time by phase \[s\].
    pub phases: BTreeMap<String, f64>,
}

impl Summary {
    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        write_atomic(path, |out| {
            serde_json::to_writer_pretty(&mut *out, self)?;
            out.write_all(b"\n")
        })
    }

    /// Reads the file.
    ///
    /// # Errors
    /// [`OutputError::Malformed`] with line and column, [`OutputError::Io`].
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        let text = std::fs::read(path).map_err(|e| OutputError::io(path, "read this summary", e))?;
        serde_json::from_slice(&text).map_err(|e| OutputError::Malformed {
            path: path.to_owned(),
            what: format!("is not a summary that this version of glebe wrote: {e}"),
        })
    }
}

/// JSON has no NaN: serde_json writes `null`, and this reads it back.
mod nullable {
    use serde::{Deserialize, Deserializer, Serializer};

    #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(*value)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
    }
}
