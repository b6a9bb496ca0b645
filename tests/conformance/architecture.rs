//! `src/ARCHITECTURE.md`: short, and the places that it names exist.

use crate::source::root;

/// Four printed pages.
const BYTES_MAX: usize = 16_000;
/// Fewest rows of "Where do I change".
const PLACES_MIN: usize = 20;

fn document() -> String {
    std::fs::read_to_string(root().join("src/ARCHITECTURE.md")).unwrap()
}

/// Paths in backticks of the second column of the table under the heading "Where do I change".
fn places(document: &str) -> Vec<Vec<String>> {
    let from = document.find("## Where do I change").expect("a section \"Where do I change\"");
    let section = document[from..].split("\n## ").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| I want"));
    rows.filter_map(|row| row.split('|').nth(2)).map(paths).collect()
}

fn paths(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Paths that are not below the root.
fn missing(document: &str) -> Vec<String> {
    let all = places(document).into_iter().flatten();
    all.filter(|path| !root().join(path).exists()).collect()
}

#[test]
fn the_document_is_short() {
    assert!(document().len() <= BYTES_MAX, "{} bytes, wanted at most {BYTES_MAX}", document().len());
}

#[test]
fn every_place_to_change_exists() {
    let text = document();
    let rows = places(&text);
    assert!(rows.len() >= PLACES_MIN, "{} rows, wanted {PLACES_MIN}", rows.len());
    assert!(rows.iter().all(|row| !row.is_empty()), "each row names a path: {rows:?}");
    assert_eq!(missing(&text), Vec::<String>::new(), "paths that do not exist");
}

#[test]
fn a_place_that_does_not_exist_is_noticed() {
    let text = document();
    let first = &places(&text)[0][0];
    let broken = text.replace(&format!("`{first}`"), "`src/nowhere.rs`");
    assert!(missing(&broken).contains(&"src/nowhere.rs".to_owned()));
}
