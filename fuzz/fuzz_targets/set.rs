//! `--set` arguments on a scene.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = str::from_utf8(data) {
        let scene = include_str!("../seeds/scene/push.toml");
        let _ = glebe_io::scene::Scene::parse("scene.toml", scene, &[text.to_owned()]);
    }
});
