//! Runs that go wrong by what scenes say, without anything being tampered with: stopped early, with the particle, its
//! place and contacts, the likely cause and advice; what was kept before stays good, and other worlds of a batch go on.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fmt::Write as _;
use std::fs;

use cli_common::Place;
use glebe::engine::state::State;
use glebe::io::checkpoint;

/// Two rocks of 1 km come together.
const ROCKS: &str = r#"gravity = [0, 0, 0]

[domain]
min = [0, 0, 0]
max = ["10 km", "10 km", "10 km"]
sides = { x = "wall", y = "wall", z = "wall" }
material = "rock"

[time]
step = "1 s"
force = true

[material.rock]
density = 2500
youngs_modulus = "10 MPa"
poissons_ratio = 0.3
restitution = 0.5
friction = 0.5

[particles.one]
material = "rock"
count = 1
radius = "1 km"
fill = "lattice"
region = { min = [2990, 4000, 4000], max = [4990, 6000, 6000] }
velocity = [1, 0, 0]

[particles.two]
material = "rock"
count = 1
radius = "1 km"
fill = "lattice"
region = { min = [5010, 4000, 4000], max = [7010, 6000, 6000] }
velocity = [-1, 0, 0]

[[stage]]
name = "meet"
duration = "200 s"

[output]
series = "10 s"
"#;

/// What goes wrong, by which values of the scene.
const WRONG: [(&str, &[&str]); 5] = [
    ("too fast for their stiffness", &["particles.one.velocity.0=20"]),
    ("too large a step", &["time.step=400 s", "stage.meet.duration=4000"]),
    (
        "an explosion, where deep overlaps are allowed",
        &["time.step=200 s", "time.overlap_limit=warn", "stage.meet.duration=4000"],
    ),
    ("through a surface in one step", &["particles.one.velocity.0=2e4"]),
    (
        "a force that single precision does not hold",
        &[
            "time.step=1e-17",
            "stage.meet.duration=1e-15",
            "output.series=1e-16",
            "material.rock.density=1e18",
            "material.rock.youngs_modulus=1e18",
            "particles.one.velocity.0=1e18",
            "particles.two.velocity.0=-1e18",
        ],
    ),
];

/// The line that says how a run failed.
fn failure(text: &str) -> &str {
    text.lines().find_map(|line| line.strip_prefix("error: ")).unwrap()
}

#[test]
fn every_failure_is_told_and_leaves_the_last_checkpoint_good() {
    let place = Place::new();
    place.write("scene.toml", ROCKS);
    let mut table = String::new();
    for (what, sets) in WRONG {
        let mut run = vec!["run", "scene.toml", "--no-cache", "--device", "cpu", "--checkpoint-every", "0"];
        run.extend(sets.iter().flat_map(|set| ["--set", set]));
        let ended = place.glebe(&[&run[..], &["--force"]].concat());
        ended.expect(1).says(&["series, frames and checkpoints up to here are in"]);
        let told = failure(&ended.stderr);
        writeln!(table, "## {what}\n{told}\n").unwrap();
        let summary = place.summary("out");
        assert_eq!((&summary["status"], &summary["reason"]), (&"failed".into(), &told.into()), "{what}");
        // A run that goes on from what was kept comes to the same end.
        for kept in fs::read_dir(place.path("out/checkpoint")).unwrap() {
            let kept = checkpoint::read(&kept.unwrap().path()).unwrap();
            let state = State::from_bytes(&kept.state).unwrap();
            assert!(state.particles.velocity.iter().all(|v| v.v.iter().all(|x| x.is_finite())), "{what}");
        }
        let again = place.glebe(&[&run[..], &["--resume"]].concat());
        again.expect(1).says(&["resumed at"]);
        assert_eq!(failure(&again.stderr), told, "{what}");
    }
    insta::assert_snapshot!(table);
}

#[test]
fn in_a_batch_only_those_that_go_wrong_end_early() {
    let place = Place::new();
    place.write("scene.toml", ROCKS);
    let study = "scene = \"scene.toml\"\nsampler = \"list\"\n\
                 [vary.speed]\npath = \"particles.one.velocity.0\"\nvalues = [1, 20, 1, 2e4, 1e18, 1]\n\
                 [vary.other]\npath = \"particles.two.velocity.0\"\nvalues = [-1, -1, -1, -1, -1e18, -2]\n\
                 [vary.density]\npath = \"material.rock.density\"\nvalues = [2500, 2500, 2500, 2500, 1e18, 2500]\n\
                 [vary.stiffness]\npath = \"material.rock.youngs_modulus\"\nvalues = [1e7, 1e7, 1e7, 1e7, 1e18, 1e7]\n\
                 [vary.step]\npath = \"time.step\"\nvalues = [1, 1, 1, 1, 1e-17, 1]\n\
                 [vary.time]\npath = \"stage.meet.duration\"\nvalues = [200, 200, 200, 200, 1e-15, 200]\n";
    place.write("study.toml", study);
    let summary =
        place.glebe(&["sweep", "study.toml", "--no-cache", "--device", "cpu", "--json"]).expect(0).json();
    let worlds = summary["worlds"].as_array().unwrap();
    let status: Vec<_> = worlds.iter().map(|w| w["status"].as_str().unwrap()).collect();
    assert_eq!(status, ["done", "failed", "done", "failed", "failed", "done"]);
    assert_eq!(worlds[0]["state_hash"], worlds[2]["state_hash"]);
    for (world, word) in [(1, "overlaps particle 1"), (3, "moves more than"), (4, "not a number")] {
        assert!(worlds[world]["reason"].as_str().unwrap().contains(word), "{}", worlds[world]["reason"]);
    }
    place.glebe(&["run", "scene.toml", "--no-cache", "--device", "cpu", "--out", "alone"]).expect(0);
    assert_eq!(worlds[0]["state_hash"], place.hash("alone"), "as if alone");
}
