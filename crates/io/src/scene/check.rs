//! Walks a document along the description of its tables: finds everything that is wrong and turns the
//! rest into values in SI units.

use std::collections::BTreeMap;

use glebe_physics::{LawChoice, LawInfo, Slot};

use super::document::{Entry, Node, Value, parse_value};
use super::error::{Located, Place, SceneError, Source};
use super::spelling::{advice, nearest};
use super::table::{Field, Kind, Names, Need, Rule, TableSpec};
use crate::units::{self, Dimension, UnitError};

/// A value that passed.
#[derive(Clone, Debug)]
pub(crate) enum Checked {
    Number(f64),
    Integer(u64),
    Bool(bool),
    Text(String),
    Vector([f64; 3]),
    Window([f64; 2]),
    Numbers(Vec<f64>),
    Names(Vec<Located<String>>),
    Law(LawChoice),
    /// As written.
    Any(Node),
    LowHigh(Box<[Checked; 2]>),
    Table(Record),
    Named(Vec<(Located<String>, Record)>),
    List(Vec<Record>),
}

/// A table that was checked: what passed, defaults filled in.
///
/// Getters of what did not pass give NaN or nothing. Whoever reads them while errors are collected may
/// compare with them (NaN compares false), and the result is thrown away.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    pub place: Place,
    /// Keys that were written, whether or not their values passed.
    written: Vec<&'static str>,
    values: BTreeMap<&'static str, (Checked, Place)>,
}

macro_rules! getter {
    ($name:ident, $variant:ident, $type:ty, $missing:expr) => {
        pub fn $name(&self, key: &str) -> $type {
            match self.get(key) {
                Some(Checked::$variant(value)) => value.clone(),
                _ => $missing,
            }
        }
    };
}

impl Record {
    fn new(place: &Place) -> Self {
        Self { place: place.clone(), written: Vec::new(), values: BTreeMap::new() }
    }

    /// Whether `key` was written; its value may have failed.
    pub fn written(&self, key: &str) -> bool {
        self.written.contains(&key)
    }

    pub fn get(&self, key: &str) -> Option<&Checked> {
        self.values.get(key).map(|(value, _)| value)
    }

    pub fn has(&self, key: &str) -> bool {
        self.values.contains_key(key)
    }

    /// Where the value of `key` was written; the table itself if it was not.
    pub fn place(&self, key: &str) -> &Place {
        self.values.get(key).map_or(&self.place, |(_, place)| place)
    }

    getter!(number, Number, f64, f64::NAN);
    getter!(text, Text, String, String::new());
    getter!(integer, Integer, u64, 0);
    getter!(flag, Bool, bool, false);
    getter!(vector, Vector, [f64; 3], [f64::NAN; 3]);
    getter!(law, Law, LawChoice, LawChoice::named(""));
    getter!(numbers, Numbers, Vec<f64>, Vec::new());
    getter!(names, Names, Vec<Located<String>>, Vec::new());

    pub fn number_if(&self, key: &str) -> Option<f64> {
        self.has(key).then(|| self.number(key))
    }

    pub fn integer_if(&self, key: &str) -> Option<u64> {
        self.has(key).then(|| self.integer(key))
    }

    pub fn law_if(&self, key: &str) -> Option<LawChoice> {
        self.has(key).then(|| self.law(key))
    }

    pub fn window_if(&self, key: &str) -> Option<[f64; 2]> {
        match self.get(key) {
            Some(Checked::Window(window)) => Some(*window),
            _ => None,
        }
    }

    pub fn located_if(&self, key: &str) -> Option<Located<String>> {
        let (value, place) = self.values.get(key)?;
        match value {
            Checked::Text(text) => Some(Located { value: text.clone(), place: place.clone() }),
            _ => None,
        }
    }

    /// The value of `key` as written.
    pub fn node(&self, key: &str) -> Option<&Node> {
        match self.get(key) {
            Some(Checked::Any(node)) => Some(node),
            _ => None,
        }
    }

