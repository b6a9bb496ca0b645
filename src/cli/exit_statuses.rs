//! The exit statuses: what each means, which commands end with it, and the help text made of both. A run's is chosen in `run::end`.

use crate::cli::{
    EXIT_DONE, EXIT_FAILED, EXIT_INCOMPLETE, EXIT_INTERRUPTED, EXIT_LOST, EXIT_NOT_MET, EXIT_OVER_BUDGET, EXIT_USAGE,
};
use base::streams::EXIT_BROKEN_PIPE;

/// One exit status.
#[derive(Debug)]
pub struct ExitStatus {
    /// The numbers: several for signals.
    pub numbers: &'static [u8],
    /// Meaning, for the table of the manual.
    pub meaning: &'static str,
    /// Commands that end with it; empty: every command may.
    pub commands: &'static [&'static str],
}

/// All exit statuses of the program.
pub const EXIT_STATUSES: &[ExitStatus] = &[
    ExitStatus { numbers: &[EXIT_DONE], meaning: "done", commands: &[] },
    ExitStatus {
        numbers: &[EXIT_FAILED],
        meaning: "could not do what was asked; also output that cannot be written, such as to a full disk",
        commands: &[],
    },
    ExitStatus { numbers: &[EXIT_USAGE], meaning: "wrong command line", commands: &[] },
    ExitStatus { numbers: &[EXIT_OVER_BUDGET], meaning: "over the timing budget", commands: &["budget"] },
    ExitStatus {
        numbers: &[EXIT_NOT_MET],
        meaning: "something that was checked does not hold: an expectation or invariant of a run, a prediction, a camera \
                  file, a captured frame, a promise of a link, a warning of `check --strict`",
        commands: &["check", "run", "replay", "fly", "report", "compare", "verify", "link-check", "study", "campaign"],
    },
    ExitStatus {
        numbers: &[EXIT_LOST],
        meaning: "it reached its end, but something was lost (frames that a sink did not take, a file, a capture, a \
                  thread, what a gateway's client read too slowly, a damaged shard); one line on standard error names it, \
                  also with --quiet",
        commands: &["run", "budget", "bus", "dataset"],
    },
    ExitStatus {
        numbers: &[EXIT_INCOMPLETE],
        meaning: "a run reached its end, but frames are missing, late, blank or lit by a held attitude, a link was lost, \
                  or input contradicts itself; the first line says what",
        commands: &["run", "budget"],
    },
    ExitStatus {
        numbers: &[EXIT_INTERRUPTED, 143, 129],
        meaning: "stopped by Ctrl-C (SIGINT), SIGTERM, SIGHUP; what was finished is written; a second signal after 0.2 s \
                  ends the program at once",
        commands: &[],
    },
    ExitStatus { numbers: &[EXIT_BROKEN_PIPE], meaning: "the reader of its output closed (`| head`)", commands: &[] },
];

/// Returns the exit statuses, one line each, as in the help.
pub(super) fn help_text() -> String {
    let lines = EXIT_STATUSES.iter().map(|status| {
        let numbers: Vec<String> = status.numbers.iter().map(ToString::to_string).collect();
        let commands =
            if status.commands.is_empty() { String::new() } else { format!(" ({})", status.commands.join(", ")) };
        format!("  {:<13} {}{commands}", numbers.join(", "), status.meaning)
    });
    format!("Exit status:\n{}", lines.collect::<Vec<_>>().join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands whose own file, or one whose name begins with theirs, uses `constant`.
    fn users(constant: &str) -> Vec<String> {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli");
        let commands = crate::cli::command();
        let names: Vec<String> = commands.get_subcommands().map(|command| command.get_name().to_owned()).collect();
        let mut users = Vec::new();
        let mut paths = vec![folder.clone()];
        while let Some(path) = paths.pop() {
            if path.is_dir() {
                paths.extend(std::fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
                continue;
            }
            let below = path.strip_prefix(&folder).unwrap().with_extension("");
            let stem = below.to_str().unwrap().replace(['_', '/'], "-");
            let text = std::fs::read_to_string(&path).unwrap();
            let product = text.split("#[cfg(test)]").next().unwrap_or_default();
            if stem == "mod" || stem == "exit-statuses" || !product.contains(constant) {
                continue;
            }
            // Such as data_set.rs for `dataset`.
            let is_whole = |name: &&String| stem.replace('-', "") == name.replace('-', "");
            let owner = names.iter().filter(|name| is_whole(name) || stem.starts_with(&format!("{name}-")));
            users.extend(owner.max_by_key(|name| name.len()).cloned());
        }
        users.sort();
        users.dedup();
        users
    }

    #[test]
    fn the_table_names_every_command_that_ends_with_a_status() {
        for (constant, number) in [
            ("EXIT_OVER_BUDGET", EXIT_OVER_BUDGET),
            ("EXIT_NOT_MET", EXIT_NOT_MET),
            ("EXIT_LOST", EXIT_LOST),
            ("EXIT_INCOMPLETE", EXIT_INCOMPLETE),
        ] {
            let row = EXIT_STATUSES.iter().find(|row| row.numbers == [number]).unwrap();
            let users = users(constant);
            assert!(!users.is_empty(), "control: {constant} is used");
            for user in users {
                assert!(row.commands.contains(&user.as_str()), "status {number}: `{user}` ends with it too");
            }
        }
        assert!(users("EXIT_LOST").contains(&"dataset".to_owned()), "control: its file is named by two words");
    }

    #[test]
    fn the_help_has_a_line_for_every_status() {
        let text = help_text();
        assert_eq!(text.lines().count(), 1 + EXIT_STATUSES.len());
        assert!(text.contains("\n  3             over the timing budget (budget)\n"), "{text}");
        assert!(text.contains("\n  130, 143, 129 stopped by Ctrl-C"), "{text}");
    }
}
