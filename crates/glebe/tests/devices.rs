//! What happens when a device is missing, too small, or lost in the middle of a run.

#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::fs;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use cli_common::{Ended, Place, SCENE, series};
use glebe::engine::backend::Backend;
use glebe::engine::backend::gpu::{Accelerator, Choice};
use glebe::io::output::summary::Status;
use glebe::io::scene::Scene;
use glebe::io::study::Study;
use glebe::run::{Existing, Listener, Pulse, Settings, run};
use glebe::study::sweep::{self, Plan};

/// Less of the scene, for devices that are programs.
const SHORT: [&str; 6] = [
    "--set",
    "stage.settle.until.at_most=0.01",
    "--set",
    "stage.push.duration=0.02",
    "--set",
    "stage.push.measure.draught_force.over_displacement=[0.002, 0.008]",
];

/// Whether there is an adapter; without one what needs it is skipped aloud, and fails in CI.
fn has_adapter(place: &Place) -> bool {
    let listing = place.glebe(&["devices", "--json"]).json();
    let has = listing["devices"].as_array().unwrap().iter().any(|d| d["name"] == "gpu:0");
    assert!(has || std::env::var_os("CI").is_none(), "{listing:#}");
    if !has {
        eprintln!("SKIPPED: there is no adapter");
    }
    has
}

fn scene() -> Place {
    let place = Place::new();
    place.write("scene.toml", SCENE);
    place
}

#[test]
#[cfg(target_os = "linux")]
fn a_missing_driver_or_loader_is_told_with_what_to_install() {
    let place = scene();
    place.write("libvulkan.so.1", "no library");
    let nowhere = ("VK_DRIVER_FILES", "/nonexistent/driver.json");
    let broken = ("LD_LIBRARY_PATH", place.path("").to_str().unwrap().to_owned());
    let cases: [(&str, String, &str, &str); 2] = [
        (nowhere.0, nowhere.1.to_owned(), "icd.d", "mesa-vulkan-drivers"),
        (broken.0, broken.1, "libvulkan.so.1 is not installed", "apt-get install libvulkan1"),
    ];
    for (name, value, why, remedy) in cases {
        let with = |args: &[&str]| Ended::of(&place.command(args).env(name, &value).output().unwrap());
        let ended = with(&["run", "scene.toml", "--device", "gpu:0"]);
        ended.expect(2).says(&["What to do:"]);
        // A machine of NVIDIA's is told of its own driver.
        if !ended.stderr.contains("NVIDIA device") {
            ended.says(&[why, remedy]);
        }
        assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
        assert!(!place.path("out").exists());
        // Nothing is missing for the CPU.
        with(&["check", "scene.toml"]).expect(0).says(&["device: cpu"]);
        with(&["devices"]).expect(0);
    }
}

#[test]
fn a_device_is_refused_before_particles_are_placed() {
    let place = scene();
    // Placing them would take minutes.
    let crowd = ["--set", "particles.bed.count=2000000000", "--set", "particles.bed.radius=1e-4"];
    let began = Instant::now();
    for verb in ["run", "check"] {
        let on =
            |device: &str| place.glebe(&[&[verb, "scene.toml", "--device", device], &crowd[..]].concat());
        on("gpu:1000").expect(2).says(&["cannot be used", "What to do:"]);
        on("cuda:1000").expect(2).says(&["cannot be used", "What to do:"]);
        if has_adapter(&place) {
            on("gpu:0").expect(2).says(&["2000000000 particles", "more than the 1073741823", "--device cpu"]);
        }
    }
    assert!(began.elapsed() < Duration::from_secs(40), "{:?}", began.elapsed());
    assert!(!place.path("out").exists());
}

#[test]
fn check_tells_the_memory_that_a_device_needs() {
    let place = scene();
    if !has_adapter(&place) {
        return;
    }
    let bytes = |count: &str| {
        let set = format!("particles.bed.count={count}");
        let args = ["check", "scene.toml", "--device", "gpu:0", "--json", "--set", &set];
        let found = place.glebe(&args).expect(0).json();
        assert!(found["device_memory_bytes"].is_null() || found["device_memory_bytes"].as_u64() > Some(0));
        found["memory_bytes"].as_f64().unwrap()
    };
    let (few, many) = (bytes("100"), bytes("900"));
    assert!(few > 1e5 && many > 1.5 * few, "{few} and {many} bytes");
    let text = place.glebe(&["check", "scene.toml", "--device", "gpu:0"]);
    assert!(text.expect(0).stdout.contains("memory     at least"), "{}", text.stdout);
}

