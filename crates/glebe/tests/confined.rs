//! What a run may touch: its own folder and the cache of beds, no network, no other program.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;
use std::path::{Path, PathBuf};

use cli_common::{Place, SCENE};

/// Names of a scene become parts of file names; none leads out of the run's folder.
#[test]
fn names_do_not_lead_out_of_the_folder() {
    let place = Place::new();
    let away = "../../../away";
    let scene = SCENE
        .replace("[geometry.block]", &format!("[geometry.\"{away}\"]"))
        .replace("move.block", &format!("move.\"{away}\""))
        .replace("\"block\"", &format!("\"{away}\""))
        .replace("\"block.draught\"", &format!("\"{away}.draught\""))
        .replace("measure.draught_force", &format!("measure.\"{away}\""))
        .replace("name = \"push\"", &format!("name = \"{away}\""))
        .replace(", over_displacement = [0.05, 0.12]", "")
        .replace("\"0.5 s\"", "\"0.02 s\"")
        .replace("\"0.3 s\"", "\"0.02 s\"")
        .replace("\"50 ms\"", "\"5 ms\"");
    fs::create_dir_all(place.path("a/b/c/d")).unwrap();
    place.write("a/b/c/d/scene.toml", scene);
    place.glebe(&["run", "a/b/c/d/scene.toml", "--device", "cpu"]).expect(0);
    let listing = place.listing();
    let folders = ["a", "a/b", "a/b/c", "a/b/c/d", "a/b/c/d/scene.toml", "cache"];
    let stray = |name: &&String| {
        !folders.contains(&name.as_str()) && !name.starts_with("a/b/c/d/out") && !name.starts_with("cache/")
    };
    assert_eq!(listing.iter().filter(stray).collect::<Vec<_>>(), Vec::<&String>::new());
    let shows = |part: &str| listing.iter().any(|name| name.contains("away") && name.contains(part));
    assert!(shows(".vtp") && shows(".svg"), "{listing:?}");
}

/// Names of what varies head columns and name plots.
#[test]
fn names_of_a_study_are_no_paths() {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    let study = "scene = \"scene.toml\"\n[vary.\"../away\"]\npath = \"material.soil.density\"\nvalues = [1400, 1800]\n";
    place.write("study.toml", study);
    let before = place.listing();
    place.glebe(&["sweep", "study.toml"]).expect(2).says(&["`../away` cannot be the name of a parameter"]);
    assert_eq!(place.listing(), before);
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// No crate of this repository has the means to open a socket or to start a program.
#[test]
fn nothing_reaches_for_the_network_or_a_shell() {
    const MEANS: [&str; 7] =
        ["std::net", "TcpStream", "UdpSocket", "UnixStream", "process::Command", "Command::new", "libc::"];
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for entry in fs::read_dir(crates).unwrap() {
        sources(&entry.unwrap().path().join("src"), &mut files);
    }
    assert!(files.len() > 100, "only {} sources found", files.len());
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        for means in MEANS {
            assert!(!text.contains(means), "{} holds `{means}`", file.display());
        }
    }
}
