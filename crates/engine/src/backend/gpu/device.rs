//! A device and its memory: buffers, uploads, reads.

use std::sync::OnceLock;

use bytemuck::Pod;
use cubecl::prelude::*;
use cubecl::server::{Binding, Handle};

use super::fault::{Fault, guarded, plain};
use super::layout::{BLOCK, U4};

/// Memory of the device.
#[derive(Clone)]
pub struct Buffer {
    handle: Handle,
    /// Elements.
    pub len: usize,
    /// Bytes of an element.
    size: usize,
}

impl Buffer {
    /// As a kernel's argument.
    pub fn arg<R: Runtime>(&self) -> ArrayArg<R> {
        // SAFETY: the length is that of the allocation.
        #[allow(unsafe_code)]
        unsafe {
            ArrayArg::from_raw_parts(self.handle.clone(), self.len)
        }
    }
    /// As a kernel's argument of which CubeCL is not told more.
    pub fn binding(&self) -> Binding {
        self.handle.clone().binding()
    }
    /// Elements that the allocation holds.
    pub fn held(&self) -> u64 {
        self.handle.size_in_used() / self.size as u64
    }
    /// Words of an element.
    pub fn lanes(&self) -> usize {
        self.size / size_of::<u32>()
    }
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.len * self.size
    }
    /// Whether it was taken by itself.
    pub fn is_large(&self) -> bool {
        self.bytes() >= LARGE
    }
}

/// A device through one of CubeCL's runtimes.
pub struct Device<R: Runtime> {
    client: ComputeClient<R>,
    /// First thing that went wrong; nothing that is read afterwards is true.
    broken: OnceLock<Fault>,
    /// What the driver has told of beside the calls.
    told: Told,
    /// Whether buffers are not taken, but measured.
    measures: bool,
}

/// Asks what a driver has told of beside the calls.
pub type Told = Box<dyn Fn() -> Option<Fault> + Send + Sync>;

impl<R: Runtime> Device<R> {
    /// Takes a client, and a way to ask what went wrong beside its calls.
    pub fn new(client: ComputeClient<R>, told: Told) -> Self {
        Self { client, broken: OnceLock::new(), told, measures: false }
    }

    /// A device whose buffers have their lengths and next to no memory: to know what will be needed. They must not be
    /// used.
    pub fn measuring(client: ComputeClient<R>) -> Self {
        Self { measures: true, ..Self::new(client, Box::new(|| None)) }
    }

    /// The first thing that went wrong.
    pub fn broken(&self) -> Option<&Fault> {
        if self.broken.get().is_none()
            && let Some(fault) = (self.told)()
        {
            // The first cause is the one that explains the others.
            let _ = self.broken.set(fault);
        }
        self.broken.get()
    }

    /// Remembers that the device cannot be trusted any more. What its driver has told of is the cause of what is
    /// noticed afterwards.
    pub fn breaks(&self, fault: Fault) {
        if self.broken().is_none() {
            let _ = self.broken.set(fault);
        }
    }

    /// Whether the device gives so much memory in one piece. It is not asked for what it cannot give: the answer would
    /// be a panic on another thread.
    fn gives(&self, bytes: usize) -> bool {
        let most = self.client.properties().memory.max_page_size;
        let fits = bytes as u64 <= most;
        if !fits {
            let mb = |bytes: u64| bytes.div_ceil(1_000_000);
            self.breaks(Fault::full(&format!(
                "a buffer of {} MB was needed, and the device gives at most {} MB in one piece",
                mb(bytes as u64),
                mb(most)
            )));
        }
        fits
    }

    /// The client, to launch with.
    pub fn client(&self) -> &ComputeClient<R> {
        &self.client
    }

    /// A buffer of zeros of elements of `size` bytes; never empty. A device that cannot give it is broken, and what
    /// comes back must not be used.
    pub fn zeros(&self, len: usize, size: usize) -> Buffer {
        let len = len.max(1);
        if self.measures {
            return Buffer { handle: self.client.empty(size), len, size };
        }
        let len = if self.gives(len * size) { len } else { 1 };
        let buffer = Buffer { handle: self.take(len * size), len, size };
        let (blocks, dim) = (grid(len.div_ceil(BLOCK as usize)), CubeDim::new_1d(BLOCK));
        // SAFETY: the kernels check their bounds; elements are one word or four.
        #[allow(unsafe_code)]
        unsafe {
            if size == QUAD {
                zero_quads::launch_unchecked::<R>(&self.client, blocks, dim, len as u32, buffer.arg());
            } else {
                zero::launch_unchecked::<R>(&self.client, blocks, dim, len as u32, buffer.arg());
            }
        }
        buffer
    }