    pub fn table(&self, key: &str) -> Option<&Self> {
        match self.get(key) {
            Some(Checked::Table(table)) => Some(table),
            _ => None,
        }
    }

    /// The table at `key`; one without values if it failed.
    pub fn table_or_empty(&self, key: &str) -> Self {
        self.table(key).cloned().unwrap_or_else(|| Self::new(&self.place))
    }

    pub fn named(&self, key: &str) -> &[(Located<String>, Self)] {
        match self.get(key) {
            Some(Checked::Named(entries)) => entries,
            _ => &[],
        }
    }

    pub fn list(&self, key: &str) -> &[Self] {
        match self.get(key) {
            Some(Checked::List(entries)) => entries,
            _ => &[],
        }
    }
}

/// Names that values of the file may refer to.
#[derive(Debug, Default)]
pub(crate) struct Known {
    pub materials: Vec<String>,
    pub surfaces: Vec<String>,
    pub stages: Vec<String>,
    pub outlets: Vec<String>,
}

impl Known {
    fn of(&self, names: Names) -> Vec<&str> {
        match names {
            Names::Material => self.materials.iter().map(String::as_str).collect(),
            Names::Surface => self.surfaces.iter().map(String::as_str).collect(),
            Names::Stage => self.stages.iter().map(String::as_str).collect(),
            Names::Outlet => self.outlets.iter().map(String::as_str).collect(),
            Names::New | Names::Pair => Vec::new(),
        }
    }

    /// The two materials of a pair's name; names may contain dashes themselves.
    pub fn pair(&self, name: &str) -> Option<[&str; 2]> {
        let find = |part: &str| self.materials.iter().map(String::as_str).find(|m| *m == part);
        name.match_indices('-').find_map(|(at, _)| Some([find(&name[..at])?, find(&name[at + 1..])?]))
    }
}

/// Bounds of numbers: the squares of those within have a place in f32.
const LARGEST: f64 = 1e18;
const SMALLEST: f64 = 1e-18;

/// Components of a force or torque that can be measured.
pub(crate) const COMPONENTS: &[&str] = &["fx", "fy", "fz", "tx", "ty", "tz", "draught"];

pub(crate) struct Checker<'a> {
    pub known: &'a Known,
    /// What was found, warnings included.
    pub found: Vec<SceneError>,
}

