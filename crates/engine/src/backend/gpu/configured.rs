//! What CubeCL is told before it is first used. By itself it takes its configuration from a `cubecl.toml` or `burn.toml` in
//! the working directory or above it, and from the environment. Kernels that files of other programs change are not those
//! that were tested, so it is given its defaults.

use std::sync::Arc;

use cubecl::config::{CubeClRuntimeConfig, RuntimeConfig};

/// Configures CubeCL, unless the program that this is a part of has.
pub fn configure() {
    CubeClRuntimeConfig::storage().lock().get_or_insert_with(|| Arc::new(CubeClRuntimeConfig::default()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubecl_has_its_defaults() {
        configure();
        let found = format!("{:?}", CubeClRuntimeConfig::get());
        assert_eq!(found, format!("{:?}", CubeClRuntimeConfig::default()));
    }
}
