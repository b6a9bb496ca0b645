//! The tables of `src/guide/command_line.md` against the command line itself: commands, exit statuses, reports as JSON.

use crate::source::root;
use clap::Command;
use starloop::cli::{exit_statuses::EXIT_STATUSES, report_json::SCHEMAS};

/// Schemas of `run --json`: with a spacecraft, faults or expectations the report is a scenario's.
const OF_RUN: &[&str] = &["run", "scenario"];

fn page() -> String {
    std::fs::read_to_string(root().join("src/guide/command_line.md")).unwrap()
}

/// The rows of the table below a heading, without its head, as written.
fn rows<'a>(page: &'a str, heading: &str) -> Vec<&'a str> {
    let section = page.split_once(&format!("\n## {heading}\n")).map_or("", |(_, rest)| rest);
    let section = section.split("\n## ").next().unwrap_or_default();
    section.lines().filter(|line| line.starts_with('|')).skip(2).collect()
}

/// The commands below `command` with their words, their order and what they do; clap's own `help` left out.
fn commands(command: &Command, words: &str, found: &mut Vec<(String, Command)>) {
    for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
        let words = format!("{words} {}", below.get_name()).trim().to_owned();
        found.push((words.clone(), below.clone()));
        commands(below, &words, found);
    }
}

fn all_commands() -> Vec<(String, Command)> {
    let mut found = Vec::new();
    commands(&starloop::cli::command(), "", &mut found);
    found
}

/// Lines of `wanted` and `got` that the other lacks.
fn differences(wanted: &[String], got: &[&str]) -> Vec<String> {
    let missing = wanted.iter().filter(|row| !got.contains(&row.as_str())).map(|row| format!("wanted: {row}"));
    let surplus =
        got.iter().filter(|row| !wanted.iter().any(|wanted| wanted == *row)).map(|row| format!("got:    {row}"));
    missing.chain(surplus).collect()
}

#[test]
fn the_table_of_commands_is_that_of_the_program() {
    let row = |(words, command): (String, Command)| {
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        format!("| `{words}` | {about} |")
    };
    let wanted: Vec<String> = all_commands().into_iter().map(row).collect();
    let page = page();
    let found = differences(&wanted, &rows(&page, "Commands"));
    assert!(wanted.len() > 30, "{}", wanted.len());
    assert!(found.is_empty(), "\n{}\n\nthe whole table:\n{}", found.join("\n"), wanted.join("\n"));
}

#[test]
fn the_table_of_exit_statuses_is_that_of_the_program() {
    let row = |status: &starloop::cli::exit_statuses::ExitStatus| {
        let numbers = status.numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        let commands: Vec<String> = status.commands.iter().map(|command| format!("`{command}`")).collect();
        let commands = if commands.is_empty() { "all".into() } else { commands.join(", ") };
        format!("| {numbers} | {} | {commands} |", status.meaning.replace('|', "\\|"))
    };
    let wanted: Vec<String> = EXIT_STATUSES.iter().map(row).collect();
    let page = page();
    let found = differences(&wanted, &rows(&page, "Exit status"));
    assert!(found.is_empty(), "\n{}\n\nthe whole table:\n{}", found.join("\n"), wanted.join("\n"));
}

#[test]
fn every_report_as_json_has_a_schema_and_a_row() {
    let has_json = |command: &Command| command.get_arguments().any(|argument| argument.get_id() == "json");
    let reporting: Vec<String> =
        all_commands().into_iter().filter(|(_, c)| has_json(c)).map(|(words, _)| words).collect();
    // `calibrate` alone is `calibrate costs`; a plan that was flown has the report of a run.
    let name_of = |words: &str| match words {
        "fly" => "report".to_owned(),
        _ => words.trim_end_matches(" costs").replace(' ', "-"),
    };
    for words in &reporting {
        let name = name_of(words);
        assert!(SCHEMAS.iter().any(|(schema, _)| *schema == name), "`{words} --json` has no row in SCHEMAS");
    }
    let page = page();
    let rows = rows(&page, "Reports as JSON");
    for (schema, version) in SCHEMAS {
        let is_printed = reporting.iter().any(|words| name_of(words) == *schema) || OF_RUN.contains(schema);
        let is_built = cfg!(feature = "data_sets") || *schema != "dataset";
        assert_eq!(is_printed, is_built, "{schema}: a command prints it when its feature is built");
        let name = format!("`starloop.{schema}/{version}`");
        assert!(rows.iter().any(|row| row.contains(&name)), "no row of the page names {name}");
    }
}

#[test]
fn a_missing_and_a_surplus_row_are_found() {
    let page =
        "# A\n\n## Commands\n\n| command | does |\n|---|---|\n| `a` | A |\n| `b` | B |\n\n## Other\n\n| c | d |\n";
    let wanted = ["| `a` | A |".to_owned(), "| `c` | C |".to_owned()];
    let found = differences(&wanted, &rows(page, "Commands"));
    assert_eq!(found, ["wanted: | `c` | C |", "got:    | `b` | B |"]);
    assert!(differences(&wanted[..1], &rows(page, "Commands")[..1]).is_empty(), "control");
}
