//! Scene files.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = str::from_utf8(data) {
        let _ = glebe_io::scene::Scene::parse("scene.toml", text, &[]);
    }
});
