//! Help for people and shells: groups of commands, examples, manual pages, completions.
//!
//! The groups that `starloop --help` lists commands in, and the help built from them.

use anyhow::{Context, Result, bail};
use base::streams::Output;
use clap::{Args, Command, ValueEnum, builder::styling::Style};
use clap_complete::Shell;
use clap_mangen::Man;
use core::fmt::Write as _;
use frames::sink::write_file_atomically;
use std::{io::Write as _, path::PathBuf};

/// Headings and their commands, in the order of the help. A command in none of them is listed under [`OTHERS`].
const GROUPS: &[(&str, &[&str])] = &[
    ("Frames", &["run", "render", "dataset", "fly", "replay", "budget"]),
    ("Configuration files", &["init", "check", "keys", "schema"]),
    ("Cameras, stars, catalogs", &["snr", "psf", "verify", "camera", "catalog"]),
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

// Examples at the end of every command's help.
//
// A command whose own help text has the heading `Examples:` keeps it. A test reads every example as a command line.

/// Heading of the examples in a help text.
const HEADING: &str = "Examples:";

/// Commands below the program, by their words, and their examples without the program's name.
const EXAMPLES: &[(&str, &[&str])] = &[
    ("", &["run", "run configs/scenarios/acquisition.toml --clock virtual", "doctor"]),
    (
        "run",
        &[
            "run",
            "run my_bench.toml --duration 60 --monitor 8090",
            "run configs/scenarios/acquisition.toml --clock virtual --out out/acquisition",
        ],
    ),
    ("budget", &["budget my_bench.toml --report out/budget", "budget my_bench.toml --duration 60 --load 2"]),
    ("replay", &["replay out/captured", "replay out/captured --frames 10..20 --out out/again"]),
    (
        "render",
        &[
            "render --camera cameras/star_tracker_20deg.toml --ra 83.8 --dec -1.2 --out orion.png",
            "render --camera my_camera.toml --ra 83.8 --dec -1.2 --rate 0,0.5,0 --truth orion.csv --out orion.fits",
            "render --camera my_camera.toml --attitudes slew.aem --out slew.fits",
        ],
    ),
    (
        "dataset",
        &[
            "dataset data_sets/lost_in_space.toml --count 1000 --out out/stars",
            "dataset my_set.toml --count 100000 --out out/set --images webdataset --shards 0..40",
            "dataset --verify out/stars",
        ],
    ),
    (
        "check",
        &["check my_bench.toml", "check my_bench.toml --set timing.frame_rate_hz=5", "check scenarios.toml --json"],
    ),
    ("calibrate", &["calibrate", "calibrate --quick --backend cpu --out costs.toml"]),
    ("calibrate costs", &["calibrate costs --quick"]),
    (
        "calibrate display",
        &[
            "calibrate display simulate --out out/display",
            "calibrate display plan --name EV27 --width 1920 --height 1200 --out plan",
        ],
    ),
    (
        "calibrate display plan",
        &["calibrate display plan --name EV27 --width 1920 --height 1200 --camera my_camera.toml --out plan"],
    ),
    ("calibrate display show-pattern", &["calibrate display show-pattern plan/plan.toml 3 --out pattern.png"]),
    (
        "calibrate display fit",
        &["calibrate display fit plan/plan.toml --measurements frames --camera my_camera.toml --out display.toml"],
    ),
    ("calibrate display check", &["calibrate display check display.toml --plan plan/plan.toml"]),
    ("calibrate display beat", &["calibrate display beat --exposure 0.055 --frame-rate 10 --refresh 59.94"]),
    ("calibrate display simulate", &["calibrate display simulate --out out/display"]),
    ("fly", &["fly configs/test_plans/ecss_star_tracker_short.toml --out out/flown"]),
    (
        "report",
        &[
            "report out/run --tracker tracker.csv",
            "report out/run --tracker tracker.aem --requirements requirements.toml --pdf",
            "report out/flown --find-axes",
        ],
    ),
    ("display", &["display monitors", "display show plan/pattern_01.png --monitor 1"]),
    ("display monitors", &["display monitors"]),
    ("display show", &["display show plan/pattern_01.png --monitor 1", "display show ramp.png --window --gamma 2.2"]),
    ("display flip", &["display flip --out submits.csv"]),
    ("display latency", &["display latency submits.csv --edges edges.csv --out flips.csv"]),
    (
        "bus",
        &[
            "bus --slcan-tcp 29536",
            "bus --socketcand 28600 --name can0",
            "bus --slcan-pty /tmp/slcan --wire can_classic --bit-rate 1000000",
        ],
    ),
    (
        "campaign",
        &["campaign --hours 30 --seed 1000", "campaign my_scenario.toml --hours 100 --shard 2/4 --out part2.jsonl"],
    ),
    ("chart", &["chart --quick", "chart --out out/chart --backend cpu"]),
    (
        "verify",
        &[
            "verify my_camera.toml",
            "verify cameras/small_tracker.toml --frames 20 --plot transfer.svg",
            "verify my_camera.toml --export out/flats",
        ],
    ),
    ("study", &["study --quick", "study my_scenario.toml --out out/study"]),
    (
        "link-check",
        &[
            "link-check",
            "link-check --kind socketcan --interface vcan0 --fd",
            "link-check --kind serial --port /dev/ttyUSB0 --peer /dev/ttyUSB1",
        ],
    ),
    (
        "export",
        &[
            "export out/loopback --attitude slew.xml --places places.csv",
            "export my_bench.toml --attitude slew.aem --observer orbit.oem",
        ],
    ),
    ("keys", &["keys", "keys camera"]),
    ("schema", &["schema bench > bench.schema.json"]),
    ("init", &["init camera > my_camera.toml", "init bench > my_bench.toml"]),
    ("camera", &["camera export cameras/star_tracker_20deg.toml --for lost"]),
    ("camera export", &["camera export my_camera.toml --for opencv --out camera.json"]),
    ("catalog", &["catalog info", "catalog query --ra 83.8 --dec -1.2 --radius 5 --mag 4"]),
    ("catalog pack", &["catalog pack my_stars.csv --out my_stars.starcat --epoch 2016"]),
    (
        "catalog import",
        &[
            "catalog import GaiaSource_000.csv.gz --bright hip2.dat --out sky --layers 10,14,18",
            "catalog import my_stars.csv --out sky --replace",
        ],
    ),
    ("catalog synthesize", &["catalog synthesize --out sky --mag 9 --layers 6"]),
    (
        "catalog export",
        &[
            "catalog export --for tetra3 --out hip_main.dat",
            "catalog export sky/g10.starlayer sky/g14.starlayer --hats my_catalog",
        ],
    ),
    ("catalog verify", &["catalog verify sky/g10.starlayer sky/g14.starlayer"]),
    ("catalog info", &["catalog info", "catalog info sky/g10.starlayer"]),
    ("catalog map", &["catalog map --out sky.png", "catalog map sky/g10.starlayer --galactic --out sky.png"]),
    (
        "catalog query",
        &[
            "catalog query --ra 83.8 --dec -1.2 --radius 5 --mag 4",
            "catalog query --ra 266.4 --dec -29 --radius 1 --at 2026-01-01T00:00:00Z",
        ],
    ),
    ("doctor", &["doctor", "doctor --json"]),
    (
        "completions",
        &[
            "completions bash > ~/.local/share/bash-completion/completions/starloop",
            "completions zsh > ~/.zfunc/_starloop",
            "completions fish > ~/.config/fish/completions/starloop.fish",
        ],
    ),
    ("man", &["man | man -l -", "man ~/.local/share/man/man1"]),
];

/// Adds examples to the help of the program and of every command below it.
pub(super) fn with_examples(program: Command) -> Command {
    below(program, "")
}

fn below(command: Command, words: &str) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let mut command = with_own(command, words);
    for name in names {
        let words = format!("{words} {name}");
        command = command.mut_subcommand(name, |command| below(command, words.trim_start()));
    }
    command
}

