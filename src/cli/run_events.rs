//! `events.jsonl`: the events of a run, one JSON object a line, after a line that counts all of them.
//!
//! The ledger of a run keeps its first [`EARLY`] events and its last [`KEPT`]; those between are counted by kind, and
//! the first line says how many they are.

use frames::report::EventLine;
use run::runtime::ledger::{EARLY, KEPT};
use run::runtime::{EventKind, RunRecord};
use serde::Serialize;
use std::collections::BTreeMap;

/// Name of the file in the folder of a run.
pub(super) const FILE: &str = "events.jsonl";
/// Version of its form.
const SCHEMA: &str = "starloop.events/1";

/// The first line.
#[derive(Debug, Serialize)]
struct Head {
    schema: &'static str,
    /// All events of the run.
    events: u64,
    /// Events that have a line.
    kept: usize,
    /// Events that are only counted.
    left_out: u64,
    first_kept: usize,
    last_kept: usize,
    counts: BTreeMap<&'static str, u64>,
}

/// Returns the kinds of events that happened, with their numbers.
pub(super) fn counted(record: &RunRecord) -> impl Iterator<Item = (EventKind, u64)> {
    let all = EventKind::ALL.iter().map(|kind| (*kind, record.ledger.count(*kind)));
    all.filter(|(_, count)| *count > 0)
}

/// Returns the number of events that are only counted.
pub(super) fn left_out(record: &RunRecord) -> u64 {
    record.ledger.total() - record.ledger.kept().count() as u64
}

/// Returns the text of the file.
///
/// # Errors
/// When an event does not go into JSON.
pub(super) fn to_json_lines(record: &RunRecord) -> serde_json::Result<String> {
    let lines: Vec<EventLine> = record.kept_events();
    let head = Head {
        schema: SCHEMA,
        events: record.ledger.total(),
        kept: lines.len(),
        left_out: left_out(record),
        first_kept: EARLY,
        last_kept: KEPT,
        counts: counted(record).map(|(kind, count)| (kind.name(), count)).collect(),
    };
    let mut text = serde_json::to_string(&head)? + "\n";
    for line in &lines {
        text.push_str(&serde_json::to_string(line)?);
        text.push('\n');
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::{Span, Tai};

    fn lines_of(events: usize) -> Vec<serde_json::Value> {
        let mut record = RunRecord::default();
        for number in 0..events {
            let number = u32::try_from(number).unwrap();
            record.note(EventKind::Late, Tai::from_ns(i64::from(number)), number, Span::ZERO);
        }
        let text = to_json_lines(&record).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    #[test]
    fn every_event_has_a_line_until_the_ledger_is_full_and_the_first_line_counts_the_rest() {
        let lines = lines_of(EARLY + KEPT);
        assert_eq!((lines.len(), &lines[0]["left_out"]), (1 + EARLY + KEPT, &0.into()));
        let lines = lines_of(EARLY + KEPT + 7);
        assert_eq!((lines.len(), &lines[0]["left_out"]), (1 + EARLY + KEPT, &7.into()), "control");
        assert_eq!(lines[0]["counts"]["late"], EARLY + KEPT + 7);
        assert_eq!((&lines[1]["frame"], &lines[1]["kind"]), (&0.into(), &"late".into()));
        assert_eq!(lines.last().unwrap()["frame"], EARLY + KEPT + 6);
        assert_eq!(lines_of(0).len(), 1, "a run without events has the first line alone");
    }
}
