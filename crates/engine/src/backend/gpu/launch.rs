//! Launches of kernels whose source in CUDA says what CubeCL 0.10 has no word for. It is rewritten here, before it is
//! compiled; sources in other languages stay as they are.
//!
//! - A processor's registers are shared by all blocks on it. CUDA's compiler takes as many as it likes for one unit, unless
//!   the source says how many blocks are wanted at a time.
//! - Reciprocals and their roots are one instruction each, with three or four around it for arguments below 10⁻³⁸, of which a
//!   contact has none: it takes them as they are.

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
        if kernel.source.contains(CUDA) {
            kernel.source = short(&crowded(&kernel.source, self.units, self.beside));
        }
        Ok(kernel)
    }
}

/// What a kernel in CUDA begins with.
const CUDA: &str = "extern \"C\" __global__";

/// A source that says how many blocks should run side by side.
fn crowded(source: &str, units: u32, beside: u32) -> String {
    if beside == 0 {
        return source.to_owned();
    }
    source.replacen(
        &format!("__launch_bounds__({units})"),
        &format!("__launch_bounds__({units}, {beside})"),
        1,
    )
}

/// Quotients and inverse roots of arguments from 10⁻³⁸ on.
const SHORT: &str = r#"__device__ __forceinline__ float inverse_root_of(float x) {
    float y;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
}
__device__ __forceinline__ float quotient_of(float a, float b) {
    float y;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(b));
    return a * y;
}
"#;

/// A source whose quick quotients and inverse roots are those of [`SHORT`].
fn short(source: &str) -> String {
    source.replace(" rsqrt(", " inverse_root_of(").replace(" __fdividef(", " quotient_of(").replacen(
        CUDA,
        &format!("{SHORT}{CUDA}"),
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
        assert_eq!(crowded(source, 32, 0), source);
    }

    #[test]
    fn quick_quotients_and_roots_are_short() {
        let source = "#include <a>\nextern \"C\" __global__ void step (const float a = rsqrt(b); c = __fdividef(a, b);";
        let found = short(source);
        assert!(
            found.ends_with("void step (const float a = inverse_root_of(b); c = quotient_of(a, b);"),
            "{found}"
        );
        assert!(found.starts_with("#include <a>\n__device__"), "{found}");
    }
}
