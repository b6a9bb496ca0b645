//! Pages that the project's programs write are made for paper too: `@media print`, margins, rows and charts in one piece.

use crate::source::{SourceFile, files};

/// Returns the files that write a page, with their styles: a page in files has its style beside it.
fn writers() -> Vec<SourceFile> {
    let mut found = files(&["src", "hil_scripts"], &["rs", "py", "css"]);
    found.retain(|file| {
        let is_test = file.path.contains("tests") || file.path.contains("test_");
        let is_page = file.text.contains("<!DOCTYPE html>") && file.text.contains("<style>");
        !is_test && (is_page || file.path.ends_with(".css"))
    });
    found
}

/// Returns what a style lacks.
fn missing(text: &str) -> Vec<&'static str> {
    let print = text.split_once("@media print").map_or("", |(_, rest)| rest);
    ["@page", "thead", "break-inside", "overflow-wrap"].into_iter().filter(|part| !print.contains(part)).collect()
}

#[test]
fn every_page_has_a_style_for_paper() {
    let writers = writers();
    assert!(writers.len() >= 3, "{:?}", writers.iter().map(|file| &file.path).collect::<Vec<_>>());
    for file in writers {
        assert_eq!(missing(&file.text), Vec::<&str>::new(), "{}", file.path);
    }
}

#[test]
fn a_page_without_a_style_for_paper_is_noticed() {
    let style = "td{}@media print{@page{}td{overflow-wrap:anywhere}thead{}tr{break-inside:avoid}}";
    assert_eq!(missing(style), Vec::<&str>::new(), "control");
    assert_eq!(missing(&style.replace("@media print", "@media screen")).len(), 4);
    assert_eq!(missing(&style.replace("break-inside", "color")), ["break-inside"]);
}
