//! Parsers meet broken files: what is made of the seeds in `fuzz/seeds` by chance is read or refused, but never ends
//! the program and never takes long. The same parsers are the targets in `fuzz`, for which more time is taken by hand.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

use std::fs;
use std::panic::catch_unwind;
use std::path::Path;
use std::time::{Duration, Instant};

use glebe_engine::backend::Backend;
use glebe_engine::batch::{Batch, Blind};
use glebe_engine::state::State;
use glebe_io::checkpoint::{self, Header};
use glebe_io::mesh::{self, Transform};
use glebe_io::scene::Scene;
use glebe_io::study::measured::{self, Headings};
use glebe_io::study::{Calibration, Study};
use glebe_io::units::Dimension;
use glebe_io::{particles, poses};
use sha2::{Digest, Sha256};

/// Files made of each seed, if `GLEBE_MUTATIONS` does not say how many.
const ROUNDS: u64 = 1500;
/// Longest time that one of them may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// SplitMix64 (Steele, Lea and Flood 2014).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Words that parsers trip over.
const WORDS: [&str; 16] = [
    "-1",
    "0",
    "nan",
    "inf",
    "1e308",
    "-1e-308",
    "18446744073709551615",
    "9223372036854775808",
    "4294967296",
    "\"",
    "[[[[[[",
    "{",
    "<",
    "é",
    "\u{feff}",
    "\n",
];

/// A file with a few things changed: bytes, stretches, words, and parts of another file.
fn mutated(seed: &[u8], other: &[u8], chance: &mut Chance) -> Vec<u8> {
    let mut file = seed.to_vec();
    for _ in 0..=chance.below(4) {
        let at = chance.below(file.len() + 1);
        let end = (at + chance.below(12)).min(file.len());
        match chance.below(8) {
            0 if at < file.len() => file[at] ^= 1 << chance.below(8),
            1 if at < file.len() => file[at] = chance.next() as u8,
            2 => drop(file.drain(at..end)),
            3 => file.truncate(at),
            4 => {
                let far = (at + chance.below(200)).min(file.len());
                let stretch = file[at..far].repeat(1 + chance.below(3));
                file.splice(at..at, stretch);
            }
            5 => {
                let from = chance.below(other.len());
                let to = (from + chance.below(100)).min(other.len());
                file.splice(at..end, other[from..to].iter().copied());
            }
            6 => {
                // A number where a number was.
                let digit = |b: &u8| b.is_ascii_digit();
                let Some(start) = file[at..].iter().position(digit).map(|n| at + n) else { continue };
                let end = file[start..].iter().position(|b| !digit(b)).map_or(file.len(), |n| start + n);
                file.splice(start..end, WORDS[chance.below(9)].bytes());
            }
            _ => drop(file.splice(at..end, WORDS[chance.below(WORDS.len())].bytes())),
        }
    }
    file
}

/// Seeds by name: the files of a folder of `fuzz/seeds`.
fn seeds(folder: &str) -> Vec<(String, Vec<u8>)> {
    files("seeds", folder)
}

fn files(kind: &str, folder: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz").join(kind).join(folder);
    let mut all: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), fs::read(path).unwrap()))
        .collect();
    all.sort();
    all
}

/// Gives the parser what is made of each seed. `read` tells whether it was accepted; seeds themselves must be.
fn torment(name: &str, seeds: &[(String, Vec<u8>)], read: fn(&[u8]) -> bool) {
    let rounds = std::env::var("GLEBE_MUTATIONS").map_or(ROUNDS, |n| n.parse().unwrap());
    for (k, (file, seed)) in seeds.iter().enumerate() {
        assert!(read(seed), "{name}: the seed {file} is refused");
        let other = &seeds[(k + 1) % seeds.len()].1;
        let mut refused = 0;
        for round in 0..rounds {
            let input = mutated(seed, other, &mut Chance(round << 8 | k as u64));
            let begun = Instant::now();
            let outcome = catch_unwind(|| read(&input));
            let fault = match outcome {
                Err(_) => "ends the program",
                Ok(_) if begun.elapsed() > PATIENCE => "takes too long",
                Ok(accepted) => {
                    refused += u64::from(!accepted);
                    continue;
                }
            };
            let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{round}"));
            fs::write(&kept, &input).unwrap();
            panic!("{name}: {file} changed by round {round} {fault}; it is kept in {}", kept.display());
        }
        assert!(refused > rounds / 10, "{name}: hardly anything made of {file} is refused");
    }
}

fn mesh_is_read(name: &str, bytes: &[u8]) -> bool {
    mesh::parse(Path::new(name), bytes, &Transform::default()).is_ok()
}

fn particles_are_read(bytes: &[u8]) -> bool {
    particles::parse(Path::new("a"), bytes).is_ok()
}

fn poses_are_read(bytes: &[u8]) -> bool {
    poses::parse(Path::new("a"), bytes).is_ok()
}

fn curve_is_read(bytes: &[u8]) -> bool {
    let x = ("displacement", Dimension::LENGTH);
    let headings = Headings { x, y: ("force", Dimension::FORCE), scatter: Some("sd") };
    measured::parse(Path::new("a"), bytes, headings).is_ok()
}