impl Checker<'_> {
    pub fn error(&mut self, error: SceneError) {
        self.found.push(error);
    }

    /// Checks a table; `path` is its name in messages, empty for the file itself.
    pub fn table(&mut self, node: &Node, spec: &'static TableSpec, path: &str) -> Record {
        let mut record = Record::new(&node.place);
        let entries = node.entries();
        for Entry { key, node } in entries {
            let Some(field) = spec.field(&key.value) else {
                // A slip of the pen is one mistake: the key it was meant to be is not missing as well.
                record.written.extend(nearest(&key.value, spec.keys()));
                self.error(
                    SceneError::new(
                        "unknown-key",
                        &key.place,
                        format!("{} has no key `{}`", owner(path), key.value),
                    )
                    .label("unknown key")
                    .help(advice(&key.value, &spec.keys(), "")),
                );
                continue;
            };
            record.written.push(field.key);
            if let Some(value) = self.value(node, &field.kind, field, &join(path, field.key)) {
                record.values.insert(field.key, (value, node.place.clone()));
            }
        }
        self.rules(spec, entries, &record, path);
        for field in spec.fields {
            if !record.written(field.key) {
                self.absent(field, spec, &mut record, path);
            }
        }
        record
    }

    fn absent(&mut self, field: &Field, spec: &TableSpec, record: &mut Record, path: &str) {
        match field.need {
            Need::Optional(_) => {}
            Need::Required => {
                self.error(
                    SceneError::new(
                        "missing",
                        &record.place,
                        format!("{} needs `{}`", owner(path), field.key),
                    )
                    .label(format!("`{}` is missing", field.key))
                    .help(format!(
                        "{} Write {} = …, {}",
                        field.doc,
                        field.key,
                        field.kind.expected()
                    )),
                );
            }
            Need::Like(other) => {
                if let Some(value) = spec.field(other).and_then(|f| record.values.get(f.key)).cloned() {
                    record.values.insert(field.key, value);
                }
            }
            Need::Default(literal) => {
                let source = Source::new(&format!("default of {}", join(path, field.key)), literal);
                let value = match parse_value(&source, 0) {
                    Ok(node) => self.value(&node, &field.kind, field, &join(path, field.key)),
                    Err(error) => {
                        self.error(error);
                        None
                    }
                };
                if let Some(value) = value {
                    // What is missing in a table that is left out altogether is missing where it would be.
                    record.values.insert(field.key, (value, record.place.clone()));
                }
            }
        }
    }

    fn rules(&mut self, spec: &TableSpec, entries: &[Entry], record: &Record, path: &str) {
        let given = |key: &str| entries.iter().find(|e| e.key.value == key);
        let mut conflicting = false;
        for rule in spec.rules {
            if let Rule::ExactlyOne(keys) | Rule::AtMostOne(keys) = rule {
                let mut present = keys.iter().filter_map(|key| given(key));
                if let (Some(first), Some(second)) = (present.next(), present.next()) {
                    conflicting = true;
                    let message = format!(
                        "{} has both `{}` and `{}`, which exclude each other",
                        owner(path),
                        first.key.value,
                        second.key.value
                    );
                    self.error(
                        SceneError::new("conflict", &second.key.place, message)
                            .label("one too many")
                            .help(format!("keep one of {}", quoted(keys))),
                    );
                }
            }
            if let Rule::ExactlyOne(keys) | Rule::AtLeastOne(keys) = rule
                && !keys.iter().any(|key| record.written(key))
            {
                let message = format!("{} needs one of {}", owner(path), quoted(keys));
                self.error(
                    SceneError::new("missing", &record.place, message).label("nothing of that is here"),
                );
            }
            if let Rule::Needs(key, needed) = rule
                && let Some(entry) = given(key)
            {
                for missing in needed.iter().filter(|n| !record.written(n)) {
                    let message = format!("{} with `{key}` needs `{missing}`", owner(path));
                    self.error(
                        SceneError::new("missing", &entry.key.place, message)
                            .label(format!("needs `{missing}`"))
                            .help(spec.field(missing).map_or("", |f| f.doc)),
                    );
                }
            }
            // Which of two to keep decides what else has a meaning.
            if let Rule::Excludes(key, excluded) = rule
                && given(key).is_some()
                && !conflicting
            {
                for entry in excluded.iter().filter_map(|e| given(e)) {
                    let message = format!(
                        "`{}` of {} means nothing together with `{key}`",
                        entry.key.value,
                        owner(path)
                    );
                    self.error(
                        SceneError::new("conflict", &entry.key.place, message)
                            .label("has no effect")
                            .help(format!("take away `{}` or `{key}`", entry.key.value)),
                    );
                }
            }
        }
    }

    fn value(&mut self, node: &Node, kind: &Kind, field: &Field, path: &str) -> Option<Checked> {
        match (kind, &node.value) {
            (Kind::Either(kinds), _) => match kinds.iter().find(|k| fits(k, &node.value)) {
                Some(kind) => self.value(node, kind, field, path),
                None => self.wrong_kind(node, kind, path),
            },
            (Kind::Number(dimension), Value::Integer(_) | Value::Float(_) | Value::Text(_)) => {
                self.number(node, *dimension, field, path).map(Checked::Number)
            }
            (Kind::Integer, Value::Integer(_)) => self.integer(node, field, path),
            (Kind::Bool, Value::Bool(b)) => Some(Checked::Bool(*b)),
            (Kind::Text, Value::Text(text)) => Some(Checked::Text(text.clone())),
            (Kind::Path, Value::Text(text)) if !text.is_empty() => Some(Checked::Text(text.clone())),
            (Kind::Words(_) | Kind::Choice(_), Value::Text(text)) => {
                let words = kind.words();
                self.one_of(text, &words, &node.place, &format!("a value of `{path}`")).map(Checked::Text)
            }
            (Kind::Vector(dimension), Value::Array(items)) if items.len() == 3 => {
                self.numbers(items, *dimension, field, path)?.try_into().ok().map(Checked::Vector)
            }
            (Kind::Numbers(dimension), Value::Array(items)) if items.len() >= 2 => {
                self.numbers(items, *dimension, field, path).map(Checked::Numbers)
            }
            (Kind::Direction, _) => self.direction(node, kind, field, path),
            (Kind::Window(dimension), Value::Array(items)) if items.len() == 2 => {
                let [from, to] = self.numbers(items, *dimension, field, path)?.try_into().ok()?;
                if from < to {
                    return Some(Checked::Window([from, to]));
                }
                let message = format!("`{path}` goes from {from} to {to}; the second must be larger");
                self.error(SceneError::new("order", &node.place, message).label("not ascending"));
                None
            }
            (Kind::Reference(names), Value::Text(text)) => {
                self.reference(text, *names, &node.place).map(Checked::Text)
            }
            (Kind::References(names), Value::Array(items)) => self.references(items, *names, path),
            (Kind::Probe, Value::Text(text)) => self.probe(text, &node.place),
            (Kind::Law(slot), _) => self.law(node, *slot, kind, path).map(Checked::Law),
            (Kind::Any, _) => Some(Checked::Any(node.clone())),
            (Kind::LowHigh(side), Value::Array(items)) if items.len() == 2 => {
                let both = [&items[0], &items[1]].map(|item| self.value(item, side, field, path));
                match both {
                    [Some(low), Some(high)] => Some(Checked::LowHigh(Box::new([low, high]))),
                    _ => None,
                }
            }
            (Kind::Table(spec), Value::Table(_)) => Some(Checked::Table(self.table(node, spec, path))),
            (Kind::Named(names, spec), Value::Table(entries)) => {
                Some(Checked::Named(self.named(entries, *names, spec, path)))
            }
            (Kind::List(spec), Value::Array(items)) => {
                let tables = items.iter().filter_map(|item| {
                    if let Value::Table(_) = &item.value {
                        return Some(self.table(item, spec, &entry_path(item, path)));
                    }
                    self.wrong_kind(item, &Kind::Table(spec), path);
                    None
                });
                Some(Checked::List(tables.collect()))
            }
            _ => self.wrong_kind(node, kind, path),
        }
    }

    pub fn wrong_kind(&mut self, node: &Node, kind: &Kind, path: &str) -> Option<Checked> {
        let found = match &node.value {
            Value::Array(items) => format!("a list of {}", items.len()),
            Value::Text(text) if text.is_empty() => "an empty text".to_owned(),
            _ => node.kind().to_owned(),
        };
        self.error(
            SceneError::new("wrong-kind", &node.place, format!("`{path}` is {found}"))
                .label("not what is expected here")
                .help(format!("expected is {}", kind.expected())),
        );
        None
    }

    pub fn number(&mut self, node: &Node, dimension: Dimension, field: &Field, path: &str) -> Option<f64> {
        let value = match &node.value {
            Value::Integer(Some(i)) => *i as f64,
            Value::Float(x) => *x,
            Value::Text(text) => match units::parse(text, dimension) {
                Ok(value) => value,
                Err(error) => {
                    let (kind, label) = match error {
                        UnitError::Dimension { .. } => ("dimension", "wrong dimension"),
                        UnitError::NoNumber(_) => ("wrong-kind", "not a number"),
                        _ => ("unit", "unit"),
                    };
                    self.error(
                        SceneError::new(kind, &node.place, format!("`{path}`: {error}"))
                            .label(label)
                            .help(format!("expected is {}", dimension.expected())),
                    );
                    return None;
                }
            },
            _ => {
                self.wrong_kind(node, &Kind::Number(dimension), path);
                return None;
            }
        };
        if !value.is_finite() {
            let message = format!("`{path}` is not a finite number");
            self.error(SceneError::new("range", &node.place, message).label("not finite"));
            return None;
        }
        let positive = field.range.min_excluded && field.range.min == 0.0;
        if value.abs() > LARGEST || positive && value > 0.0 && value < SMALLEST {
            let message = format!("`{path}` is {}, which cannot be computed with", node.place.text());
            self.error(SceneError::new("range", &node.place, message).label("out of range").help(format!(
                "in SI units numbers go up to {LARGEST:e} and, where they must be above 0, down to {SMALLEST:e}"
            )));
            return None;
        }
        if !field.range.contains(value) {
            let written = node.place.text();
            self.error(
                SceneError::new("range", &node.place, format!("`{path}` is {written}"))
                    .label("out of range")
                    .help(format!("allowed is {}{}", field.range.words(), in_unit(dimension))),
            );
            return None;
        }
        if let Some((from, to)) = field.usual
            && !(from..=to).contains(&value)
        {
            let message = format!("`{path}` is {value}{}, which is unusual", in_unit(dimension));
            self.error(
                SceneError::new("unusual", &node.place, message)
                    .label("a slip of the unit?")
                    .help(format!(
                        "usual is {from} to {to}{}; plain numbers are in SI units",
                        in_unit(dimension)
                    ))
                    .warning(),
            );
        }
        Some(value)
    }

    fn numbers(
        &mut self,
        items: &[Node],
        dimension: Dimension,
        field: &Field,
        path: &str,
    ) -> Option<Vec<f64>> {
        // All components are looked at, so that each mistake is reported.
        let values: Vec<Option<f64>> =
            items.iter().map(|item| self.number(item, dimension, field, path)).collect();
        values.into_iter().collect()
    }

    fn integer(&mut self, node: &Node, field: &Field, path: &str) -> Option<Checked> {
        let value = match node.value {
            Value::Integer(Some(value)) if field.range.contains(value as f64) => u64::try_from(value).ok(),
            _ => None,
        };
        if value.is_none() {
            self.error(
                SceneError::new("range", &node.place, format!("`{path}` is {}", node.place.text()))
                    .label("out of range")
                    .help(format!("allowed are whole numbers, {}", field.range.words())),
            );
        }
        value.map(Checked::Integer)
    }

    fn direction(&mut self, node: &Node, kind: &Kind, field: &Field, path: &str) -> Option<Checked> {
        let vector = match &node.value {
            Value::Text(text) => {
                let (sign, axis) = text.strip_prefix('-').map_or((1.0, text.as_str()), |axis| (-1.0, axis));
                let Some(k) = ["x", "y", "z"].iter().position(|a| *a == axis) else {
                    return self.wrong_kind(node, kind, path);
                };
                let mut unit = [0.0; 3];
                unit[k] = sign;
                unit
            }
            Value::Array(items) if items.len() == 3 => {
                self.numbers(items, Dimension::NONE, field, path)?.try_into().ok()?
            }
            _ => return self.wrong_kind(node, kind, path),
        };
        let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            let message = format!("`{path}` has no direction");
            self.error(
                SceneError::new("range", &node.place, message)
                    .label("zero")
                    .help("give a vector of any length but zero"),
            );
            return None;
        }
        Some(Checked::Vector(vector.map(|x| x / length)))
    }

    /// `text` if it is one of `words`; `what` says in the message what it should have been.
    fn one_of(&mut self, text: &str, words: &[&str], place: &Place, what: &str) -> Option<String> {
        if words.contains(&text) {
            return Some(text.to_owned());
        }
        self.error(
            SceneError::new("unknown-word", place, format!("`{text}` is not {what}"))
                .label("unknown")
                .help(advice(text, words, "nothing is defined that could stand here")),
        );
        None
    }

    fn reference(&mut self, name: &str, names: Names, place: &Place) -> Option<String> {
        let known = self.known;
        if known.of(names).contains(&name) {
            return Some(name.to_owned());
        }
        let noun = names.noun();
        let table = match names {
            Names::Material => format!("[material.{name}]"),
            Names::Stage => format!("[[stage]] with name = \"{name}\""),
            Names::Outlet => format!("[outlet.{name}]"),
            _ => format!("[geometry.{name}]"),
        };
        self.error(
            SceneError::new("undefined", place, format!("no {noun} is called `{name}`"))
                .label(format!("undefined {noun}"))
                .help(format!("{}, or define {table}", advice(name, &known.of(names), "none is defined"))),
        );
        None
    }

    fn references(&mut self, items: &[Node], names: Names, path: &str) -> Option<Checked> {
        let mut all = Vec::new();
        for item in items {
            if let Value::Text(text) = &item.value {
                let name = self.reference(text, names, &item.place);
                all.extend(name.map(|value| Located { value, place: item.place.clone() }));
            } else {
                self.wrong_kind(item, &Kind::Reference(names), path);
            }
        }
        (all.len() == items.len()).then_some(Checked::Names(all))
    }

    fn probe(&mut self, text: &str, place: &Place) -> Option<Checked> {
        let Some((surface, component)) = text.rsplit_once('.') else {
            self.error(
                SceneError::new("wrong-kind", place, format!("`{text}` names no component"))
                    .label("a surface alone")
                    .help(format!("write \"{text}.fx\" or another of {}", quoted(COMPONENTS))),
            );
            return None;
        };
        let surface = self.reference(surface, Names::Surface, place);
        let component = self.one_of(component, COMPONENTS, place, "a component of a force or torque");
        Some(Checked::Text(format!("{}.{}", surface?, component?)))
    }

    fn named(
        &mut self,
        entries: &[Entry],
        names: Names,
        spec: &'static TableSpec,
        path: &str,
    ) -> Vec<(Located<String>, Record)> {
        let known = self.known;
        let mut all = Vec::new();
        for Entry { key, node } in entries {
            match names {
                Names::New => {}
                Names::Material | Names::Surface | Names::Stage | Names::Outlet => {
                    self.reference(&key.value, names, &key.place);
                }
                Names::Pair if known.pair(&key.value).is_some() => {}
                Names::Pair => {
                    let pairs = known.materials.iter().enumerate().flat_map(|(i, a)| {
                        known.materials[i..]
                            .iter()
                            .flat_map(move |b| [format!("{a}-{b}"), format!("{b}-{a}")])
                    });
                    let pairs: Vec<String> = pairs.collect();
                    let near = nearest(&key.value, pairs.iter().map(String::as_str));
                    let near = near.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default();
                    let message = format!("`{}` is not two materials with a dash between", key.value);
                    self.error(
                        SceneError::new("undefined", &key.place, message)
                            .label("no such pair")
                            .help(format!("{near}Materials: {}", quoted(&known.materials))),
                    );
                }
            }
            if matches!(node.value, Value::Table(_)) {
                let record = self.table(node, spec, &join(path, &key.value));
                all.push((key.clone(), record));
            } else {
                self.wrong_kind(node, &Kind::Table(spec), &join(path, &key.value));
            }
        }
        all
    }

    fn law(&mut self, node: &Node, slot: Slot, kind: &Kind, path: &str) -> Option<LawChoice> {
        let laws = glebe_physics::laws(slot);
        let (name, place, given) = match &node.value {
            Value::Text(name) => (name, &node.place, None),
            Value::Table(entries) if entries.len() == 1 => {
                (&entries[0].key.value, &entries[0].key.place, Some(&entries[0].node))
            }
            Value::Table(_) => {
                let message = format!("`{path}` must name one law");
                self.error(
                    SceneError::new("wrong-kind", &node.place, message).label("one law, please").help(
                        format!(
                            "write {path} = \"name\", or a table [{path}.NAME] with its parameters; {}",
                            advice("", &kind.words(), "")
                        ),
                    ),
                );
                return None;
            }
            _ => {
                self.wrong_kind(node, kind, path);
                return None;
            }
        };
        self.one_of(name, &kind.words(), place, &format!("a law for `{path}`"))?;
        let law = laws.iter().find(|law| law.name == name)?;
        let path = join(path, law.name);
        if let Some(node) = given
            && !matches!(node.value, Value::Table(_))
        {
            self.error(
                SceneError::new("wrong-kind", &node.place, format!("`{path}` is {}", node.kind()))
                    .label("not a table")
                    .help(format!("expected is a table with the law's parameters: {}", parameter_list(law))),
            );
            return None;
        }
        self.parameters(law, given.map_or(&[], Node::entries), place, &path)
    }

    fn parameters(
        &mut self,
        law: &'static LawInfo,
        entries: &[Entry],
        place: &Place,
        path: &str,
    ) -> Option<LawChoice> {
        let mut choice = LawChoice::named(law.name);
        let mut good = true;
        for Entry { key, node } in entries {
            let Some(parameter) = law.parameters.iter().find(|p| p.name == key.value) else {
                let names: Vec<&str> = law.parameters.iter().map(|p| p.name).collect();
                self.error(
                    SceneError::new(
                        "unknown-key",
                        &key.place,
                        format!("the law `{}` has no parameter `{}`", law.name, key.value),
                    )
                    .label("unknown parameter")
                    .help(advice(&key.value, &names, "it has none")),
                );
                good = false;
                continue;
            };
            let dimension = Dimension::of_si(parameter.unit);
            let field = Field::new(parameter.name, Kind::Number(dimension), parameter.summary)
                .at_least(parameter.min);
            match self.number(node, dimension, &field, &join(path, parameter.name)) {
                Some(value) => choice.parameters.push((parameter.name.to_owned(), value)),
                None => good = false,
            }
        }
        for parameter in law.parameters {
            let given = entries.iter().any(|e| e.key.value == parameter.name);
            if parameter.required && !given {
                let message = format!("the law `{}` needs its parameter `{}`", law.name, parameter.name);
                let help =
                    format!("{} Write a table [{path}] with {}", parameter.summary, parameter_list(law));
                self.error(
                    SceneError::new("missing", place, message)
                        .label(format!("needs `{}`", parameter.name))
                        .help(help),
                );
                good = false;
            }
        }
        good.then_some(choice)
    }
}

