//! Gives the program the commit that it was built from, for `starloop --version`.
//!
//! `STARLOOP_COMMIT` names it without a repository, such as in a package's own build; without either the commit is
//! "unknown". A commit with changes ends in `-dirty`.

use std::{path::Path, process::Command};

/// Digits of a commit: enough for any repository.
const DIGITS: &str = "--abbrev=12";

fn main() {
    println!("cargo::rerun-if-env-changed=STARLOOP_COMMIT");
    for path in ["src", "firmware_protocol", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={path}");
    }
    // Commits change one of these; a path that does not exist would rerun this with every build.
    for path in [".git/HEAD", ".git/logs/HEAD"].iter().filter(|path| Path::new(path).exists()) {
        println!("cargo::rerun-if-changed={path}");
    }
    let given = std::env::var("STARLOOP_COMMIT").ok().filter(|commit| !commit.is_empty());
    let commit = given.or_else(commit_of_repository).unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=STARLOOP_COMMIT={commit}");
    println!("cargo::rustc-env=STARLOOP_TARGET={}", std::env::var("TARGET").unwrap_or_default());
}

/// Returns the commit of the repository that this folder is the root of; another one around it says nothing about it.
fn commit_of_repository() -> Option<String> {
    let root = git(&["rev-parse", "--show-toplevel"])?;
    let here = std::env::current_dir().ok()?;
    let is_root = Path::new(&root).canonicalize().ok()? == here.canonicalize().ok()?;
    is_root.then(|| git(&["describe", "--always", "--dirty", DIGITS, "--exclude=*"]))?
}

/// Returns what git prints, when there is a git and it can.
fn git(words: &[&str]) -> Option<String> {
    let output = Command::new("git").args(words).output().ok().filter(|output| output.status.success())?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (!text.is_empty()).then_some(text)
}
