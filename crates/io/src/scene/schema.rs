//! The JSON Schema (draft 2020-12) of scene and study files, generated from the description that parses them.

use std::collections::BTreeMap;

use glebe_physics::{LawInfo, Slot, laws};
use serde_json::{Map, Value as Json, json};

use super::document::{Node, Value, parse_value};
use super::error::Source;
use super::fields::SCENE;
use super::model::built_in;
use super::table::{Field, Kind, Names, Need, Range, Rule, TableSpec};
use crate::units::Dimension;

/// A number followed by a unit.
const QUANTITY: &str = r"^\s*[-+]?([0-9_]+\.?[0-9_]*|\.[0-9_]+)([eE][-+]?[0-9]+)?\s*\S.*$";

/// The JSON Schema of scene files, for editors: every table, key, unit, range and default.
pub fn schema() -> Json {
    schema_of(&SCENE, "glebe scene")
}

/// The JSON Schema of a file that the table describes.
pub(crate) fn schema_of(spec: &'static TableSpec, title: &str) -> Json {
    let mut definitions = BTreeMap::new();
    let mut root = table(spec, &mut definitions);
    if let Json::Object(map) = &mut root {
        map.insert("$schema".to_owned(), json!("https://json-schema.org/draft/2020-12/schema"));
        map.insert("title".to_owned(), json!(title));
        map.insert("$defs".to_owned(), json!(definitions));
    }
    root
}

type Definitions = BTreeMap<String, Json>;

fn table(spec: &'static TableSpec, definitions: &mut Definitions) -> Json {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for field in spec.fields {
        properties.insert(field.key.to_owned(), property(field, definitions));
        if matches!(field.need, Need::Required) {
            required.push(field.key);
        }
    }
    let mut out = json!({
        "type": "object", "description": spec.doc, "properties": properties, "additionalProperties": false,
    });
    if !required.is_empty() {
        out["required"] = json!(required);
    }
    let rules: Vec<Json> = spec.rules.iter().map(rule).collect();
    if !rules.is_empty() {
        out["allOf"] = json!(rules);
    }
    out
}

fn rule(rule: &Rule) -> Json {
    let has = |key: &&str| json!({ "required": [key] });
    let each = |keys: &[&str]| keys.iter().map(has).collect::<Vec<_>>();
    match rule {
        Rule::ExactlyOne(keys) => json!({ "oneOf": each(keys) }),
        Rule::AtLeastOne(keys) => json!({ "anyOf": each(keys) }),
        Rule::AtMostOne(keys) => {
            let mut cases = each(keys);
            cases.push(json!({ "not": { "anyOf": each(keys) } }));
            json!({ "oneOf": cases })
        }
        Rule::Needs(key, needed) => json!({ "anyOf": [{ "not": has(key) }, { "required": needed }] }),
        Rule::Excludes(key, excluded) => {
            json!({ "not": { "allOf": [has(key), { "anyOf": each(excluded) }] } })
        }
    }
}

fn property(field: &Field, definitions: &mut Definitions) -> Json {
    let mut out = kind(&field.kind, field.range, definitions);
    let absent = match field.need {
        Need::Optional(words) => Some(format!(" If absent: {words}.")),
        Need::Like(key) => Some(format!(" If absent: as `{key}`.")),
        Need::Required | Need::Default(_) => None,
    };
    let Json::Object(map) = &mut out else { return out };
    let doc = format!("{}{}", field.doc, absent.unwrap_or_default());
    map.insert("description".to_owned(), json!(doc));
    if let Need::Default(literal) = field.need
        && let Ok(node) = parse_value(&Source::new(field.key, literal), 0)
    {
        map.insert("default".to_owned(), to_json(&node));
    }
    out
}

