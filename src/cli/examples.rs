//! Examples at the end of every command's help.
//!
//! A command whose own help text has the heading `Examples:` keeps it. A test reads every example as a command line.

use clap::Command;

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
    ("verify", &["verify my_camera.toml", "verify cameras/small_tracker.toml --frames 20 --plot transfer.svg"]),
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
    ("catalog export", &["catalog export sky/g10.starlayer sky/g14.starlayer --hats my_catalog"]),
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
    ("fly", &["fly my_plan.toml --out out/plan", "fly my_plan.toml --case rate --out out/rates"]),
    (
        "report",
        &[
            "report out/acquisition --tracker my_log.csv",
            "report out/acquisition --tracker my_log.csv --requirements my_requirements.toml",
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

#[cfg(test)]
mod tests {
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
