//! JSON Schema of every kind of files, for editors and validators.

use crate::declared::{Declared, Key, Presence, Preset, Table};
use crate::{check::Rule, file_keys::declared, file_kind::FileKind, key_type::Shape};
use serde_json::{Map, Value, json};

/// Returns the JSON Schema (draft 2020-12) of a kind of files. What depends on several keys only the program checks.
pub fn key_schema(kind: FileKind) -> Value {
    let mut schema = of_keys(&declared(kind));
    schema.insert("$schema".into(), json!("https://json-schema.org/draft/2020-12/schema"));
    schema.insert("title".into(), json!(format!("starloop {} file", kind.name())));
    Value::Object(schema)
}

fn of_keys(declared: &Declared) -> Map<String, Value> {
    let keys = declared.keys.iter().map(|key| (key.name.to_owned(), of_key(key)));
    let tables = declared.tables.iter().map(|table| (table.name.to_owned(), of_table(table)));
    let needed = declared.keys.iter().filter(|key| matches!(key.preset, Preset::Needed)).map(|key| key.name);
    let required: Vec<&str> =
        needed.chain(declared.tables.iter().filter(|table| table.is_needed()).map(|table| table.name)).collect();
    let mut schema = Map::new();
    schema.insert("type".into(), json!("object"));
    schema.insert("additionalProperties".into(), json!(false));
    if !required.is_empty() {
        schema.insert("required".into(), json!(required));
    }
    schema.insert("properties".into(), Value::Object(keys.chain(tables).collect()));
    schema
}

fn of_table(table: &Table) -> Value {
    let mut forms: Vec<Value> = table.forms.iter().map(|form| Value::Object(of_keys(form))).collect();
    let one = if forms.len() == 1 { forms.remove(0) } else { json!({ "oneOf": forms }) };
    let path = json!({ "type": "string", "description": "The path of a file that holds the same keys." });
    let mut schema = match table.presence {
        Presence::Once | Presence::Optional => one,
        Presence::List => json!({ "type": "array", "items": one }),
        Presence::NeededList => json!({ "type": "array", "items": one, "minItems": 1 }),
        Presence::OrFile => json!({ "anyOf": [one, path] }),
        Presence::ListOrFiles => json!({ "type": "array", "items": { "anyOf": [one, path] } }),
    };
    schema["description"] = json!(table.sentence);
    schema
}

fn of_key(key: &Key) -> Value {
    let mut schema = of_shape(&key.shape);
    let unit = key.unit().map(|unit| format!(" Unit: {unit}.")).unwrap_or_default();
    let without = match &key.preset {
        Preset::Computed(text) => format!(" Without it: {text}."),
        Preset::Noted(default) | Preset::Silent(default) => {
            schema["default"] = json!(default);
            String::new()
        }
        Preset::Needed | Preset::Optional => String::new(),
    };
    schema["description"] = json!(format!("{}{unit}{without}", key.meaning()));
    schema
}

fn of_shape(shape: &Shape) -> Value {
    match shape {
        Shape::Number(rule) => of_rule(*rule),
        Shape::Whole(range) if *range.end() == i64::MAX => json!({ "type": "integer", "minimum": range.start() }),
        Shape::Whole(range) => json!({ "type": "integer", "minimum": range.start(), "maximum": range.end() }),
        Shape::Words(words) => json!({ "enum": words }),
        Shape::Text(_) => json!({ "type": "string" }),
        Shape::Flag => json!({ "type": "boolean" }),
        Shape::Row(count, of) => {
            json!({ "type": "array", "items": of_shape(of), "minItems": count, "maxItems": count })
        }
        Shape::List(of) => json!({ "type": "array", "items": of_shape(of) }),
        Shape::Table(_) => json!({ "type": "object" }),
        Shape::Either(forms) => json!({ "anyOf": forms.iter().map(of_shape).collect::<Vec<_>>() }),
    }
}

fn of_rule(rule: Rule) -> Value {
    match rule {
        Rule::Positive => json!({ "type": "number", "exclusiveMinimum": 0 }),
        Rule::PositiveUpTo(most) => json!({ "type": "number", "exclusiveMinimum": 0, "maximum": most }),
        Rule::NotNegative => json!({ "type": "number", "minimum": 0 }),
        Rule::Within(least, most) => json!({ "type": "number", "minimum": least, "maximum": most }),
        Rule::Finite => json!({ "type": "number" }),
    }
}
