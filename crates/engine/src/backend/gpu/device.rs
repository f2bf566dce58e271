//! A device and its memory: buffers, uploads, reads.

use std::sync::OnceLock;

use bytemuck::Pod;
use cubecl::prelude::*;
use cubecl::server::Handle;

use super::layout::BLOCK;

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
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.len * self.size
    }
}

/// A device through one of CubeCL's runtimes.
pub struct Device<R: Runtime> {
    client: ComputeClient<R>,
    /// First thing that went wrong; nothing that is read afterwards is true.
    broken: OnceLock<String>,
    /// What the driver has told of beside the calls.
    fault: Box<dyn Fn() -> Option<String> + Send + Sync>,
}

impl<R: Runtime> Device<R> {
    /// Takes a client, and a way to ask what went wrong beside its calls.
    pub fn new(client: ComputeClient<R>, fault: Box<dyn Fn() -> Option<String> + Send + Sync>) -> Self {
        Self { client, broken: OnceLock::new(), fault }
    }

    /// The first thing that went wrong.
    pub fn broken(&self) -> Option<&str> {
        if self.broken.get().is_none()
            && let Some(why) = (self.fault)()
        {
            self.breaks(why);
        }
        self.broken.get().map(String::as_str)
    }

    /// Remembers that the device cannot be trusted any more.
    pub fn breaks(&self, why: String) {
        // The first cause is the one that explains the others.
        let _ = self.broken.set(why);
    }

    /// The client, to launch with.
    pub fn client(&self) -> &ComputeClient<R> {
        &self.client
    }

    /// A buffer of zeros of elements of `size` bytes; never empty.
    pub fn zeros(&self, len: usize, size: usize) -> Buffer {
        let len = len.max(1);
        let handle = self.client.empty(len * size);
        let words = len * size / 4;
        let buffer = Buffer { handle: handle.clone(), len, size };
        let whole = Buffer { handle, len: words, size: 4 };
        // SAFETY: the kernel checks its bounds.
        #[allow(unsafe_code)]
        unsafe {
            zero::launch_unchecked::<R>(
                &self.client,
                grid(words.div_ceil(BLOCK as usize)),
                CubeDim::new_1d(BLOCK),
                words as u32,
                whole.arg(),
            );
        }
        buffer
    }

    /// A buffer with contents; never empty.
    pub fn upload<T: Pod>(&self, data: &[T]) -> Buffer {
        if data.is_empty() {
            return self.zeros(1, size_of::<T>());
        }
        let handle = self.client.create_from_slice(bytemuck::cast_slice(data));
        Buffer { handle, len: data.len(), size: size_of::<T>() }
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
        if let Err(error) = cubecl::future::block_on(self.client.sync()) {
            self.breaks(format!("{error:?}"));
        }
    }

    /// `len` elements of a buffer from `from` on.
    pub fn read<T: Pod>(&self, buffer: &Buffer, from: usize, len: usize) -> Vec<T> {
        if len == 0 {
            return Vec::new();
        }
        let part = Buffer { handle: self.client.empty(len * buffer.size), len, size: buffer.size };
        let words = buffer.size / 4;
        self.copy(buffer, from * words, &part, 0, len * words);
        match self.client.read_one(part.handle) {
            Ok(bytes) => bytemuck::pod_collect_to_vec(&bytes[..len * size_of::<T>()]),
            Err(error) => {
                self.breaks(format!("the device does not answer: {error:?}"));
                vec![T::zeroed(); len]
            }
        }
    }

    /// Writes `data` into a buffer from `at` on.
    pub fn write<T: Pod>(&self, buffer: &Buffer, at: usize, data: &[T]) {
        if data.is_empty() {
            return;
        }
        let words = buffer.size / 4;
        let source = self.upload(bytemuck::cast_slice::<T, u32>(data));
        self.copy(&source, 0, buffer, at * words, size_of_val(data) / 4);
    }

    fn copy(&self, from: &Buffer, begin: usize, to: &Buffer, at: usize, words: usize) {
        let whole = |b: &Buffer| Buffer { handle: b.handle.clone(), len: b.bytes() / 4, size: 4 };
        // SAFETY: the kernel checks its bounds against `words`, and callers stay within the buffers.
        #[allow(unsafe_code)]
        unsafe {
            paste::launch_unchecked::<R>(
                &self.client,
                grid(words.div_ceil(BLOCK as usize)),
                CubeDim::new_1d(BLOCK),
                words as u32,
                begin as u32,
                at as u32,
                whole(from).arg(),
                whole(to).arg(),
            );
        }
    }
}

/// Most blocks along an axis of a grid. Kernels that look up the world of their block are launched with no more: a
/// grid of rows has blocks beyond those asked for.
pub const MOST_BLOCKS: usize = 65_535;

/// A grid of at least `blocks` blocks.
pub fn grid(blocks: usize) -> CubeCount {
    let rows = blocks.div_ceil(MOST_BLOCKS).max(1);
    CubeCount::Static(blocks.div_ceil(rows).max(1) as u32, rows as u32, 1)
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
fn paste(n: u32, begin: u32, at: u32, from: &Array<u32>, to: &mut Array<u32>) {
    let i = u32::cast_from(ABSOLUTE_POS);
    if i < n {
        to[(at + i) as usize] = from[(begin + i) as usize];
    }
}

/// Bytes of four words.
pub const QUAD: usize = size_of::<[u32; 4]>();
