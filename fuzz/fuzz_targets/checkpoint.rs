//! Checkpoint files, and the states in them: as they are, and with the right checksum, which shields what is behind it
//! from chance, but not from somebody who means ill.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};

fuzz_target!(|data: &[u8]| {
    let signed = [data, Sha256::digest(data).as_slice()].concat();
    for bytes in [data, &signed] {
        if let Ok(found) = glebe_io::checkpoint::parse("fuzz.glebe".as_ref(), bytes) {
            let _ = glebe_engine::state::State::from_bytes(&found.state);
        }
    }
});
