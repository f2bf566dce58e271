//! A scene file written anew: with values that `--set` would put in, and for another folder; comments and order stay.

use std::path::{Component, Path, PathBuf};

use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, Value};

use super::fields::SCENE;
use super::table::{Kind, TableSpec};

/// The scene `text` with each of `sets` (`path=value`, see [`super::Scene::parse`]) written into it. Files that it names
/// relative to the folder `from` are named relative to `to`. None if it is no scene in which they have a place.
pub fn rewritten(text: &str, sets: &[String], from: &Path, to: &Path) -> Option<String> {
    let mut document: DocumentMut = text.parse().ok()?;
    move_files(document.as_table_mut(), &SCENE, &|path| moved(path, from, to));
    for set in sets {
        let (path, value) = set.split_once('=')?;
        let keys: Vec<String> =
            toml_edit::Key::parse(path).ok()?.iter().map(|k| k.get().to_owned()).collect();
        let value = value.trim().parse::<Value>().unwrap_or_else(|_| Value::from(value.trim()));
        put(document.as_item_mut(), &keys, value)?;
    }
    Some(document.to_string())
}

/// Sets a value at the end of a path, making the tables that lead there.
fn put(item: &mut Item, keys: &[String], value: Value) -> Option<()> {
    let [key, rest @ ..] = keys else {
        // What stands around the old value, such as a comment behind it, stays.
        let mut value = value;
        if let Some(old) = item.as_value() {
            *value.decor_mut() = old.decor().clone();
        }
        *item = Item::Value(value);
        return Some(());
    };
    match item {
        Item::ArrayOfTables(tables) => {
            let named = |t: &Table| t.get("name").and_then(Item::as_str) == Some(key);
            let at = tables.iter().position(named).or_else(|| key.parse().ok())?;
            let table: &mut dyn TableLike = tables.get_mut(at)?;
            put_in(table, rest, value)
        }
        Item::Value(Value::Array(items)) => {
            let named = |v: &Value| {
                v.as_inline_table().and_then(|t| t.get("name")).and_then(Value::as_str) == Some(key)
            };
            let at = items.iter().position(named).or_else(|| key.parse().ok())?;
            put_in_element(items, at, rest, value)
        }
        _ => {
            if !item.is_table_like() {
                *item = Item::Value(Value::InlineTable(InlineTable::new()));
            }
            put_in(item.as_table_like_mut()?, keys, value)
        }
    }
}

fn put_in(table: &mut dyn TableLike, keys: &[String], value: Value) -> Option<()> {
    let [key, rest @ ..] = keys else { return None };
    if table.get(key).is_none() {
        table.insert(
            key,
            if rest.is_empty() {
                Item::Value(value.clone())
            } else {
                Item::Value(Value::InlineTable(InlineTable::new()))
            },
        );
    }
    put(table.get_mut(key)?, rest, value)
}

fn put_in_element(items: &mut Array, at: usize, keys: &[String], value: Value) -> Option<()> {
    let mut item = Item::Value(items.get(at)?.clone());
    put(&mut item, keys, value)?;
    *items.get_mut(at)? = item.into_value().ok()?;
    Some(())
}

/// Gives every file that a table names its new name.
fn move_files(table: &mut dyn TableLike, spec: &'static TableSpec, moved: &dyn Fn(&str) -> String) {
    for (key, item) in table.iter_mut() {
        if let Some(field) = spec.field(key.get()) {
            move_in(item, &field.kind, moved);
        }
    }
}

fn move_in(item: &mut Item, kind: &Kind, moved: &dyn Fn(&str) -> String) {
    match kind {
        Kind::Path => {
            if let Some(path) = item.as_str() {
                let mut value = Value::from(moved(path));
                if let Some(old) = item.as_value() {
                    *value.decor_mut() = old.decor().clone();
                }
                *item = Item::Value(value);
            }
        }
        Kind::Table(spec) => {
            if let Some(table) = item.as_table_like_mut() {
                move_files(table, spec, moved);
            }
        }
        Kind::Named(_, spec) => {
            if let Some(table) = item.as_table_like_mut() {
                for (_, entry) in table.iter_mut() {
                    move_in(entry, &Kind::Table(spec), moved);
                }
            }
        }
        Kind::List(spec) => match item {
            Item::ArrayOfTables(tables) => tables.iter_mut().for_each(|t| move_files(t, spec, moved)),
            Item::Value(Value::Array(items)) => {
                for value in items.iter_mut() {
                    let mut entry = Item::Value(value.clone());
                    move_in(&mut entry, &Kind::Table(spec), moved);
                    if let Ok(new) = entry.into_value() {
                        *value = new;
                    }
                }
            }
            _ => {}
        },
        // A text is a path in an alternative that has one, a table is one in every alternative.
        Kind::Either(kinds) => {
            let text = item.is_str();
            let fitting = kinds.iter().filter(|k| matches!(k, Kind::Path) == text);
            fitting.for_each(|kind| move_in(item, kind, moved));
        }
        _ => {}
    }
}

