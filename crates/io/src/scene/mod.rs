//! Scene files: TOML in, a checked [`Scene`] or every mistake at once, then a world for the engine.
//!
//! `fields.rs` lists every key once, with its kind, range, default and a line of documentation.
//! `check.rs` walks a file along that list, `schema.rs` prints it as a JSON Schema, `set.rs` follows it
//! for `--set`. `tools.rs` has the keys of tools with what they mean, `outputs.rs` those of
//! fields, `doors.rs` those of inlets and outlets, `surveys.rs` reads surveys. `model.rs` makes the typed scene, `build.rs` reads the files that it names.
//!
//! ```
//! use glebe_io::scene::Scene;
//! let text = r#"
//!     [domain]
//!     min = [0, 0, 0]
//!     max = ["50 cm", 0.5, 1]
//!     material = "steel"
//!     [[stage]]
//!     name = "wait"
//!     duraton = "1 s"
//! "#;
//! let errors = Scene::parse("scene.toml", text, &[]).unwrap_err();
//! assert_eq!(errors[0].message(), "`stage.wait` has no key `duraton`");
//! assert!(errors[0].advice().unwrap().starts_with("did you mean `duration`?"));
//! ```

mod build;
pub(crate) mod check;
pub(crate) mod document;
mod doors;
pub(crate) mod error;
pub(crate) mod fields;
mod model;
mod outputs;
mod rewrite;
pub(crate) mod schema;
pub(crate) mod set;
mod shapes;
pub(crate) mod spelling;
mod surveys;
pub(crate) mod table;
mod tools;

use std::path::Path;

pub use build::{BuiltScene, PlacedMesh};
pub use doors::{InletPart, SupplyPart};
pub use error::{Located, Place, SceneError, Source};
pub use model::{
    DomainPart, GeometryPart, GeometryShape, MeasurePart, MotionPart, Origin, PairPart, ParticlePart, Scene,
    StagePart,
};
pub use rewrite::rewritten;
pub use schema::schema;

use check::{Checker, Known};
use document::{Node, Value};

use crate::input;

/// Scenes are read up to this size \[bytes\]: particles and meshes have files of their own.
pub(crate) const MOST_BYTES: u64 = 1 << 20;
/// Mistakes that are told at once.
const MOST_ERRORS: usize = 100;

impl Scene {
    /// Reads the scene file `path` and applies `sets` (`path=value`, see [`Scene::parse`]).
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file.
    pub fn load(path: &Path, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let help = "give the path of a scene file; `glebe new` makes one";
        let text =
            input::read_text(path, MOST_BYTES).map_err(|e| vec![SceneError::unreadable(path, &e, help)])?;
        Self::parse(&path.display().to_string(), &text, sets)
    }

    /// Reads the scene `text`; `name` stands for it in messages.
    ///
    /// Each of `sets` is `path=value` and replaces or adds a value before anything is checked: keys are
    /// joined by dots, stages are addressed by their name, elements of vectors by their index from 0;
    /// texts need no quotes. An example is `stage.till.duration=0.2`.
    ///
    /// # Errors
    /// Everything that is wrong with it, in the order of the file; none of them is a warning. A text that
    /// is not TOML has no other errors.
    pub fn parse(name: &str, text: &str, sets: &[String]) -> Result<Self, Vec<SceneError>> {
        let source = Source::new(name, text);
        let mut root = document::parse(&source).map_err(first)?;
        let misplaced = set::apply(&mut root, &fields::SCENE, sets);
        let known = known(&root);
        let mut checker = Checker { known: &known, found: misplaced };
        let file = checker.table(&root, &fields::SCENE, "");
        let mut scene = model::scene(&file, &mut checker);
        let (warnings, mut errors): (Vec<_>, Vec<_>) =
            checker.found.into_iter().partition(SceneError::is_warning);
        if errors.is_empty() {
            scene.warnings = warnings;
            return Ok(scene);
        }
        // Of the file first, then of each --set in the order given.
        errors.sort_by_key(|e| {
            if e.place().source().name() == name { e.place().span().start } else { usize::MAX }
        });
        Err(first(errors))
    }
}

/// As many errors as people read, and a word about the others.
pub(crate) fn first(mut errors: Vec<SceneError>) -> Vec<SceneError> {
    let more = errors.len().saturating_sub(MOST_ERRORS);
    errors.truncate(MOST_ERRORS);
    if more > 0
        && let Some(last) = errors.last()
    {
        let message = format!("there are {more} more mistakes behind this one");
        errors.push(SceneError::new("more", last.place(), message).help("mend those above first"));
    }
    errors
}

/// The names that a file defines, gathered before anything else is looked at.
fn known(root: &Node) -> Known {
    let names = |key: &str| {
        let entries = root.get(key).map(Node::entries).unwrap_or_default();
        entries.iter().map(|entry| entry.key.value.clone()).collect::<Vec<_>>()
    };
    let mut materials = names("material");
    for built_in in model::built_in() {
        if !materials.contains(&built_in.name) {
            materials.push(built_in.name);
        }
    }
    let stages = match root.get("stage").map(|node| &node.value) {
        Some(Value::Array(stages)) => stages.as_slice(),
        _ => &[],
    };
    let stages = stages.iter().filter_map(|stage| match &stage.get("name")?.value {
        Value::Text(name) => Some(name.clone()),
        _ => None,
    });
    Known { materials, surfaces: names("geometry"), stages: stages.collect(), outlets: names("outlet") }
}
