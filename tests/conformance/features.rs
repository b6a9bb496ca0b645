//! A missing feature is reported with the line that installs it, and the documents name every feature.

use crate::source::{files, root};
use std::collections::BTreeSet;

const INSTALL: &str = "cargo install --locked --path . --features ";

/// Returns the features of the program, with what each has in it.
fn features() -> Vec<(String, String)> {
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let section = manifest.split("\n[features]\n").nth(1).unwrap().split("\n[").next().unwrap();
    let lines = section.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split_once(" = "));
    lines.map(|(name, parts)| (name.to_owned(), parts.to_owned())).collect()
}

/// Returns the messages of a source that name a feature to build with, and not the whole line that installs it.
fn breaches(source: &str) -> Vec<&str> {
    let is_message = |line: &&str| !line.trim_start().starts_with("//") && line.contains("--features ");
    let is_whole = |line: &str| line.contains(INSTALL) || line.contains(".contains(") || line.contains("\"--features ");
    source.lines().filter(is_message).filter(|line| !is_whole(line)).collect()
}

#[test]
fn messages_about_a_missing_feature_have_the_line_that_installs_it() {
    let sources = files(&["src"], &["rs"]);
    let found: Vec<_> = sources
        .iter()
        .flat_map(|file| breaches(&file.text).into_iter().map(|line| format!("{}: {}", file.path, line.trim())))
        .collect();
    assert!(found.is_empty(), "wanted \"{INSTALL}...\":\n{}", found.join("\n"));
    let named = |name: &str| sources.iter().any(|file| file.text.contains(&format!("{INSTALL}{name}")));
    for name in ["display", "spice", "hats", "data_sets", "parquet", "iceoryx2"] {
        assert!(named(name), "{name}");
    }
    assert_eq!(breaches("bail!(\"build it with --features hats\")").len(), 1, "control");
    assert_eq!(breaches("bail!(\"with `cargo install --locked --path . --features hats`\")").len(), 0);
}

#[test]
fn every_feature_has_a_row_and_full_has_them_all() {
    let page = std::fs::read_to_string(root().join("src/guide/installing.md")).unwrap();
    let features = features();
    let named = |name: &&str| !matches!(*name, "default" | "full");
    let names: BTreeSet<_> = features.iter().map(|(name, _)| name.as_str()).filter(named).collect();
    for name in &names {
        assert!(page.contains(&format!("\n| `{name}` | ")), "{name} has no row in the table of features");
    }
    let parts = |wanted: &str| &features.iter().find(|(name, _)| name == wanted).unwrap().1;
    let has = |whole: &str, name: &str| parts(whole).contains(&format!("\"{name}\""));
    assert!(has("default", "display"));
    for name in names.iter().filter(|name| **name != "display") {
        assert!(has("full", name), "full lacks {name}");
    }
}
