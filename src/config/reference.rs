//! The Markdown reference of every key.
//!
//! JSON Schema of every kind of files, for editors and validators.
//!
//! Templates of files: every key with what it means, commented out.
//!
//! Kind of a file -> all that is declared of its keys.

use crate::declared::{Declared, Key, Presence, Preset, Table};
use crate::test_plan_keys::{PlanKeys, RequirementKeys};
use crate::{
    bench::BenchKeys, camera::CameraKeys, check::Rule, file_kind::FileKind, key::Section, key_type::Shape,
    link::LinkTable, scenario::ScenarioKeys, spacecraft::SpacecraftKeys, test_plan_keys::DataSetKeys,
};
use core::fmt::Write;
use serde_json::{Map, Value, json};

/// Returns the reference of the keys of these kinds of files, as Markdown.
pub fn key_reference(kinds: &[FileKind]) -> String {
    let mut page = String::from(HEAD);
    for kind in kinds {
        page.push_str(&format!("\n## {}\n\n{}\n", heading(*kind), about(*kind)));
        write_table(&mut page, &declared(*kind), "");
    }
    page
}

/// Returns the rows of [`key_reference`] that have all `words` in the name of the table or in the row, below their
/// headings; nothing where no row has them. Capital letters count as small ones.
pub fn key_search(kinds: &[FileKind], words: &[String]) -> String {
    let words: Vec<String> = words.iter().map(|word| word.to_lowercase()).collect();
    let page = key_reference(kinds);
    let (mut found, mut kind, mut table, mut said) = (String::new(), "", "", ["", ""]);
    for line in page.lines() {
        if line.starts_with("## ") {
            (kind, table) = (line, "");
        } else if line.starts_with("### ") {
            table = line;
        } else if line.starts_with("| `") {
            let text = format!("{table} {line}").to_lowercase();
            if !words.iter().all(|word| text.contains(word)) {
                continue;
            }
            for (heading, said) in [kind, table].into_iter().zip(&mut said) {
                if *said != heading {
                    *said = heading;
                    let blank = if found.is_empty() { "" } else { "\n" };
                    found.push_str(&format!("{blank}{heading}\n"));
                }
            }
            found.push_str(&format!("{line}\n"));
        }
    }
    found
}

const HEAD: &str = "# Configuration keys

`starloop keys` prints this page from the declarations that files are checked by; `starloop schema` prints them as JSON
Schema, and `starloop init` as a template. A name ends with the unit of its value. A path is relative to the file that
names it.
";

const fn heading(kind: FileKind) -> &'static str {
    match kind {
        FileKind::Bench => "Bench files",
        FileKind::Scenario => "Scenario files",
        FileKind::Camera => "Camera files",
        FileKind::Link => "Link files",
        FileKind::Spacecraft => "Spacecraft files",
        FileKind::TestPlan => "Test plans",
        FileKind::Requirements => "Requirements",
        FileKind::DataSet => "Data sets",
    }
}

const fn about(kind: FileKind) -> &'static str {
    match kind {
        FileKind::Bench => "A run of the stimulator. Every key has a default: an empty file is a bench.",
        FileKind::Scenario => "A bench with a spacecraft that is flown inside the program, events and expectations.",
        FileKind::Camera => "Optics and detector. Only the detector's size and the focal length have no default.",
        FileKind::Link => "A bus to the flight computer: the keys of a bench's `[link]` in a file of their own.",
        FileKind::Spacecraft => "Body, wheels, modes, disturbances, gyro, Sun sensor, control.",
        FileKind::TestPlan => {
            "Cases that `starloop fly` flies with a star tracker, as [test_plans.md](test_plans.md) explains."
        }
        FileKind::Requirements => "Limits of the metrics that [metrics.md](metrics.md) lists.",
        FileKind::DataSet => {
            "Images with labels that `starloop dataset` draws, as [data_sets.md](data_sets.md) explains."
        }
    }
}

fn write_table(page: &mut String, declared: &Declared, path: &str) {
    write_keys(page, declared.keys.iter());
    for table in &declared.tables {
        let path = if path.is_empty() { table.name.to_owned() } else { format!("{path}.{}", table.name) };
        let header = if is_list(table.presence) { format!("[[{path}]]") } else { format!("[{path}]") };
        page.push_str(&format!("\n### `{header}`\n\n{}{}\n", table.sentence, presence(table)));
        let [form] = table.forms.as_slice() else {
            write_forms(page, table);
            continue;
        };
        write_table(page, form, &path);
    }
}

