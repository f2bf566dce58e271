//! The GPU backend: the laws' own source, expanded by CubeCL into kernels for Vulkan, Metal, DirectX or CUDA.

// Kernels: what is decided when they are expanded stands apart from what is decided when they run, the expander knows
// operators only, and what units share has a size on devices only.
#![allow(
    clippy::collapsible_if,
    clippy::collapsible_else_if,
    clippy::manual_div_ceil,
    clippy::manual_is_multiple_of,
    clippy::trivially_copy_pass_by_ref
)]

mod choices;
mod compensated;
mod configured;
mod contacts;
mod device;
mod fault;
#[cfg(test)]
mod faults;
mod fleet;
mod grades;
mod keep;
mod launch;
mod layout;
mod lists;
mod pair;
pub mod probe;
mod recall;
mod round;
mod rows;
mod scan;
mod search;
mod step;
mod sums;
mod surfaces;
mod tables;

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

#[cfg(feature = "cuda")]
use cubecl::cuda::{CudaDevice, CudaRuntime};
use cubecl::device::Device as _;
use cubecl::future::block_on;
use cubecl::prelude::*;
use cubecl::wgpu::{MemoryConfiguration, RuntimeOptions, WgpuDevice, WgpuRuntime, WgpuSetup, init_device};

use self::device::{Device, Told};
pub use self::fault::Fault;
use self::fault::{guarded, panic_of};
use self::fleet::Need;
use self::probe::{Adapter, Kind};
use super::{Fleet, Memory, Unavailable};
use crate::setup::Constants;
use crate::state::State;

/// Launches that wgpu gathers into one submission.
const TASKS: usize = 32;

/// Least memory of a particle, whatever its world: all columns, and 12 places for neighbours \[bytes\].
const BYTES: u64 = 440;
/// The part of it in the largest buffer, what contacts remember \[bytes\].
const LARGEST: u64 = 96;

/// Which device to open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The first of [`probe::adapters`] that is a graphics processor.
    First,
    /// The first, be it software that acts as one: for tests.
    Any,
    /// By number in [`probe::adapters`].
    Adapter(usize),
    /// By number among the devices that CUDA knows.
    Cuda(usize),
}

/// A device to run on, which was found fit and opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Accelerator(Door);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Door {
    /// By place in [`opened`].
    Adapter(usize),
    #[cfg(feature = "cuda")]
    Cuda(usize),
}

/// An adapter that CubeCL holds until the program ends.
struct Opened {
    number: usize,
    adapter: Adapter,
    device: WgpuDevice,
    handle: wgpu::Device,
    fault: Arc<OnceLock<Fault>>,
}

impl Opened {
    /// Opens an adapter with limits that it has.
    fn new(
        number: usize,
        adapter: Adapter,
        instance: wgpu::Instance,
        handle: wgpu::Adapter,
        limits: wgpu::Limits,
    ) -> Result<Self, Unavailable> {
        let name = format!("gpu:{number} ({})", adapter.name);
        let (device, queue) = block_on(
            handle.request_device(&wgpu::DeviceDescriptor {
                required_features: handle
                    .features()
                    .difference(wgpu::Features::MAPPABLE_PRIMARY_BUFFERS)
                    .difference(wgpu::Features::all_experimental_mask()),
                required_limits: limits,
                // CubeCL pools buffers itself.
                memory_hints: wgpu::MemoryHints::MemoryUsage,
                ..wgpu::DeviceDescriptor::default()
            }),
        )
        .map_err(|error| {
            Unavailable::new(
                &name,
                format!("the driver does not open it: {error}"),
                "end other programs that use it, or update its driver",
            )
        })?;
        let fault = Arc::new(OnceLock::new());
        let (of_error, of_loss) = (fault.clone(), fault.clone());
        // Without these wgpu panics, or goes on as if nothing had happened. The first fault is the cause of the rest.
        device.on_uncaptured_error(Arc::new(move |error| {
            let _ = of_error.set(Fault::told(&error));
        }));
        device.set_device_lost_callback(move |reason, message| {
            let _ = of_loss.set(Fault::lost(&format!("{message} ({reason:?})")));
        });
        let backend = handle.get_info().backend;
        let taken = device.clone();
        let setup = WgpuSetup { instance, adapter: handle, device, queue, backend };
        let options = RuntimeOptions { tasks_max: TASKS, memory_config: MemoryConfiguration::default() };
        let device = guarded(|| init_device(setup, options))
            .map_err(|why| Unavailable::new(&name, why, "update its driver, or run with --device cpu"))?;
        Ok(Self { number, adapter, device, handle: taken, fault })
    }

