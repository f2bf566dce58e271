//! Each way in which a device is known to fail silently is provoked here, and must be heard of.

#![allow(clippy::unwrap_used, reason = "a failed unwrap fails the test")]

use std::io::Write as _;
use std::time::{Duration, Instant};

use cubecl::prelude::*;
use cubecl::wgpu::WgpuRuntime;
use glebe_physics::{IntegratorKind, Material};

use super::device::{Buffer, Device, MOST_BLOCKS, grid, rows_of_grid};
use super::layout::BLOCK;
use super::*;
use crate::backend::{Backend, Job};
use crate::batch::{Batch, Blind, Status};
use crate::prepare;
use crate::spec::{Domain, Side, Stage, Step, Time, Until, WorldSpec};

/// A device of the test's own with changed limits, or none where there is no adapter, which is an error in CI.
fn device(change: impl FnOnce(&mut wgpu::Limits)) -> Option<Opened> {
    let (instance, handles) = probe::enumerate();
    let adapters = probe::adapters_of(&handles);
    let found = pick(&adapters, Choice::Any).ok();
    let Some((number, (adapter, handle))) =
        found.and_then(|n| Some((n, adapters.into_iter().zip(handles).nth(n)?)))
    else {
        assert!(std::env::var_os("CI").is_none(), "faults of devices must be tested: there is no adapter");
        std::io::stderr().write_all(b"SKIPPED: faults of devices: there is no adapter\n").unwrap();
        return None;
    };
    let mut limits = handle.limits();
    change(&mut limits);
    Some(Opened::new(number, adapter, instance, handle, limits).unwrap())
}

/// As a fleet has it.
fn connected(opened: &Opened) -> Device<WgpuRuntime> {
    let (fault, id) = (opened.fault.clone(), opened.device.to_id());
    let told = move || fault.get().cloned().or_else(|| panic_of(&id).map(Fault::refused));
    Device::new(WgpuRuntime::client(&opened.device), Box::new(told))
}

/// What is known of it after all launches.
fn heard(device: &Device<WgpuRuntime>) -> String {
    device.settle();
    device.broken().map(|fault| fault.why.clone()).unwrap_or_default()
}

/// Two grains above a floor.
fn world() -> WorldSpec {
    let sides = [[Side::Open; 2], [Side::Open; 2], [Side::Wall, Side::Open]];
    let domain = Domain::aligned([0.0; 3], [0.1, 0.1, 0.1], sides, Some(0));
    let time = Time { step: Step::Fixed(1e-5), integrator: IntegratorKind::Euler, force: false };
    let mut world = WorldSpec::new(domain, time);
    world.materials = vec![Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e7,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    }];
    world.gravity = [0.0, 0.0, -9.81];
    world.particles.push([0.05, 0.05, 0.005], 0.005, 0);
    world.particles.push([0.05, 0.052, 0.0145], 0.005, 0);
    let until = Until { at_most: Some(1.0), ..Until::default() };
    world.stages = vec![Stage { name: "fall".to_owned(), until, ..Stage::default() }];
    world
}

#[test]
fn a_healthy_device_is_silent_and_passes_its_trial() {
    let Some(opened) = device(|_| {}) else { return };
    let device = connected(&opened);
    assert_eq!(device.try_out(), Ok(()));
    assert_eq!(heard(&device), "");
}

#[cube(launch_unchecked)]
#[expect(clippy::too_many_arguments, reason = "that is what is tried")]
fn crowd(
    a: &mut Array<u32>,
    b: &mut Array<u32>,
    c: &mut Array<u32>,
    d: &mut Array<u32>,
    e: &mut Array<u32>,
    f: &mut Array<u32>,
    g: &mut Array<u32>,
    h: &mut Array<u32>,
    i: &mut Array<u32>,
    j: &mut Array<u32>,
) {
    let sum = b[0] + c[0] + d[0] + e[0] + f[0] + g[0] + h[0] + i[0] + j[0];
    a[0] = sum + 1u32;
}