#[test]
fn settings_of_cubecl_beside_a_scene_change_nothing() {
    let place = scene();
    if !has_adapter(&place) {
        return;
    }
    let run = |out: &str| {
        let args = ["run", "scene.toml", "--no-cache", "--device", "gpu:0", "--out", out];
        place.glebe(&[&args[..], &SHORT].concat()).expect(0);
        place.summary(out)["state_hash"].clone()
    };
    let alone = run("alone");
    // It would check bounds in kernels that are made without, and write their sources down.
    let log = place.path("kernels.log");
    let settings = format!(
        "[compilation]\ncheck_mode = \"validate\"\n[compilation.logger]\nlevel = \"full\"\nfile = {:?}\n",
        log.to_str().unwrap()
    );
    place.write("cubecl.toml", &settings);
    assert_eq!(run("beside"), alone);
    assert!(!log.exists(), "CubeCL took the settings");
    // With one that it cannot read it would end the program.
    place.write("cubecl.toml", "[compilation");
    assert_eq!(run("broken"), alone);
    fs::remove_file(place.path("cubecl.toml")).unwrap();
    place.write("burn.toml", "cubecl = 3");
    assert_eq!(run("burn"), alone);
}

/// Held by tests that lose the device: those of one process share it.
static DEVICE: Mutex<()> = Mutex::new(());

/// Loses its device after so many samples.
struct Loses {
    accelerator: Accelerator,
    samples: u32,
    told: String,
}

impl Listener for Loses {
    fn note(&mut self, line: &str) {
        self.told += line;
    }
    fn pulse(&mut self, _: &Pulse<'_>) {
        if self.samples == 1 {
            self.accelerator.give_up();
        }
        self.samples = self.samples.saturating_sub(1);
    }
}

/// A run with a checkpoint every 5 ms, on the first device.
fn on_device(
    place: &Path,
    out: &str,
    existing: Existing,
    samples: u32,
) -> (glebe::io::output::summary::Summary, String) {
    let sets: Vec<String> = SHORT.iter().skip(1).step_by(2).map(|s| (*s).to_owned()).collect();
    let scene = Scene::load(&place.join("scene.toml"), &sets).unwrap();
    let world = scene.build(place).unwrap().world;
    let accelerator = Accelerator::open(Choice::Adapter(0)).unwrap();
    let settings = Settings {
        backend: Backend::Gpu(accelerator),
        existing,
        checkpoint_time: Some(0.005),
        ..Settings::new(place.join(out))
    };
    let mut listener = Loses { accelerator, samples, told: String::new() };
    (run(world, &settings, &mut listener).unwrap(), listener.told)
}

#[test]
fn a_run_that_loses_its_device_says_so_and_goes_on_from_its_checkpoint() {
    let place = scene();
    if !has_adapter(&place) {
        return;
    }
    let _alone = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = place.path("");
    let (whole, _) = on_device(&folder, "whole", Existing::Refuse, u32::MAX);
    assert_eq!(whole.status, Status::Done);

    let (lost, _) = on_device(&folder, "parts", Existing::Refuse, 17);
    assert_eq!(lost.status, Status::Failed);
    let reason = lost.reason.clone().unwrap();
    assert!(reason.contains("the device failed: it was lost"), "{reason}");
    assert_eq!(lost.state_hash, "", "nothing is known of the state");
    // What was written is whole: every row has its columns, every frame that is listed is there.
    let rows = series(&place.path("parts"));
    assert!(rows.rows() >= 17);
    let time = rows.column("time").unwrap();
    assert!(time.windows(2).all(|pair| pair[0] < pair[1]));
    let pvd = fs::read_to_string(place.path("parts/frames.pvd")).unwrap();
    for file in pvd.split("file=\"").skip(1).filter_map(|part| part.split('"').next()) {
        assert!(place.path("parts").join(file).is_file(), "{file}");
    }
    assert_eq!(place.summary("parts")["status"], "failed");

    let (resumed, told) = on_device(&folder, "parts", Existing::Resume, u32::MAX);
    assert!(told.contains("resumed at t = 0.01"), "{told}");
    assert_eq!((resumed.status, &resumed.state_hash), (Status::Done, &whole.state_hash));
    let bytes = |name: &str| fs::read(place.path(name)).unwrap();
    assert_eq!(bytes("parts/series.csv"), bytes("whole/series.csv"), "the series has a seam");
}

