//! The crates and their dependencies, as Cargo knows them, compared with the table of `src/ARCHITECTURE.md`.
//!
//! Who may import whom is not checked here: a crate that is not a dependency cannot be named, the compiler says so.

use crate::source::root;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

/// Crate -> everything of its `[dependencies]`, without the prefix `starloop_`; or file -> the files that it refers to.
pub(crate) type Graph = BTreeMap<String, BTreeSet<String>>;

/// Crates above the laboratory: they open it to users.
const INTERFACES: &[&str] = &["starloop", "python"];
/// Crates that the simulated far end of the cable checks, and so must not share.
const CHECKED_BY_TESTBED: &[&str] = &["sky", "plan", "image", "frames", "outputs", "run"];
/// The only crates that speak to the graphics interface.
const MAY_NAME_WGPU: &[&str] = &["image", "outputs"];

fn short(name: &str) -> String {
    name.strip_prefix("starloop_").unwrap_or(name).to_owned()
}

/// Returns the workspace's packages, read by `cargo metadata`.
fn packages() -> Vec<Value> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["metadata", "--format-version", "1", "--no-deps", "--offline", "--locked"]).current_dir(root());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

fn name_of(package: &Value) -> String {
    short(package["name"].as_str().unwrap())
}

fn graph() -> Graph {
    packages().iter().map(|package| (name_of(package), dependencies(package))).collect()
}

/// Returns the crates of `src/lab`.
fn laboratory() -> BTreeSet<String> {
    let is_in_it = |package: &&Value| package["manifest_path"].as_str().unwrap().contains("/src/lab/");
    packages().iter().filter(is_in_it).map(name_of).collect()
}

fn dependencies(package: &Value) -> BTreeSet<String> {
    let all = package["dependencies"].as_array().unwrap();
    let normal = all.iter().filter(|dependency| dependency["kind"].is_null());
    normal.map(|dependency| short(dependency["name"].as_str().unwrap())).collect()
}

/// Returns the crates of the workspace among the dependencies.
fn inside(graph: &Graph) -> Graph {
    let own = |all: &BTreeSet<String>| all.iter().filter(|name| graph.contains_key(*name)).cloned().collect();
    graph.iter().map(|(name, all)| (name.clone(), own(all))).collect()
}

/// Returns every crate, or file, that `name` reaches through what it depends on.
pub(crate) fn reached_from(name: &str, graph: &Graph) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut waiting = vec![name.to_owned()];
    while let Some(next) = waiting.pop() {
        for dependency in graph.get(&next).into_iter().flatten() {
            if reached.insert(dependency.clone()) {
                waiting.push(dependency.clone());
            }
        }
    }
    reached
}

fn document() -> String {
    std::fs::read_to_string(root().join("src/ARCHITECTURE.md")).unwrap()
}

fn in_backticks(cell: &str) -> BTreeSet<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// Returns rows of the table of crates: `| name | sentence | dependencies |`.
fn table(document: &str) -> Graph {
    let mut rows = Graph::new();
    let mut is_in_table = false;
    for line in document.lines() {
        let cells: Vec<_> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
        if !line.starts_with('|') {
            is_in_table = false;
        } else if cells.first() == Some(&"crate") && cells.last() == Some(&"depends on") {
            is_in_table = true;
        } else if is_in_table && cells.len() == 3 && cells[0].starts_with('`') {
            assert!(cells[1].len() > 20, "{}: one sentence on what it does", cells[0]);
            rows.insert(cells[0].trim_matches('`').to_owned(), in_backticks(cells[2]));
        }
    }
    rows
}

/// Differences between a document's table and the graph, in words.
fn differences(document: &str, graph: &Graph) -> Vec<String> {
    let table = table(document);
    let mut found = Vec::new();
    for name in graph.keys().chain(table.keys()).collect::<BTreeSet<_>>() {
        if graph.get(name) != table.get(name) {
            found.push(format!("{name}: Cargo has {:?}, the table {:?}", graph.get(name), table.get(name)));
        }
    }
    found
}

#[test]
fn the_documented_table_is_what_cargo_has() {
    let found = differences(&document(), &inside(&graph()));
    assert!(found.is_empty(), "src/ARCHITECTURE.md:\n{}", found.join("\n"));
}

#[test]
fn a_changed_table_is_noticed() {
    let graph = inside(&graph());
    let text = document();
    let row = text.lines().find(|line| line.starts_with("| `testbed` |")).unwrap();
    assert_eq!(differences(&text.replace(&format!("{row}\n"), ""), &graph).len(), 1, "a missing row");
    assert_eq!(differences(&text.replace(row, &row.replace("`link`", "`image`")), &graph).len(), 1, "another crate");
}

#[test]
fn the_testbed_cannot_reach_what_it_checks() {
    let graph = inside(&graph());
    let reached = reached_from("testbed", &graph);
    assert!(reached.contains("stars"), "control: {reached:?}");
    for name in CHECKED_BY_TESTBED {
        assert!(graph.contains_key(*name), "{name} is a crate");
        assert!(!reached.contains(*name), "testbed reaches {name}");
    }
}

/// Crates outside the laboratory that reach it, interfaces aside.
fn breaches(graph: &Graph, laboratory: &BTreeSet<String>) -> Vec<String> {
    let mission = graph.keys().filter(|name| !laboratory.contains(*name) && !INTERFACES.contains(&name.as_str()));
    mission.filter(|name| !reached_from(name, graph).is_disjoint(laboratory)).cloned().collect()
}

#[test]
fn the_mission_does_not_reach_the_laboratory() {
    let (mut graph, laboratory) = (inside(&graph()), laboratory());
    for name in ["imports", "batch", "data_sets", "night_sky", "performance", "fmu", "fmu_library"] {
        assert!(laboratory.contains(name), "{name} is in the laboratory");
    }
    assert_eq!(breaches(&graph, &laboratory), Vec::<String>::new());
    graph.get_mut("scene").unwrap().insert("batch".into());
    assert!(
        breaches(&graph, &laboratory).contains(&"run".to_owned()),
        "a breach is noticed, also through another crate"
    );
}

#[test]
fn two_crates_speak_to_the_graphics_interface() {
    let named: Vec<_> = graph().into_iter().filter(|(_, all)| all.contains("wgpu")).map(|(name, _)| name).collect();
    assert_eq!(named, MAY_NAME_WGPU);
}
