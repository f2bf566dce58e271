//! A TOML document as a tree that knows where each value was written, whatever source it came from: the
//! values that `--set` puts in point at their argument.

use std::sync::Arc;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::{Located, Place, SceneError, Source};

#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub place: Place,
    pub value: Value,
}

#[derive(Clone, Debug)]
pub(crate) enum Value {
    Text(String),
    /// `None` if it does not fit.
    Integer(Option<i64>),
    Float(f64),
    Bool(bool),
    /// A date or time, which no scene has a use for.
    Date,
    Array(Vec<Node>),
    Table(Vec<Entry>),
}

/// Key and value; entries keep the order of the file.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub key: Located<String>,
    pub node: Node,
}

impl Node {
    pub fn entries(&self) -> &[Entry] {
        match &self.value {
            Value::Table(entries) => entries,
            _ => &[],
        }
    }

    pub fn get(&self, key: &str) -> Option<&Self> {
        self.entries().iter().find(|e| e.key.value == key).map(|e| &e.node)
    }

    /// In words, for messages.
    pub fn kind(&self) -> &'static str {
        match &self.value {
            Value::Text(_) => "a text",
            Value::Integer(_) => "a whole number",
            Value::Float(_) => "a number",
            Value::Bool(_) => "true or false",
            Value::Date => "a date",
            Value::Array(_) => "a list",
            Value::Table(_) => "a table",
        }
    }
}

/// Mistakes of syntax that are looked at; of a file that is not TOML at all, every byte may be one.
const MOST_SYNTAX_ERRORS: usize = 1000;

/// Parses a document; with syntax errors, the first of each line.
pub(crate) fn parse(source: &Arc<Source>) -> Result<Node, Vec<SceneError>> {
    let (root, errors) = DeTable::parse_recoverable(source.text());
    if errors.is_empty() {
        Ok(Node { place: Place::new(source, 0..0), value: table(source, 0, root.into_inner()) })
    } else {
        // What follows a mistake on its own line is mostly its echo.
        let mut found: Vec<SceneError> =
            errors.iter().take(MOST_SYNTAX_ERRORS).map(|error| syntax(source, error)).collect();
        found.dedup_by_key(|error| error.place().line_column().0);
        Err(found)
    }
}

/// Parses the value that starts at byte `offset` of the source.
pub(crate) fn parse_value(source: &Arc<Source>, offset: usize) -> Result<Node, SceneError> {
    let text = source.text().get(offset..).unwrap_or_default();
    DeValue::parse(text).map(|value| node(source, offset, value)).map_err(|error| {
        let span = error.span().unwrap_or(0..text.len());
        let place = Place::new(source, span.start + offset..span.end + offset);
        SceneError::new("syntax", &place, format!("this is not TOML: {}", error.message())).label("here")
    })
}

fn syntax(source: &Arc<Source>, error: &toml::de::Error) -> SceneError {
    let place = Place::new(source, error.span().unwrap_or(0..0));
    SceneError::new("syntax", &place, format!("this is not TOML: {}", error.message())).label("here")
}

fn node(source: &Arc<Source>, offset: usize, value: Spanned<DeValue<'_>>) -> Node {
    let span = value.span();
    let value = match value.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(i) => Value::Integer(i64::from_str_radix(i.as_str(), i.radix()).ok()),
        // TOML's grammar only lets through what f64 reads; `inf` and `nan` are refused by the checker.
        DeValue::Float(f) => Value::Float(f.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(b) => Value::Bool(b),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(items) => Value::Array(items.into_iter().map(|v| node(source, offset, v)).collect()),
        DeValue::Table(entries) => table(source, offset, entries),
    };
    Node { place: Place::new(source, span.start + offset..span.end + offset), value }
}

fn table(source: &Arc<Source>, offset: usize, entries: DeTable<'_>) -> Value {
    let mut entries: Vec<Entry> = entries
        .into_iter()
        .map(|(key, value)| {
            let span = key.span();
            let place = Place::new(source, span.start + offset..span.end + offset);
            let key = Located { value: key.into_inner().into_owned(), place };
            Entry { key, node: node(source, offset, value) }
        })
        .collect();
    entries.sort_by_key(|entry| entry.key.place.span().start);
    Value::Table(entries)
}
