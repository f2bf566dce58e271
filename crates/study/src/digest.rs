//! Digests of what results depend on.

use std::fmt::{self, Debug, Write as _};

use glebe_engine::Constants;
use glebe_engine::state::State;
use sha2::{Digest as _, Sha256};

/// Takes in anything that prints itself. Rust prints floats with as many digits as tell them apart, so
/// equal digests mean equal bits (but for the payload of a NaN, which no checked specification has).
#[derive(Default)]
pub(crate) struct Digest(Sha256);

impl Digest {
    pub(crate) fn debug(mut self, value: &impl Debug) -> Self {
        // Our `write_str` does not fail.
        let _ = write!(self, "{value:?};");
        self
    }

    pub(crate) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.update(bytes);
        self
    }

    pub(crate) fn finish(self) -> String {
        self.0.finalize().iter().fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}

impl fmt::Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text);
        Ok(())
    }
}

/// The digest of a prepared world: equal for scenes that are the same in effect, whatever their files look
/// like, and including the contents of all files that they name.
pub fn scene_hash(constants: &Constants, fresh: &State) -> String {
    Digest::default().debug(&constants.spec).debug(&constants.dt).debug(&fresh.hash()).finish()
}
