//! The output that documents quote is the output that the program prints.
//!
//! A ```` ```text ```` block under a line `<!-- output: COMMAND -->` is an excerpt: each of its lines is a line of what
//! the command prints, in the same order. The command runs in an empty folder with `configs/` taken from the
//! repository. Words are compared one by one. A number with one or two decimals in a block marked `<!-- output, times
//! vary: COMMAND -->` may be any number: it is a time of the machine. In excerpts without a marker the text says by
//! hand where and when the run was.

use crate::commands::{from_root, output_within};
use crate::{pages::pages, source::root};
use std::process::Command;

/// Longest run of one command, s.
const LIMIT_S: u64 = 300;

/// One excerpt.
#[derive(Debug, PartialEq, Eq)]
struct Excerpt<'a> {
    arguments: Vec<&'a str>,
    times_vary: bool,
    lines: Vec<&'a str>,
}

/// Returns the marked excerpts of a document.
fn excerpts(document: &str) -> Vec<Excerpt<'_>> {
    let mut found = Vec::new();
    let mut lines = document.lines();
    while let Some(line) = lines.next() {
        let marker = line.strip_prefix("<!-- output").and_then(|rest| rest.strip_suffix(" -->"));
        let Some((manner, command)) = marker.and_then(|rest| rest.split_once(": ")) else { continue };
        assert!(manner.is_empty() || manner == ", times vary", "an unknown marker: {line}");
        assert_eq!(lines.next(), Some("```text"), "behind {line}");
        let block = lines.by_ref().take_while(|line| *line != "```").collect();
        let arguments = command.strip_prefix("starloop ").expect("a call of starloop").split_whitespace().collect();
        found.push(Excerpt { arguments, times_vary: !manner.is_empty(), lines: block });
    }
    found
}

/// Returns true for a number that an excerpt may give as a time of the machine.
fn is_time(word: &str) -> bool {
    let decimals = word.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    (1..=2).contains(&decimals) && word.parse::<f64>().is_ok()
}

fn is_same_line(quoted: &str, printed: &str, times_vary: bool) -> bool {
    let (quoted, printed) = (quoted.split_whitespace(), printed.split_whitespace());
    let is_same_word =
        |(quoted, printed): (&str, &str)| quoted == printed || times_vary && is_time(quoted) && is_time(printed);
    quoted.clone().count() == printed.clone().count() && quoted.zip(printed).all(is_same_word)
}

/// Returns the first quoted line that is not printed, in order.
fn first_difference<'a>(excerpt: &Excerpt<'a>, printed: &str) -> Option<&'a str> {
    let mut rest = printed.lines();
    excerpt
        .lines
        .iter()
        .copied()
        .find(|quoted| !quoted.trim().is_empty() && !rest.any(|line| is_same_line(quoted, line, excerpt.times_vary)))
}

#[test]
fn quoted_output_is_what_the_program_prints() {
    let pages = pages();
    let excerpts: Vec<_> = pages.iter().flat_map(|page| excerpts(&page.text)).collect();
    assert!(excerpts.len() >= 3, "the pages have {} marked excerpts", excerpts.len());
    for excerpt in &excerpts {
        let folder = tempfile::tempdir().unwrap();
        let arguments = excerpt.arguments.iter().map(|argument| from_root(argument, &root()));
        let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
        let output = output_within(command.args(arguments).current_dir(folder.path()), LIMIT_S).unwrap();
        let printed = String::from_utf8_lossy(&output.stdout);
        let difference = first_difference(excerpt, &printed);
        assert_eq!(difference, None, "`starloop {}` prints:\n{printed}", excerpt.arguments.join(" "));
    }
}

#[test]
fn changed_number_or_order_is_found() {
    let document = "<!-- output, times vary: starloop check -->\n```text\na 1.5 3.1e-4\nb\n```\ntext\n";
    let excerpts = excerpts(document);
    let [excerpt] = &excerpts[..] else { panic!("{excerpts:?}") };
    assert_eq!((excerpt.arguments.as_slice(), excerpt.times_vary), (&["check"][..], true));
    assert_eq!(first_difference(excerpt, "x\na  0.25 3.1e-4\ny\n b\n"), None);
    assert_eq!(first_difference(excerpt, "a 0.25 3.2e-4\nb\n"), Some("a 1.5 3.1e-4"));
    assert_eq!(first_difference(excerpt, "b\na 0.25 3.1e-4\n"), Some("b"));
    let exact = Excerpt { times_vary: false, ..super::excerpts::excerpts(document).remove(0) };
    assert_eq!(first_difference(&exact, "a 0.25 3.1e-4\nb\n"), Some("a 1.5 3.1e-4"));
}
