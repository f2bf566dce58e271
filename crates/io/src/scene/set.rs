//! Paths to values, and what they are set to: `material.soil.density=2000`, `stage.till.duration=0.2`.

use std::sync::Arc;

use super::document::{Entry, Node, Value, parse, parse_value};
use super::error::{Located, Place, SceneError, Source};
use super::spelling::advice;
use super::table::{Kind, Names, TableSpec};
use crate::units::Dimension;

/// Puts the overrides into the document, in order; each that leads nowhere is an error, the others are
/// still applied.
pub(crate) fn apply(root: &mut Node, spec: &'static TableSpec, sets: &[String]) -> Vec<SceneError> {
    sets.iter().filter_map(|set| apply_one(root, spec, set).err()).collect()
}

fn apply_one(root: &mut Node, spec: &'static TableSpec, argument: &str) -> Result<(), SceneError> {
    let source = Source::new("--set", argument);
    let whole = Place::new(&source, 0..argument.len());
    let Some(equals) = first_equals(argument) else {
        return Err(SceneError::new("set", &whole, format!("`{argument}` sets nothing"))
            .label("no `=`")
            .help("write path=value, such as material.soil.density=2000"));
    };
    let at = whole.part(0..equals);
    let path = keys(&argument[..equals], &at)?;
    let value = value(&source, equals + 1)?;
    descend(root, &Kind::Table(spec), &path, value, &at).map(|_| ())
}

/// What may be set at a path, which stands at a place of its own, in a document.
pub(crate) fn leads_to(
    root: &Node,
    spec: &'static TableSpec,
    path: &str,
    at: &Place,
) -> Result<Kind, SceneError> {
    let keys = keys(path, at)?;
    let anything = Node { place: at.clone(), value: Value::Bool(true) };
    descend(&mut root.clone(), &Kind::Table(spec), &keys, anything, at)
}

/// The first `=` outside of quotes.
fn first_equals(argument: &str) -> Option<usize> {
    let mut quote = None;
    argument.char_indices().find_map(|(at, c)| {
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            _ => {}
        }
        (c == '=' && quote.is_none()).then_some(at)
    })
}

/// The keys of a path, which are a dotted TOML key, and where in `at` they stand.
fn keys(text: &str, at: &Place) -> Result<Vec<Located<String>>, SceneError> {
    let unreadable = || {
        SceneError::new("set", at, format!("`{text}` is not a path"))
            .label("here")
            .help("write names with dots between, such as stage.till.duration; quote names with other signs in them")
    };
    let document = parse(&Source::new("path", &format!("{text}=0"))).map_err(|_| unreadable())?;
    let start = at.span().start;
    let mut path = Vec::new();
    let mut node = &document;
    while let [Entry { key, node: next }] = node.entries() {
        let span = key.place.span();
        path.push(Located { value: key.value.clone(), place: at.part(start + span.start..start + span.end) });
        node = next;
    }
    if path.is_empty() { Err(unreadable()) } else { Ok(path) }
}

/// What stands right of the `=`: a TOML value, or a text that needs no quotes.
fn value(source: &Arc<Source>, offset: usize) -> Result<Node, SceneError> {
    let text = &source.text()[offset..];
    parse_value(source, offset).or_else(|error| {
        if text.trim_start().starts_with(['[', '{', '"', '\'']) || text.trim().is_empty() {
            return Err(error);
        }
        let start = offset + text.len() - text.trim_start().len();
        let place = Place::new(source, start..start + text.trim().len());
        Ok(Node { place, value: Value::Text(text.trim().to_owned()) })
    })
}

