//! The table for people: `src/guide/frame_facts.md`.

use super::row::{Card, Key, Place, Row};
use super::table::TABLE;
use super::value::{Form, Kind};
use core::fmt::Write;

const HEAD: &str = "# Facts of a frame

The facts of each frame, and where they are stored. Generated from the table in `src/frames/sink/facts/table.rs`, which every
output walks; a test compares this file with it, and leaves the new text in `target/frame_facts` when they differ.

A dash: that output deliberately does not have the fact. FITS has nearly all; `frames.csv` has what changes from frame to
frame; shared memory (offset and type in a slot's head, [FRAMES.md](../../firmware_protocol/FRAMES.md)) and the chunk data of
the network camera (place from 0) have fixed layouts; the live view (`frame` of `/state.json`) has what its page shows, the
control socket what a program that steps a run asks for. `_ns`, `_ms` and `_s` in a name are units; where a name has none,
the unit is the one of the table. A fact that a frame does not have is left out of FITS, empty in CSV, `null` in JSON.

Not facts of the frame, and written beside them: the map to the sky (WCS) and checksums in FITS, `serial` in shared memory,
`count`, `taken_utc` and `age_s` in the live view, `mid_exposure_s` (since the run's start) in the control socket's answer.

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
        let unit = if row.unit.is_empty() { "-" } else { row.unit };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| `{}` | {} | {unit} | {} |", row.name, row.kind.name(), row.about);
    }
    text.push_str(PLACES);
    for row in TABLE {
        let cells = [fits(row), csv(row), memory(row), chunk(row), keys(row.live, ""), control(row)];
        let cells = cells.map(|cell| if cell.is_empty() { "-".to_owned() } else { cell });
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
