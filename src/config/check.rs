//! The rules a value must meet, with one form of message, and the list of defaults that were taken.

use crate::document::Document;
use crate::error::{ConfigError, Partly, Result, with_what_was_meant};
use core::fmt;
use std::ops::RangeInclusive;

/// Longest name, characters: with endings and numbers it is still a file name.
const NAME_MAX: usize = 100;
/// Characters of a refused name that a message shows.
const SHOWN: usize = 60;

/// Returns a refused name, escaped and not longer than a line.
fn quoted(name: &str) -> String {
    let shown: String = name.chars().take(SHOWN).collect();
    let more = if name.chars().count() > SHOWN { "..." } else { "" };
    format!("{shown:?}{more}")
}

/// A value that the file does not give.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Defaulted {
    /// The key with its tables.
    pub key: String,
    /// The value that was taken.
    pub value: String,
}

/// The range of a number, which must also be finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Rule {
    /// More than zero.
    Positive,
    /// More than zero, up to this.
    PositiveUpTo(f64),
    /// Zero or more.
    NotNegative,
    /// Between two numbers, both allowed.
    Within(f64, f64),
    /// Any.
    Finite,
}

impl Rule {
    pub(super) fn is_met_by(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Self::Positive => value > 0.0,
                Self::PositiveUpTo(most) => value > 0.0 && value <= most,
                Self::NotNegative => value >= 0.0,
                Self::Within(least, most) => (least..=most).contains(&value),
                Self::Finite => true,
            }
    }
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Positive => write!(f, "a number above 0"),
            Self::PositiveUpTo(most) => write!(f, "a number above 0, up to {most}"),
            Self::NotNegative => write!(f, "a number, 0 or more"),
            Self::Within(least, most) => write!(f, "a number from {least} to {most}"),
            Self::Finite => write!(f, "a number"),
        }
    }
}

/// Checks the values of one document.
#[derive(Debug)]
pub(super) struct Checker<'a> {
    pub(super) document: &'a Document,
    pub(super) defaulted: Vec<Defaulted>,
    /// Errors of files that the document names.
    pub(super) named_errors: Vec<ConfigError>,
}

impl<'a> Checker<'a> {
    pub(super) fn new(document: &'a Document) -> Self {
        Self { document, defaulted: Vec::new(), named_errors: Vec::new() }
    }

    /// Returns the error of a value that breaks a rule.
    pub(super) fn invalid(
        &self,
        key: &str,
        got: impl fmt::Display,
        wanted: impl fmt::Display,
        advice: &str,
    ) -> ConfigError {
        ConfigError::Invalid {
            place: self.document.place(key),
            key: key.into(),
            wanted: wanted.to_string(),
            got: got.to_string(),
            advice: advice.into(),
        }
    }

    /// Takes the value of a file that the document names, and keeps what is wrong with that file for the end.
    pub(super) fn take<T>(&mut self, (value, errors): Partly<T>) -> T {
        self.named_errors.extend(errors);
        value
    }

    /// Notes a default that was taken.
    pub(super) fn note(&mut self, key: &str, value: impl fmt::Display) {
        self.defaulted.push(Defaulted { key: key.into(), value: value.to_string() });
    }

    /// Returns the given value, or the default, which is added to the list of defaults.
    pub(super) fn given_or<T: fmt::Display>(&mut self, key: &str, given: Option<T>, default: T) -> T {
        given.unwrap_or_else(|| {
            self.defaulted.push(Defaulted { key: key.into(), value: default.to_string() });
            default
        })
    }

    /// Returns the `name` of what the document describes, or the file's: it is printed, and written into files.
    pub(super) fn label(&mut self, given: Option<String>) -> Result<String> {
        let name = self.given_or("name", given, self.document.stem());
        let is_printable = !name.trim().is_empty() && !name.chars().any(char::is_control);
        if is_printable && name.chars().count() <= NAME_MAX {
            return Ok(name);
        }
        let wanted = format!("1 to {NAME_MAX} printable characters");
        Err(self.invalid(
            "name",
            quoted(&name),
            wanted,
            "without line breaks, escape sequences or other control characters",
        ))
    }

    /// Returns the `name` of a bench or scenario, which is also that of a folder below `out/`.
    pub(super) fn folder_name(&mut self, given: Option<String>) -> Result<String> {
        let name = self.label(given)?;
        if name.contains(['/', '\\']) || matches!(name.as_str(), "." | "..") {
            let advice = "it names a folder below out/: to write elsewhere, give sink.directory or --out";
            return Err(self.invalid("name", quoted(&name), "a name without / and \\, and not . or ..", advice));
        }
        Ok(name)
    }

    /// Returns the number itself, when it meets the rule.
    pub(super) fn meets(&self, key: &str, value: f64, rule: Rule, advice: &str) -> Result<f64> {
        if rule.is_met_by(value) { Ok(value) } else { Err(self.invalid(key, value, rule, advice)) }
    }

    /// Returns a whole number in the range, or the default; without a default it must be given.
    pub(super) fn whole(
        &mut self,
        key: &str,
        given: Option<i64>,
        default: Option<u32>,
        range: RangeInclusive<u32>,
        advice: &str,
    ) -> Result<u32> {
        let wanted = format!("a whole number from {} to {}", range.start(), range.end());
        let value = match (given, default) {
            (Some(value), _) => value,
            (None, Some(default)) => i64::from(self.given_or(key, None, default)),
            (None, None) => return Err(self.invalid(key, "missing", wanted, advice)),
        };
        let in_range = u32::try_from(value).ok().filter(|value| range.contains(value));
        in_range.ok_or_else(|| self.invalid(key, value, wanted, advice))
    }

    /// Returns one of a few words, or the first of them.
    pub(super) fn choice<T: Copy>(
        &mut self,
        key: &str,
        given: Option<&str>,
        choices: &[(&str, T)],
        advice: &str,
    ) -> Result<T> {
        let default = choices.first().map_or("", |(word, _)| word).to_owned();
        let word = self.given_or(key, given.map(str::to_owned), default);
        let found = choices.iter().find(|(known, _)| *known == word).map(|(_, choice)| *choice);
        found.ok_or_else(|| {
            let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
            let wanted = format!("one of \"{}\"", words.join("\", \""));
            self.invalid(key, with_what_was_meant(&word, words.iter().copied()), wanted, advice)
        })
    }

    /// Refuses a key that has a meaning only with another choice.
    pub(super) fn unused(&self, key: &str, is_given: bool, belongs_to: &str) -> Result<()> {
        if is_given {
            return Err(self.invalid(key, "given", format!("no {key} here"), &format!("it belongs to {belongs_to}")));
        }
        Ok(())
    }
}