/// Follows the path through the document and the description of its tables side by side, so that keys
/// which the file leaves to their defaults can be set as well. Returns what is expected at its end.
fn descend(
    node: &mut Node,
    kind: &Kind,
    path: &[Located<String>],
    value: Node,
    argument: &Place,
) -> Result<Kind, SceneError> {
    let [key, rest @ ..] = path else {
        *node = value;
        return Ok(*kind);
    };
    let nowhere = |candidates: &[&str]| {
        SceneError::new("set", &key.place, format!("`{}` leads nowhere", argument.text()))
            .label(format!("no `{}` here", key.value))
            .help(advice(&key.value, candidates, "the value before it has no parts"))
    };
    let kind = alternative(kind, node, &key.value);
    if let Value::Array(items) = &mut node.value {
        let names: Vec<String> = items.iter().filter_map(name_of).collect();
        let index = names
            .iter()
            .position(|n| *n == key.value)
            .filter(|_| names.len() == items.len())
            .or_else(|| key.value.parse().ok());
        let inner = match kind {
            Kind::List(spec) => Kind::Table(spec),
            Kind::Vector(dimension) | Kind::Window(dimension) | Kind::Numbers(dimension) => {
                Kind::Number(dimension)
            }
            Kind::LowHigh(side) => *side,
            _ => return Err(nowhere(&[])),
        };
        let count = items.len();
        return match index.and_then(|i| items.get_mut(i)) {
            Some(item) => descend(item, &inner, rest, value, argument),
            None if names.is_empty() => Err(nowhere(&[]).help(format!("there are {count}, counted from 0"))),
            None => Err(nowhere(&names.iter().map(String::as_str).collect::<Vec<_>>())),
        };
    }
    let inner = match kind {
        Kind::Table(spec) => match spec.field(&key.value) {
            Some(field) => field.kind,
            None => return Err(nowhere(&spec.keys())),
        },
        // What a name refers to is checked later; a name that the file itself defines must be there.
        Kind::Named(names, spec) => {
            let known: Vec<&str> = node.entries().iter().map(|e| e.key.value.as_str()).collect();
            if names == Names::New && !known.contains(&key.value.as_str()) {
                return Err(nowhere(&known));
            }
            Kind::Table(spec)
        }
        Kind::Law(slot) => match glebe_physics::laws(slot).iter().find(|law| law.name == key.value) {
            // Another law than the one there: its parameters go with it.
            Some(law) => {
                if node.get(&key.value).is_none() {
                    *node = Node { place: argument.clone(), value: Value::Table(Vec::new()) };
                }
                Kind::Parameters(law)
            }
            None => return Err(nowhere(&kind.words())),
        },
        Kind::Parameters(law) => match law.parameters.iter().find(|p| p.name == key.value) {
            Some(parameter) => Kind::Number(Dimension::of_si(parameter.unit)),
            None => return Err(nowhere(&law.parameters.iter().map(|p| p.name).collect::<Vec<_>>())),
        },
        _ => return Err(nowhere(&[])),
    };
    if !matches!(node.value, Value::Table(_)) {
        *node = Node { place: argument.clone(), value: Value::Table(Vec::new()) };
    }
    let Value::Table(entries) = &mut node.value else { return Ok(inner) };
    if let Some(entry) = entries.iter_mut().find(|e| e.key.value == key.value) {
        return descend(&mut entry.node, &inner, rest, value, argument);
    }
    let mut made = Node { place: argument.clone(), value: Value::Table(Vec::new()) };
    let end = descend(&mut made, &inner, rest, value, argument)?;
    entries.push(Entry { key: key.clone(), node: made });
    Ok(end)
}

/// The alternative that has parts as the node or the key wants them.
fn alternative(kind: &Kind, node: &Node, key: &str) -> Kind {
    let Kind::Either(kinds) = kind else { return *kind };
    let is_list = matches!(node.value, Value::Array(_));
    let fits = |k: &&Kind| match k {
        Kind::Table(spec) => spec.field(key).is_some() || !is_list,
        Kind::Vector(_) | Kind::Window(_) | Kind::Numbers(_) | Kind::LowHigh(_) | Kind::List(_) => is_list,
        _ => false,
    };
    kinds.iter().find(fits).copied().unwrap_or(*kind)
}

fn name_of(item: &Node) -> Option<String> {
    match item.get("name").map(|n| &n.value) {
        Some(Value::Text(name)) => Some(name.clone()),
        _ => None,
    }
}
