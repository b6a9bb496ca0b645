//! `hil_scripts/tests.txt` lists every test of the project with the form of the test command that runs it, and why.

use crate::source::{files, root};
use serde_json::Value;
use std::{collections::BTreeSet, process::Command};

const LIST: &str = "hil_scripts/tests.txt";
/// A package without a test: its tests are a script.
const WITHOUT_TESTS: &str = "starloop_python";

/// A row: kind and name, form, whether a reason is given.
type Row<'a> = ((&'a str, &'a str), &'a str, bool);

fn rows(list: &str) -> Vec<Row<'_>> {
    let lines = list.lines().filter(|line| !line.starts_with('#') && !line.trim().is_empty());
    let row = |line| {
        let mut words = str::split_whitespace(line);
        let mut next = || words.next().unwrap_or("");
        let (kind, name, form) = (next(), next(), next());
        ((kind, name), form, !next().is_empty())
    };
    lines.map(row).collect()
}

/// Returns the tests that exist: kind and name.
fn existing() -> BTreeSet<(String, String)> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(["metadata", "--format-version", "1", "--no-deps", "--offline", "--locked"]).current_dir(root());
    let metadata: Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    let mut found = BTreeSet::new();
    for package in metadata["packages"].as_array().unwrap() {
        for target in package["targets"].as_array().unwrap().iter().filter(|target| target["test"] == true) {
            let is_binary = target["kind"][0] == "test";
            let (kind, named) = if is_binary { ("binary", target) } else { ("crate", package) };
            found.insert((kind.to_owned(), named["name"].as_str().unwrap().to_owned()));
        }
    }
    for entry in std::fs::read_dir(root().join("hil_scripts/tests")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name.starts_with("test_") && name.ends_with(".py") {
            found.insert(("script".to_owned(), name));
        }
    }
    found
}

/// Returns what is wrong with the list.
fn breaches(list: &str, existing: &BTreeSet<(String, String)>) -> Vec<String> {
    let rows = rows(list);
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    for ((kind, name), form, has_reason) in &rows {
        let key = ((*kind).to_owned(), (*name).to_owned());
        if !existing.contains(&key) {
            found.push(format!("{kind} {name}: such a test does not exist"));
        }
        if !seen.insert(key) {
            found.push(format!("{kind} {name}: listed twice"));
        }
        let is_part = *kind == "script" && form.starts_with("quick:");
        if !["quick", "full"].contains(form) && !is_part {
            found.push(format!("{kind} {name}: form \"{form}\", wanted quick, full, or quick: and names of a script"));
        }
        if !has_reason {
            found.push(format!("{kind} {name}: no reason"));
        }
    }
    let missing = existing.iter().filter(|key| !seen.contains(*key));
    found.extend(missing.map(|(kind, name)| format!("{kind} {name}: not in {LIST}")));
    found
}

#[test]
fn every_test_is_in_the_list_once_with_a_form_and_a_reason() {
    let list = std::fs::read_to_string(root().join(LIST)).unwrap();
    let existing = existing();
    assert!(existing.len() > 80 && !existing.contains(&("crate".to_owned(), WITHOUT_TESTS.to_owned())));
    let found = breaches(&list, &existing);
    assert!(found.is_empty(), "{}", found.join("\n"));
    let forms = |form: &str| rows(&list).iter().filter(|row| row.1.starts_with(form)).count();
    assert!(forms("quick") > 40 && forms("full") > 20);
}

#[test]
fn a_test_that_is_missing_or_listed_wrongly_is_noticed() {
    let existing: BTreeSet<_> = [("script", "test_a.py"), ("crate", "b")].map(|(a, b)| (a.into(), b.into())).into();
    let count = |list: &str| breaches(list, &existing).len();
    assert_eq!(count("script test_a.py quick:A.test_b why\n# x\ncrate b full why so\n"), 0);
    assert_eq!(count("script test_a.py quick why\n"), 1, "one is missing");
    assert_eq!(count("script test_a.py quick why\ncrate b slow why\n"), 1, "no such form");
    assert_eq!(count("script test_a.py quick why\ncrate b quick\n"), 1, "no reason");
    assert_eq!(count("script test_a.py full why\ncrate b full why\ncrate b full why\n"), 1, "twice");
    assert_eq!(count("script test_a.py full why\ncrate b full why\nbinary c full why\n"), 1, "does not exist");
    assert_eq!(count("script test_a.py full why\ncrate b quick:x why\n"), 1, "only scripts have parts");
}

#[test]
fn parts_of_scripts_exist() {
    let list = std::fs::read_to_string(root().join(LIST)).unwrap();
    let scripts = files(&["hil_scripts/tests"], &["py"]);
    for ((_, name), form, _) in rows(&list) {
        let Some(parts) = form.strip_prefix("quick:") else { continue };
        let script = scripts.iter().find(|script| script.path.ends_with(&format!("/{name}"))).unwrap();
        for part in parts.split(',') {
            let (class, test) = part.split_once('.').unwrap_or((part, ""));
            assert!(script.text.contains(&format!("class {class}(")), "{name}: {class}");
            assert!(script.text.contains(&format!("def {test}")), "{name}: {test}");
        }
    }
}

#[test]
fn continuous_integration_runs_the_quick_form_that_the_first_page_names() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap();
    assert!(read(".ci/run").trim_end().ends_with("\nexec hil_scripts/test.sh"));
    assert!(read("README.md").contains("\n$ hil_scripts/test.sh\n"));
}
