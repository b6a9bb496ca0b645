//! Files are on one subject, which shows in their length.

use crate::source::files;

/// Beyond this many lines a file has two subjects.
const LINES_MAX: usize = 600;

#[test]
fn each_file_has_one_subject() {
    let all = files(&["src", "tests", "firmware_protocol"], &["rs", "wgsl"]);
    let long = all.iter().filter(|file| file.text.lines().count() > LINES_MAX);
    let long: Vec<_> = long.map(|file| format!("{}: {} lines", file.path, file.text.lines().count())).collect();
    assert!(long.is_empty(), "more than {LINES_MAX} lines:\n{}", long.join("\n"));
}
