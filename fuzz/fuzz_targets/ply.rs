//! Meshes from PLY.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let _ = glebe_io::mesh::parse("fuzz.ply".as_ref(), data, &glebe_io::mesh::Transform::default());
});