#[test]
fn a_kernel_with_too_many_buffers_is_heard_of() {
    let Some(opened) = device(|limits| limits.max_storage_buffers_per_shader_stage = 8) else { return };
    let device = connected(&opened);
    let b: Vec<Buffer> = (0..10).map(|_| device.zeros(4, 4)).collect();
    assert_eq!(heard(&device), "");
    // SAFETY: every buffer has an element.
    #[allow(unsafe_code)]
    unsafe {
        crowd::launch_unchecked::<WgpuRuntime>(
            device.client(),
            grid(1),
            CubeDim::new_1d(1),
            b[0].arg(),
            b[1].arg(),
            b[2].arg(),
            b[3].arg(),
            b[4].arg(),
            b[5].arg(),
            b[6].arg(),
            b[7].arg(),
            b[8].arg(),
            b[9].arg(),
        );
    }
    assert_ne!(heard(&device), "");
    assert_eq!(device.broken().unwrap().remedy, Fault::refused("").remedy);
}

#[cube(launch_unchecked)]
fn take_one(x: &mut Array<Atomic<u32>>) {
    x[0].fetch_sub(1u32);
}

#[test]
fn a_kernel_that_does_not_compile_is_heard_of() {
    let Some(opened) = device(|_| {}) else { return };
    let device = connected(&opened);
    let buffer = device.upload(&[5_u32]);
    // SAFETY: the buffer has an element.
    #[allow(unsafe_code)]
    unsafe {
        take_one::launch_unchecked::<WgpuRuntime>(device.client(), grid(1), CubeDim::new_1d(1), buffer.arg());
    }
    let told = heard(&device);
    // Where it compiles it has to be right.
    assert!(!told.is_empty() || device.read::<u32>(&buffer, 0, 1) == [4], "nothing was heard");
}

#[test]
fn a_buffer_that_is_too_large_is_heard_of_before_it_is_asked_for() {
    let Some(opened) = device(|_| {}) else { return };
    let device = connected(&opened);
    let most = device.client().properties().memory.max_page_size as usize;
    device.zeros(most / 16 + 1, 16);
    let told = heard(&device);
    assert!(told.contains("its memory ran out") && told.contains("MB in one piece"), "{told}");
}

#[test]
fn a_panic_on_the_device_s_thread_is_heard_of() {
    let Some(opened) = device(|_| {}) else { return };
    let device = connected(&opened);
    let most = device.client().properties().memory.max_page_size as usize;
    // Past the check: CubeCL has no page of that size, and panics where nobody listens.
    drop(device.client().empty(2 * most));
    assert_ne!(heard(&device), "");
}

#[cube(launch_unchecked)]
fn touch(x: &mut Array<u32>) {
    if ABSOLUTE_POS == 0 {
        x[0] = 6u32;
    }
}

#[test]
fn grids_stay_within_the_limit_and_one_beyond_it_is_heard_of() {
    for blocks in [0, 1, MOST_BLOCKS - 1, MOST_BLOCKS, MOST_BLOCKS + 1, 1_000_000, 100_000_000] {
        let CubeCount::Static(x, y, z) = grid(blocks) else { panic!("grids are known beforehand") };
        assert!([x, y, z].iter().all(|n| (1..=MOST_BLOCKS as u32).contains(n)), "{blocks}: {x} {y} {z}");
        assert!(x as usize * y as usize * z as usize >= blocks);
        let whole = rows_of_grid(blocks);
        let CubeCount::Static(x, y, z) = grid(whole) else { panic!("grids are known beforehand") };
        assert_eq!(x as usize * y as usize * z as usize, whole.max(1), "{blocks}");
        assert!((blocks..blocks + 2000).contains(&whole));
    }
    let Some(opened) = device(|_| {}) else { return };
    if opened.handle.limits().max_compute_workgroups_per_dimension > MOST_BLOCKS as u32 {
        return;
    }
    let device = connected(&opened);
    let buffer = device.upload(&[5_u32]);
    let beyond = CubeCount::Static(MOST_BLOCKS as u32 + 1, 1, 1);
    // SAFETY: the buffer has an element.
    #[allow(unsafe_code)]
    unsafe {
        touch::launch_unchecked::<WgpuRuntime>(device.client(), beyond, CubeDim::new_1d(BLOCK), buffer.arg());
    }
    assert_ne!(heard(&device), "");
}