fn kind(of: &Kind, range: Range, definitions: &mut Definitions) -> Json {
    match of {
        Kind::Number(dimension) => number(*dimension, range, definitions),
        Kind::Integer => bounded("integer", range),
        Kind::Bool => json!({ "type": "boolean" }),
        Kind::Text | Kind::Path => json!({ "type": "string" }),
        Kind::Words(words) => json!({ "enum": words }),
        Kind::Choice(rows) => {
            let rows = rows();
            json!({ "oneOf": rows.iter().map(|(name, doc)| json!({ "const": name, "description": doc })).collect::<Vec<_>>() })
        }
        Kind::Vector(dimension) => list(&number(*dimension, range, definitions), 3),
        Kind::Direction => json!({ "anyOf": [
            { "enum": ["x", "y", "z", "-x", "-y", "-z"] },
            list(&json!({ "type": "number" }), 3),
        ] }),
        Kind::Window(dimension) => list(&number(*dimension, range, definitions), 2),
        Kind::Numbers(dimension) => {
            json!({ "type": "array", "items": number(*dimension, range, definitions), "minItems": 2 })
        }
        Kind::Reference(names) => {
            let examples: Vec<String> = match names {
                Names::Material => built_in().into_iter().map(|m| m.name).collect(),
                _ => Vec::new(),
            };
            json!({ "type": "string", "examples": examples })
        }
        Kind::References(_) => json!({ "type": "array", "items": { "type": "string" } }),
        Kind::Probe => json!({ "type": "string", "pattern": r"\.([ft][xyz]|draught)$" }),
        Kind::Law(slot) => law_choice(*slot, definitions),
        Kind::Parameters(law) => parameters(law, definitions),
        Kind::Any => json!({}),
        Kind::LowHigh(side) => list(&kind(side, range, definitions), 2),
        Kind::Table(spec) => table(spec, definitions),
        Kind::Named(_, spec) => {
            json!({ "type": "object", "additionalProperties": table(spec, definitions) })
        }
        Kind::List(spec) => json!({ "type": "array", "items": table(spec, definitions) }),
        Kind::Either(kinds) => {
            json!({ "anyOf": kinds.iter().map(|k| kind(k, range, definitions)).collect::<Vec<_>>() })
        }
    }
}

fn list(item: &Json, count: usize) -> Json {
    json!({ "type": "array", "items": item, "minItems": count, "maxItems": count })
}

fn bounded(name: &str, range: Range) -> Json {
    let mut out = json!({ "type": name });
    if range.min.is_finite() {
        out[if range.min_excluded { "exclusiveMinimum" } else { "minimum" }] = json!(range.min);
    }
    if range.max.is_finite() {
        out["maximum"] = json!(range.max);
    }
    out
}

/// A number, or a text with a unit, whose definition is shared by all values of a dimension.
fn number(dimension: Dimension, range: Range, definitions: &mut Definitions) -> Json {
    let name = dimension.name.replace(' ', "_");
    definitions.entry(name.clone()).or_insert_with(|| {
        json!({
            "type": "string", "pattern": QUANTITY,
            "description": format!("Number and unit: {}", dimension.expected()),
        })
    });
    json!({ "anyOf": [bounded("number", range), { "$ref": format!("#/$defs/{name}") }] })
}

fn law_choice(slot: Slot, definitions: &mut Definitions) -> Json {
    let registered = laws(slot);
    let alone = |law: &&LawInfo| !law.parameters.iter().any(|p| p.required);
    let words: Vec<Json> = registered
        .iter()
        .filter(alone)
        .map(|law| json!({ "const": law.name, "description": format!("{} ({})", law.summary, law.source) }))
        .collect();
    let tables: Map<String, Json> =
        registered.iter().map(|law| (law.name.to_owned(), parameters(law, definitions))).collect();
    json!({ "anyOf": [
        { "oneOf": words },
        { "type": "object", "properties": tables, "additionalProperties": false, "minProperties": 1, "maxProperties": 1 },
    ] })
}

fn parameters(law: &LawInfo, definitions: &mut Definitions) -> Json {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for p in law.parameters {
        let field = Field::new(p.name, Kind::Number(Dimension::of_si(p.unit)), p.summary).at_least(p.min);
        let mut out = property(&field, definitions);
        if let Some(default) = p.default {
            out["default"] = json!(default);
        }
        properties.insert(p.name.to_owned(), out);
        if p.required {
            required.push(p.name);
        }
    }
    json!({
        "type": "object", "description": format!("{} ({})", law.summary, law.source),
        "properties": properties, "required": required, "additionalProperties": false,
    })
}

fn to_json(node: &Node) -> Json {
    match &node.value {
        Value::Text(text) => json!(text),
        Value::Integer(Some(i)) => json!(i),
        Value::Float(x) => json!(x),
        Value::Bool(b) => json!(b),
        Value::Array(items) => items.iter().map(to_json).collect(),
        Value::Table(entries) => {
            Json::Object(entries.iter().map(|e| (e.key.value.clone(), to_json(&e.node))).collect())
        }
        Value::Integer(None) | Value::Date => Json::Null,
    }
}
