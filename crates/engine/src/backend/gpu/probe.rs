//! What hardware there is, and why not more. Looked at before CubeCL, which panics on a thread of its own where
//! a device, a driver or a library is missing.

use std::path::{Path, PathBuf};

use cubecl::future::block_on;

use super::layout::BLOCK;
use crate::backend::Unavailable;

/// Storage buffers that a kernel may bind: CubeCL adds one to those of the largest kernel.
const BUFFERS: u32 = 24;
/// Workgroups that a launch may have along an axis.
const GRID: u32 = 65_535;

/// What a device is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A card with memory of its own.
    Discrete,
    /// A part of the processor, sharing its memory.
    Integrated,
    /// Lent to a virtual machine.
    Virtual,
    /// The driver does not say.
    Other,
    /// A program that acts as one, on the CPU.
    Software,
}

impl Kind {
    /// In a word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Software => "software",
        }
    }
}

/// A device that Vulkan, Metal or DirectX offers.
#[derive(Clone, Debug)]
pub struct Adapter {
    /// As the driver calls it.
    pub name: String,
    /// The driver, with its version where it is told.
    pub driver: String,
    /// Vulkan, Metal or DirectX 12.
    pub api: &'static str,
    /// What it is made of.
    pub kind: Kind,
    /// Memory of the device, where the interface tells it \[bytes\].
    pub memory: Option<u64>,
    /// Largest buffer that a kernel can use \[bytes\].
    pub largest_buffer: u64,
    /// Buffers that a kernel can use.
    pub buffers: u32,
    /// Why the kernels cannot run on it.
    pub unfit: Option<String>,
}

impl Adapter {
    /// Whether worlds may be run on it unless a software one is asked for.
    pub fn is_hardware(&self) -> bool {
        self.kind != Kind::Software && self.unfit.is_none()
    }

    fn of(adapter: &wgpu::Adapter) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let asked = [
            ("buffers per kernel", limits.max_storage_buffers_per_shader_stage, BUFFERS),
            ("units per workgroup", limits.max_compute_invocations_per_workgroup, BLOCK),
            ("units along a workgroup", limits.max_compute_workgroup_size_x, BLOCK),
            ("workgroups along a launch", limits.max_compute_workgroups_per_dimension, GRID),
        ];
        let unfit = asked
            .iter()
            .find(|(_, has, needs)| has < needs)
            .map(|(what, has, needs)| format!("it has {has} {what}, and the kernels need {needs}"));
        Self {
            driver: [info.driver, info.driver_info].join(" ").trim().to_owned(),
            name: info.name,
            api: match info.backend {
                wgpu::Backend::Metal => "Metal",
                wgpu::Backend::Dx12 => "DirectX 12",
                _ => "Vulkan",
            },
            kind: kind(info.device_type),
            memory: memory(adapter),
            largest_buffer: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            buffers: limits.max_storage_buffers_per_shader_stage,
            unfit,
        }
    }
}

const fn kind(of: wgpu::DeviceType) -> Kind {
    match of {
        wgpu::DeviceType::DiscreteGpu => Kind::Discrete,
        wgpu::DeviceType::IntegratedGpu => Kind::Integrated,
        wgpu::DeviceType::VirtualGpu => Kind::Virtual,
        wgpu::DeviceType::Other => Kind::Other,
        wgpu::DeviceType::Cpu => Kind::Software,
    }
}

/// The largest heap of the device's own memory.
#[cfg(not(target_vendor = "apple"))]
#[allow(unsafe_code)]
fn memory(adapter: &wgpu::Adapter) -> Option<u64> {
    /// `VK_MEMORY_HEAP_DEVICE_LOCAL_BIT`.
    const LOCAL: u32 = 1;
    // SAFETY: the handle is asked for its properties and let go.
    let vulkan = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
    let instance = vulkan.shared_instance().raw_instance();
    // SAFETY: the physical device is of that instance, and both live as long as `vulkan`.
    let memory = unsafe { instance.get_physical_device_memory_properties(vulkan.raw_physical_device()) };
    let heaps = memory.memory_heaps_as_slice().iter();
    heaps.filter(|heap| heap.flags.as_raw() & LOCAL != 0).map(|heap| heap.size).max()
}

/// Metal does not tell.
#[cfg(target_vendor = "apple")]
fn memory(_: &wgpu::Adapter) -> Option<u64> {
    None
}

/// Every device that Vulkan, Metal or DirectX offers, cards first and software last: number N is the device that
/// `gpu:N` means.
pub fn adapters() -> Vec<Adapter> {
    adapters_of(&enumerate().1)
}

pub(super) fn adapters_of(handles: &[wgpu::Adapter]) -> Vec<Adapter> {
    handles.iter().map(Adapter::of).collect()
}

/// Handles of [`adapters`], in their order.
pub(super) fn enumerate() -> (wgpu::Instance, Vec<wgpu::Adapter>) {
    let backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut found = block_on(instance.enumerate_adapters(backends));
    found.sort_by_key(|adapter| kind(adapter.get_info().device_type));
    (instance, found)
}

