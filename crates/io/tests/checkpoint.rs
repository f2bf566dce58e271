//! Checkpoint files: what is written comes back, and nothing damaged is taken for good.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::fs;
use std::path::{Path, PathBuf};

use glebe_io::checkpoint::{self, CheckpointError, CheckpointWriter, Header};

/// A fresh folder for one test.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("checkpoint").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

fn header(step: u64) -> Header {
    Header {
        glebe_version: "0.1.0".to_owned(),
        device: "cpu".to_owned(),
        scene_hash: "5ce7e".to_owned(),
        step,
        time: step as f64 * 1.1e-5,
        rows: step / 10,
        frames: step / 100,
        forgetful: false,
        seen: 0,
    }
}

/// Bytes without a pattern that would hide an exchange of two of them.
fn state(seed: u32, length: usize) -> Vec<u8> {
    let mut x = seed;
    let mut next = || {
        x = x.wrapping_mul(1664525).wrapping_add(1013904223);
        (x >> 24) as u8
    };
    (0..length).map(|_| next()).collect()
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_state_comes_back_to_the_bit() {
    let dir = folder("round-trip");
    for (k, length) in [0, 1, 31, 100_000].into_iter().enumerate() {
        let path = dir.join(format!("{k:06}.glebe"));
        checkpoint::write(&path, &header(123), &state(7, length)).unwrap();
        let found = checkpoint::read(&path).unwrap();
        assert_eq!(found.header, header(123));
        assert_eq!(found.state, state(7, length));
        assert!(found.skipped.is_empty());
    }
}

#[test]
fn every_flipped_byte_is_noticed() {
    let dir = folder("flipped");
    let path = dir.join("000000.glebe");
    checkpoint::write(&path, &header(5), &state(1, 300)).unwrap();
    let good = fs::read(&path).unwrap();
    for at in 0..good.len() {
        let mut bad = good.clone();
        bad[at] ^= 0x01;
        fs::write(&path, &bad).unwrap();
        let error = checkpoint::read(&path).expect_err("a flipped bit");
        let expected = match at {
            0..8 => matches!(error, CheckpointError::Foreign { .. }),
            // A length that is wrong can look like a missing end.
            12..24 => matches!(error, CheckpointError::Damaged { .. } | CheckpointError::CutShort { .. }),
            _ => matches!(error, CheckpointError::Damaged { .. }),
        };
        assert!(expected, "byte {at}: {error}");
        assert!(error.to_string().starts_with(path.to_str().unwrap()), "{error}");
    }
}

#[test]
fn every_missing_end_is_noticed() {
    let dir = folder("cut");
    let path = dir.join("000000.glebe");
    checkpoint::write(&path, &header(5), &state(2, 300)).unwrap();
    let good = fs::read(&path).unwrap();
    for length in 0..good.len() {
        fs::write(&path, &good[..length]).unwrap();
        let error = checkpoint::read(&path).expect_err("a missing end");
        assert!(
            matches!(error, CheckpointError::CutShort { found, .. } if found == length as u64),
            "{error}"
        );
    }
    let longer = [good.as_slice(), b"x"].concat();
    fs::write(&path, longer).unwrap();
    assert!(matches!(checkpoint::read(&path), Err(CheckpointError::Damaged { .. })));
}

/// Makes a good file one of a later format.
fn make_newer(path: &Path) {
    change(path, 8, &99_u32.to_le_bytes());
}

/// Writes bytes into a file and signs it anew.
fn change(path: &Path, at: usize, new: &[u8]) {
    use sha2::Digest;

    let mut bytes = fs::read(path).unwrap();
    bytes[at..at + new.len()].copy_from_slice(new);
    let end = bytes.len() - 32;
    let digest = sha2::Sha256::digest(&bytes[..end]);
    bytes[end..].copy_from_slice(&digest);
    fs::write(path, bytes).unwrap();
}

#[test]
fn foreign_and_newer_files_are_told_apart() {
    let dir = folder("foreign");
    let path = dir.join("000000.glebe");
    fs::write(&path, "time,step\n0,0\n".repeat(20)).unwrap();
    assert!(matches!(checkpoint::read(&path), Err(CheckpointError::Foreign { .. })));

    checkpoint::write(&path, &header(5), &state(3, 300)).unwrap();
    make_newer(&path);
    let error = checkpoint::read(&path).unwrap_err();
    assert!(matches!(error, CheckpointError::Newer { found: 99, .. }), "{error}");
    assert!(error.to_string().contains("continue with the newer glebe"), "{error}");
}

#[test]
fn a_state_said_to_be_larger_than_memory_is_not_unpacked() {
    let path = folder("bomb").join("000000.glebe");
    checkpoint::write(&path, &header(5), &state(3, 300)).unwrap();
    change(&path, 24, &(1_u64 << 50).to_le_bytes());
    let error = checkpoint::read(&path).unwrap_err();
    assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
    change(&path, 24, &299_u64.to_le_bytes());
    let error = checkpoint::read(&path).unwrap_err().to_string();
    assert!(error.contains("its state is not 299 bytes long"), "{error}");
}

#[test]
fn the_last_two_are_kept() {
    let dir = folder("last-two").join("checkpoint");
    let mut writer = CheckpointWriter::new(&dir, None).unwrap();
    for step in 0..5 {
        writer.write(&header(step), &state(step as u32, 1000)).unwrap();
    }
    assert_eq!(names(&dir), ["000003.glebe", "000004.glebe"]);
    let found = checkpoint::latest_valid(&dir, "5ce7e").unwrap();
    assert_eq!((found.header.step, found.state), (4, state(4, 1000)));
    assert_eq!(found.path, dir.join("000004.glebe"));
}

#[test]
fn the_one_before_stands_in_for_a_damaged_one() {
    let dir = folder("fall-back");
    let mut writer = CheckpointWriter::new(&dir, None).unwrap();
    for step in 0..3 {
        writer.write(&header(step), &state(step as u32, 1000)).unwrap();
    }
    let newest = dir.join("000002.glebe");
    let bytes = fs::read(&newest).unwrap();
    fs::write(&newest, &bytes[..500]).unwrap();
    let found = checkpoint::latest_valid(&dir, "5ce7e").unwrap();
    assert_eq!((found.header.step, &found.state), (1, &state(1, 1000)));
    assert_eq!(found.skipped.len(), 1);
    assert!(found.skipped[0].contains("000002.glebe: this checkpoint is cut short: it has 500 of"));

    // The good one must survive the next write, and the damaged one must not count as one of two.
    let mut writer = CheckpointWriter::new(&dir, Some(&found.path)).unwrap();
    writer.write(&header(9), &state(9, 1000)).unwrap();
    assert_eq!(names(&dir), ["000001.glebe", "000003.glebe"]);
}

#[test]
fn the_one_before_stands_in_whatever_is_wrong_with_the_newest() {
    type Spoil = fn(&Path);
    let spoils: [(&str, Spoil, &str); 5] = [
        ("cut", |p| fs::write(p, &fs::read(p).unwrap()[..40]).unwrap(), "is cut short"),
        ("empty", |p| fs::write(p, "").unwrap(), "is cut short"),
        ("foreign", |p| fs::write(p, "something else").unwrap(), "is not a checkpoint of glebe"),
        ("newer", make_newer, "has format 99, but this glebe reads formats up to 1"),
        (
            "folder",
            |p| fs::remove_file(p).and_then(|()| fs::create_dir(p)).unwrap(),
            "cannot read this checkpoint",
        ),
    ];
    for (name, spoil, reason) in spoils {
        let dir = folder(&format!("stand-in-{name}"));
        let mut writer = CheckpointWriter::new(&dir, None).unwrap();
        for step in 0..2 {
            writer.write(&header(step), &state(step as u32, 1000)).unwrap();
        }
        spoil(&dir.join("000001.glebe"));
        let found = checkpoint::latest_valid(&dir, "5ce7e").unwrap();
        assert_eq!((found.header.step, &found.state), (0, &state(0, 1000)), "{name}");
        assert!(matches!(&found.skipped[..], [why] if why.contains(reason)), "{name}: {:?}", found.skipped);
        spoil(&dir.join("000000.glebe"));
        let error = checkpoint::latest_valid(&dir, "5ce7e").unwrap_err();
        assert!(matches!(&error, CheckpointError::NoneValid { reasons, .. } if reasons.len() == 2), "{name}");
    }
}

#[test]
fn without_a_usable_one_it_says_why() {
    let dir = folder("none");
    let error = checkpoint::latest_valid(&dir, "5ce7e").unwrap_err();
    assert!(matches!(error, CheckpointError::None { .. }), "{error}");
    let error = checkpoint::latest_valid(&dir.join("absent"), "5ce7e").unwrap_err();
    assert!(matches!(error, CheckpointError::None { .. }), "{error}");

    fs::write(dir.join("000000.glebe"), "").unwrap();
    fs::write(dir.join("000001.glebe"), "something else").unwrap();
    let error = checkpoint::latest_valid(&dir, "5ce7e").unwrap_err();
    assert!(matches!(&error, CheckpointError::NoneValid { reasons, .. } if reasons.len() == 2), "{error}");
    assert!(error.to_string().contains("000001.glebe: this is not a checkpoint of glebe"), "{error}");
}

#[test]
fn another_scene_is_refused_even_if_an_older_file_would_fit() {
    let dir = folder("other-scene");
    let mut writer = CheckpointWriter::new(&dir, None).unwrap();
    writer.write(&header(0), &state(0, 10)).unwrap();
    writer.write(&Header { scene_hash: "07he4".to_owned(), ..header(1) }, &state(1, 10)).unwrap();
    let error = checkpoint::latest_valid(&dir, "5ce7e").unwrap_err();
    assert!(matches!(error, CheckpointError::OtherScene { .. }), "{error}");
    assert!(error.to_string().contains("hash 07he4, the scene given has 5ce7e"), "{error}");
}