    /// Memory, not cleared. Pools take it in pages of up to a quarter of the device, of which a few large buffers would
    /// leave much unused: those are taken one by one, after what nobody uses any more has been given back.
    fn take(&self, bytes: usize) -> Handle {
        if bytes < LARGE {
            return self.client.empty(bytes);
        }
        self.give_back();
        let taken = self.client.memory_persistent_allocation(bytes, |bytes| self.client.empty(bytes));
        taken.unwrap_or_else(|_| self.client.empty(bytes))
    }

    /// Gives memory back that nobody uses any more.
    pub fn give_back(&self) {
        self.client.memory_cleanup();
    }

    /// A buffer with contents; never empty. A device that cannot give it is broken, as for [`Self::zeros`].
    pub fn upload<T: Pod>(&self, data: &[T]) -> Buffer {
        if data.is_empty() || self.measures || !self.gives(size_of_val(data)) {
            return self.zeros(data.len(), size_of::<T>());
        }
        let handle = self.client.create_from_slice(bytemuck::cast_slice(data));
        Buffer { handle, len: data.len(), size: size_of::<T>() }
    }

    /// Whether the device does what it is asked to: a kernel is compiled and run, and its result read.
    ///
    /// # Errors
    /// What went wrong.
    pub fn try_out(&self) -> Result<(), Fault> {
        let asked = [3_u32, 1, 4, 1, 5];
        let buffer = self.zeros(asked.len(), 4);
        self.write(&buffer, 0, &asked);
        self.settle();
        let found: Vec<u32> = self.read(&buffer, 0, asked.len());
        match self.broken() {
            Some(fault) => Err(fault.clone()),
            None if found == asked => Ok(()),
            None => Err(Fault::refused("a kernel was sent to it and not run")),
        }
    }

    /// Whether the device's `fma` is one fused operation.
    pub fn fuses(&self) -> bool {
        // (1 + 2⁻¹²)² = 1 + 2⁻¹¹ + 2⁻²⁴, whose last part only a fused operation keeps.
        let x = 1.0 + 2.0_f32.powi(-12);
        let buffer = self.upload(&[x, 0.0]);
        // SAFETY: the kernel reads and writes two numbers.
        #[allow(unsafe_code)]
        unsafe {
            fuse::launch_unchecked::<R>(&self.client, grid(1), CubeDim::new_1d(1), buffer.arg());
        }
        self.read::<f32>(&buffer, 1, 1) == [2.0_f32.powi(-24)]
    }

    /// Waits for all launches; what went wrong in them is kept.
    pub fn settle(&self) {
        match guarded(|| cubecl::future::block_on(self.client.sync())) {
            Ok(Ok(())) => {}
            Ok(Err(error)) => self.breaks(Fault::refused(plain(&error))),
            Err(panic) => self.breaks(Fault::refused(panic)),
        }
    }

    /// All that buffers hold, in one answer.
    pub fn read_all(&self, buffers: &[&Buffer]) -> Vec<Vec<u32>> {
        let handles = buffers.iter().map(|b| b.handle.clone()).collect();
        match guarded(|| cubecl::future::block_on(self.client.read_async(handles))) {
            Ok(Ok(all)) if all.iter().zip(buffers).all(|(bytes, b)| bytes.len() >= b.bytes()) => {
                let both = all.iter().zip(buffers);
                return both.map(|(bytes, b)| bytemuck::pod_collect_to_vec(&bytes[..b.bytes()])).collect();
            }
            Ok(Ok(_)) => self.breaks(unanswered("fewer bytes came back than were asked for")),
            Ok(Err(error)) => self.breaks(unanswered(plain(&error))),
            Err(panic) => self.breaks(unanswered(panic)),
        }
        buffers.iter().map(|b| vec![0; b.bytes() / 4]).collect()
    }

