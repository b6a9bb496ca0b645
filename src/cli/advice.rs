//! Command lines that cannot be read: the parser's message, and below it what to type instead.

use crate::cli::{EXIT_USAGE, named::degrees_of_sexagesimal};
use base::streams;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{ArgAction, Command, FromArgMatches};
use std::io::{IsTerminal, Write};

/// Reads the command line.
///
/// # Errors
/// With the exit status, after printing help, the version, or what is wrong and what to type instead.
pub(super) fn parsed<P: FromArgMatches>(command: Command) -> Result<P, u8> {
    read(command, std::env::args_os()).map_err(|error| {
        let status = u8::try_from(error.exit_code()).unwrap_or(EXIT_USAGE);
        if let Err(failure) = print(&error) {
            streams::note_failure(error.use_stderr(), failure);
        } else if let (true, Some(advice)) = (error.use_stderr(), advice(&error)) {
            eprintln!("\n{advice}");
        }
        streams::status_of_streams(status)
    })
}

/// Prints a message of the parser; what its number readers say is put in plain words.
fn print(error: &clap::Error) -> std::io::Result<()> {
    if !error.use_stderr() {
        return error.print();
    }
    let is_plain = !std::io::stderr().is_terminal() || std::env::var_os("NO_COLOR").is_some_and(|set| !set.is_empty());
    let text = error.render();
    let text = if is_plain { text.to_string() } else { text.ansi().to_string() };
    std::io::stderr().write_all(in_plain_words(&text).as_bytes())
}

/// Messages of the library that reads numbers, and ours for them.
const WORDS: [(&str, &str); 7] = [
    ("invalid float literal", "wanted a number, such as 2.5"),
    ("cannot parse float from empty string", "wanted a number, such as 2.5"),
    ("invalid digit found in string", "wanted a whole number, 0 or more"),
    ("cannot parse integer from empty string", "wanted a whole number, 0 or more"),
    ("number too large to fit in target type", "wanted a smaller whole number"),
    ("number too small to fit in target type", "wanted a larger whole number"),
    ("provided string was not `true` or `false`", "wanted true or false"),
];

fn in_plain_words(text: &str) -> String {
    let plain = WORDS.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to));
    match plain.split_once(" is not in ") {
        Some((start, rest)) => {
            let (range, rest) = rest.split_once('\n').unwrap_or((rest, ""));
            let start = start.rsplit_once(": ").map_or(start, |(start, _)| start);
            format!(
                "{start}: wanted a whole number from {}\n{rest}",
                range.replace("..=", " to ").replace("..", " to below ")
            )
        }
        None => plain,
    }
}

fn read<P: FromArgMatches>(
    mut command: Command,
    words: impl IntoIterator<Item = impl Into<std::ffi::OsString> + Clone>,
) -> Result<P, clap::Error> {
    let mut matches = command.try_get_matches_from_mut(words)?;
    P::from_arg_matches_mut(&mut matches).map_err(|error| error.format(&mut command))
}

/// Lets every option take a negative number: the option then refuses it with its own range, or takes it.
pub(super) fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|argument| {
        let takes_a_value = matches!(argument.get_action(), ArgAction::Set | ArgAction::Append);
        if takes_a_value && !argument.is_positional() && !argument.is_allow_hyphen_values_set() {
            argument.allow_negative_numbers(true)
        } else {
            argument
        }
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Returns what to type instead, when the mistake is one of the usual ones.
fn advice(error: &clap::Error) -> Option<String> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    if error.kind() == ErrorKind::UnknownArgument {
        let is_number = text(ContextKind::InvalidArg)?.parse::<f64>().is_ok();
        is_number.then(|| "Several numbers of one option are separated by commas, without blanks: --at 0.1,0.2".into())
    } else if error.kind() == ErrorKind::InvalidSubcommand {
        (text(ContextKind::InvalidSubcommand)? == "version").then(|| "The version: starloop --version".into())
    } else if matches!(error.kind(), ErrorKind::ValueValidation | ErrorKind::InvalidValue) {
        let (option, given) = (text(ContextKind::InvalidArg)?, text(ContextKind::InvalidValue)?);
        advice_for_number(option, given)
    } else {
        None
    }
}

