//! Reads a document as a table of keys, and refuses what is not one, in plain words.

use crate::document::{Document, Origin};
use crate::wrong_type::{wrong_type, wrong_type_of};
use crate::{error::ConfigError, nearest::nearest};
use serde::de::DeserializeOwned;

/// Keys that other programs have, the one here, and how its value follows.
const SYNONYMS: [(&str, &str, &str); 1] =
    [("f_number", "aperture_mm", "the aperture is focal length / f-number, in millimetres")];

impl Document {
    /// Reads the text as `S`, whose tables refuse unknown keys.
    pub(super) fn read_as<S: DeserializeOwned>(&self) -> Result<S, ConfigError> {
        let as_written = toml::from_str(self.text()).map_err(|error| self.refuse(&error))?;
        if self.settings.is_empty() {
            return Ok(as_written);
        }
        let mut table: toml::Table = toml::from_str(self.text()).map_err(|error| self.refuse(&error))?;
        let mut read = as_written;
        for setting in &self.settings {
            // Read after each change: the first that cannot be read is the one to blame.
            if setting.apply(&mut table)? {
                let reported = setting.reported();
                let place = format!("{reported} ({})", self.name());
                let refuse = |error: toml::de::Error| {
                    wrong_type_of(self, &error, place.clone(), &setting.key(), setting.value_text())
                        .unwrap_or_else(|| refusal(&error, place, setting.value_text()))
                };
                read = from_table(&table).map_err(refuse)?;
            }
        }
        Ok(read)
    }

    /// Reads the table `name` of this document, where one key decides which others are allowed; `which` is a clause for
    /// messages.
    pub(super) fn read_table<S: DeserializeOwned>(
        &self,
        table: &toml::Table,
        name: &str,
        which: &str,
    ) -> Result<S, ConfigError> {
        let whole = match from_table(table) {
            Ok(read) => return Ok(read),
            Err(error) => error,
        };
        // Every key is optional: the first that cannot be read by itself is the one to blame.
        let bad = table.iter().find_map(|(key, value)| {
            let alone = toml::Table::from_iter([(key.clone(), value.clone())]);
            Some((format!("{name}.{key}"), format!("{key} = {value}"), from_table::<S>(&alone).err()?))
        });
        let (key, text, error) = bad.unwrap_or_else(|| (name.to_owned(), name.to_owned(), whole));
        let value = text.split_once(" = ").map_or("", |(_, value)| value);
        if let Some(refused) = wrong_type_of(self, &error, self.place(&key), &key, value) {
            return Err(refused);
        }
        Err(match refusal(&error, self.place(&key), &text) {
            ConfigError::UnknownKey { place, nearest, known, .. } => {
                ConfigError::UnknownKey { place, key, nearest, known: format!("{known}{which}") }
            }
            refused @ (ConfigError::Read { .. }
            | ConfigError::Syntax { .. }
            | ConfigError::WrongKind { .. }
            | ConfigError::Several { .. }
            | ConfigError::Invalid { .. }) => refused,
        })
    }

    fn refuse(&self, error: &toml::de::Error) -> ConfigError {
        if let Some(refused) = wrong_type(self, error) {
            return refused;
        }
        let offset = error.span().map_or(0, |span| span.start);
        let text = self.text().lines().nth(self.line_of_offset(offset) - 1).unwrap_or_default();
        let mut refused = refusal(error, self.place_of_offset(offset), text.trim());
        if let ConfigError::Syntax { why, .. } = &mut refused {
            if error.message().contains("duplicate key") {
                why.push_str(&self.first_line_of(text));
            } else if let Some(hint) = syntax_hint(text) {
                why.push_str(hint);
            }
            if let Origin::File(path) = &self.origin
                && path.extension().is_none_or(|end| end != "toml")
                && self.text().parse::<toml::Table>().is_err()
            {
                why.push_str(" (wanted a TOML file: a bench, a scenario or a camera)");
            }
        }
        refused
    }

    /// Returns where the key of a line is given for the first time, as a clause.
    fn first_line_of(&self, line: &str) -> String {
        let key_of = |line: &str| match line.split_once('=') {
            Some((key, _)) => Some(key.trim().to_owned()),
            None => line.trim().starts_with('[').then(|| line.trim().to_owned()),
        };
        let (Some(key), lines) = (key_of(line), self.text().lines()) else { return String::new() };
        let first = lines.zip(1..).find(|(other, _)| key_of(other).as_ref() == Some(&key));
        first.map(|(_, number)| format!(": `{key}` is already in line {number}")).unwrap_or_default()
    }
}

/// Reads a table as `S`, through its text: a second reader, of tables, would be compiled for every type of the configuration.
fn from_table<S: DeserializeOwned>(table: &toml::Table) -> Result<S, toml::de::Error> {
    toml::from_str(&table.to_string())
}

/// Returns the error of a reader of `text`, which is at `place`.
fn refusal(error: &toml::de::Error, place: String, text: &str) -> ConfigError {
    match unknown_key(error.message()) {
        Some((key, known)) => ConfigError::UnknownKey {
            place,
            key: key.into(),
            nearest: match SYNONYMS.iter().find(|(other, name, _)| *other == key && known.contains(name)) {
                Some((_, name, meaning)) => format!(", did you mean `{name}`? ({meaning})"),
                None => nearest(key, known.iter().copied())
                    .map(|name| format!(", did you mean `{name}`?"))
                    .unwrap_or_default(),
            },
            known: if known.is_empty() { "nothing".into() } else { known.join(", ") },
        },
        None => ConfigError::Syntax { place, why: error.message().trim().replace('\n', ", "), text: text.into() },
    }
}

/// Returns what is usually meant by a line that is not TOML, as a clause.
fn syntax_hint(line: &str) -> Option<&'static str> {
    let line = line.trim();
    if line.starts_with('{') || (line.ends_with(':') && !line.contains('=')) {
        return Some(" (wanted a TOML file: [table] on a line of its own, then key = value)");
    }
    let (_, value) = line.split_once('=')?;
    let value = value.split('#').next().unwrap_or_default().trim();
    if value == "True" || value == "False" {
        return Some(" (wanted true or false, in small letters)");
    }
    if value.starts_with('"') && value.contains('\\') {
        return Some(" (a backslash begins an escape in double quotes: put paths in single quotes)");
    }
    let is_decimal_comma = value.split_once(',').is_some_and(|(whole, part)| {
        let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        is_digits(whole.trim_start_matches('-')) && is_digits(part)
    });
    if is_decimal_comma {
        return Some(" (decimals have a point)");
    }
    let is_word = value.starts_with(char::is_alphabetic) && !value.contains(['"', '\'']);
    is_word.then_some(" (a word or a path needs quotes)")
}

/// Returns the key and its known neighbours out of serde's "unknown field `x`, expected one of `a`, `b`".
fn unknown_key(message: &str) -> Option<(&str, Vec<&str>)> {
    let quoted = message.strip_prefix("unknown field ")?;
    let mut names = quoted.split('`').skip(1).step_by(2);
    Some((names.next()?, names.collect()))
}