    /// The first thing that went wrong on it and that no call has reported.
    fn fault(&self) -> Option<Fault> {
        // A loss is told when wgpu is next asked how things are, which may be later than the calls that fail of it.
        if self.fault.get().is_none() {
            let _ = self.handle.poll(wgpu::PollType::Poll);
        }
        self.fault.get().cloned().or_else(|| panic_of(&self.device.to_id()).map(Fault::refused))
    }
}

/// Adapters that were opened.
fn opened() -> MutexGuard<'static, Vec<Opened>> {
    static OPENED: Mutex<Vec<Opened>> = Mutex::new(Vec::new());
    // What another thread left when it panicked is whole: a row is pushed at once.
    OPENED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Accelerator {
    /// Opens a device, or takes it up again.
    ///
    /// # Errors
    /// There is no such device, or it cannot run the kernels: why, and what to do.
    pub fn open(choice: Choice) -> Result<Self, Unavailable> {
        configured::configure();
        if let Choice::Cuda(number) = choice {
            return open_cuda(number);
        }
        let mut opened = opened();
        let (instance, handles) = probe::enumerate();
        let adapters = probe::adapters_of(&handles);
        let number = pick(&adapters, choice)?;
        // One that failed is opened anew.
        if let Some(place) = opened.iter().position(|o| o.number == number && o.fault().is_none()) {
            drop(opened);
            return Self(Door::Adapter(place)).tried_out();
        }
        // `pick` gives numbers of adapters that are there.
        let Some((adapter, handle)) = adapters.into_iter().zip(handles).nth(number) else {
            return Err(probe::why_no_hardware());
        };
        let limits = handle.limits();
        opened.push(Opened::new(number, adapter, instance, handle, limits)?);
        let accelerator = Self(Door::Adapter(opened.len() - 1));
        drop(opened);
        accelerator.tried_out()
    }

    /// The device, once it has run a kernel.
    fn tried_out(self) -> Result<Self, Unavailable> {
        let tried = match self.0 {
            Door::Adapter(_) => {
                guarded(|| Device::new(WgpuRuntime::client(&self.wgpu_device()), self.told()).try_out())
            }
            #[cfg(feature = "cuda")]
            Door::Cuda(index) => {
                guarded(|| Device::new(CudaRuntime::client(&CudaDevice { index }), self.told()).try_out())
            }
        };
        // What happened on the device's thread explains what its caller saw.
        let fault = match tried {
            Ok(Ok(())) => return Ok(self),
            Ok(Err(fault)) => fault,
            Err(panic) => self.fault().unwrap_or_else(|| Fault::refused(panic)),
        };
        Err(Unavailable::new(&self.name(), format!("a first kernel failed: {}", fault.why), fault.remedy))
    }

    fn wgpu_device(self) -> WgpuDevice {
        match self.0 {
            // Accelerators are made with their row, and rows stay.
            Door::Adapter(place) => opened().get(place).map(|o| o.device.clone()).unwrap_or_default(),
            #[cfg(feature = "cuda")]
            Door::Cuda(_) => WgpuDevice::default(),
        }
    }

    fn told(self) -> Told {
        Box::new(move || self.fault())
    }

    /// Gives the device up: what runs on it ends with a failure. Opening it again takes it up anew. A device that only
    /// CUDA knows stays.
    pub fn give_up(self) {
        match self.0 {
            Door::Adapter(place) => opened().get(place).into_iter().for_each(|o| o.handle.destroy()),
            #[cfg(feature = "cuda")]
            Door::Cuda(_) => {}
        }
    }

    /// As `--device` names it, and as its driver does.
    pub fn name(self) -> String {
        match self.0 {
            Door::Adapter(place) => opened().get(place).map_or_else(String::new, |o| {
                format!("gpu:{} ({}, {})", o.number, o.adapter.name, o.adapter.api)
            }),
            #[cfg(feature = "cuda")]
            Door::Cuda(number) => {
                let known = probe::cuda_devices().ok().and_then(|all| all.into_iter().nth(number));
                format!("cuda:{number} ({})", known.map_or_else(String::new, |device| device.name))
            }
        }
    }

    /// The first thing that went wrong on the device and that no call has reported: memory that ran out, a kernel
    /// that was refused, a driver that was reset.
    pub fn fault(self) -> Option<Fault> {
        match self.0 {
            Door::Adapter(place) => opened().get(place).and_then(Opened::fault),
            #[cfg(feature = "cuda")]
            Door::Cuda(index) => panic_of(&CudaDevice { index }.to_id()).map(Fault::refused),
        }
    }

    /// The memory of the device and of its largest buffer, where they are known \[bytes\].
    fn room(self) -> (Option<u64>, u64) {
        match self.0 {
            Door::Adapter(place) => {
                opened().get(place).map_or((None, u64::MAX), |o| (o.adapter.memory, o.adapter.largest_buffer))
            }
            #[cfg(feature = "cuda")]
            Door::Cuda(number) => {
                let known = probe::cuda_devices().ok().and_then(|all| all.get(number)?.memory);
                // CubeCL's pools give a quarter of the memory at once.
                (known, known.map_or(u64::MAX, |bytes| bytes / 4))
            }
        }
    }

    /// Why the device has no room for a world of that many particles, whatever they are.
    pub fn crowded(self, particles: usize) -> Option<String> {
        let n = particles as u64;
        let need = Need { all: n * BYTES, largest: n * LARGEST, longest: n };
        beyond_reach(particles).or_else(|| overflow(particles, need, self.room()))
    }

    fn need(self, worlds: &[Arc<Constants>]) -> Need {
        match self.0 {
            Door::Adapter(_) => {
                let client = WgpuRuntime::client(&self.wgpu_device());
                fleet::GpuFleet::<WgpuRuntime>::need(client, worlds)
            }
            #[cfg(feature = "cuda")]
            Door::Cuda(index) => {
                let client = CudaRuntime::client(&CudaDevice { index });
                fleet::GpuFleet::<CudaRuntime>::need(client, worlds)
            }
        }
    }

    /// Memory that worlds need on the device, and its own.
    pub fn memory(self, worlds: &[Arc<Constants>]) -> Memory {
        Memory { needed: self.need(worlds).all, device: self.room().0 }
    }

    /// Why the device cannot run worlds together.
    pub fn refusal(self, worlds: &[Arc<Constants>]) -> Option<String> {
        let laws = || worlds.iter().find_map(|c| choices::Choices::refusal(c));
        let each = worlds.iter().find_map(|c| self.crowded(c.count)).or_else(laws);
        each.or_else(|| {
            let particles = worlds.iter().map(|c| c.count).sum();
            overflow(particles, self.need(worlds), self.room())
        })
    }

    /// A batch of worlds on the device.
    pub fn fleet(self, worlds: Vec<(Arc<Constants>, &mut State)>) -> Box<dyn Fleet> {
        match self.0 {
            Door::Adapter(_) => {
                let client = WgpuRuntime::client(&self.wgpu_device());
                Box::new(fleet::GpuFleet::<WgpuRuntime>::new(client, self.told(), worlds))
            }
            #[cfg(feature = "cuda")]
            Door::Cuda(index) => {
                let client = CudaRuntime::client(&CudaDevice { index });
                Box::new(fleet::GpuFleet::<CudaRuntime>::new(client, self.told(), worlds))
            }
        }
    }
}

