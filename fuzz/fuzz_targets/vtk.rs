//! Particles from VTK's XML.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = glebe_io::particles::parse("fuzz.vtp".as_ref(), data);
});
