//! Where a run computes: what may be asked for, what there is, and what is chosen.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use glebe_engine::Constants;
use glebe_engine::backend::{Backend, Unavailable};
use serde::Serialize;

#[cfg(feature = "gpu")]
mod accelerators;
#[cfg(not(feature = "gpu"))]
#[path = "device/no_accelerators.rs"]
mod accelerators;

/// What a user asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// A graphics processor if there is one that can run the world, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A graphics processor: the first, or by its number.
    Gpu(Option<usize>),
    /// A device that CUDA knows, by its number.
    Cuda(usize),
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (word, number) = text.split_once(':').map_or((text, None), |(word, number)| (word, Some(number)));
        match (word, number.map(str::parse)) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("gpu", None) => Ok(Self::Gpu(None)),
            ("gpu", Some(Ok(number))) => Ok(Self::Gpu(Some(number))),
            ("cuda", None) => Ok(Self::Cuda(0)),
            ("cuda", Some(Ok(number))) => Ok(Self::Cuda(number)),
            _ => {
                Err("choose auto, cpu, gpu, gpu:NUMBER or cuda:NUMBER; `glebe devices` lists them".to_owned())
            }
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(None) => f.write_str("gpu"),
            Self::Gpu(Some(number)) => write!(f, "gpu:{number}"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
        }
    }
}

/// What was chosen.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Where worlds run.
    pub backend: Backend,
    /// What the user should know of the choice.
    pub note: Option<String>,
}

/// A device that was opened before the worlds are known that it is to run.
#[derive(Clone, Debug)]
pub struct Opened {
    asked: Device,
    found: Result<Backend, Unavailable>,
}

impl Device {
    /// Opens the device, if a world of so many particles can have room on it, whatever they are.
    ///
    /// # Errors
    /// A device that is not there, or too small. With `auto` that is none: the CPU is left.
    pub fn open(self, particles: usize) -> Result<Opened, Unavailable> {
        let found = match self {
            Self::Cpu => Ok(Backend::Cpu),
            Self::Auto => accelerators::best(),
            Self::Gpu(number) => accelerators::gpu(number),
            Self::Cuda(number) => accelerators::cuda(number),
        };
        let found = found.and_then(|backend| accept(backend, backend.crowded(particles)));
        match (self, found) {
            (Self::Auto, found) => Ok(Opened { asked: self, found }),
            (_, found) => found.map(|backend| Opened { asked: self, found: Ok(backend) }),
        }
    }
}

impl Opened {
    /// The device for worlds, or why it cannot run them.
    ///
    /// # Errors
    /// A device that cannot run the worlds. `auto` takes the CPU then.
    pub fn admit(self, worlds: &[Arc<Constants>]) -> Result<Chosen, Unavailable> {
        let admitted = self.found.and_then(|backend| admit(backend, worlds).map(|()| backend));
        match (self.asked, admitted) {
            (Device::Auto, Ok(backend)) => {
                Ok(Chosen { backend, note: Some(format!("device: {}", backend.device())) })
            }
            (Device::Auto, Err(why)) => {
                let backend = Backend::Cpu;
                let note = format!("device: {} ({}; see `glebe devices`)", backend.device(), why.why);
                Ok(Chosen { backend, note: Some(note) })
            }
            (_, Ok(backend)) => Ok(Chosen { backend, note: None }),
            (_, Err(why)) => Err(why),
        }
    }
}

/// Refuses worlds that a backend cannot run together.
///
/// # Errors
/// Why it cannot.
pub fn admit(backend: Backend, worlds: &[Arc<Constants>]) -> Result<(), Unavailable> {
    accept(backend, backend.refusal(worlds)).map(|_| ())
}

fn accept(backend: Backend, refusal: Option<String>) -> Result<Backend, Unavailable> {
    match refusal {
        Some(why) => Err(Unavailable::new(&backend.device(), why, "run it with --device cpu")),
        None => Ok(backend),
    }
}

/// A device that was found.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    /// The word by which `--device` takes it.
    pub name: String,
    /// What its maker calls it.
    pub model: String,
    /// cpu, discrete, integrated, virtual, other or software.
    pub kind: &'static str,
    /// What it is reached through, with the driver.
    pub through: Option<String>,
    /// Threads of the CPU.
    pub threads: Option<usize>,
    /// Its memory, where known \[bytes\].
    pub memory_bytes: Option<u64>,
    /// Largest buffer of a kernel \[bytes\].
    pub largest_buffer_bytes: Option<u64>,
    /// Whether worlds can be run on it.
    pub usable: bool,
    /// Why not, or what speaks against it.
    pub remark: Option<String>,
}

/// Everything that was found, and what was not.
#[derive(Clone, Debug, Serialize)]
pub struct Listing {
    /// Devices.
    pub devices: Vec<Found>,
    /// The one that `auto` takes.
    pub auto: String,
    /// What is missing, why, and how to get it.
    pub unavailable: Vec<Unavailable>,
}

impl Listing {
    /// Looks for devices.
    pub fn look() -> Self {
        let cpu = Found {
            name: "cpu".to_owned(),
            model: processor(),
            kind: "cpu",
            through: None,
            threads: Some(std::thread::available_parallelism().map_or(1, usize::from)),
            memory_bytes: None,
            largest_buffer_bytes: None,
            usable: true,
            remark: None,
        };
        let (others, unavailable) = accelerators::found();
        let devices: Vec<Found> = std::iter::once(cpu).chain(others).collect();
        let best = devices.iter().find(|d| d.usable && !["cpu", "software"].contains(&d.kind));
        let auto = best.map_or("cpu", |d| &d.name).to_owned();
        Self { devices, auto, unavailable }
    }
}

/// Memory of what a backend computes on, as far as it is free where that is known \[bytes\].
pub fn memory(backend: Backend) -> Option<u64> {
    if backend == Backend::Cpu {
        return glebe_io::free_memory();
    }
    let name = backend.device();
    let own = |found: &Found| name.split(' ').next() == Some(&found.name);
    accelerators::found().0.into_iter().find(own)?.memory_bytes
}

/// The processor's name where the system tells it, else its architecture.
pub fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let named =
        info.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':').map(|(_, n)| n.trim()));
    named.unwrap_or(std::env::consts::ARCH).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_named_in_words() {
        let words = [
            ("auto", Device::Auto),
            ("cpu", Device::Cpu),
            ("gpu", Device::Gpu(None)),
            ("gpu:0", Device::Gpu(Some(0))),
            ("gpu:12", Device::Gpu(Some(12))),
            ("cuda", Device::Cuda(0)),
            ("cuda:3", Device::Cuda(3)),
        ];
        for (word, device) in words {
            assert_eq!(word.parse(), Ok(device));
            assert_eq!(device.to_string().parse(), Ok(device));
        }
        for word in ["", "GPU", "gpu:", "gpu:-1", "gpu:one", "cpu:0", "auto:1", "cuda:", "vulkan"] {
            assert!(word.parse::<Device>().unwrap_err().contains("cuda:NUMBER"), "{word}");
        }
    }
}