#[test]
fn steps_that_were_not_run_are_missed_whatever_the_driver_says() {
    // The kernels of a step have more buffers than that, those of the host's bookkeeping have not.
    let Some(opened) = device(|limits| limits.max_storage_buffers_per_shader_stage = 8) else { return };
    let (constants, mut state) = prepare(world()).unwrap();
    let mut progress = state.progress.clone();
    // A driver that says nothing.
    let deaf = Box::new(|| None);
    let client = WgpuRuntime::client(&opened.device);
    let mut fleet = fleet::GpuFleet::<WgpuRuntime>::new(client, deaf, vec![(constants, &mut state)]);
    let mut jobs = [Job { world: 0, steps: 100, progress: &mut progress, outcome: Ok(()) }];
    let began = Instant::now();
    fleet.advance(&mut jobs);
    let failure = jobs[0].outcome.clone().unwrap_err();
    assert!(failure.what.contains("the device failed"), "{failure}");
    assert_eq!(progress.step, 0, "steps were counted that were not run");
    assert!(began.elapsed() < Duration::from_secs(60));
}

#[test]
fn a_device_that_is_lost_stops_its_worlds_and_can_be_opened_again() {
    // Opened as users open it, which no other test of this file does.
    if device(|_| {}).is_none() {
        return;
    }
    let accelerator = Accelerator::open(Choice::Any).unwrap();
    let mut batch = Batch::new(vec![world()], Backend::Gpu(accelerator)).unwrap();
    let Ok(()) = batch.advance(&mut Blind);
    assert!(batch.running());
    let steps = batch.progress(0).step;
    assert!(steps > 0 && batch.sound_state(0).is_ok());

    accelerator.give_up();
    let Ok(()) = batch.advance(&mut Blind);
    let Status::Failed(failure) = batch.status(0) else { panic!("{:?}", batch.status(0)) };
    assert!(failure.what.contains("the device failed: it was lost"), "{failure}");
    assert_eq!((failure.step, batch.progress(0).step), (steps, steps));
    // What is read of it now is not taken for true, and does not panic.
    assert!(batch.sound_state(0).is_err());
    batch.moment(0);

    let again = Accelerator::open(Choice::Any).unwrap();
    assert_eq!(again.fault(), None);
    let mut batch = Batch::new(vec![world()], Backend::Gpu(again)).unwrap();
    let Ok(()) = batch.advance(&mut Blind);
    assert!(batch.running());
}

/// Grains far apart, in a box with walls if asked for.
fn gas(count: usize, walls: bool) -> WorldSpec {
    let mut world = world();
    let width = (count as f64).cbrt().ceil();
    let side = if walls { Side::Wall } else { Side::Open };
    world.domain = Domain::aligned([0.0; 3], [0.03 * width; 3], [[side; 2]; 3], Some(0));
    world.particles = crate::spec::ParticleSet::default();
    for i in 0..count {
        let at =
            [i, i / width as usize, i / (width * width) as usize].map(|k| (k as f64 % width + 0.5) * 0.03);
        world.particles.push(at, 0.005, 0);
    }
    world
}

#[test]
fn needs_are_known_before_they_are_taken() {
    for (count, walls) in [(2, false), (300, true), (20_000, true)] {
        let Some(opened) = device(|_| {}) else { return };
        let client = || WgpuRuntime::client(&opened.device);
        let (constants, mut state) = prepare(gas(count, walls)).unwrap();
        let need = fleet::GpuFleet::<WgpuRuntime>::need(client(), std::slice::from_ref(&constants));
        let mut progress = state.progress.clone();
        let told = Box::new(|| None);
        let mut fleet = fleet::GpuFleet::<WgpuRuntime>::new(client(), told, vec![(constants, &mut state)]);
        fleet.advance(&mut [Job { world: 0, steps: 20, progress: &mut progress, outcome: Ok(()) }]);
        let taken = fleet.bytes_per_particle(0) * count as f64;
        let most = need.all as f64;
        // What is not yet there is of a stretch of the largest size.
        assert!(taken <= most && most < 1.25 * taken + 2e6, "{count}: {taken} bytes taken, {most} foretold");
        let reserved = client().memory_usage().unwrap().bytes_reserved as f64;
        assert!(taken <= reserved, "{reserved} bytes reserved");
        // What is known of any world is less.
        let least = [BYTES, LARGEST].map(|bytes| bytes * count as u64);
        assert!(least[0] <= need.all && least[1] <= need.largest, "{count}: {least:?} {need:?}");
    }
}
