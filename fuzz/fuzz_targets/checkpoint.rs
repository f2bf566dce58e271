//! Checkpoint files, and the states in them.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(found) = glebe_io::checkpoint::parse("fuzz.glebe".as_ref(), data) {
        let _ = glebe_engine::state::State::from_bytes(&found.state);
    }
});
