//! Tables of poses.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = glebe_io::poses::parse("fuzz.csv".as_ref(), data);
});
