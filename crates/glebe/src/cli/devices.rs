//! `glebe devices`: what can compute, and what cannot.

use serde_json::json;

use super::{Problem, Ui};

/// Shows what hardware can be used
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe devices
  glebe devices --json")]
pub(super) struct Args {}

const NO_GPU: &str = "this build of glebe has no GPU backend";

/// Where a run computes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Device {
    /// What is best on this machine.
    Auto,
    Cpu,
    /// A GPU, by its number if one is named.
    Gpu(Option<u32>),
}

impl std::str::FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu(None)),
            _ => text
                .strip_prefix("gpu:")
                .and_then(|n| n.parse().ok())
                .map(|n| Self::Gpu(Some(n)))
                .ok_or_else(|| "choose auto, cpu, gpu or gpu:NUMBER".to_owned()),
        }
    }
}

impl Device {
    /// Chooses the CPU, the only backend of this build, or says why not.
    pub(super) fn choose(&self, ui: &Ui) -> Result<(), Problem> {
        match self {
            Self::Cpu => Ok(()),
            Self::Auto => {
                ui.note(&format!("device: {} ({NO_GPU})", crate::run::device()));
                Ok(())
            }
            Self::Gpu(_) => Err(Problem::Input(format!(
                "--device gpu cannot be used: {NO_GPU}; give --device cpu, or auto to take what there is"
            ))),
        }
    }
}

pub(super) fn run(ui: &Ui) {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let arch = std::env::consts::ARCH;
    let value = json!({
        "devices": [{ "name": "cpu", "kind": "cpu", "architecture": arch, "threads": cores, "usable": true }],
        "auto": "cpu",
        "unusable": [{ "name": "gpu", "reason": NO_GPU }],
    });
    let text = format!("cpu   {arch}, {cores} threads   used by --device auto\ngpu   not usable: {NO_GPU}");
    ui.result(&value, &text);
}