/// A sweep of two worlds on the first device.
fn sweep_on_device(place: &Place, out: &str, existing: Existing, samples: u32) -> sweep::Summary {
    let plan = Plan::new(Study::load(&place.path("study.toml"), &[]).unwrap(), || false).unwrap().unwrap();
    let accelerator = Accelerator::open(Choice::Adapter(0)).unwrap();
    let settings = sweep::Settings {
        backend: Backend::Gpu(accelerator),
        existing,
        checkpoint_every: Duration::ZERO,
        ..sweep::Settings::new(place.path(out))
    };
    sweep::run(&plan, &settings, &mut Loses { accelerator, samples, told: String::new() }).unwrap()
}

#[test]
fn a_sweep_that_loses_its_device_leaves_its_worlds_for_later() {
    let place = Place::new();
    place.write("scene.toml", SCENE.replace("\"0.5 s\"", "0.01").replace("\"0.3 s\"", "0.02"));
    place.write(
        "study.toml",
        "scene = \"scene.toml\"\n[vary.density]\npath = \"material.soil.density\"\nvalues = [2000, 2200]\n",
    );
    if !has_adapter(&place) {
        return;
    }
    let _alone = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let whole = sweep_on_device(&place, "whole", Existing::Refuse, u32::MAX);
    assert_eq!((whole.status, whole.counts.done), (Status::Done, 2));

    let lost = sweep_on_device(&place, "parts", Existing::Refuse, 7);
    assert_eq!((lost.status, lost.counts.interrupted), (Status::Failed, 2));
    let reason = lost.reason.unwrap();
    assert!(reason.contains("the device failed: it was lost"), "{reason}");
    for world in &lost.worlds {
        assert_eq!((&world.state_hash, world.reason.as_ref()), (&None, Some(&reason)));
    }

    let resumed = sweep_on_device(&place, "parts", Existing::Resume, u32::MAX);
    assert_eq!((resumed.status, &resumed.reason), (Status::Done, &None));
    let hashes = |summary: &sweep::Summary| -> Vec<_> {
        summary.worlds.iter().map(|world| world.state_hash.clone().unwrap()).collect()
    };
    assert_eq!(hashes(&resumed), hashes(&whole));
    let table = |out: &str| fs::read(place.path(out).join("worlds.csv")).unwrap();
    assert_eq!(table("parts"), table("whole"));
}

#[test]
fn a_checkpoint_goes_on_on_another_device_and_says_that_bits_differ() {
    let place = scene();
    if !has_adapter(&place) {
        return;
    }
    let run = |device: &str, out: &str, more: &[&str]| {
        let args =
            ["run", "scene.toml", "--no-cache", "--device", device, "--out", out, "--checkpoint-every", "0"];
        place.glebe(&[&args[..], &SHORT, more].concat())
    };
    for (first, second) in [("cpu", "gpu:0"), ("gpu:0", "cpu")] {
        let out = format!("{}-first", first.replace(':', ""));
        run(first, &out, &[]).expect(0);
        // As if it had been stopped there: the last checkpoints and the summary are gone.
        let folder = place.path(&out).join("checkpoint");
        let mut kept: Vec<_> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
        kept.sort();
        fs::remove_file(kept.pop().unwrap()).unwrap();
        fs::remove_file(place.path(&out).join("summary.json")).unwrap();
        let ended = run(second, &out, &["--resume"]);
        ended.expect(0).says(&["resumed at", "the bits differ"]);
        let summary = place.summary(&out);
        assert_eq!(summary["status"], "done");
        assert!(summary["device"].as_str().unwrap().starts_with(second), "{summary:#}");
        let told = summary["warnings"].as_array().unwrap();
        assert!(told.iter().any(|w| w.as_str().unwrap().contains("is continued on")), "{told:?}");
        let rows = series(&place.path(&out));
        let time = rows.column("time").unwrap();
        assert!(time.windows(2).all(|pair| pair[0] < pair[1]), "the series has a seam");
    }
}