/// Writes a table whose keys depend on the first of them.
fn write_forms(page: &mut String, table: &Table) {
    let Some(first) = table.forms.first() else { return };
    let mut common: Vec<Key> = first.keys.iter().filter(|key| table.is_common(key)).cloned().collect();
    if let Some(kind) = common.first_mut() {
        kind.shape = Shape::Words(table.forms.iter().map(|form| words_of(form)).collect::<Vec<_>>().concat());
    }
    write_keys(page, common.iter());
    for form in &table.forms {
        let own: Vec<&Key> = form.keys.iter().filter(|key| !table.is_common(key)).collect();
        if let (Some(kind), false) = (form.keys.first(), own.is_empty()) {
            page.push_str(&format!("\nWith `{} = \"{}\"`:\n", kind.name, words_of(form).concat()));
            write_keys(page, own.into_iter());
        }
    }
}

fn words_of(form: &Declared) -> Vec<&'static str> {
    match form.keys.first().map(|kind| &kind.shape) {
        Some(Shape::Words(words)) => words.clone(),
        _ => Vec::new(),
    }
}

const fn is_list(presence: Presence) -> bool {
    matches!(presence, Presence::List | Presence::ListOrFiles | Presence::NeededList)
}

fn presence(table: &Table) -> &'static str {
    match table.presence {
        Presence::Once if table.is_needed() => " It must be given.",
        Presence::Once => "",
        Presence::Optional => " Without the table there is none.",
        Presence::List => " A table for each.",
        Presence::NeededList => " A table for each, one at least.",
        Presence::OrFile => " A table, or the path of a file that holds the same keys.",
        Presence::ListOrFiles => " A table for each, or a list of paths of files that hold the same keys.",
    }
}