/// A device that CUDA knows.
#[derive(Clone, Debug)]
pub struct CudaDevice {
    /// As the driver calls it.
    pub name: String,
    /// Memory \[bytes\].
    pub memory: Option<u64>,
}

/// The devices that CUDA knows, by number.
///
/// # Errors
/// What is missing, and how to get it.
#[cfg(feature = "cuda")]
#[allow(unsafe_code)]
pub fn cuda_devices() -> Result<Vec<CudaDevice>, Unavailable> {
    use cudarc::driver::{result, sys};

    let missing = |why: String, remedy: &str| Unavailable::new("CUDA", why, remedy);
    let failed = |error: result::DriverError| {
        missing(
            format!("its driver answers {error}"),
            "see that `nvidia-smi` lists the device, and that the driver is not older than the CUDA toolkit",
        )
    };
    // SAFETY: looks for a library whose initialisers are the driver's own.
    if !unsafe { sys::is_culib_present() } {
        return Err(missing("the driver's library libcuda.so.1 was not found".to_owned(), NVIDIA_DRIVER));
    }
    result::init().map_err(failed)?;
    let count = result::device::get_count().map_err(failed)?;
    if count == 0 {
        return Err(missing("its driver knows no device".to_owned(), NVIDIA_DRIVER));
    }
    // SAFETY: as above.
    let compiler = unsafe { cudarc::nvrtc::sys::is_culib_present() };
    let toolkit = cubecl::cuda::install::cuda_path();
    if let Some(why) = lacking(compiler, toolkit.as_deref()) {
        return Err(missing(
            why,
            "install the CUDA toolkit (NVRTC and the headers of its runtime; on Debian and Ubuntu from NVIDIA's \
             repository `cuda-nvrtc-dev-12-8 cuda-cudart-dev-12-8 cuda-cccl-12-8`), and name its folder in CUDA_PATH \
             unless it is /usr/local/cuda",
        ));
    }
    let device = |number| {
        let handle = result::device::get(number).map_err(failed)?;
        // SAFETY: the handle was just given.
        let memory = unsafe { result::device::total_mem(handle) }.ok().map(|bytes| bytes as u64);
        Ok(CudaDevice { name: result::device::get_name(handle).map_err(failed)?, memory })
    };
    (0..count).map(device).collect()
}

/// The devices that CUDA knows, by number: none in this build.
///
/// # Errors
/// Always: how to get a build that can.
#[cfg(not(feature = "cuda"))]
pub fn cuda_devices() -> Result<Vec<CudaDevice>, Unavailable> {
    Err(no_cuda())
}

#[cfg(not(feature = "cuda"))]
pub(super) fn no_cuda() -> Unavailable {
    Unavailable::new(
        "CUDA",
        "this build of glebe has no CUDA backend",
        "build it with `cargo build --release --features cuda`; where it runs it needs NVIDIA's driver and the CUDA \
         toolkit (NVRTC and headers)",
    )
}

/// What kernels cannot be compiled without for CUDA.
#[cfg(any(feature = "cuda", test))]
fn lacking(compiler: bool, toolkit: Option<&Path>) -> Option<String> {
    if !compiler {
        return Some("NVRTC, which compiles the kernels, was not found (libnvrtc.so)".to_owned());
    }
    let Some(toolkit) = toolkit else {
        return Some("the CUDA toolkit was not found: neither CUDA_PATH nor /usr/local/cuda".to_owned());
    };
    let header = toolkit.join("include").join("cuda_runtime.h");
    (!header.is_file()).then(|| format!("the toolkit's headers are missing: no {}", header.display()))
}

#[cfg(feature = "cuda")]
const NVIDIA_DRIVER: &str = "install NVIDIA's driver (on Debian `nvidia-driver`, on Ubuntu `ubuntu-drivers install`); in a \
     container run with `--gpus all`";

/// Why Vulkan, Metal or DirectX offers no graphics processor, and what to do.
pub fn why_no_hardware() -> Unavailable {
    Surroundings::look().tell()
}

/// What a graphics processor needs on Linux, as found.
#[derive(Debug, Default)]
struct Surroundings {
    /// Whether the Vulkan loader can be loaded.
    loader: bool,
    /// Manifests of Vulkan drivers.
    drivers: Vec<String>,
    /// Whether NVIDIA's kernel module runs.
    nvidia: bool,
    /// A graphics device that the user may not open.
    closed: Option<PathBuf>,
}

