//! States as bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = glebe_engine::state::State::from_bytes(data);
});
