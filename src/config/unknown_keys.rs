//! Reads a document as a table of keys, and refuses what is not one, in plain words.
//!
//! Values of a wrong type, in the words of the other refusals: key, value, what is wanted, and what to try.

use crate::declared::{Declared, Key};
use crate::document::{Document, Origin};
use crate::error::{ConfigError, Result, nearest};
use crate::{file_kind::FileKind, key_type::Shape, reference::declared};
use core::ops::Range;
use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

/// Keys that other programs have, the one here, and how its value follows.
const SYNONYMS: [(&str, &str, &str); 1] =
    [("f_number", "aperture_mm", "the aperture is focal length / f-number, in millimetres")];

impl Document {
    /// Reads the text as `S`, whose tables refuse unknown keys.
    pub(super) fn read_as<S: DeserializeOwned>(&self) -> Result<S> {
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
    pub(super) fn read_table<S: DeserializeOwned>(&self, table: &toml::Table, name: &str, which: &str) -> Result<S> {
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
        let refused = refusal(&error, self.place(&key), &text);
        let ConfigError::UnknownKey { place, nearest, known, .. } = refused else { return Err(refused) };
        Err(ConfigError::UnknownKey { place, key, nearest, known: format!("{known}{which}") })
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

/// Characters of a value that a message shows.
const SHOWN: usize = 80;

/// Returns the refusal of a value of a wrong type, from the words of the TOML reader; `None` for its other errors.
pub(super) fn wrong_type(document: &Document, error: &toml::de::Error) -> Option<ConfigError> {
    let wanted = wanted_words(error.message())?;
    let (text, span) = (document.text(), error.span()?);
    let parsed = DeTable::parse(text).ok()?;
    let (key, value) = key_around(parsed.get_ref(), &span, String::new())?;
    let given = text.get(value.clone())?;
    let is_table = error.message().contains("invalid type: map");
    let (got, wanted) = match (is_table, wanted.as_str()) {
        (true, "a list") => ("one table".to_owned(), format!("several tables, each as [[{key}]]")),
        (true, _) if text.get(value.start..)?.starts_with("[[") => {
            ("a list of tables".to_owned(), format!("one table: [{key}]"))
        }
        _ => (shortened(given), wanted),
    };
    Some(wrong_type_refusal(document, document.place_of_offset(value.start), key, got, wanted))
}

/// Returns the refusal with what the declaration of the key says, when it has one.
fn wrong_type_refusal(document: &Document, place: String, key: String, got: String, wanted: String) -> ConfigError {
    let declared = declared(FileKind::of(document));
    match declared_key(&declared, &key) {
        Some(known) => {
            let wanted = wanted_by(&known.shape).unwrap_or(wanted);
            ConfigError::Invalid { place, key, wanted, got, advice: as_clause(&known.meaning()) }
        }
        None => ConfigError::Invalid { place, key, got, advice: advice(&wanted).into(), wanted },
    }
}

/// Returns the refusal of the value of a key that is known, at `place`.
pub(super) fn wrong_type_of(
    document: &Document,
    error: &toml::de::Error,
    place: String,
    key: &str,
    value: &str,
) -> Option<ConfigError> {
    let wanted = wanted_words(error.message())?;
    Some(wrong_type_refusal(document, place, key.into(), shortened(value), wanted))
}

/// Returns what a reader's message about a wrong type wants, in plain words.
fn wanted_words(message: &str) -> Option<String> {
    let message = message.lines().next()?;
    let is_about_type =
        ["invalid type: ", "invalid length ", "invalid value: "].iter().any(|start| message.starts_with(start));
    let (_, wanted) = message.rsplit_once("expected ").filter(|_| is_about_type)?;
    let count = |wanted: &str| wanted.rsplit(' ').next().unwrap_or_default().to_owned();
    Some(match wanted {
        "f64" | "f32" => "a number".into(),
        "i64" | "i32" | "u64" | "u32" | "u16" | "u8" | "usize" => "a whole number".into(),
        "a boolean" => "true or false".into(),
        "a string" => "a text in quotes".into(),
        "a sequence" => "a list".into(),
        wanted if wanted.starts_with("struct ") || wanted == "a map" => "a table".into(),
        wanted if wanted.starts_with("an array of length") || wanted.starts_with("a tuple of size") => {
            format!("a list of {}", count(wanted))
        }
        other => other.into(),
    })
}

/// Returns the innermost key whose value contains the span, with its tables, and where the value is.
fn key_around(table: &DeTable<'_>, span: &Range<usize>, around: String) -> Option<(String, Range<usize>)> {
    let contains = |outer: &Range<usize>| outer.start <= span.start && span.end <= outer.end;
    for (key, value) in table {
        let name = if around.is_empty() { key.get_ref().to_string() } else { format!("{around}.{}", key.get_ref()) };
        let whole = key.span().start.min(value.span().start)..value.span().end;
        let inner = if let DeValue::Table(inner) = value.get_ref() {
            key_around(inner, span, name.clone())
        } else if let DeValue::Array(items) = value.get_ref() {
            items.iter().zip(0..).find_map(|(item, place)| {
                let DeValue::Table(inner) = item.get_ref() else { return None };
                key_around(inner, span, format!("{name}[{place}]"))
            })
        } else {
            None
        };
        if let Some(found) = inner {
            return Some(found);
        }
        if contains(&whole) {
            return Some((name, value.span()));
        }
    }
    None
}

/// Returns the form of a declared value, as refusals say it; `None` for texts and lists of any length.
pub(super) fn wanted_by(shape: &Shape) -> Option<String> {
    match shape {
        Shape::Number(_) | Shape::Whole(_) | Shape::Row(..) => Some(format!("a {shape}")),
        Shape::Words(_) => Some(format!("one of {shape}")),
        Shape::Flag => Some(shape.to_string()),
        Shape::Text(_) | Shape::List(_) | Shape::Either(_) | Shape::Table(_) => None,
    }
}

/// Returns a sentence as the end of another one.
pub(super) fn as_clause(sentence: &str) -> String {
    let mut rest = sentence.trim_end_matches('.').chars();
    rest.next().map(|first| format!("{}{}", first.to_lowercase(), rest.as_str())).unwrap_or_default()
}

/// Returns how a value of a form is written.
fn advice(wanted: &str) -> &'static str {
    match wanted {
        "a table" => "write its name in brackets on a line of its own, and its keys below it",
        "a list" => "write it in brackets, with commas: [1.0, 2.0]",
        _ => "`starloop keys` prints every key with its values",
    }
}

/// Returns the declaration of a key such as `event[1].for_s`.
pub(super) fn declared_key<'d>(declared: &'d Declared, key: &str) -> Option<&'d Key> {
    match key.split_once('.') {
        None => declared.keys.iter().find(|known| known.name == key),
        Some((table, rest)) => {
            let name = table.split('[').next()?;
            let table = declared.tables.iter().find(|known| known.name == name)?;
            table.forms.iter().find_map(|form| declared_key(form, rest))
        }
    }
}

