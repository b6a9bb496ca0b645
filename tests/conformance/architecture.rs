//! `src/ARCHITECTURE.md`: short, and the places that it names exist.

use crate::source::root;
use std::path::PathBuf;

/// Three printed pages.
const BYTES_MAX: usize = 12_000;
/// Fewest rows of "Where do I change".
const PLACES_MIN: usize = 20;
/// Most steps of the walk from link to frame.
const STEPS_MAX: usize = 15;

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

/// A path of the document, which is below `src` or at the top.
fn place(path: &str) -> Option<PathBuf> {
    [root().join("src").join(path), root().join(path)].into_iter().find(|place| place.exists())
}

/// Paths that do not exist.
fn missing(document: &str) -> Vec<String> {
    places(document).into_iter().flatten().filter(|path| place(path).is_none()).collect()
}

/// File and function of each step of the walk from link to frame.
fn steps(document: &str) -> Vec<[String; 2]> {
    let from = document.find("## One attitude from link to frame").expect("the walk of one attitude");
    let section = document[from..].split("\n## ").next().unwrap();
    let steps = section.lines().filter(|line| line.starts_with(|first: char| first.is_ascii_digit()));
    steps.map(|line| paths(line).try_into().expect("a file and a function")).collect()
}

/// Steps whose function is not in their file.
fn untrue(document: &str) -> Vec<String> {
    let has = |[path, function]: &[String; 2]| {
        let text = place(path).and_then(|place| std::fs::read_to_string(place).ok());
        text.is_some_and(|text| text.contains(&format!("fn {function}(")) || text.contains(&format!("fn {function}<")))
    };
    steps(document).into_iter().filter(|step| !has(step)).map(|step| step.join(" ")).collect()
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
fn each_step_of_the_walk_is_a_function_that_exists() {
    let text = document();
    assert!((10..=STEPS_MAX).contains(&steps(&text).len()), "{} steps", steps(&text).len());
    assert_eq!(untrue(&text), Vec::<String>::new(), "functions that are not there");
    let broken = text.replace("`take_in`", "`take_out`");
    assert_eq!(untrue(&broken).len(), 1, "a function that does not exist is noticed");
}

#[test]
fn a_place_that_does_not_exist_is_noticed() {
    let text = document();
    let first = &places(&text)[0][0];
    let broken = text.replace(&format!("`{first}`"), "`src/nowhere.rs`");
    assert!(missing(&broken).contains(&"src/nowhere.rs".to_owned()));
}
