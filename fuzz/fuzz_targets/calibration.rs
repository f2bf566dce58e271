//! Calibration files, over a scene of the seeds.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = str::from_utf8(data) {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/seeds/scene");
        let _ = glebe_io::study::Calibration::parse("study.toml", text, folder.as_ref(), &[]);
    }
});
