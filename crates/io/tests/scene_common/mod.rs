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

/// The scene of a text that must be right.
pub fn good(text: &str, sets: &[String]) -> Scene {
    match Scene::parse("scene.toml", text, sets) {
        Ok(scene) => scene,
        Err(errors) => panic!("{}", all(&errors)),
    }
}

/// The errors of a text that must have some.
pub fn report(text: &str) -> Vec<SceneError> {
    match Scene::parse("scene.toml", text, &[]) {
        Ok(scene) => panic!("nothing was found wrong with {scene:?}"),
        Err(errors) => errors,
    }
}

/// The error of a text that must have exactly one.
pub fn only(text: &str) -> SceneError {
    single(&report(text))
}

/// The one of a list that must have exactly one.
pub fn single(errors: &[SceneError]) -> SceneError {
    assert_eq!(errors.len(), 1, "{}", all(errors));
    errors[0].clone()
}

/// The full texts, one after the other.
pub fn all(errors: &[SceneError]) -> String {
    errors.iter().map(|error| format!("{error:#}")).collect::<Vec<_>>().concat()
}

/// The full text of the only error, which is of the kind.
pub fn full_text(text: &str, kind: &str) -> String {
    let error = only(text);
    assert_eq!(error.kind(), kind);
    format!("{error:#}")
}
