//! Words that are not allowed in names and comments of `src`, `firmware_protocol` and `tests`.

use crate::source::{SourceFile, Token, files, tokens};

/// Names of a place for anything: no module, function or type has them as one of its words.
const SAYS_NOTHING: &[&str] = &["util", "utils", "manager", "managers", "helper", "helpers"];
/// Verbs that do not say what is done: no module or function begins with them.
const VAGUE_VERBS: &[&str] = &["handle", "process"];

/// Returns `PATH:LINE: what` for each breach in one file.
fn breaches(file: &SourceFile) -> Vec<String> {
    let tokens = tokens(&file.text);
    let stem = file.path.rsplit('/').next().unwrap_or_default().split('.').next().unwrap_or_default();
    let at_line = |(line, what): (usize, String)| format!("{}:{line}: {what}", file.path);
    let named = is_vague(stem).then(|| format!("{}: is named `{stem}`", file.path));
    let folders = file.path.split('/').rev().skip(1).filter(|folder| is_vague(folder));
    let folders = folders.map(|folder| format!("{}: is in `{folder}`", file.path));
    let in_text = vague_names(&tokens).chain(unfinished(&tokens)).chain(ignored_tests(&tokens)).map(at_line);
    named.into_iter().chain(folders).chain(in_text).collect()
}

/// Returns the words of a name, `snake_case` and `CamelCase` alike.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    for c in name.chars() {
        if c == '_' || c.is_uppercase() {
            words.push(String::new());
        }
        words.last_mut().unwrap().extend(c.to_lowercase().filter(|c| *c != '_'));
    }
    words.retain(|word| !word.is_empty());
    words
}

fn is_vague(name: &str) -> bool {
    let words = words(name);
    let says_nothing = words.iter().any(|word| SAYS_NOTHING.contains(&word.as_str()));
    says_nothing || words.first().is_some_and(|verb| VAGUE_VERBS.contains(&verb.as_str()))
}

fn vague_names(tokens: &[Token]) -> impl Iterator<Item = (usize, String)> {
    tokens.windows(2).filter_map(|pair| {
        let is_declared = matches!(pair[0].text.as_str(), "mod" | "fn" | "struct" | "enum" | "trait");
        (is_declared && is_vague(&pair[1].text)).then(|| (pair[1].line, format!("declares `{}`", pair[1].text)))
    })
}

fn unfinished(tokens: &[Token]) -> impl Iterator<Item = (usize, String)> {
    tokens.windows(2).filter_map(|pair| {
        let is_unfinished = matches!(pair[0].text.as_str(), "todo" | "unimplemented") && pair[1].text == "!";
        is_unfinished.then(|| (pair[0].line, format!("calls `{}!`", pair[0].text)))
    })
}

/// Finds `#[ignore]`, `#[ignore = ".."]` and `#[cfg_attr(.., ignore)]`.
fn ignored_tests(tokens: &[Token]) -> impl Iterator<Item = (usize, String)> {
    tokens.windows(3).enumerate().filter_map(|(at, start)| {
        let is_attribute = start[0].text == "#" && start[1].text == "[";
        let inside = || tokens[at + 3..].iter().take_while(|token| token.text != "]");
        let ignores =
            start[2].text == "ignore" || (start[2].text == "cfg_attr" && inside().any(|token| token.text == "ignore"));
        (is_attribute && ignores).then(|| (start[0].line, "ignores a test".to_owned()))
    })
}

#[test]
fn names_avoid_vague_words() {
    let all = files(&["src", "firmware_protocol", "tests"], &["rs", "wgsl"]);
    let found: Vec<_> = all.iter().flat_map(breaches).collect();
    assert!(found.is_empty(), "\n{}", found.join("\n"));
}

fn breaches_in(path: &str, text: &str) -> usize {
    breaches(&SourceFile { path: path.to_owned(), text: text.to_owned() }).len()
}

#[test]
fn vague_words_are_caught() {
    assert_eq!(
        breaches_in("src/sink/null.rs", "fn send() {} mod card; struct Handled; fn in_process() {}"),
        0,
        "control"
    );
    assert_eq!(breaches_in("src/sink/utils.rs", ""), 1, "file");
    assert_eq!(breaches_in("src/helpers/null.rs", ""), 1, "folder");
    assert_eq!(breaches_in("src/a.rs", "mod fits_utils; fn handle() {} fn process_frame() {} struct FrameManager;"), 4);
}

#[test]
fn unfinished_and_ignored_code_is_caught() {
    assert_eq!(
        breaches_in("src/a.rs", "// todo!()\n/// #[ignore]\nfn a() { \"todo!()\"; }"),
        0,
        "comments and strings"
    );
    assert_eq!(breaches_in("src/a.rs", "fn a() { todo!() } fn b() { unimplemented!(\"c\") }"), 2);
    assert_eq!(breaches_in("src/a.rs", "#[ignore] fn a() {} #[ignore = \"b\"] fn c() {}"), 2);
    assert_eq!(breaches_in("src/a.rs", "#[cfg_attr(miri, ignore)] fn a() {}"), 1);
}