/// Adds the examples of one command, unless its help has some.
fn with_own(command: Command, words: &str) -> Command {
    let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let found = EXAMPLES.iter().find(|(name, _)| *name == words);
    let Some((_, examples)) = found.filter(|_| !help.contains(HEADING)) else { return command };
    let separator = if help.is_empty() { "" } else { "\n\n" };
    let lines: String = examples.iter().map(|example| format!("\n  starloop {example}")).collect();
    command.after_help(format!("{help}{separator}{HEADING}{lines}"))
}

// `starloop man`: manual pages, written from the command line's own help.

/// Section of the manual: commands.
const SECTION: &str = "1";

/// Command line of `man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder that gets a page for every command (made where it is missing); without one the program's own page is
    /// printed
    folder: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When a page cannot be written.
pub fn run_man(arguments: &ManArgs) -> Result<()> {
    let pages = pages()?;
    let Some(folder) = &arguments.folder else {
        let (_, first) = pages.first().context("the manual has 0 pages")?;
        return Ok(Output.write_all(first)?);
    };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    for (name, text) in &pages {
        write_file_atomically(&folder.join(name), |out| out.write_all(text))?;
    }
    println!("{} pages in {}", pages.len(), folder.display());
    Ok(())
}

/// Returns the names and texts of all pages, that of the program first.
fn pages() -> Result<Vec<(String, Vec<u8>)>> {
    let mut program = crate::cli::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    add_pages(&program, "starloop", &mut pages)?;
    Ok(pages)
}

