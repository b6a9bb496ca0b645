//! `src/guide/verdicts.md` has every word of a verdict that the program prints, and no other.
//!
//! Words that the program keeps in a list have a row each in their section. Words of other commands are texts of the
//! source: each command that ends with "over the budget" or "not met" has a row, and what the row quotes must be there.

use crate::quoted_messages::{is_said, joined, quoted};
use crate::source::{files, root};
use frames::report::{FrameEnd, LineVerdict, LostPart, RunLimits, RunWord};
use performance::requirements::{Outcome, Verdict};
use run::runtime::{EventKind, record::missing};
use starloop::cli::exit_statuses::EXIT_STATUSES;
use starloop::cli::{EXIT_NOT_MET, EXIT_OVER_BUDGET};

const PAGE: &str = "src/guide/verdicts.md";
/// Kinds of reasons without a list of their own: no attitude from outside, a signal, and who drove the clock is gone.
const REASONS: &[&str] = &["no_attitude", "interrupted", "plant_gone", "client_gone"];
/// The command with sections of its own.
const RUN: &str = "run";

/// Returns the rows of the table in a section, as cells.
fn rows<'a>(page: &'a str, heading: &str) -> Vec<Vec<&'a str>> {
    let section = page.split_once(&format!("\n## {heading}\n")).map_or("", |(_, rest)| rest);
    let section = section.split("\n## ").next().unwrap_or_default();
    let lines = section.lines().filter(|line| line.starts_with('|')).skip(2);
    lines.map(|line| line.split('|').skip(1).map(str::trim).collect()).collect()
}

/// Returns the words that the first cells of a section name.
fn words<'a>(page: &'a str, heading: &str) -> Vec<&'a str> {
    rows(page, heading).iter().flat_map(|cells| quoted(cells[0]).collect::<Vec<_>>()).collect()
}

/// Returns the words of a list without a row, and the rows without a word of the list.
fn differences(page: &str, heading: &str, wanted: &[&str]) -> Vec<String> {
    let got = words(page, heading);
    let missing = wanted.iter().filter(|word| !got.contains(word)).map(|word| format!("{heading}: no row for {word}"));
    let surplus = got.iter().filter(|word| !wanted.contains(word));
    missing.chain(surplus.map(|word| format!("{heading}: the program has no {word}"))).collect()
}

/// Returns the differences of all sections whose words the program lists.
fn listed(page: &str) -> Vec<String> {
    let events = missing(&RunLimits::default()).map(|missing| missing.kind.name());
    let of_links = [EventKind::LinkLost, EventKind::LinkUnreached].map(EventKind::name);
    let of_events: Vec<&str> = events.into_iter().chain(of_links).chain(REASONS.iter().copied()).collect();
    [
        differences(page, "The word of a run", &RunWord::ALL.map(RunWord::name)),
        differences(page, "The ends of frames", &FrameEnd::ALL.map(FrameEnd::name)),
        differences(page, "Events that make a run incomplete", &of_events),
        differences(page, "Lost parts", &LostPart::ALL.map(LostPart::name)),
        differences(page, "Requirements", &Verdict::ALL.map(Verdict::name)),
    ]
    .concat()
}

/// Returns the keys of limits that their rows lack.
fn limits(page: &str) -> Vec<String> {
    let rows = rows(page, "Events that make a run incomplete");
    let has_key = |kind: &str, key: &str| rows.iter().any(|cells| cells[0].contains(kind) && cells[1].contains(key));
    let all = missing(&RunLimits::default());
    let lacking = all.iter().filter(|missing| !missing.key.is_empty() && !has_key(missing.kind.name(), missing.key));
    lacking.map(|missing| format!("{} has the limit {}", missing.kind.name(), missing.key)).collect()
}

/// Returns commands without a row, and quoted words that no source has.
fn other_commands(page: &str, sources: &[String]) -> Vec<String> {
    const HEADING: &str = "Other commands";
    let named = words(page, HEADING);
    let judging = EXIT_STATUSES
        .iter()
        .filter(|status| status.numbers.iter().any(|number| [EXIT_NOT_MET, EXIT_OVER_BUDGET].contains(number)));
    let commands = judging.flat_map(|status| status.commands).filter(|command| **command != RUN);
    let lacking = commands.filter(|command| !named.contains(command)).map(|command| format!("no row for {command}"));
    let rows = rows(page, HEADING);
    let quotes = rows.iter().flat_map(|cells| quoted(cells[1]).chain(quoted(cells[2])).collect::<Vec<_>>());
    let unknown = quotes.filter(|quote| !is_said(quote, sources)).map(|quote| format!("no source says `{quote}`"));
    let of_lists = LineVerdict::ALL.map(LineVerdict::name).into_iter().chain(Outcome::ALL.map(Outcome::name));
    let unnamed =
        of_lists.filter(|word| !page.contains(&format!("`{word}`"))).map(|word| format!("{word} is not there"));
    lacking.chain(unknown).chain(unnamed).collect()
}

fn page() -> String {
    std::fs::read_to_string(root().join(PAGE)).unwrap()
}

fn sources() -> Vec<String> {
    files(&["src"], &["rs"]).iter().map(|file| joined(&file.text)).collect()
}

#[test]
fn every_word_of_a_verdict_has_a_row() {
    let page = page();
    let found = [listed(&page), limits(&page), other_commands(&page, &sources())].concat();
    assert!(found.is_empty(), "{PAGE}:\n{}", found.join("\n"));
}

#[test]
fn missing_and_unknown_words_are_noticed() {
    let page = page();
    for (right, wrong, wanted) in [
        ("| `LOST` |", "| `GONE` |", 2),
        ("| `not_exposed` |", "| `exposed` |", 2),
        ("| `queue_overflow` |", "| - |", 1),
        ("| `thread` |", "| `threads` |", 2),
    ] {
        assert_eq!(page.matches(right).count(), 1, "{right}");
        assert_eq!(listed(&page.replace(right, wrong)).len(), wanted, "{right}");
    }
    let sources = sources();
    assert_eq!(limits(&page.replace("`packets_lost_at_most`", "none")).len(), 1);
    assert_eq!(other_commands(&page.replace("| `verify` |", "| - |"), &sources), ["no row for verify"]);
    assert_eq!(other_commands(&page.replace("`frames bit-identical`", "`all alike here`"), &sources).len(), 1);
}
