//! The groups that `starloop --help` lists commands in, and the help built from them.

use clap::{Command, builder::styling::Style};
use core::fmt::Write;

/// Headings and their commands, in the order of the help. A command in none of them is listed under [`OTHERS`].
const GROUPS: &[(&str, &[&str])] = &[
    ("Frames", &["run", "render", "dataset", "fly", "replay", "budget"]),
    ("Configuration files", &["init", "check", "keys", "schema"]),
    ("Cameras, stars, catalogs", &["snr", "psf", "verify", "catalog"]),
    ("Connections and displays", &["bus", "link-check", "display", "export", "fmu"]),
    ("Reports and studies", &["report", "compare", "chart", "study", "campaign"]),
    ("This machine", &["doctor", "calibrate", "completions", "man"]),
];
/// Heading of commands that belong to no group.
const OTHERS: &str = "Others";
/// Name of the command that clap adds.
const HELP: &str = "help";

/// How the program's own help is laid out: the grouped commands are its `before-help`.
const TEMPLATE: &str = "{about-with-newline}\n{usage-heading} {usage}\n\n{before-help}Options:\n{options}{after-help}";

/// Puts the commands into groups in the program's own help.
pub(super) fn with_groups(program: Command) -> Command {
    let listing = listing(&program);
    program.before_help(listing).help_template(TEMPLATE)
}

/// Returns the commands below the headings of their groups.
fn listing(program: &Command) -> String {
    let commands: Vec<&Command> = program.get_subcommands().filter(|command| command.get_name() != HELP).collect();
    let width = commands.iter().map(|command| command.get_name().len()).max().unwrap_or_default();
    let heading = Style::new().bold().underline();
    let name_style = Style::new().bold();
    let mut text = String::new();
    for (title, names) in groups(&commands) {
        let separator = if text.is_empty() { "" } else { "\n" };
        let _ = writeln!(text, "{separator}{heading}{title}:{heading:#}"); // writing to a string does not fail
        for name in names {
            let about = commands.iter().find(|command| command.get_name() == name).and_then(|found| found.get_about());
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _ = writeln!(text, "  {name_style}{name:<width$}{name_style:#}  {about}"); // writing to a string does not fail
        }
    }
    text.trim_end().to_owned()
}

/// Returns the groups that have commands, and the commands of each.
fn groups<'a>(commands: &[&'a Command]) -> Vec<(&'static str, Vec<&'a str>)> {
    let find = |name: &str| commands.iter().map(|command| command.get_name()).find(|found| *found == name);
    let is_grouped = |name: &str| GROUPS.iter().any(|(_, names)| names.contains(&name));
    let others = commands.iter().map(|command| command.get_name()).filter(|name| !is_grouped(name)).collect();
    let named = GROUPS.iter().map(|(title, names)| (*title, names.iter().filter_map(|name| find(name)).collect()));
    named.chain([(OTHERS, others)]).filter(|(_, names): &(_, Vec<&str>)| !names.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_of_the_program_has_a_group() {
        let program = crate::cli::command();
        let commands: Vec<&Command> = program.get_subcommands().filter(|command| command.get_name() != HELP).collect();
        let groups = groups(&commands);
        let ungrouped = groups.iter().find(|(title, _)| *title == OTHERS);
        assert!(ungrouped.is_none(), "add these to GROUPS: {ungrouped:?}");
        let listed: usize = groups.iter().map(|(_, names)| names.len()).sum();
        assert_eq!(listed, commands.len(), "each once");
    }

    #[test]
    fn a_command_without_a_group_is_listed_all_the_same() {
        let program = Command::new("x").subcommand(Command::new("run")).subcommand(Command::new("unknown").about("A"));
        let text = anstream_free(&listing(&program));
        assert_eq!(text, "Frames:\n  run      \n\nOthers:\n  unknown  A");
    }

    /// Takes the escape codes out.
    fn anstream_free(text: &str) -> String {
        let mut plain = String::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('\x1b') {
            plain.push_str(before);
            rest = after.split_once('m').map_or("", |(_, rest)| rest);
        }
        plain + rest
    }
}