/// Adds the page of a command and those of the commands below it.
fn add_pages(command: &Command, name: &str, pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    // Pages of the groups' listing would say everything twice.
    let plain = command.clone().before_help(None::<&str>).name(name.to_owned()).display_name(name.to_owned());
    let mut text = Vec::new();
    let source = format!("starloop {}", env!("CARGO_PKG_VERSION"));
    Man::new(plain).section(SECTION).source(source).manual("starloop").render(&mut text)?;
    pages.push((format!("{name}.{SECTION}"), text));
    for below in command.get_subcommands() {
        add_pages(below, &format!("{name}-{}", below.get_name()), pages)?;
    }
    Ok(())
}

// `starloop completions`: what a shell needs to complete the command line.

/// Command line of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// Shell that the text is for
    #[arg(value_enum)]
    shell: ShellName,
}

/// A shell, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShellName {
    /// GNU bash
    Bash,
    /// zsh
    Zsh,
    /// fish
    Fish,
}

impl ShellName {
    /// Returns the library's word for it.
    fn shell(self) -> Shell {
        match self {
            Self::Bash => Shell::Bash,
            Self::Zsh => Shell::Zsh,
            Self::Fish => Shell::Fish,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// When nothing could be generated.
pub fn run_completions(arguments: &CompletionsArgs) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell.shell(), &mut crate::cli::command(), "starloop", &mut text);
    if text.is_empty() {
        bail!("no completions were made for {:?}", arguments.shell);
    }
    Ok(Output.write_all(&text)?)
}

#[cfg(test)]
mod command_groups_tests {
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

#[cfg(test)]
mod examples_tests {
    use super::*;

    /// The words and the help of every command below `command`, its own first.
    fn helps(command: &Command, words: &str, found: &mut Vec<(String, String)>) {
        let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        found.push((words.trim().to_owned(), help));
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            helps(sub, &format!("{words} {}", sub.get_name()), found);
        }
    }

    /// The examples of a help text, as written.
    fn examples(help: &str) -> Vec<&str> {
        let after = help.split_once(HEADING).map_or("", |(_, after)| after);
        after.lines().map(str::trim).filter(|line| line.starts_with("starloop ")).collect()
    }

    /// Why a line is not a command line, if it is not one.
    fn fault(line: &str) -> Option<String> {
        let words = line.split_whitespace().take_while(|word| !matches!(*word, ">" | "|"));
        crate::cli::command().try_get_matches_from(words).err().map(|error| format!("{line}: {error}"))
    }

    #[test]
    fn every_command_has_examples_of_itself_and_each_is_a_command_line() {
        let mut all = Vec::new();
        helps(&crate::cli::command(), "", &mut all);
        assert!(all.len() > 30, "{}", all.len());
        let mut faults = Vec::new();
        for (words, help) in &all {
            let examples = examples(help);
            let own = format!("starloop {words}");
            if !examples.iter().any(|example| example.starts_with(own.trim())) {
                faults.push(format!("`{words}` has no example: add one to EXAMPLES in src/cli/examples.rs"));
            }
            faults.extend(examples.into_iter().filter_map(fault));
        }
        assert!(faults.is_empty(), "\n{}", faults.join("\n"));
    }

    #[test]
    fn a_wrong_example_and_a_missing_one_are_found() {
        assert!(fault("starloop run --no-such-option").is_some());
        assert!(fault("starloop doctor > file").is_none(), "control");
        assert!(examples("Text without any").is_empty());
    }

    #[test]
    fn examples_of_commands_that_do_not_exist_are_found() {
        let mut all = Vec::new();
        helps(&crate::cli::command(), "", &mut all);
        let unknown = EXAMPLES.iter().find(|(words, _)| !all.iter().any(|(found, _)| found == words));
        assert!(unknown.is_none(), "{unknown:?}");
    }
}

#[cfg(test)]
mod manual_tests {
    use super::*;

    fn commands(command: &Command) -> usize {
        1 + command.get_subcommands().map(commands).sum::<usize>()
    }

    #[test]
    fn every_command_has_a_page_with_its_options() {
        let pages = pages().unwrap();
        assert_eq!(pages.len(), commands(&crate::cli::command()));
        let text = |name: &str| {
            let page = pages.iter().find(|(found, _)| found == name);
            String::from_utf8(page.unwrap_or_else(|| panic!("no {name}")).1.clone()).unwrap()
        };
        assert!(text("starloop.1").contains("Exit status"), "{}", text("starloop.1"));
        assert!(text("starloop-run.1").contains("clock"));
        assert!(text("starloop-catalog-query.1").contains("radius"));
        assert!(!text("starloop-run.1").contains("radius"), "control");
    }
}

#[cfg(test)]
mod completions_tests {
    use super::*;

    #[test]
    fn every_shell_gets_every_command() {
        for shell in ShellName::value_variants() {
            let mut text = Vec::new();
            clap_complete::generate(shell.shell(), &mut crate::cli::command(), "starloop", &mut text);
            let text = String::from_utf8(text).unwrap();
            for command in crate::cli::command().get_subcommands() {
                assert!(text.contains(command.get_name()), "{shell:?}: no {}", command.get_name());
            }
            assert!(!text.contains("no-such-command"), "control");
        }
    }
}