/// The number of the adapter that a choice means.
fn pick(adapters: &[Adapter], choice: Choice) -> Result<usize, Unavailable> {
    let number = match choice {
        Choice::Adapter(number) => number,
        Choice::Any => 0,
        Choice::First | Choice::Cuda(_) => {
            return adapters.iter().position(Adapter::is_hardware).ok_or_else(|| no_hardware(adapters));
        }
    };
    let what = format!("gpu:{number}");
    match adapters.get(number) {
        Some(Adapter { unfit: None, .. }) => Ok(number),
        Some(Adapter { name, unfit: Some(why), .. }) => Err(Unavailable::new(
            &what,
            format!("{name} cannot run the kernels: {why}"),
            "update its driver, or use another device",
        )),
        None if adapters.is_empty() => {
            let why = probe::why_no_hardware();
            Err(Unavailable::new(
                &what,
                format!("there is no device: {}: {}", why.what, why.why),
                &why.remedy,
            ))
        }
        None => Err(Unavailable::new(
            &what,
            format!("there is no device of that number; there are gpu:0 to gpu:{}", adapters.len() - 1),
            "`glebe devices` lists them",
        )),
    }
}

/// Why there is no graphics processor among the adapters; what else there is.
fn no_hardware(adapters: &[Adapter]) -> Unavailable {
    let unfit = adapters.iter().find(|adapter| adapter.kind != Kind::Software);
    if let Some((name, why)) = unfit.and_then(|adapter| Some((&adapter.name, adapter.unfit.as_ref()?))) {
        let why = format!("{name} cannot run the kernels: {why}");
        return Unavailable::new("gpu", why, "update its driver, or use --device cpu");
    }
    let Unavailable { what, why, remedy } = probe::why_no_hardware();
    let software = adapters.iter().enumerate().find(|(_, a)| a.kind == Kind::Software && a.unfit.is_none());
    let force = software.map_or_else(String::new, |(number, adapter)| {
        let name = &adapter.name;
        format!(
            "; --device gpu:{number} forces {name}, a program that acts as a graphics processor, slower than \
             --device cpu"
        )
    });
    Unavailable {
        what: "gpu".to_owned(),
        why: format!("no graphics processor was found: {what}: {why}"),
        remedy: remedy + &force,
    }
}