/// Returns a value on one line, with its middle left out when it is long.
fn shortened(value: &str) -> String {
    let line = value.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= SHOWN {
        return line;
    }
    format!("{} ...", line.chars().take(SHOWN).collect::<String>())
}

#[cfg(test)]
mod wrong_type_tests {
    use crate::{Bench, Document};
    use std::path::Path;

    fn refused(text: &str) -> String {
        let document = Document::from_text(text, Path::new("bench.toml"));
        Bench::from_document(&document).unwrap_err().to_string()
    }

    #[test]
    fn wrong_type_names_key_value_and_what_is_wanted() {
        let rate = refused("[timing]\nframe_rate_hz = \"ten\"\n");
        assert!(rate.starts_with("bench.toml:2: timing.frame_rate_hz is \"ten\"; wanted a number above 0"), "{rate}");
        assert!(rate.contains("such as 10.0"), "the declaration's sentence: {rate}");
        let flag = refused("[sky]\nbodies = \"yes\"\n");
        assert!(flag.contains("sky.bodies is \"yes\"; wanted true or false"), "{flag}");
        let line = refused("[[flight_computer.jitter_line]]\nfrequency_hz = 5.0\namplitude_arcsec = [1.0, 2.0]\n");
        let wanted = "flight_computer.jitter_line[0].amplitude_arcsec is [1.0, 2.0]; wanted a list of 3";
        assert!(line.contains(wanted), "{line}");
        assert!(!line.contains("missing"), "one error: {line}");
    }

    #[test]
    fn tables_in_the_wrong_number_show_the_right_brackets() {
        assert!(refused("timing = 5\n").contains("timing is 5; wanted a table"), "{}", refused("timing = 5\n"));
        let one = refused("[event]\ndo = \"safe\"\n");
        assert!(one.contains("event is one table; wanted several tables, each as [[event]]"), "{one}");
        let several = refused("[[timing]]\nframe_rate_hz = 5\n");
        assert!(several.contains("bench.toml:1") && several.contains("wanted one table: [timing]"), "{several}");
    }
}
