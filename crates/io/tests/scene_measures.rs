//! What scenes measure besides forces: how classes are mixed, contacts in frames, wear.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used, clippy::panic)]

mod scene_common;

use glebe_engine::spec::{Class, Surveyed};

use glebe_io::scene::{Scene, SceneError};
use scene_common::{EXAMPLE, all, edited, good};

const REGION: &str = "region = { min = [0, 0, 0], max = [\"10 cm\", 0.2, 0.3] }";

fn with(text: &str, sets: &[&str]) -> Scene {
    good(text, &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>())
}

fn attempt(text: &str, set: &str) -> Vec<SceneError> {
    Scene::parse("scene.toml", text, &[set.to_owned()]).map(|scene| panic!("{scene:?}")).unwrap_err()
}

fn wrong(set: &str) -> String {
    all(&attempt(EXAMPLE, set))
}

#[test]
fn a_lacey_index_is_of_a_class_over_samples() {
    let survey = |what: &str| format!("stage.settle.survey={{ mixed = {{ of = \"lacey-index\", {what} }} }}");
    for (class, expected) in
        [("material = \"soil\"", Class::Material(0)), ("radius_above = \"8 mm\"", Class::RadiusAbove(0.008))]
    {
        let scene = with(EXAMPLE, &[&survey(&format!("{REGION}, spacing = \"52 mm\", {class}"))]);
        let index =
            Surveyed::LaceyIndex { class: expected, min: [0.0; 3], max: [0.1, 0.2, 0.3], samples: [2, 4, 6] };
        assert_eq!(scene.stages[0].surveys[0].of, index);
    }
    for (what, part) in [
        (format!("{REGION}, material = \"soil\""), "`survey.mixed` needs `spacing`"),
        (format!("{REGION}, spacing = 0.05"), "`survey.mixed` needs `material`"),
        ("spacing = 0.05, material = \"soil\"".to_owned(), "`survey.mixed` needs `region`"),
        (format!("{REGION}, spacing = 0.05, material = \"steel\""), "`steel` is built in, and no class"),
        (format!("{REGION}, spacing = 1, material = \"soil\""), "has 1 samples"),
        (format!("{REGION}, spacing = 1e-5, material = \"soil\""), "samples"),
        (format!("{REGION}, spacing = 0.05, material = \"soil\", radius_above = 1"), "radius_above"),
    ] {
        let message = wrong(&survey(&what));
        assert!(message.contains(part), "no `{part}` for {what} in {message}");
    }
    let slope = "stage.settle.survey={ a = { of = \"angle-of-repose\", spacing = 0.1 } }";
    assert!(wrong(slope).contains("`survey.a.spacing` means nothing of an angle of repose"));
}

#[test]
fn a_material_wears_by_coefficient_over_hardness() {
    let scene = with(EXAMPLE, &["material.soil.wear={ coefficient = 1e-4, hardness = \"2 GPa\" }"]);
    assert_eq!(scene.materials.len(), scene.wear.len());
    assert_eq!(scene.wear[0], 5e-14);
    assert!(scene.wear[1..].iter().all(|k| *k == 0.0));
    assert!(wrong("material.soil.wear={ coefficient = 1e-4 }").contains("hardness"));
    assert!(wrong("material.soil.wear={ coefficient = -1, hardness = 1e9 }").contains("coefficient"));
}

#[test]
fn contacts_are_shown_in_frames() {
    assert!(!with(EXAMPLE, &[]).network);
    assert!(with(EXAMPLE, &["output.contacts=true", "output.frames=0.02"]).network);
    let errors = attempt(&edited("frames = \"20 ms\"", ""), "output.contacts=true");
    assert!(errors[0].message().contains("contacts are shown in frames"), "{:?}", errors[0]);
}
