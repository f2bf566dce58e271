//! The example of the manual, and ways to break it.

#![allow(dead_code, reason = "each test binary uses its part")]

use glebe_io::scene::{Scene, SceneError};

/// The example of the interface description, to the letter.
pub const EXAMPLE: &str = include_str!("example.toml");

/// The example with `from`, which must be there once, replaced.
pub fn edited(from: &str, to: &str) -> String {
    assert_eq!(EXAMPLE.matches(from).count(), 1, "`{from}` is not there exactly once");
    EXAMPLE.replace(from, to)
}

/// The errors of a text that must have some.
pub fn report(text: &str) -> Vec<SceneError> {
    Scene::parse("scene.toml", text, &[]).expect_err("the scene is wrong")
}

/// The error of a text that must have exactly one.
pub fn only(text: &str) -> SceneError {
    let errors = report(text);
    assert_eq!(errors.len(), 1, "{}", errors.iter().map(|e| format!("{e:#}")).collect::<String>());
    errors[0].clone()
}

/// The full text of the only error, which is of the kind.
pub fn full_text(text: &str, kind: &str) -> String {
    let error = only(text);
    assert_eq!(error.kind(), kind);
    format!("{error:#}")
}
