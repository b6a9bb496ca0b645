//! Tests `starloop link-check` as a program.

use std::process::{Command, Output};

fn link_check(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_starloop")).arg("link-check").args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn links_of_this_machine_are_held_to_their_promises() {
    for arguments in [&["--kind", "serial", "--pty"][..], &["--kind", "simulated", "--fd"]] {
        let done = link_check(arguments);
        let out = text(&done.stdout);
        assert_eq!(done.status.code(), Some(0), "{arguments:?}: {out}{}", text(&done.stderr));
        assert_eq!(out.matches("held  ").count(), 9, "{out}");
    }
}

#[test]
fn failed_opening_is_reported_with_advice() {
    for (arguments, said) in [
        (&["--kind", "socketcan", "--interface", "can_none"][..], "can_none"),
        (&["--kind", "serial", "--port", "/dev/ttyNone9", "--peer", "/dev/ttyNone8"], "ports here"),
        (&["--kind", "simulated", "--echo"], "other programs cannot reach"),
        (&["--pps", "/nonexistent/pps0"], "ls /sys/class/pps"),
    ] {
        let done = link_check(arguments);
        let error = text(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{arguments:?}: {error}");
        assert!(error.contains(said), "{arguments:?}: {error}");
    }
}

#[test]
fn wrong_command_lines_are_refused() {
    for arguments in [
        &["--kind", "socketcan"][..],
        &["--kind", "telepathy"],
        &["--kind", "serial", "--pty", "--port", "/dev/null"],
        &["--kind", "serial", "--pps", "/sys/class/pps/pps0"],
        &["--kind", "serial", "--port", "/dev/null"],
    ] {
        let done = link_check(arguments);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {}", text(&done.stderr));
    }
}
