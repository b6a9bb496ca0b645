//! Files are read whole through `base::input_file` only, which has a bound: no file or device fills the memory.

use crate::source::{Token, files, tokens};

/// Code that opens or reads a file to its end.
const READERS: [&[&str]; 6] = [
    &["fs", "::", "read", "("],
    &["fs", "::", "read_to_string"],
    &["File", "::", "open"],
    &[".", "from_path", "("],
    &["Reader", "::", "from_path"],
    &[".", "read_to_end"],
];
/// Files below `src` that do so themselves, with the reason.
const WITH_REASON: [(&str, &str); 25] = [
    ("base/input_file.rs", "is that reader"),
    ("base/memory.rs", KERNEL),
    ("cli/doctor/host.rs", KERNEL),
    ("cli/provenance.rs", KERNEL),
    ("cli/signals.rs", KERNEL),
    ("frames/report/machine.rs", KERNEL),
    ("frames/sink/fits/compressed.rs", "reads as many bytes as the header says, of a file that is bounded"),
    ("link/pps.rs", KERNEL),
    ("link/socketcan/mod.rs", KERNEL),
    ("outputs/network_camera/interface.rs", KERNEL),
    ("cli/catalog/hats.rs", PARTS),
    ("histories/parquet_table.rs", PARTS),
    ("histories/read.rs", PARTS),
    ("lab/imports/hats/file.rs", PARTS),
    ("link/capture/mod.rs", PARTS),
    ("run/wiring/replay/captured_links.rs", PARTS),
    ("run/wiring/replay/completeness.rs", PARTS),
    ("run/wiring/replay/table_lines.rs", PARTS),
    ("stars/layer/open.rs", PARTS),
    ("stars/layer/runs.rs", PARTS),
    ("frames/sink/fits/read.rs", "reads as many bytes as the header says, which it checks"),
    ("frames/sink/sample.rs", "is used by tests only"),
    ("lab/data_sets/folder.rs", "locks a folder"),
    ("stars/layer/build.rs", "makes files last"),
    ("stars/layer/writer.rs", "makes a folder last"),
];
const KERNEL: &str = "reads files of the kernel";
const PARTS: &str = "reads parts or lines of a bounded length";

/// Returns whether a file has product code.
fn is_product(path: &str) -> bool {
    !(path.ends_with("tests.rs") || path.contains("/tests/"))
}

/// Returns the code before the module of tests.
fn without_tests(mut code: Vec<Token>) -> Vec<Token> {
    let is = |place: usize, word: &str| code.get(place).is_some_and(|token| token.text == word);
    let is_start = |place: &usize| {
        let words = ["#", "[", "cfg", "(", "test", ")", "]"];
        let behind = place + words.len();
        // Such as `pub(in crate::sink) mod tests`.
        let closed = || (behind..code.len()).find(|place| is(*place, ")")).map_or(behind, |place| place + 1);
        let module = if is(behind, "pub") && is(behind + 1, "(") { closed() } else { behind };
        words.iter().enumerate().all(|(nth, word)| is(place + nth, word)) && is(module, "mod") && is(module + 2, "{")
    };
    let end = (0..code.len()).find(is_start).unwrap_or(code.len());
    code.truncate(end);
    code
}

/// Returns the lines that read a file.
fn reading(text: &str) -> Vec<usize> {
    let code = without_tests(tokens(text));
    let is_reader = |place: &usize| {
        READERS.iter().any(|words| {
            let found = code[*place..].iter().map(|token| token.text.as_str());
            words.len() <= code.len() - place && found.zip(*words).all(|(token, word)| token == *word)
        })
    };
    (0..code.len()).filter(is_reader).map(|place| code[place].line).collect()
}

#[test]
fn files_are_read_whole_through_one_bounded_reader() {
    let mut unknown = Vec::new();
    let mut used = Vec::new();
    for file in files(&["src"], &["rs"]).iter().filter(|file| is_product(&file.path)) {
        let lines = reading(&file.text);
        match WITH_REASON.iter().find(|(path, _)| format!("src/{path}") == file.path) {
            Some((path, _)) if !lines.is_empty() => used.push(*path),
            _ => unknown.extend(lines.iter().map(|line| format!("{}:{line}", file.path))),
        }
    }
    let wanted = "wanted base::input_file, or a row of WITH_REASON with the reason";
    assert!(unknown.is_empty(), "{wanted}: {unknown:#?}");
    let stale: Vec<_> = WITH_REASON.iter().filter(|(path, _)| !used.contains(path)).collect();
    assert!(stale.is_empty(), "rows that no file needs: {stale:?}");
}

#[test]
fn a_reader_without_a_bound_is_noticed() {
    for text in [
        "fn f() { std::fs::read(path) }",
        "fn f() { fs::read_to_string(path) }",
        "fn f() { std::fs::File::open(path) }",
        "fn f() { csv::Reader::from_path(path) }",
        "fn f() { builder.from_path(path) }",
        "fn f() { file.read_to_end(&mut bytes) }",
    ] {
        assert_eq!(reading(text), [1], "{text}");
        let test = format!("#[cfg(test)]\nmod tests {{\n{text}\n}}");
        assert_eq!(reading(&test), Vec::<usize>::new(), "{test}");
    }
    assert_eq!(reading("// fs::read(path)\nfn f() { fs::read_dir(path) }"), Vec::<usize>::new());
}
