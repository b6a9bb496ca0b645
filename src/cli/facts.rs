//! Facts that a command found, gathered once: text for people, an object for programs, and the warnings of both.

use crate::cli::report_json::print_json;
use anyhow::Result;
use core::fmt::Display;
use serde_json::{Map, Value};

/// Name of a fact that is a warning.
const WARNING: &str = "WARNING";

/// A part of the text.
#[derive(Debug)]
enum Part {
    /// A heading, a row of a table, an empty line.
    Line(String),
    /// A fact by its name.
    Fact(String, String),
    /// A warning: the file is not called sound.
    Warning(String),
}

/// A report: its text, whose names begin behind an indent and take a width, and the values beside it.
#[derive(Debug)]
pub(super) struct Facts {
    parts: Vec<Part>,
    values: Map<String, Value>,
    indent: &'static str,
    width: usize,
}

/// The name of a fact whose words are still missing.
#[must_use = "a name without words is not in the report"]
#[derive(Debug)]
pub(super) struct Named<'a> {
    facts: &'a mut Facts,
    name: String,
}

impl Named<'_> {
    /// Adds the words.
    pub(super) fn line(self, words: impl Display) {
        self.facts.parts.push(Part::Fact(self.name, words.to_string()));
    }
}

impl Facts {
    pub(super) fn new(indent: &'static str, width: usize) -> Self {
        Self { parts: Vec::new(), values: Map::new(), indent, width }
    }

    /// Returns a report whose facts are indented below headings.
    pub(super) fn indented() -> Self {
        Self::new("  ", 12)
    }

    /// Adds a heading, a row of a table or an empty line.
    pub(super) fn line(&mut self, words: impl Display) {
        self.parts.push(Part::Line(words.to_string()));
    }

    /// Begins a fact with its name.
    pub(super) fn named(&mut self, name: impl Display) -> Named<'_> {
        Named { name: name.to_string(), facts: self }
    }

    /// Adds a fact by its name.
    pub(super) fn fact(&mut self, name: impl Display, words: impl Display) {
        self.named(name).line(words);
    }

    /// Adds more about the fact before.
    pub(super) fn more(&mut self, words: impl Display) {
        self.fact("", words);
    }

    /// Adds a warning.
    pub(super) fn warning(&mut self, words: impl Display) {
        self.parts.push(Part::Warning(words.to_string()));
    }

    /// Adds a value that programs read, or gives it another one.
    pub(super) fn value(&mut self, key: &str, value: impl Into<Value>) {
        self.values.insert(key.to_owned(), value.into());
    }

    /// Adds a value to a list that programs read.
    pub(super) fn element(&mut self, list: &str, value: Value) {
        let elements = self.values.entry(list).or_insert_with(|| Value::Array(Vec::new()));
        if let Some(elements) = elements.as_array_mut() {
            elements.push(value);
        }
    }

    /// Adds another report below this one.
    pub(super) fn append(&mut self, other: Self) {
        self.parts.extend(other.parts);
        self.values.extend(other.values);
    }

    /// Returns the warnings in order, each once: what several frames share is one.
    pub(super) fn warnings(&self) -> Vec<&str> {
        let mut found: Vec<&str> = Vec::new();
        for part in &self.parts {
            if let Part::Warning(words) = part
                && !found.contains(&words.as_str())
            {
                found.push(words);
            }
        }
        found
    }

    /// Returns the verdict on `what`, such as `bench "lab"`: one line, and below it the warnings, numbered.
    pub(super) fn verdict(&self, what: &str) -> String {
        let warnings = self.warnings();
        if warnings.is_empty() {
            return format!("{what} is sound\n");
        }
        let plural = if warnings.len() == 1 { "" } else { "s" };
        let lines = warnings.iter().zip(1..).map(|(words, number)| format!("  {number}. {words}\n"));
        format!("{WARNING}: {what}: {} warning{plural}\n{}\n", warnings.len(), lines.collect::<String>())
    }

    /// Returns the text.
    pub(super) fn text(&self) -> String {
        let named = |name: &str, words: &str| format!("{}{name:<width$} {words}\n", self.indent, width = self.width);
        let lines = self.parts.iter().map(|part| match part {
            Part::Line(words) => format!("{words}\n"),
            Part::Fact(name, words) => named(name, words),
            Part::Warning(words) => named(WARNING, words),
        });
        lines.collect()
    }

    /// Prints the text, or the values as the line of JSON of `command`.
    ///
    /// # Errors
    /// When the values do not go into JSON.
    pub(super) fn print(&self, command: &str, as_json: bool) -> Result<()> {
        if as_json {
            return print_json(command, &self.values);
        }
        print!("{}", self.text());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn facts() -> Facts {
        let mut facts = Facts::indented();
        facts.line("bench \"a\"");
        facts.fact("camera", "\"b\"");
        facts.warning("too dark");
        facts.more("and more: WARNING is a word like others here");
        facts.warning("late");
        facts.warning("too dark");
        facts
    }

    #[test]
    fn names_take_a_width_and_lines_are_as_they_are() {
        let wanted = "bench \"a\"\n  camera       \"b\"\n  WARNING      too dark\n               and more: WARNING is a word \
                      like others here\n  WARNING      late\n  WARNING      too dark\n";
        assert_eq!(facts().text(), wanted);
    }

    #[test]
    fn a_report_with_warnings_is_not_called_sound_and_each_is_listed_once() {
        assert_eq!(facts().warnings(), ["too dark", "late"]);
        assert_eq!(Facts::indented().verdict("bench \"a\""), "bench \"a\" is sound\n");
        let text = facts().verdict("bench \"a\"");
        assert_eq!(text, "WARNING: bench \"a\": 2 warnings\n  1. too dark\n  2. late\n\n");
        let mut one = Facts::indented();
        one.warning("late");
        assert!(one.verdict("bench \"a\"").starts_with("WARNING: bench \"a\": 1 warning\n"));
    }

    #[test]
    fn values_of_a_report_below_another_are_beside_its_own() {
        let mut first = Facts::indented();
        first.value("bench", "a");
        let mut second = facts();
        second.element("plans", json!({ "frame": 0 }));
        second.element("plans", json!({ "frame": 9 }));
        first.append(second);
        assert_eq!(
            Value::Object(first.values.clone()),
            json!({ "bench": "a", "plans": [{ "frame": 0 }, { "frame": 9 }] })
        );
        assert_eq!(first.warnings().len(), 2);
    }
}
