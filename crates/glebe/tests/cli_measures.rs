//! What a run measures of contacts, wear and mixing, from the scene to the files.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests fail by panicking")]

mod cli_common;

use std::process::Command;

use cli_common::{Place, SCENE, series};
use serde_json::Value;

/// How the larger half of the grains is mixed with the smaller one.
const MIXED: &str = "[stage.survey.mixed]
of = \"lacey-index\"
region = { min = [-0.1, -0.05, 0], max = [0.1, 0.05, 0.1] }
spacing = \"30 mm\"
radius_above = \"7.5 mm\"
";

/// The frames of a run as VTK reads them; without python3 and its package `vtk` an error in CI, a notice elsewhere.
fn frames(place: &Place) -> Option<Vec<Value>> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../io/tests/output_vtk.py");
    let python = std::env::var("GLEBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    match Command::new(python).arg(script).arg(place.path("out/frames.pvd")).output() {
        Ok(output) if output.status.success() => Some(serde_json::from_slice(&output.stdout).unwrap()),
        Ok(output) if output.status.code() != Some(77) => {
            panic!("the script failed: {}", String::from_utf8_lossy(&output.stderr))
        }
        _ => {
            let notice = "not read with VTK: needs python3 with the package vtk (run scripts/test)";
            assert!(std::env::var_os("CI").is_none(), "{notice}");
            eprintln!("NOTICE: {notice}");
            None
        }
    }
}

fn numbers(values: &Value) -> Vec<f64> {
    values.as_array().unwrap().iter().map(|x| x.as_str().unwrap().parse().unwrap()).collect()
}

fn column(set: &Value, name: &str) -> Vec<f64> {
    numbers(&set["cell_data"][name]["values"])
}

/// Twice the areas of the triangles of a set.
fn areas(set: &Value) -> Vec<f64> {
    let points = numbers(&set["points"]);
    let at = |k: &Value| {
        let k = 3 * k.as_u64().unwrap() as usize;
        [points[k], points[k + 1], points[k + 2]]
    };
    let area = |t: &Value| {
        let [a, b, c] = [0, 1, 2].map(|k| at(&t[k]));
        let [u, v] = [b, c].map(|p: [f64; 3]| [0, 1, 2].map(|k| p[k] - a[k]));
        let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        0.5 * cross.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    set["polys"].as_array().unwrap().iter().map(area).collect()
}

#[test]
fn wear_of_a_material_that_no_surface_has_is_warned_of() {
    let place = Place::new();
    let wears = "wear = { coefficient = 1e-4, hardness = \"1 GPa\" }";
    let name = |material: &str| format!("[material.{material}]");
    place.write("scene.toml", SCENE.replace(&name("soil"), &format!("{}\n{wears}", name("soil"))));
    place
        .glebe(&["check", "scene.toml"])
        .expect(0)
        .says(&["the material `soil` wears, but no surface has it"]);
    place.write("scene.toml", SCENE.replace(&name("wall"), &format!("{}\n{wears}", name("wall"))));
    let output = place.glebe(&["check", "scene.toml"]);
    output.expect(0);
    assert!(!output.stderr.contains("no surface has it") && !output.stdout.contains("no surface has it"));
}

#[test]
fn frames_show_contacts_and_wear_and_the_summary_has_the_index() {
    let place = Place::new();
    let scene = SCENE
        .replace("frames = \"50 ms\"", "frames = \"50 ms\"\ncontacts = true")
        .replace("at_most = \"0.5 s\" }", &format!("at_most = \"0.2 s\" }}\n{MIXED}"))
        .replace("duration = \"0.3 s\"", "duration = \"0.1 s\"")
        .replace("[material.wall]", "[material.wall]\nwear = { coefficient = 1e-4, hardness = \"1 GPa\" }");
    place.write("scene.toml", scene);
    place.glebe(&["run", "scene.toml", "--no-cache", "--device", "cpu"]).expect(0).says(&[
        "contacts in frames: laws are 0 hertz mindlin constant-torque none none",
        "materials are 0 soil, 1 wall",
    ]);
    let summary = place.summary("out");
    let mixed = &summary["stages"][0]["measures"]["mixed"];
    let index = mixed["mean"].as_f64().unwrap();
    assert!((0.3..1.5).contains(&index) && mixed["n"] == 1, "{mixed}");

    let rows = series(&place.path("out"));
    let [time, contacts, on_surfaces, wear] =
        ["time", "contacts", "surface_contacts", "block.wear"].map(|name| rows.column(name).unwrap());
    assert!(wear.windows(2).all(|pair| pair[0] <= pair[1]) && wear[wear.len() - 1] > 0.0);
    let Some(sets) = frames(&place) else { return };
    let mut seen = [0, 0];
    for set in &sets {
        assert_eq!(set["errors"], serde_json::json!([]), "{}", set["name"]);
        let at: f64 = set["timestep"].as_str().unwrap().parse().unwrap();
        let row = time.iter().position(|t| (t - at).abs() < 1e-9).unwrap();
        if set["name"] == "contacts" {
            seen[0] += 1;
            let surfaces = column(set, "surface");
            let touches = surfaces.iter().filter(|s| **s >= 0.0).count() as f64;
            assert_eq!((touches, surfaces.len() as f64 - touches), (on_surfaces[row], contacts[row]));
            assert_eq!(set["lines"].as_array().unwrap().len(), surfaces.len());
            let (normal, tangential) = (column(set, "normal_force"), column(set, "tangential_force"));
            let force = column(set, "force");
            for (k, f) in force.chunks(3).enumerate() {
                let whole = f.iter().map(|x| x * x).sum::<f64>().sqrt();
                assert!((normal[k].hypot(tangential[k]) - whole).abs() < 1e-5 * whole + 1e-12);
            }
        }
        if set["name"] == "block" {
            seen[1] += 1;
            let lost: f64 = column(set, "wear_depth").iter().zip(areas(set)).map(|(d, a)| d * a).sum();
            assert!((lost - wear[row]).abs() < 1e-9 * wear[row] + 1e-30, "{lost:e} and {:e}", wear[row]);
        }
    }
    assert!(seen[0] > 3 && seen[1] >= 1, "{seen:?}");
}