impl Surroundings {
    fn look() -> Self {
        let exists = |path: &str| Path::new(path).exists();
        Self {
            loader: loads(if cfg!(windows) { "vulkan-1.dll" } else { "libvulkan.so.1" }),
            drivers: manifests(),
            nvidia: exists("/proc/driver/nvidia/version") || exists("/dev/nvidiactl"),
            closed: files("/dev/dri").into_iter().find(|path| {
                let node = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("renderD"));
                node && std::fs::OpenOptions::new().read(true).write(true).open(path).is_err()
            }),
        }
    }

    fn tell(&self) -> Unavailable {
        if cfg!(target_vendor = "apple") {
            return Unavailable::new(
                "Metal",
                "it offers no device",
                "run on a machine with a GPU that Metal supports",
            );
        }
        let say = |why: &str, remedy: &str| Unavailable::new("Vulkan", why, remedy);
        if cfg!(windows) {
            return say(
                "no driver offers a graphics processor to Vulkan or DirectX 12",
                "install the driver of the graphics processor's maker",
            );
        }
        if !self.loader {
            return say(
                "the Vulkan loader libvulkan.so.1 is not installed",
                "install it and a driver: `apt-get install libvulkan1 mesa-vulkan-drivers` for AMD and Intel, \
                 `libvulkan1` and NVIDIA's driver for NVIDIA",
            );
        }
        if self.nvidia && !self.drivers.iter().any(|name| name.contains("nvidia")) {
            return say(
                "an NVIDIA device is there, but the Vulkan part of its driver is not registered (nvidia_icd.json)",
                "install the graphics part of the driver (on Debian and Ubuntu `libnvidia-gl-VERSION`); in a container \
                 set NVIDIA_DRIVER_CAPABILITIES=all; or use a build with `--features cuda`",
            );
        }
        if self.drivers.is_empty() {
            return say(
                "no Vulkan driver is registered (icd.d)",
                "install the driver of the graphics processor: `apt-get install mesa-vulkan-drivers` for AMD and Intel, \
                 NVIDIA's driver for NVIDIA",
            );
        }
        if let Some(path) = &self.closed {
            return say(
                &format!("this user may not open {}", path.display()),
                "add the user to the device's group, `sudo usermod -aG render $USER`, and log in again",
            );
        }
        let drivers = self.drivers.join(", ");
        say(
            &format!("the drivers that are registered ({drivers}) found no graphics processor"),
            "see that the device is visible here (`vulkaninfo --summary`); in a container pass it on with `--gpus all` \
             or `--device /dev/dri`; on a machine without one use --device cpu",
        )
    }
}

/// Whether the system has a library of that name.
#[allow(unsafe_code)]
fn loads(name: &str) -> bool {
    // SAFETY: the loader's initialisers have no requirements; wgpu loads the same library.
    unsafe { libloading::Library::new(name) }.is_ok()
}

/// Names of the manifests of Vulkan drivers, where the loader looks for them.
fn manifests() -> Vec<String> {
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().find_map(std::env::var_os);
    let found: Vec<PathBuf> = if let Some(paths) = named {
        std::env::split_paths(&paths).filter(|path| path.exists()).collect()
    } else {
        let home = std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/share"));
        let system = ["/etc", "/usr/local/share", "/usr/share"].map(PathBuf::from);
        system.into_iter().chain(home).flat_map(|folder| files(folder.join("vulkan/icd.d"))).collect()
    };
    found.iter().filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned())).collect()
}

/// The files of a folder in the order of their names; none if it cannot be read.
fn files(folder: impl AsRef<Path>) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn what_is_missing_is_named_with_a_remedy() {
        let drivers = || vec!["lvp_icd.x86_64.json".to_owned()];
        let found = |loader, drivers, nvidia| Surroundings { loader, drivers, nvidia, closed: None };
        let closed =
            Surroundings { closed: Some("/dev/dri/renderD128".into()), ..found(true, drivers(), false) };
        let cases = [
            (found(false, vec![], true), "libvulkan.so.1", "libvulkan1"),
            (found(true, drivers(), true), "nvidia_icd.json", "NVIDIA_DRIVER_CAPABILITIES"),
            (found(true, vec![], false), "icd.d", "mesa-vulkan-drivers"),
            (closed, "/dev/dri/renderD128", "usermod"),
            (found(true, drivers(), false), "lvp_icd.x86_64.json", "--device cpu"),
        ];
        for (surroundings, why, remedy) in cases {
            let told = surroundings.tell();
            assert!(told.why.contains(why) && told.remedy.contains(remedy), "{surroundings:?}: {told}");
        }
    }

    #[test]
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    fn libraries_are_looked_for() {
        assert!(loads("libc.so.6") && !loads("libglebe-has-none.so.1"));
    }

    #[test]
    fn cuda_needs_a_compiler_and_headers() {
        let toolkit = std::env::temp_dir().join(format!("glebe-toolkit-{}", std::process::id()));
        let include = toolkit.join("include");
        std::fs::create_dir_all(&include).unwrap();
        assert!(lacking(false, Some(&toolkit)).unwrap().contains("NVRTC"));
        assert!(lacking(true, None).unwrap().contains("CUDA_PATH"));
        assert!(lacking(true, Some(&toolkit)).unwrap().contains("cuda_runtime.h"));
        std::fs::write(include.join("cuda_runtime.h"), "").unwrap();
        assert_eq!(lacking(true, Some(&toolkit)), None);
        std::fs::remove_dir_all(toolkit).unwrap();
    }

    #[test]
    fn cards_come_before_software() {
        assert!(Kind::Discrete < Kind::Integrated && Kind::Other < Kind::Software);
        let found = adapters();
        assert!(found.is_sorted_by_key(|adapter| adapter.kind), "{found:?}");
        for adapter in found {
            assert!(!adapter.name.is_empty() && adapter.largest_buffer > 0, "{adapter:?}");
        }
    }
}