#[cfg(feature = "cuda")]
fn open_cuda(number: usize) -> Result<Accelerator, Unavailable> {
    let count = probe::cuda_devices()?.len();
    if number >= count {
        return Err(Unavailable::new(
            &format!("cuda:{number}"),
            format!("there is no device of that number; there are cuda:0 to cuda:{}", count - 1),
            "`glebe devices` lists them",
        ));
    }
    Accelerator(Door::Cuda(number)).tried_out()
}

#[cfg(not(feature = "cuda"))]
fn open_cuda(_: usize) -> Result<Accelerator, Unavailable> {
    Err(probe::no_cuda())
}

/// Why a world of that many particles is beyond what lists can tell.
fn beyond_reach(particles: usize) -> Option<String> {
    let most = layout::PARTNER as usize;
    (particles > most).then(|| {
        format!("{particles} particles in one world are more than the {most} that its lists can tell")
    })
}

/// What does not fit into a device with that memory and largest buffer \[bytes\].
fn overflow(particles: usize, need: Need, (memory, largest): (Option<u64>, u64)) -> Option<String> {
    let told = |needs: u64, what: &str, has: u64| {
        format!(
            "{particles} particles need {what} {} MB, and the device has {} MB",
            needs.div_ceil(1_000_000),
            has / 1_000_000
        )
    };
    match memory {
        Some(memory) if need.all > memory => Some(told(need.all, "at least", memory)),
        _ if need.largest > largest => Some(told(need.largest, "a buffer of at least", largest)),
        _ if need.longest > u64::from(u32::MAX) => Some(format!(
            "{particles} particles need a list of {} entries, and kernels count no further than {}",
            need.longest,
            u32::MAX
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(kind: Kind, unfit: Option<&str>) -> Adapter {
        Adapter {
            name: format!("a {} one", kind.name()),
            driver: String::new(),
            api: "Vulkan",
            kind,
            memory: None,
            largest_buffer: 1 << 30,
            buffers: 32,
            unfit: unfit.map(str::to_owned),
        }
    }

    #[test]
    fn software_is_taken_only_when_asked_for() {
        let mixed = [
            adapter(Kind::Discrete, Some("too old")),
            adapter(Kind::Virtual, None),
            adapter(Kind::Software, None),
        ];
        assert_eq!(pick(&mixed, Choice::First).unwrap(), 1);
        assert_eq!(pick(&mixed, Choice::Adapter(2)).unwrap(), 2);
        assert!(pick(&mixed, Choice::Adapter(0)).unwrap_err().why.contains("too old"));
        assert!(pick(&mixed, Choice::Adapter(3)).unwrap_err().why.contains("gpu:0 to gpu:2"));

        let software = &mixed[2..];
        assert_eq!(pick(software, Choice::Any).unwrap(), 0);
        let told = pick(software, Choice::First).unwrap_err();
        assert!(told.remedy.contains("--device gpu:0 forces a software one"), "{told}");
        assert!(pick(&mixed[..1], Choice::First).unwrap_err().why.contains("too old"));
        for choice in [Choice::First, Choice::Any, Choice::Adapter(0)] {
            assert!(pick(&[], choice).is_err());
        }
    }

    #[test]
    fn room_is_looked_at_before_it_is_taken() {
        const GB: u64 = 1_000_000_000;
        let need = Need { all: 2 * GB, largest: GB, longest: 1 };
        assert_eq!(overflow(1_000_000, need, (Some(2 * GB), GB)), None);
        let told = overflow(1_000_000, need, (Some(GB), GB)).unwrap();
        assert!(
            told.contains("1000000 particles need at least 2000 MB, and the device has 1000 MB"),
            "{told}"
        );
        let told = overflow(1_000_000, need, (None, GB / 8)).unwrap();
        assert!(told.contains("a buffer of at least 1000 MB, and the device has 125 MB"), "{told}");
        let long = Need { longest: 1 << 32, ..need };
        assert!(overflow(1, long, (None, GB)).unwrap().contains("no further than 4294967295"));
        assert_eq!(beyond_reach(1_000_000_000), None);
        assert!(beyond_reach(1_100_000_000).unwrap().contains("more than the 1073741823"));
    }

    #[test]
    fn a_device_that_is_not_there_is_an_error() {
        assert!(Accelerator::open(Choice::Adapter(1000)).is_err());
        assert!(Accelerator::open(Choice::Cuda(1000)).is_err());
    }
}