fn write_keys<'k>(page: &mut String, keys: impl Iterator<Item = &'k Key>) {
    let mut rows = keys.peekable();
    if rows.peek().is_none() {
        return;
    }
    page.push_str("\n| key | value | without it | meaning |\n|---|---|---|---|\n");
    for key in rows {
        let unit = key.unit().map(|unit| format!(", {unit}")).unwrap_or_default();
        let without = match &key.preset {
            Preset::Needed => "must be given".to_owned(),
            Preset::Noted(default) | Preset::Silent(default) => format!("`{default}`"),
            Preset::Computed(text) => (*text).to_owned(),
            Preset::Optional => String::new(),
        };
        let cells = [format!("`{}`", key.name), format!("{}{unit}", key.shape), without, key.meaning()];
        // Writing to a string does not fail.
        let _ = writeln!(page, "| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
    }
}

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

/// Columns of a line of comment.
const COLUMNS: usize = 100;

/// Marks a value that is not the default.
const EXAMPLE_MARK: &str = "  # an example, not the default";

/// Values of keys that must be given.
const EXAMPLES: [(&str, &str); 18] = [
    ("bench", "\"../benches/closed_loop.toml\""),
    ("spacecraft", "\"../spacecraft/smallsat.toml\""),
    ("name", "\"my name\""),
    ("camera", "\"../cameras/star_tracker_20deg.toml\""),
    ("case.name", "\"lost in space\""),
    ("case.frames", "2"),
    ("case.attitudes.kind", "\"fixed\""),
    ("case.attitudes.ra_deg", "84.0"),
    ("case.attitudes.dec_deg", "-1.2"),
    ("requirement.id", "\"ST-010\""),
    ("requirement.metric", "\"false_solutions\""),
    ("requirement.most", "0.0"),
    ("target.ra_deg", "84.0"),
    ("target.dec_deg", "-1.2"),
    ("detector.width_px", "1024"),
    ("detector.height_px", "1024"),
    ("optics.focal_length_mm", "50.0"),
    ("body.inertia_kg_m2", "[[5.0, 0.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 5.0]]"),
];

/// Keys that a template gives although they are needed only beside other values.
const LIVE: [&str; 4] = ["case.attitudes.ra_deg", "case.attitudes.dec_deg", "requirement.most", "attitude.kind"];

/// Returns a file of this kind with every key commented out but those that must be given.
pub fn key_template(kind: FileKind) -> String {
    let mut text = String::new();
    comment(&mut text, &format!("A {} file: remove the # before a key to change its value.", kind.name()));
    comment(&mut text, "A value is the default, or marked as an example: put your own in its place.");
    if kind == FileKind::Scenario {
        comment(&mut text, "The paths are those of a file in configs/scenarios.");
    }
    if kind == FileKind::TestPlan {
        comment(&mut text, "The paths are those of a file in configs/test_plans.");
    }
    text.push('\n');
    template_table(&mut text, &declared(kind), "", true);
    text
}

fn template_table(text: &mut String, declared: &Declared, path: &str, is_live: bool) {
    for key in &declared.keys {
        write_key(text, key, path, is_live);
    }
    for table in &declared.tables {
        let path = if path.is_empty() { table.name.to_owned() } else { format!("{path}.{}", table.name) };
        let is_live = is_live && matches!(table.presence, Presence::Once | Presence::OrFile | Presence::NeededList);
        text.push('\n');
        comment(text, table.sentence);
        let header = match table.presence {
            Presence::List | Presence::ListOrFiles | Presence::NeededList => format!("[[{path}]]"),
            Presence::Once | Presence::Optional | Presence::OrFile => format!("[{path}]"),
        };
        line(text, &header, is_live);
        template_forms(text, table, &path, is_live);
    }
}

fn template_forms(text: &mut String, table: &Table, path: &str, is_live: bool) {
    for (place, form) in table.forms.iter().enumerate() {
        if place == 0 {
            template_table(text, form, path, is_live);
            continue;
        }
        if let Some(Key { name, shape: Shape::Words(words), .. }) = form.keys.first() {
            text.push('\n');
            comment(text, &format!("With {name} = \"{}\":", words.concat()));
        }
        for key in form.keys.iter().filter(|key| !table.is_common(key)) {
            write_key(text, key, path, false);
        }
    }
}

fn write_key(text: &mut String, key: &Key, path: &str, is_live: bool) {
    let unit = key.unit().map(|unit| format!(", {unit}")).unwrap_or_default();
    let without = match &key.preset {
        Preset::Computed(text) => format!(" Without it: {text}."),
        Preset::Optional => " Without it: none.".to_owned(),
        Preset::Needed | Preset::Noted(_) | Preset::Silent(_) => String::new(),
    };
    comment(text, &format!("{} Value: {}{unit}.{without}", key.meaning(), key.shape));
    let full = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
    let example = EXAMPLES.iter().find(|(known, _)| *known == full).map(|(_, value)| (*value).to_owned());
    let is_needed = matches!(key.preset, Preset::Needed);
    // A value that is not the default is marked: without the mark, taking the # away would change the file unnoticed.
    let (value, mark) = match (&key.preset, example) {
        (Preset::Noted(default) | Preset::Silent(default), _) => (default.to_string(), ""),
        (_, Some(example)) => (example, EXAMPLE_MARK),
        (_, None) => (sample(&key.shape), EXAMPLE_MARK),
    };
    let is_needed = is_needed || LIVE.contains(&full.as_str());
    line(text, &format!("{} = {value}{mark}", key.name), is_live && is_needed);
}

/// Returns a value of this form.
pub(super) fn sample(shape: &Shape) -> String {
    match shape {
        Shape::Number(Rule::Within(least, most)) if !(*least..=*most).contains(&1.0) => format!("{least:?}"),
        Shape::Number(Rule::PositiveUpTo(most)) if *most < 1.0 => format!("{most:?}"),
        Shape::Number(Rule::Finite) => "1".into(),
        Shape::Number(_) => "1.0".into(),
        Shape::Whole(range) => (*range.start()).max(1.min(*range.end())).to_string(),
        Shape::Words(words) => format!("\"{}\"", words.first().unwrap_or(&"")),
        Shape::Text(_) => "\"\"".into(),
        Shape::Flag => "true".into(),
        Shape::Row(count, of) => format!("[{}]", vec![sample(of); *count].join(", ")),
        Shape::List(of) => format!("[{}]", sample(of)),
        Shape::Either(forms) => sample(&forms[0]),
        Shape::Table(_) => "{}".into(),
    }
}

/// Writes a line of TOML, commented out unless it is live.
fn line(text: &mut String, toml: &str, is_live: bool) {
    // Writing to a string does not fail.
    let _ = writeln!(text, "{}{toml}", if is_live { "" } else { "#" });
}

/// Words of comment, wrapped.
fn comment(text: &mut String, words: &str) {
    let mut row = String::from("#");
    for word in words.split_whitespace() {
        if row.len() + 1 + word.len() > COLUMNS {
            text.push_str(&row);
            text.push('\n');
            row = String::from("#");
        }
        row.push(' ');
        row.push_str(word);
    }
    text.push_str(&row);
    text.push('\n');
}

/// Returns all keys of a kind of files.
pub(super) fn declared(kind: FileKind) -> Declared {
    match kind {
        FileKind::Bench => BenchKeys::declared(),
        FileKind::Scenario => ScenarioKeys::declared(),
        FileKind::Camera => CameraKeys::declared(),
        FileKind::Link => LinkTable::declared(),
        FileKind::Spacecraft => SpacecraftKeys::declared(),
        FileKind::TestPlan => PlanKeys::declared(),
        FileKind::Requirements => RequirementKeys::declared(),
        FileKind::DataSet => DataSetKeys::declared(),
    }
}