fn scene_is_read(bytes: &[u8]) -> bool {
    str::from_utf8(bytes).is_ok_and(|text| Scene::parse("scene.toml", text, &[]).is_ok())
}

fn set_is_read(bytes: &[u8]) -> bool {
    let scene = include_str!("../../../fuzz/seeds/scene/push.toml");
    str::from_utf8(bytes).is_ok_and(|set| Scene::parse("scene.toml", scene, &[set.to_owned()]).is_ok())
}

/// Over a scene of the seeds.
fn study_is_read(bytes: &[u8]) -> bool {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds/scene");
    str::from_utf8(bytes).is_ok_and(|text| Study::parse("study.toml", text, &folder, &[]).is_ok())
}

/// Over a scene of the seeds.
fn calibration_is_read(bytes: &[u8]) -> bool {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds/scene");
    str::from_utf8(bytes).is_ok_and(|text| Calibration::parse("study.toml", text, &folder, &[]).is_ok())
}

/// With the right checksum: it shields what is behind it from chance, but somebody who means ill gets it right.
fn checkpoint_is_read(bytes: &[u8]) -> bool {
    let signed = [bytes, Sha256::digest(bytes).as_slice()].concat();
    checkpoint::parse(Path::new("a"), &signed).is_ok()
}

#[test]
fn scenes() {
    torment("scene", &seeds("scene"), scene_is_read);
}

#[test]
fn studies() {
    torment("study", &seeds("study"), study_is_read);
    torment("calibration", &seeds("calibration"), calibration_is_read);
}

#[test]
fn set_arguments() {
    torment("set", &seeds("set"), set_is_read);
}

#[test]
fn meshes() {
    torment("stl", &seeds("stl"), |bytes| mesh_is_read("a.stl", bytes));
    torment("obj", &seeds("obj"), |bytes| mesh_is_read("a.obj", bytes));
    torment("ply", &seeds("ply"), |bytes| mesh_is_read("a.ply", bytes));
}

#[test]
fn particle_files() {
    for folder in ["csv", "vtk", "ply-particles"] {
        torment(folder, &seeds(folder), particles_are_read);
    }
}

/// What fuzzing found worth keeping; much of it is broken.
#[test]
fn the_corpus_of_fuzzing_is_read_or_refused() {
    type Reader = fn(&[u8]) -> bool;
    let readers: [(&str, Reader); 13] = [
        ("calibration", calibration_is_read),
        ("checkpoint", checkpoint_is_read),
        ("csv", particles_are_read),
        ("curve", curve_is_read),
        ("obj", |bytes| mesh_is_read("a.obj", bytes)),
        ("ply", |bytes| mesh_is_read("a.ply", bytes)),
        ("poses", poses_are_read),
        ("scene", scene_is_read),
        ("set", set_is_read),
        ("state", |bytes| State::from_bytes(bytes).is_ok()),
        ("stl", |bytes| mesh_is_read("a.stl", bytes)),
        ("study", study_is_read),
        ("vtk", particles_are_read),
    ];
    for (name, read) in readers {
        for (file, bytes) in files("corpus", name) {
            let begun = Instant::now();
            assert!(catch_unwind(|| read(&bytes)).is_ok(), "{name}: {file} ends the program");
            assert!(begun.elapsed() < PATIENCE, "{name}: {file} takes too long");
        }
    }
}

#[test]
fn pose_tables() {
    torment("poses", &seeds("poses"), poses_are_read);
    torment("curve", &seeds("curve"), curve_is_read);
}

/// The bytes of a small state, with contacts that remember something.
fn state() -> Vec<u8> {
    let scene = Scene::parse("push.toml", include_str!("../../../fuzz/seeds/scene/push.toml"), &[]).unwrap();
    let (constants, state) = glebe_engine::prepare(scene.build(Path::new(".")).unwrap().world).unwrap();
    let mut batch = Batch::from_states(vec![(constants, state)], Backend::Cpu);
    for _ in 0..100 {
        batch.advance(&mut Blind).unwrap();
    }
    let state = batch.state(0);
    assert!(!state.contacts.is_empty() && !state.surface_contacts.is_empty());
    state.to_bytes()
}

#[test]
fn states_and_checkpoints() {
    let state = state();
    torment("state", &[("a run".to_owned(), state.clone())], |bytes| State::from_bytes(bytes).is_ok());

    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mutations.glebe");
    let header =
        Header { glebe_version: "0.1.0".to_owned(), device: "cpu".to_owned(), step: 7, ..Header::default() };
    checkpoint::write(&path, &header, &state[..5000]).unwrap();
    let seed = [("a checkpoint".to_owned(), fs::read(&path).unwrap())];
    torment("checkpoint", &seed, |bytes| checkpoint::parse(Path::new("a"), bytes).is_ok());
    let unsigned = seed[0].1[..seed[0].1.len() - 32].to_vec();
    torment("signed checkpoint", &[("a checkpoint".to_owned(), unsigned)], checkpoint_is_read);
}