    /// `len` elements of a buffer from `from` on.
    pub fn read<T: Pod>(&self, buffer: &Buffer, from: usize, len: usize) -> Vec<T> {
        let mut all = Vec::with_capacity(len);
        while all.len() < len {
            let many = (len - all.len()).min(PORTION / buffer.size);
            let part = Buffer { handle: self.client.empty(many * buffer.size), len: many, size: buffer.size };
            self.copy(buffer, from + all.len(), &part, 0, many);
            match guarded(|| self.client.read_one(part.handle)) {
                Ok(Ok(bytes)) if bytes.len() >= many * size_of::<T>() => {
                    all.extend(bytemuck::pod_collect_to_vec::<u8, T>(&bytes[..many * size_of::<T>()]));
                    continue;
                }
                Ok(Ok(bytes)) => self.breaks(unanswered(format!("{} bytes came back", bytes.len()))),
                Ok(Err(error)) => self.breaks(unanswered(plain(&error))),
                Err(panic) => self.breaks(unanswered(panic)),
            }
            all.resize(len, T::zeroed());
        }
        all
    }

    /// Writes `data` into a buffer from element `at` on.
    pub fn write<T: Pod>(&self, buffer: &Buffer, at: usize, data: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let mut at = at;
        for portion in bytes.chunks(PORTION) {
            let many = portion.len() / buffer.size;
            let handle = self.client.create_from_slice(portion);
            self.copy(&Buffer { handle, len: many, size: buffer.size }, 0, buffer, at, many);
            at += many;
        }
    }

    /// Copies elements between buffers of elements of one size.
    fn copy(&self, from: &Buffer, begin: usize, to: &Buffer, at: usize, many: usize) {
        let (blocks, dim) = (grid(many.div_ceil(BLOCK as usize)), CubeDim::new_1d(BLOCK));
        let [n, begin, at] = [many, begin, at].map(|x| x as u32);
        // SAFETY: the kernels check their bounds against `many`, and callers stay within the buffers, whose elements are
        // one word or four.
        #[allow(unsafe_code)]
        unsafe {
            if from.size == QUAD {
                let client = &self.client;
                paste_quads::launch_unchecked::<R>(client, blocks, dim, n, begin, at, from.arg(), to.arg());
            } else {
                paste::launch_unchecked::<R>(&self.client, blocks, dim, n, begin, at, from.arg(), to.arg());
            }
        }
    }
}

fn unanswered(why: impl std::fmt::Display) -> Fault {
    Fault::refused(format!("it does not answer: {why}"))
}

/// Bytes that go between host and device at a time: both sides need as much again meanwhile.
const PORTION: usize = 256 << 20;

/// Bytes from which on a buffer is taken by itself.
const LARGE: usize = 1 << 30;

/// Most blocks along an axis of a grid.
pub const MOST_BLOCKS: usize = 65_535;

/// A grid of at least `blocks` blocks; of those beyond, which a grid of rows may have, kernels have to know.
pub fn grid(blocks: usize) -> CubeCount {
    let rows = blocks.div_ceil(MOST_BLOCKS).max(1);
    CubeCount::Static(blocks.div_ceil(rows).max(1) as u32, rows as u32, 1)
}

/// The least number of blocks from `blocks` on whose grid has none beyond them.
pub fn rows_of_grid(blocks: usize) -> usize {
    blocks.next_multiple_of(blocks.div_ceil(MOST_BLOCKS).max(1))
}

#[cube(launch_unchecked)]
fn fuse(x: &mut Array<f32>) {
    let a = x[0];
    x[1] = fma(a, a, 0.0f32 - a * a);
}

#[cube(launch_unchecked)]
fn zero(n: u32, out: &mut Array<u32>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        out[i as usize] = 0u32;
    }
}

#[cube(launch_unchecked)]
fn zero_quads(n: u32, out: &mut Array<U4>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        out[i as usize] = U4::new(0u32);
    }
}

#[cube(launch_unchecked)]
fn paste(n: u32, begin: u32, at: u32, from: &Array<u32>, to: &mut Array<u32>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        to[(at + i) as usize] = from[(begin + i) as usize];
    }
}

#[cube(launch_unchecked)]
fn paste_quads(n: u32, begin: u32, at: u32, from: &Array<U4>, to: &mut Array<U4>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        to[(at + i) as usize] = from[(begin + i) as usize];
    }
}

/// Bytes of four words.
pub const QUAD: usize = size_of::<[u32; 4]>();
