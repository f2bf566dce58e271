//! Runs the program as users do.

#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "helpers of tests fail by panicking, and no test uses all"
)]

pub mod disk;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant, SystemTime};

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

    /// Runs a command that goes on where it was, until it ends, and kills it so many times before: in turn at a time by
    /// chance, and as soon as a file is half-written in each of the `folders`. Tells how often one was left so in each.
    pub fn killed_again_and_again(&self, args: &[&str], folders: &[&str], kills: usize) -> Vec<usize> {
        let (mut killed, mut torn) = (0, vec![0; folders.len()]);
        let begun = Instant::now();
        loop {
            let mut child = self.command(args).spawn().unwrap();
            let (started, at) = (Instant::now(), Duration::from_millis(some_number(60).into()));
            let folder = (killed % (folders.len() + 1)).checked_sub(1);
            while child.try_wait().unwrap().is_none() {
                let due = match folder {
                    None => started.elapsed() >= at,
                    Some(k) => {
                        started.elapsed() >= Duration::from_millis(20) && self.half_written(folders[k])
                    }
                };
                if due && killed < kills {
                    child.kill().unwrap();
                }
            }
            let ended = Ended::of(&child.wait_with_output().unwrap());
            if ended.code == 0 {
                assert!(2 * killed > kills, "it was killed {killed} times only");
                return torn;
            }
            ended.expect(-1);
            if let Some(k) = folder {
                torn[k] += usize::from(self.half_written(folders[k]));
            }
            killed += 1;
            assert!(begun.elapsed() < Duration::from_secs(60), "no end after {killed} kills");
        }
    }

    /// Whether a file is being written in a folder, or was when its writer was killed.
    fn half_written(&self, folder: &str) -> bool {
        let partial = |e: fs::DirEntry| e.file_name().to_string_lossy().starts_with(".glebe-partial-");
        fs::read_dir(self.path(folder)).is_ok_and(|all| all.flatten().any(partial))
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

/// A number below `end` that is another in every run of the test.
pub fn some_number(end: u32) -> u32 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().subsec_micros() % end
}

/// Sends a signal, such as `-INT`, to a program that runs.
pub fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

/// The scene of a ball above a floor without gravity, with `stages` and what they leave.
pub fn ball_with(stages: &str) -> String {
    const BALL: &str = r#"
[domain]
min = [-0.05, -0.05, 0]
max = [0.05, 0.05, 0.1]
sides = { x = "open", y = "open", z = "open" }
material = "ball"

[time]
step = "4 us"

[material.ball]
density = 2500
youngs_modulus = "5 MPa"
poissons_ratio = 0.3
restitution = 0.6
friction = 0.3

[particles.ball]
material = "ball"
count = 1
radius = "10 mm"
fill = "lattice"
velocity = [0, 0, -1]
region = { min = [-0.01, -0.01, 0.0005], max = [0.01, 0.01, 0.0205] }

[geometry.floor]
plane = { point = [0, 0, 0], normal = [0, 0, 1] }
material = "ball"

"#;
    [BALL, stages].concat()
}

/// Eighty soft grains, periodic along all axes.
pub const SAMPLE: &str = r#"
gravity = [0, 0, 0]

[domain]
min = [0, 0, 0]
max = ["11.5 mm", "11.5 mm", "11.5 mm"]
sides = { x = "periodic", y = "periodic", z = "periodic" }

[material.grain]
density = "2650 kg/m^3"
youngs_modulus = "50 MPa"
poissons_ratio = 0.3
restitution = 0.2
friction = 0.5

[contact]
local_damping = 0.3

[particles.grains]
material = "grain"
count = 80
radius = { uniform = ["1 mm", "1.5 mm"] }
fill = "dense"

[[stage]]
name = "compress"
cell = { stress = { xx = "100 kPa", yy = "100 kPa", zz = "100 kPa" }, inertial_number = 0.05 }
until = { stress_within = 0.01, at_most = "1 s" }
"#;
