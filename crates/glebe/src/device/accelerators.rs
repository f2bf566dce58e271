//! Graphics processors, in builds that can use them.

use glebe_engine::backend::gpu::probe::{Kind, adapters, cuda_devices, why_no_hardware};
use glebe_engine::backend::gpu::{Accelerator, Choice};
use glebe_engine::backend::{Backend, Unavailable};

use super::Found;

/// What `auto` prefers to the CPU: a graphics processor, else a device that only CUDA knows.
pub(super) fn best() -> Result<Backend, Unavailable> {
    gpu(None).or_else(|why| cuda(0).map_err(|_| why))
}

pub(super) fn gpu(number: Option<usize>) -> Result<Backend, Unavailable> {
    Accelerator::open(number.map_or(Choice::First, Choice::Adapter)).map(Backend::Gpu)
}

pub(super) fn cuda(number: usize) -> Result<Backend, Unavailable> {
    Accelerator::open(Choice::Cuda(number)).map(Backend::Gpu)
}

pub(super) fn found() -> (Vec<Found>, Vec<Unavailable>) {
    let adapters = adapters();
    let mut unavailable = Vec::new();
    if !adapters.iter().any(|adapter| adapter.kind != Kind::Software) {
        unavailable.push(why_no_hardware());
    }
    let graphics = adapters.into_iter().enumerate().map(|(number, adapter)| Found {
        name: format!("gpu:{number}"),
        model: adapter.name,
        kind: adapter.kind.name(),
        through: Some(format!("{}, {}", adapter.api, adapter.driver)),
        threads: None,
        memory_bytes: adapter.memory,
        largest_buffer_bytes: Some(adapter.largest_buffer),
        usable: adapter.unfit.is_none(),
        remark: adapter.unfit.or_else(|| (adapter.kind == Kind::Software).then(|| SOFTWARE.to_owned())),
    });
    let mut devices: Vec<Found> = graphics.collect();
    match cuda_devices() {
        Ok(known) => devices.extend(known.into_iter().enumerate().map(|(number, device)| Found {
            name: format!("cuda:{number}"),
            model: device.name,
            kind: Kind::Discrete.name(),
            through: Some("CUDA".to_owned()),
            threads: None,
            memory_bytes: device.memory,
            largest_buffer_bytes: None,
            usable: true,
            remark: None,
        })),
        Err(why) => unavailable.push(why),
    }
    (devices, unavailable)
}

const SOFTWARE: &str =
    "a program that acts as a graphics processor, slower than the CPU backend: never taken unless named";