fn advice_for_number(option: &str, given: &str) -> Option<String> {
    let degrees = degrees_of_sexagesimal(given, option.starts_with("--ra "));
    if let Some(degrees) = degrees.filter(|_| option.contains("DEG")) {
        return Some(format!("Angles are decimal degrees: {given} is {degrees}."));
    }
    let point = given.replace(',', ".");
    if given.matches(',').count() == 1 && point.parse::<f64>().is_ok() && !option.contains(',') {
        return Some(format!("Decimals have a point: {point}"));
    }
    let number = given.trim_end_matches(|c: char| c.is_alphabetic() || c == '%' || c == '/' || c == ' ');
    let has_unit = number.len() < given.len() && number.parse::<f64>().is_ok();
    has_unit.then(|| format!("Numbers have no unit here, such as {number}; `--help` states each option's unit."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};

    #[derive(Debug, Parser)]
    struct Words {
        #[arg(long, value_name = "S")]
        duration: Option<f64>,
        #[arg(long, value_name = "DEG")]
        ra: Option<f64>,
        #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
        dec: Option<f64>,
        #[arg(long)]
        seed: Option<u64>,
        #[arg(long, value_delimiter = ',')]
        at: Vec<f64>,
        file: Option<String>,
    }

    fn refused(words: &[&str]) -> (String, Option<String>) {
        let all = core::iter::once("program").chain(words.iter().copied());
        let error = read::<Words>(with_negative_numbers(Words::command()), all).unwrap_err();
        (error.to_string(), advice(&error))
    }

    #[test]
    fn negative_number_reaches_its_option() {
        let words: Words =
            read(with_negative_numbers(Words::command()), ["program", "--duration", "-5", "--at", "-1"]).unwrap();
        assert_eq!((words.duration, words.at), (Some(-5.0), vec![-1.0]));
        let (message, _) = refused(&["--seed", "-1"]);
        assert!(message.contains("invalid value '-1' for '--seed"), "{message}");
        let (message, _) = refused(&["-5"]);
        assert!(message.contains("unexpected argument"), "no option takes it: {message}");
    }

    #[test]
    fn words_of_number_readers_become_plain() {
        let (message, _) = refused(&["--duration", "long"]);
        assert!(in_plain_words(&message).contains("'--duration <S>': wanted a number, such as 2.5"), "{message}");
        let (message, _) = refused(&["--seed", "-1"]);
        assert!(in_plain_words(&message).contains("wanted a whole number, 0 or more"), "{message}");
        let range = "error: invalid value '0' for '--frames <N>': 0 is not in 2..=65536\n\nmore\n";
        assert_eq!(
            in_plain_words(range),
            "error: invalid value '0' for '--frames <N>': wanted a whole number from 2 to 65536\n\nmore\n"
        );
    }

    #[test]
    fn advice_names_what_works() {
        let of = |words: &[&str]| refused(words).1.unwrap_or_else(|| "none".into());
        assert_eq!(of(&["--ra", "5h30m"]), "Angles are decimal degrees: 5h30m is 82.5.");
        assert_eq!(of(&["--ra", "5:35:00"]), "Angles are decimal degrees: 5:35:00 is 83.75.");
        assert_eq!(of(&["--dec", "-1:12:00"]), "Angles are decimal degrees: -1:12:00 is -1.2.");
        assert!(of(&["--duration", "10s"]).contains("such as 10;"), "{}", of(&["--duration", "10s"]));
        assert_eq!(of(&["--duration", "0,5"]), "Decimals have a point: 0.5");
        assert!(of(&["a file", "--at", "0.1", "0.2"]).contains("commas"));
        assert_eq!(of(&["--unknown"]), "none");
        assert_eq!(of(&["--duration", "ten"]), "none");
    }
}
