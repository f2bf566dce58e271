//! Launches of kernels that are told how many of their blocks should run side by side.
//!
//! A processor's registers are shared by all blocks on it. CUDA's compiler takes as many as it likes for one unit, unless the
//! source says how many blocks are wanted at a time, for which CubeCL 0.10 has no word. So the source that CubeCL writes is
//! given that number here, before it is compiled; sources in other languages have no such place and stay as they are.

use cubecl::prelude::*;
use cubecl::server::{Binding, KernelArguments};
use cubecl::{CompilationError, ir::StorageType};
use cubecl::{Compiler, CubeTask, InfoBuilder};

use super::device::Buffer;

/// The arguments of a kernel, in its order.
#[derive(Default)]
pub struct Arguments {
    info: InfoBuilder,
    buffers: Vec<Binding>,
}

impl Arguments {
    /// Begins with words.
    pub fn of(words: &[u32]) -> Self {
        let mut all = Self::default();
        for word in words {
            all.info.scalars.push(*word);
        }
        all
    }

    /// Adds a buffer.
    pub fn buffer(&mut self, buffer: &Buffer) -> ArrayCompilationArg {
        let lanes = buffer.lanes() as u64;
        self.info.metadata.register_array(buffer.held(), buffer.len as u64 / lanes, AddressType::U32);
        self.buffers.push(buffer.binding());
        ArrayCompilationArg { inplace: None }
    }

    /// Launches `kernel`, of which `beside` blocks of `units` should run on a processor at a time; 0 leaves that open.
    ///
    /// # Safety
    /// The kernel must stay within its buffers and end, and take these arguments.
    #[allow(unsafe_code)]
    pub unsafe fn launch_unchecked<R: Runtime, K: CubeKernel>(
        mut self,
        client: &ComputeClient<R>,
        count: CubeCount,
        kernel: K,
        units: u32,
        beside: u32,
    ) {
        let mut given = KernelArguments::new();
        given.buffers = self.buffers;
        given.info = self.info.finish(AddressType::U32);
        let task = Crowded { task: KernelTask::<R::Compiler, K>::new(kernel), units, beside };
        // SAFETY: as asked of the caller.
        unsafe { client.launch_unchecked(Box::new(task), count, given) }
    }
}

/// The settings of a kernel with blocks of `units`.
pub fn settings(units: u32) -> KernelSettings {
    KernelSettings::default().cube_dim(CubeDim::new_1d(units)).address_type(AddressType::U32)
}

/// A kernel of which so many blocks should run side by side.
struct Crowded<T> {
    task: T,
    units: u32,
    beside: u32,
}

impl<T: KernelMetadata> KernelMetadata for Crowded<T> {
    fn name(&self) -> &'static str {
        self.task.name()
    }

    fn id(&self) -> KernelId {
        self.task.id()
    }

    fn address_type(&self) -> StorageType {
        self.task.address_type()
    }
}

impl<C: Compiler, T: CubeTask<C>> CubeTask<C> for Crowded<T> {
    fn compile(
        &self,
        compiler: &mut C,
        options: &C::CompilationOptions,
        mode: ExecutionMode,
        addresses: StorageType,
    ) -> Result<CompiledKernel<C>, CompilationError> {
        let mut kernel = self.task.compile(compiler, options, mode, addresses)?;
        if self.beside > 0 {
            kernel.source = crowded(&kernel.source, self.units, self.beside);
        }
        Ok(kernel)
    }
}

/// A source in CUDA that says how many blocks should run side by side; any other as it is.
fn crowded(source: &str, units: u32, beside: u32) -> String {
    source.replacen(
        &format!("__launch_bounds__({units})"),
        &format!("__launch_bounds__({units}, {beside})"),
        1,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_says_how_many_blocks_run_side_by_side() {
        let source = "extern \"C\" __global__ void __launch_bounds__(32)step (";
        assert_eq!(crowded(source, 32, 24), "extern \"C\" __global__ void __launch_bounds__(32, 24)step (");
        assert_eq!(crowded(source, 64, 24), source);
        let other = "@compute @workgroup_size(32, 1, 1) fn step() {}";
        assert_eq!(crowded(other, 32, 24), other);
    }
}
