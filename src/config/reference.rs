//! The Markdown reference of every key.

use crate::declared::{Declared, Key, Presence, Preset, Table};
use crate::{file_keys::declared, file_kind::FileKind, key_type::Shape};
use core::fmt::Write;

/// Returns the reference of the keys of these kinds of files, as Markdown.
pub fn key_reference(kinds: &[FileKind]) -> String {
    let mut page = String::from(HEAD);
    for kind in kinds {
        page.push_str(&format!("\n## {}\n\n{}\n", heading(*kind), about(*kind)));
        write_table(&mut page, &declared(*kind), "");
    }
    page
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
            "Cases that `starloop fly` flies with a star tracker, as [reports.md](reports.md) explains."
        }
        FileKind::Requirements => "Limits of the metrics that [reports.md](reports.md#metrics) lists.",
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
