//! Templates of files: every key with what it means, commented out.

use crate::declared::{Declared, Key, Presence, Preset, Table};
use crate::{check::Rule, file_keys::declared, file_kind::FileKind, key_type::Shape};
use core::fmt::Write;

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
    write_table(&mut text, &declared(kind), "", true);
    text
}

fn write_table(text: &mut String, declared: &Declared, path: &str, is_live: bool) {
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
        write_forms(text, table, &path, is_live);
    }
}

fn write_forms(text: &mut String, table: &Table, path: &str, is_live: bool) {
    for (place, form) in table.forms.iter().enumerate() {
        if place == 0 {
            write_table(text, form, path, is_live);
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