/// Whether a value has the outer shape of `kind`, so that its errors are those of that kind.
fn fits(kind: &Kind, value: &Value) -> bool {
    let numeric = |text: &str| units::number_length(text.trim()) > 0;
    match (kind, value) {
        (Kind::Number(_), Value::Integer(_) | Value::Float(_))
        | (Kind::Table(_) | Kind::Named(..), Value::Table(_))
        | (
            Kind::Vector(_) | Kind::Window(_) | Kind::Numbers(_) | Kind::LowHigh(_) | Kind::List(_),
            Value::Array(_),
        ) => true,
        (Kind::Number(_), Value::Text(text)) => numeric(text),
        (Kind::Words(_), Value::Text(text)) => !numeric(text),
        _ => false,
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// A table in a message.
fn owner(path: &str) -> String {
    if path.is_empty() { "the file".to_owned() } else { format!("`{path}`") }
}

/// An element of a list, by its name if it has one.
fn entry_path(item: &Node, path: &str) -> String {
    match item.get("name").map(|n| &n.value) {
        Some(Value::Text(name)) if !name.is_empty() => join(path, name),
        _ => path.to_owned(),
    }
}

pub(crate) fn quoted<S: AsRef<str>>(words: &[S]) -> String {
    words.iter().map(|w| format!("`{}`", w.as_ref())).collect::<Vec<_>>().join(", ")
}

fn in_unit(dimension: Dimension) -> String {
    if dimension.si.is_empty() { String::new() } else { format!(" {}", dimension.si) }
}

fn parameter_list(law: &LawInfo) -> String {
    let all = law.parameters.iter().map(|p| match p.default {
        Some(default) => format!("{} [{}] (default {default})", p.name, p.unit),
        None if p.required => format!("{} [{}]", p.name, p.unit),
        None => format!("{} [{}] (optional)", p.name, p.unit),
    });
    all.collect::<Vec<_>>().join(", ")
}