/// A path relative to the folder `to` that was relative to `from`; absolute where there is no such path.
fn moved(path: &str, from: &Path, to: &Path) -> String {
    let full = from.join(path);
    if Path::new(path).is_absolute() {
        return path.to_owned();
    }
    let [full, to] = [&full, to].map(|p| std::path::absolute(p).map_or_else(|_| p.to_owned(), |p| plain(&p)));
    let common = full.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    // Nothing in common but the root: an absolute path is shorter.
    if common <= 1 {
        return written(&full);
    }
    let up = to.components().skip(common).map(|_| Component::ParentDir);
    written(&up.chain(full.components().skip(common)).collect::<PathBuf>())
}

/// With slashes, which every system reads.
fn written(path: &Path) -> String {
    path.display().to_string().replace('\\', "/")
}

/// Without `.` and `..` where that can be told from the path alone.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut all, part| {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                all.pop();
            }
            _ => all.push(part),
        }
        all
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    const TEXT: &str = r#"# A scene
[material.soil]
density = 1000                    # kg/m³
[particles.bed]
material = "soil"
file = "grains/bed.csv"           # beside it
[geometry.tool]
file = "/meshes/tool.stl"
[[stage]]
name = "till"
duration = 1.0
move.tool = { velocity = [0.7, 0, 0] }
"#;

    fn sets(sets: &[&str]) -> Vec<String> {
        sets.iter().map(|s| (*s).to_owned()).collect()
    }

    #[test]
    fn values_and_files_are_written_and_the_rest_stays() {
        let sets = sets(&[
            "material.soil.density=2000.0",
            "material.soil.friction=0.5",
            "stage.till.move.tool.velocity.0=1.5",
            "contact.normal=linear",
            "stage.till.duration=0.5",
        ]);
        let text = rewritten(TEXT, &sets, Path::new("/home/field"), Path::new("/home/field/out")).unwrap();
        let expected = TEXT
            .replace("density = 1000  ", "density = 2000.0  ")
            .replace("# kg/m³\n", "# kg/m³\nfriction = 0.5\n")
            .replace("\"grains/bed.csv\"", "\"../grains/bed.csv\"")
            .replace("duration = 1.0", "duration = 0.5")
            .replace("velocity = [0.7,", "velocity = [1.5,");
        assert_eq!(text, format!("contact = {{ normal = \"linear\" }}\n{expected}"));
        let elsewhere = rewritten(TEXT, &[], Path::new("/home/field"), Path::new("/data")).unwrap();
        assert!(elsewhere.contains("\"/home/field/grains/bed.csv\""), "{elsewhere}");
        assert_eq!(rewritten(TEXT, &[], Path::new("/a"), Path::new("/a")).unwrap(), TEXT);
    }

    /// What is written means what `--set` means.
    #[test]
    fn the_new_scene_is_the_scene_with_its_sets() {
        let text = include_str!("../../tests/scene_common/example.toml");
        let sets = sets(&["material.soil.density=1234.5", "time.step=1e-5", "seed=7"]);
        let by_sets = Scene::parse("s", text, &sets).unwrap();
        let new = rewritten(text, &sets, Path::new("a"), Path::new("a")).unwrap();
        let by_text = Scene::parse("s", &new, &[]).unwrap();
        assert_eq!((by_text.seed, by_sets.seed), (7, 7));
        assert_eq!(by_sets.materials, by_text.materials);
        assert_eq!(by_text.materials[0].density, 1234.5);
        assert_eq!(format!("{:?}", by_sets.time), format!("{:?}", by_text.time));
    }
}
