//! `KEY=VALUE` from the command line -> one value of a configuration, changed before it is checked.
//!
//! KEY is dotted as in the messages about a file: `control.delay_ms`, `event[1].for_s`. A key that goes on where the
//! file names another file, such as `bench.timing.frame_rate_hz`, changes that file's value. VALUE is TOML; any other
//! word is taken as a string, so that a shell needs no second quotes. Tests: `setting_tests`.

use crate::error::{ConfigError, Result};

/// Keys whose value may be the path of a file that is read in their place.
pub(super) const NAMES_A_FILE: [&str; 4] = ["bench", "camera", "link", "spacecraft"];

/// One change of a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// As given on the command line, for messages.
    reported: String,
    /// The steps from the top table to the value.
    steps: Vec<Step>,
    value: toml::Value,
}

/// A key, and the place in its list: `event[1]`.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Step {
    name: String,
    place: Option<usize>,
}

impl Setting {
    /// Reads `KEY=VALUE`.
    ///
    /// # Errors
    /// When it has no `=`, no usable key, or a value that is neither TOML nor a word.
    pub fn parse(text: &str) -> Result<Self> {
        let refuse = |key: &str, got: &str, wanted: &str| ConfigError::Invalid {
            place: "--set".into(),
            key: key.into(),
            wanted: wanted.into(),
            got: format!("`{got}`"),
            advice: "such as --set control.delay_ms=300".into(),
        };
        let (key, given) = text.split_once('=').ok_or_else(|| refuse("KEY=VALUE", text, "a key, `=` and a value"))?;
        let steps: Option<Vec<Step>> = key.trim().split('.').map(Step::parse).collect();
        let steps = steps.ok_or_else(|| refuse("KEY", key, "names joined by dots, such as event[0].for_s"))?;
        let value = value(given.trim()).ok_or_else(|| refuse(key, given, "a TOML value or a word"))?;
        Ok(Self { reported: format!("--set {text}"), steps, value })
    }

    /// Returns the value as it was given.
    pub(super) fn value_text(&self) -> &str {
        self.reported.split_once('=').map_or("", |(_, value)| value)
    }

    /// Returns its key.
    pub(super) fn key(&self) -> String {
        self.steps.iter().map(Step::to_string).collect::<Vec<_>>().join(".")
    }

    /// Returns how messages call it: as it was given.
    pub(super) fn reported(&self) -> &str {
        &self.reported
    }

    /// Returns whether it gives the value of `key` (as [`super::Document::place`] takes it) or of a table around it.
    pub(super) fn gives(&self, key: &str) -> bool {
        key.strip_prefix(&self.key()).is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', '[']))
    }

    /// Returns whether it gives this top-level key as a whole.
    pub(super) fn is_for(&self, key: &str) -> bool {
        matches!(self.steps.as_slice(), [only] if only.place.is_none() && only.name == key)
    }

    /// Returns the change of the file that `key` names; `None` when it changes something else.
    pub(super) fn below(&self, key: &str) -> Option<Self> {
        let (first, rest) = self.steps.split_first()?;
        let is_below = first.place.is_none() && first.name == key && !rest.is_empty();
        is_below.then(|| Self { steps: rest.to_vec(), ..self.clone() })
    }

    /// Changes `table`; false when the value belongs to a file that the table names.
    pub(super) fn apply(&self, table: &mut toml::Table) -> Result<bool> {
        if self.is_of_another_file(table) {
            return Ok(false);
        }
        let Some((last, tables)) = self.steps.split_last() else { return Ok(false) };
        let mut here = table;
        for step in tables {
            let entry = here.entry(step.name.clone());
            let value = entry.or_insert_with(|| toml::Value::Table(toml::Table::new()));
            here = self.item(step, value)?.as_table_mut().ok_or_else(|| self.refuse(step, "a value", "a table"))?;
        }
        match last.place {
            None => drop(here.insert(last.name.clone(), self.value.clone())),
            Some(_) => {
                let missing = || self.refuse(last, "missing", "a list");
                let list = here.get_mut(&last.name).ok_or_else(missing)?;
                *self.item(last, list)? = self.value.clone();
            }
        }
        Ok(true)
    }

    fn is_of_another_file(&self, table: &toml::Table) -> bool {
        let named = |key: &str| self.below(key).is_some() && table.get(key).is_some_and(toml::Value::is_str);
        NAMES_A_FILE.iter().any(|key| named(key))
    }

    /// Returns the value itself, or its item when the step says which.
    fn item<'a>(&self, step: &Step, value: &'a mut toml::Value) -> Result<&'a mut toml::Value> {
        let Some(place) = step.place else { return Ok(value) };
        let list = value.as_array_mut().ok_or_else(|| self.refuse(step, "no list", "a list"))?;
        let obtained = list.len();
        let wanted = || self.refuse(step, &format!("beyond a list of {obtained}"), "an item that is there, from 0");
        list.get_mut(place).ok_or_else(wanted)
    }

    fn refuse(&self, step: &Step, got: &str, wanted: &str) -> ConfigError {
        ConfigError::Invalid {
            place: self.reported.clone(),
            key: step.to_string(),
            wanted: wanted.into(),
            got: got.into(),
            advice: "as in the file that is changed".into(),
        }
    }
}

impl Step {
    fn parse(text: &str) -> Option<Self> {
        let (name, place) = match text.split_once('[') {
            Some((name, rest)) => (name, Some(rest.strip_suffix(']')?.parse().ok()?)),
            None => (text, None),
        };
        let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        (!name.is_empty() && name.chars().all(is_bare)).then(|| Self { name: name.into(), place })
    }
}

impl core::fmt::Display for Step {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.place {
            Some(place) => write!(f, "{}[{place}]", self.name),
            None => f.write_str(&self.name),
        }
    }
}

/// Returns a TOML value, or a word or path as a string.
fn value(text: &str) -> Option<toml::Value> {
    let table: Option<toml::Table> = toml::from_str(&format!("value = {text}")).ok();
    let read = table.filter(|table| table.len() == 1).and_then(|mut table| table.remove("value"));
    let is_word = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '.' || c == '/')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "_-./ ".contains(c));
    read.or_else(|| is_word.then(|| toml::Value::String(text.into())))
}
