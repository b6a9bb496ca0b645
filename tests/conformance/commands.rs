//! The commands of README.md and of the guide: each one parses, and those marked `<!-- test -->` run.
//!
//! A command is a line that begins with `$ ` in a fenced block marked `console`; a trailing `\` continues it. It
//! is tested when it calls `starloop` or `cargo run --release --`. The marker is on the line above the
//! fence and applies to the whole block. Marked commands of a page run in order, in one empty folder, with `configs/` taken from
//! the repository; so a later command may read what an earlier one wrote. Blocks marked
//! `<!-- test with --features display -->` run in a build with that feature. Blocks marked `<!-- test in a shell -->` need more
//! than the program: `hil_scripts/tests/test_recipes.py` runs them, and says how files and checks beside them are marked. Blocks
//! marked `<!-- in short: ... -->` are run by `hil_scripts/tests/test_in_short.py`.

use crate::{pages::pages, source::root};
use std::process::{Command, Output};
use std::{path::Path, time::Duration};

const MARK: &str = "<!-- test -->";
/// Marks a block for a program with displays.
const MARK_DISPLAY: &str = "<!-- test with --features display -->";
/// Marks a block that hil_scripts/tests/test_recipes.py runs.
const MARK_SHELL: &str = "<!-- test in a shell -->";
/// Begins the mark of a block that hil_scripts/tests/test_in_short.py runs.
const MARK_IN_SHORT: &str = "<!-- in short: ";
const CALLS: &[&str] = &["cargo run --release -- ", "starloop "];
/// Fewest pages with commands that run.
const PAGES_MARKED_MIN: usize = 4;
/// Longest run of one command: the pages promise seconds, a busy machine takes longer.
const LIMIT_S: u64 = 300;
/// Characters with which a shell would do more than start the program.
const SHELL: &[char] = &['|', '&', ';', '>', '<', '$', '`', '*', '~'];

/// A call of the program.
#[derive(Debug, PartialEq, Eq)]
struct Call {
    /// As written, continuation lines joined.
    written: String,
    arguments: Vec<String>,
    is_marked: bool,
}

/// Returns the calls of the program in `document`.
fn calls(document: &str) -> Vec<Call> {
    let mut calls = Vec::new();
    let mut lines = document.lines();
    let mut last_text = "";
    while let Some(line) = lines.next() {
        if let Some(language) = line.trim().strip_prefix("```") {
            let block: Vec<_> = lines.by_ref().take_while(|line| line.trim() != "```").collect();
            if language == "console" && last_text != MARK_SHELL && !last_text.starts_with(MARK_IN_SHORT) {
                calls.extend(commands(&block).into_iter().filter_map(|command| call(command, is_mark(last_text))));
            }
            last_text = "";
        } else if !line.trim().is_empty() {
            last_text = line.trim();
        }
    }
    calls
}

/// Returns whether the commands of a block under this line run.
fn is_mark(line: &str) -> bool {
    line == MARK || cfg!(feature = "display") && line == MARK_DISPLAY
}

/// Returns the `$ ` lines of a block.
fn commands(block: &[&str]) -> Vec<String> {
    let mut commands: Vec<String> = Vec::new();
    let mut is_continued = false;
    for line in block {
        let text = line.trim_end_matches('\\');
        if is_continued {
            commands.last_mut().unwrap().push_str(text);
        } else if let Some(command) = text.trim_start().strip_prefix("$ ") {
            commands.push(command.to_owned());
        } else {
            continue;
        }
        is_continued = line.ends_with('\\');
    }
    commands
}

fn call(written: String, is_marked: bool) -> Option<Call> {
    let plain = written.split(" #").next().unwrap_or_default();
    let arguments = CALLS.iter().find_map(|call| plain.strip_prefix(call))?;
    let arguments = arguments.split_whitespace().map(str::to_owned).collect();
    Some(Call { written, arguments, is_marked })
}

/// Returns why a marked call cannot run here, if it cannot.
fn obstacle(call: &Call) -> Option<&'static str> {
    let value = |argument: &str| argument.rsplit('=').next().is_some_and(|value| value.starts_with('/'));
    if call.arguments.iter().any(|argument| value(argument) || argument.contains("..")) {
        return Some("it names a path outside its folder");
    }
    let needs_shell = call.arguments.iter().any(|argument| argument.contains(SHELL) || argument.contains(['"', '\'']));
    needs_shell.then_some("it needs a shell")
}

/// Returns `configs/x` and `--flag=configs/x` with the path of the repository, all else as written.
pub(crate) fn from_root(argument: &str, root: &Path) -> String {
    let (flag, value) = argument.split_at(argument.rfind('=').map_or(0, |at| at + 1));
    let is_config = value == "configs" || value.starts_with("configs/");
    if is_config { format!("{flag}{}", root.join(value).display()) } else { argument.to_owned() }
}

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_starloop"))
}

/// Runs a marked call in `folder`; gives what went wrong.
fn run(call: &Call, folder: &Path) -> Option<String> {
    if let Some(obstacle) = obstacle(call) {
        return Some(format!("{obstacle}: $ {}", call.written));
    }
    let arguments = call.arguments.iter().map(|argument| from_root(argument, &root()));
    failure(program().args(arguments).current_dir(folder), &call.written)
}

