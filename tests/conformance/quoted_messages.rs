//! The messages that `src/guide/troubleshooting.md` quotes are messages of the program.
//!
//! The first cell of a row has the symptom; each text in backticks there, up to `...`, must occur in a source file,
//! where strings that go on in the next line are joined. Other words of the cell are free.

use crate::source::{files, root};

const PAGE: &str = "src/guide/troubleshooting.md";
/// Fewest rows of the page.
const ROWS_MIN: usize = 40;

/// Returns the first cells of the page's tables.
fn symptoms(page: &str) -> Vec<&str> {
    let rows = page.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| symptom "));
    rows.filter_map(|row| row.split('|').nth(1)).collect()
}

/// Returns the texts of the program that a symptom quotes.
pub(crate) fn quoted(symptom: &str) -> impl Iterator<Item = &str> {
    let quotes = symptom.split('`').skip(1).step_by(2);
    quotes.flat_map(|quote| quote.split("...")).map(str::trim).filter(|piece| !piece.is_empty())
}

/// Returns a source with strings that go on in the next line joined.
pub(crate) fn joined(text: &str) -> String {
    let mut pieces = text.split("\\\n");
    let first = pieces.next().unwrap_or_default().to_owned();
    pieces.fold(first, |text, piece| text + piece.trim_start())
}

/// Returns whether a source has a text, as it is or with its quotes escaped.
pub(crate) fn is_said(piece: &str, sources: &[String]) -> bool {
    let escaped = piece.replace('"', "\\\"");
    sources.iter().any(|source| source.contains(piece) || source.contains(&escaped))
}

/// Returns the rows that quote nothing, and the quoted texts that no source has.
fn breaches(page: &str, sources: &[String]) -> Vec<String> {
    let of_row = |symptom: &&str| {
        let missing: Vec<_> =
            quoted(symptom).filter(|piece| !is_said(piece, sources)).map(|piece| format!("`{piece}`")).collect();
        let is_empty = quoted(symptom).next().is_none();
        if is_empty { vec![format!("a row that quotes nothing: {symptom}")] } else { missing }
    };
    symptoms(page).iter().flat_map(of_row).collect()
}

#[test]
fn messages_of_the_troubleshooting_page_are_in_the_source() {
    let sources: Vec<_> = files(&["src"], &["rs"]).iter().map(|file| joined(&file.text)).collect();
    let page = std::fs::read_to_string(root().join(PAGE)).unwrap();
    let rows = symptoms(&page).len();
    assert!(rows >= ROWS_MIN, "{rows} rows");
    let found = breaches(&page, &sources);
    assert!(found.is_empty(), "{PAGE} quotes what no source says:\n{}", found.join("\n"));
}

#[test]
fn changed_messages_and_rows_without_one_are_noticed() {
    let sources = [joined("let a = \"cannot be \\\n        read: {file} is \\\"lost\\\"\";")];
    let page = |symptom: &str| format!("| symptom | cause |\n|---|---|\n| {symptom} | - |\n");
    assert_eq!(breaches(&page("`cannot be read: ... is \"lost\"`, always"), &sources), Vec::<String>::new());
    assert_eq!(breaches(&page("`cannot be red`"), &sources), ["`cannot be red`"]);
    assert_eq!(breaches(&page("cannot be read"), &sources).len(), 1);
}
