//! Files as VTK, ParaView's library, writes them: in every format and encoding they are read as what they are.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends there")]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glebe_io::mesh::{self, MeshReport, Transform};
use glebe_io::particles;

/// The folder with the files. Without python3 and its `vtk` package there is nothing to read: an error in CI, a
/// notice elsewhere.
fn written_with_vtk(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/write_with_vtk.py");
    let python = std::env::var("GLEBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    match Command::new(python).arg(script).arg(&folder).output() {
        Ok(output) if output.status.success() => Some(folder),
        Ok(output) if output.status.code() != Some(77) => {
            panic!("the script failed: {}", String::from_utf8_lossy(&output.stderr))
        }
        _ => {
            let notice = "VTK's files are not read: needs python3 with the package vtk (run scripts/test)";
            assert!(std::env::var_os("CI").is_none(), "{notice}");
            eprintln!("NOTICE: {notice}");
            None
        }
    }
}

#[test]
fn meshes() {
    let Some(folder) = written_with_vtk("foreign-meshes") else { return };
    let report = |name: &str| mesh::read(&folder.join(name), &Transform::default()).unwrap().1;
    // 24 meridians of 11 points between the poles; two rings of 24 triangles, ten of 48.
    let MeshReport { triangles, vertices, parts, volume, .. } = report("ascii.stl");
    assert_eq!((triangles, vertices, parts), (2 * 24 + 10 * 48, 2 + 11 * 24, 1));
    let volume = volume.unwrap();
    let sphere = 4.0 / 3.0 * std::f64::consts::PI * 0.25f64.powi(3);
    assert!((0.95..1.0).contains(&(volume / sphere)), "{volume}");
    for name in ["binary.stl", "ascii.ply", "binary.ply", "big.ply", "faces.obj"] {
        let other = report(name);
        assert_eq!((other.triangles, other.vertices, other.parts), (triangles, vertices, parts), "{name}");
        // Text is rounded to six digits.
        assert!((other.volume.unwrap() / volume - 1.0).abs() < 1e-5, "{name}");
    }
}

#[test]
fn particles_in_every_encoding() {
    let Some(folder) = written_with_vtk("foreign-particles") else { return };
    let mut read = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.extension().is_none_or(|e| e != "vtu" && e != "vtp") {
            continue;
        }
        if name.starts_with("LZ") {
            let error = particles::read(&path).unwrap_err().to_string();
            assert!(error.contains("DataCompressor` cannot be unpacked: save the file without"), "{error}");
            continue;
        }
        let columns = particles::read(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(columns.len(), 1000, "{name}");
        let materials = BTreeMap::from([("a".to_owned(), 0), ("b".to_owned(), 1)]);
        let set = columns.into_set(&materials, None).unwrap();
        for k in 0..1000 {
            let x = k as f64;
            assert_eq!(set.position[k], [x / 8.0, -x / 16.0, x / 1024.0], "{name}");
            assert_eq!(set.velocity[k], [x, 0.5, -1.0], "{name}");
            assert_eq!(set.spin[k], [0.0, -x, 0.25], "{name}");
            // Text keeps as many digits as a float has.
            assert!((set.radius[k] - (0.0078125 + x / 65536.0)).abs() < 1e-9, "{name}");
            assert_eq!(set.material[k], k % 2, "{name}");
        }
        read += 1;
    }
    assert_eq!(read, 64);
}