/// Returns the written command and its last words, when it fails or does not end.
fn failure(command: &mut Command, written: &str) -> Option<String> {
    let output = match output_within(command, LIMIT_S) {
        Ok(output) => output,
        Err(error) => return Some(format!("{error}: $ {written}")),
    };
    let words = String::from_utf8_lossy(&output.stderr);
    (!output.status.success()).then(|| format!("{}: $ {written}\n{words}", output.status))
}

/// Runs a command with its output in files, so that a talkative program never waits for a reader.
pub(crate) fn output_within(command: &mut Command, limit_s: u64) -> std::io::Result<Output> {
    const POLL: Duration = Duration::from_millis(20);
    let logs = tempfile::tempdir()?;
    let (out, err) = (logs.path().join("out"), logs.path().join("err"));
    let (out_file, err_file) = (std::fs::File::create(&out)?, std::fs::File::create(&err)?);
    let mut child = command.stdin(std::process::Stdio::null()).stdout(out_file).stderr(err_file).spawn()?;
    for _ in 0..limit_s * 1000 / 20 {
        if let Some(status) = child.try_wait()? {
            return Ok(Output { status, stdout: std::fs::read(&out)?, stderr: std::fs::read(&err)? });
        }
        std::thread::sleep(POLL);
    }
    child.kill()?;
    child.wait()?;
    Err(std::io::Error::new(std::io::ErrorKind::TimedOut, format!("not over after {limit_s} s")))
}

/// Returns the pages that hold at least one call of the program.
fn pages_with_calls() -> Vec<(String, Vec<Call>)> {
    let pages = pages().into_iter().map(|page| (page.path, calls(&page.text)));
    pages.filter(|(_, calls)| !calls.is_empty()).collect()
}

#[test]
fn each_command_of_a_page_parses() {
    let pages = pages_with_calls();
    assert!(pages.iter().any(|(path, _)| path == "README.md"), "README.md has no call of the program");
    let parse = |path: &str, call: &Call| {
        let fault = failure(program().args(&call.arguments).arg("--help"), &call.written)?;
        Some(format!("{path}: {fault}"))
    };
    let failures: Vec<_> =
        pages.iter().flat_map(|(path, calls)| calls.iter().filter_map(move |call| parse(path, call))).collect();
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn marked_commands_of_a_page_run() {
    let pages = pages_with_calls();
    let marked = pages.iter().filter(|(_, calls)| calls.iter().any(|call| call.is_marked)).count();
    assert!(
        marked >= PAGES_MARKED_MIN,
        "{marked} pages have {MARK} above a ```console block with a `$ starloop` command"
    );
    let mut failures = Vec::new();
    for (path, calls) in &pages {
        let folder = tempfile::tempdir().unwrap();
        let marked = calls.iter().filter(|call| call.is_marked);
        failures.extend(marked.filter_map(|call| run(call, folder.path())).map(|fault| format!("{path}: {fault}")));
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

const SAMPLE: &str = "\
<!-- test -->
```console
$ cargo run --release -- run --out run # seconds
3 frames
$ starloop run \\
    --bench configs/benches/a.toml
$ cargo test
```
<!-- test -->
Prose parts the marker from its block.
```console
$ starloop doctor
```
```sh
$ starloop hidden
```
<!-- test in a shell -->
```console
$ starloop bus &
```
<!-- in short: 0 -->
```console
$ starloop run & wait
ok: ...
```
";

#[test]
fn commands_are_found_in_console_blocks_alone() {
    let calls = calls(SAMPLE);
    let found: Vec<_> = calls.iter().map(|call| (call.arguments.join(" "), call.is_marked)).collect();
    let wanted = [("run --out run", true), ("run --bench configs/benches/a.toml", true), ("doctor", false)];
    assert_eq!(found, wanted.map(|(arguments, is_marked)| (arguments.to_owned(), is_marked)));
}

#[test]
fn configs_come_from_the_repository() {
    let root = Path::new("/checkout");
    assert_eq!(from_root("configs/a.toml", root), "/checkout/configs/a.toml");
    assert_eq!(from_root("--bench=configs/a.toml", root), "--bench=/checkout/configs/a.toml");
    assert_eq!(from_root("my_configs/a.toml", root), "my_configs/a.toml");
}

#[test]
fn a_command_that_cannot_run_alone_is_refused() {
    let refused = |command: &str| obstacle(&call(command.to_owned(), true).unwrap()).is_some();
    assert!(!refused("starloop run --out=run"), "control");
    assert!(refused("starloop run --out /tmp/run"), "absolute path");
    assert!(refused("starloop run --out=../run"), "path that climbs");
    assert!(refused("starloop run | head"), "pipe");
}

#[test]
fn a_failing_command_is_caught() {
    assert!(failure(&mut Command::new("true"), "true").is_none(), "control");
    assert!(failure(&mut Command::new("false"), "false").is_some(), "exit status");
    assert!(output_within(Command::new("sleep").arg("5"), 0).is_err(), "no end");
}
