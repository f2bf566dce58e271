//! Particles from CSV.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = glebe_io::particles::parse("fuzz.csv".as_ref(), data);
});
