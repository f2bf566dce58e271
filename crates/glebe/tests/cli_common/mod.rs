//! Runs the program as users do.

#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests fail by panicking, and no test uses all"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

/// A hundred grains fall into a box, then a block is pushed through them: all parts of a run in a second.
pub const SCENE: &str = r#"
title = "A block through grains"

[domain]
min = [-0.10, -0.05, 0.0]
max = [ 0.10,  0.05, 0.4]
sides = { x = "wall", y = "wall", z = ["wall", "open"] }
material = "wall"

[time]
step = "50 us"

[material.soil]
density = 2000
youngs_modulus = "5 MPa"
poissons_ratio = 0.3
restitution = 0.5
friction = 0.5
static_friction = 0.6
rolling_friction = 0.02

[material.wall]
youngs_modulus = "50 MPa"
poissons_ratio = 0.3
restitution = 0.5
friction = 0.5

[contact]
rolling = "constant-torque"

[particles.bed]
material = "soil"
count = 250
radius = { uniform = ["6 mm", "9 mm"] }
fill = "rain"

[geometry.floor]
plane = { point = [0, 0, 0.001], normal = "z" }
material = "wall"

[geometry.block]
box = { min = [-0.02, -0.02, 0.02], max = [0, 0.02, 0.2] }
material = "wall"
translate = [-0.11, 0, 0]

[[stage]]
name = "settle"
until = { kinetic_energy_below = "1 mJ", at_most = "0.5 s" }

[[stage]]
name = "trim"
remove = { above = 0.08 }

[[stage]]
name = "push"
duration = "0.3 s"
insert = ["block"]
move.block = { velocity = [0.5, 0, 0] }
measure.draught_force = { of = "block.draught", over_displacement = [0.05, 0.12] }

[output]
frames = "50 ms"
series = "1 ms"
"#;

/// A folder of its own with scenes, results and a cache.
pub struct Place {
    folder: TempDir,
}

impl Place {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> &Self {
        fs::write(self.path(name), text).unwrap();
        self
    }

    /// All files below it, sorted.
    pub fn listing(&self) -> Vec<String> {
        let mut names = Vec::new();
        let mut folders = vec![self.folder.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                names.push(path.strip_prefix(self.folder.path()).unwrap().display().to_string());
                if path.is_dir() {
                    folders.push(path);
                }
            }
        }
        names.sort();
        names
    }

    /// The program, to be run in this folder.
    pub fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_glebe"));
        command
            .args(args)
            .current_dir(self.folder.path())
            .env("GLEBE_CACHE", self.path("cache"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    pub fn glebe(&self, args: &[&str]) -> Ended {
        Ended::of(&self.command(args).output().unwrap())
    }

    pub fn summary(&self, out: &str) -> Value {
        json(&fs::read_to_string(self.path(out).join("summary.json")).unwrap())
    }

    pub fn hash(&self, out: &str) -> String {
        self.summary(out)["state_hash"].as_str().unwrap().to_owned()
    }
}

/// How the program ended, and what it said.
#[derive(Debug)]
pub struct Ended {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Ended {
    pub fn of(output: &Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }

    pub fn expect(&self, code: i32) -> &Self {
        assert_eq!(self.code, code, "\n--- stdout\n{}\n--- stderr\n{}", self.stdout, self.stderr);
        self
    }

    pub fn says(&self, parts: &[&str]) -> &Self {
        for part in parts {
            assert!(self.stderr.contains(part), "no `{part}` in:\n{}", self.stderr);
        }
        self
    }

    pub fn json(&self) -> Value {
        json(&self.stdout)
    }
}

pub fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in:\n{text}"))
}

/// Columns of a series, by name.
pub fn series(out: &Path) -> glebe::io::output::series::Series {
    glebe::io::output::series::Series::read(&out.join("series.csv")).unwrap()
}

/// Sends a signal, such as `-INT`, to a program that runs.
pub fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}
