//! The table for people: `src/guide/frame_facts.md`.

use super::row::{Card, Key, Place, Row};
use super::table::TABLE;
use super::value::{Form, Kind};
use core::fmt::Write;

const HEAD: &str = "# Facts of a frame

Written from the table in `src/frames/sink/facts/table.rs`; a test compares this page with it, and leaves the new text in
`target/frame_facts` when they differ.

Empty: that output does not have the fact, on purpose. Of shared memory ([FRAMES.md](../../firmware_protocol/FRAMES.md)) the page has
offset and type in a slot's head, of chunk data of the network camera the place from 0; the live view is `frame` of `/state.json`.
`_ns`, `_ms` and `_s` in a name are units. A fact that a frame does not have is left out of FITS, empty in CSV, `null` in JSON.

Beside them: WCS and checksums in FITS, `serial` in shared memory, `count`, `taken_utc` and `age_s` in the live view, `mid_exposure_s`
in the control socket's answer.

| fact | type | unit | meaning |
|---|---|---|---|
";

const PLACES: &str = "
| fact | FITS | frames.csv | shared memory | chunk data | live view | control socket |
|---|---|---|---|---|---|---|
";

/// Returns the text of `src/guide/frame_facts.md`.
pub(super) fn reference() -> String {
    let mut text = String::from(HEAD);
    for row in TABLE {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| `{}` | {} | {} | {} |", row.name, row.kind.name(), row.unit, row.about);
    }
    text.push_str(PLACES);
    for row in TABLE {
        let cells = [fits(row), csv(row), memory(row), chunk(row), keys(row.live, ""), control(row)];
        let _ = writeln!(text, "| `{}` | {} |", row.name, cells.join(" | ")); // writing to a string cannot fail
    }
    text
}

fn fits(row: &Row) -> String {
    let ends = |form| match (row.kind, form) {
        (Kind::Active, Form::Plain) => &["n", "nNUM", "nVAL"][..],
        (Kind::Regions, Form::Plain) => &["n"],
        (_one_card, _) => &[""],
    };
    let names = row.fits.iter().flat_map(|Card(keyword, form, _)| ends(*form).iter().map(move |end| (keyword, end)));
    names.map(|(keyword, end)| format!("`{keyword}{end}`")).collect::<Vec<_>>().join(", ")
}

fn csv(row: &Row) -> String {
    row.csv.iter().map(|column| format!("`{}`", column.0)).collect::<Vec<_>>().join(", ")
}

fn memory(row: &Row) -> String {
    let Some(Place(first_byte, stored, _)) = row.memory else { return String::new() };
    match row.kind {
        Kind::Reals(count) | Kind::Wholes(count) => format!("{first_byte}: {}[{count}]", stored.name()),
        Kind::Flag
        | Kind::U32
        | Kind::U64
        | Kind::Count
        | Kind::Real
        | Kind::Text
        | Kind::Time
        | Kind::Span
        | Kind::Faults
        | Kind::Active
        | Kind::Regions => format!("{first_byte}: {}", stored.name()),
    }
}

fn chunk(row: &Row) -> String {
    let features: Vec<_> = row.chunk.iter().map(|feature| format!("{}: `{}`", feature.place, feature.name)).collect();
    features.join(", ")
}

fn keys(keys: &[Key], before: &str) -> String {
    let names: Vec<_> = keys.iter().map(|key| format!("`{before}{}`", key.0)).collect();
    names.join(", ")
}

fn control(row: &Row) -> String {
    [keys(row.control, ""), keys(row.control_meta, "meta.")]
        .into_iter()
        .filter(|cell| !cell.is_empty())
        .collect::<Vec<_>>()
        .join(", ")
}
