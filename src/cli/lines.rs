//! Reports for people: lines, and facts that begin with their names.

use core::fmt::{Display, Write};

/// Word that makes a line of a report a warning.
pub(super) const WARNING: &str = "WARNING";

/// A report while it grows; its names begin behind an indent and take a width.
#[derive(Debug)]
pub(super) struct Lines {
    pub(super) text: String,
    indent: &'static str,
    width: usize,
}

impl Lines {
    pub(super) fn new(indent: &'static str, width: usize) -> Self {
        Self { text: String::new(), indent, width }
    }

    /// Returns a report whose facts are indented below headings.
    pub(super) fn indented() -> Self {
        Self::new("  ", 12)
    }

    /// Adds a heading, a row of a table or an empty line.
    pub(super) fn line(&mut self, words: impl Display) {
        let _text_grows = writeln!(self.text, "{words}");
    }

    /// Begins the line of a fact with its name.
    pub(super) fn named(&mut self, name: impl Display) -> &mut Self {
        let Self { indent, width, .. } = *self;
        let _text_grows = write!(self.text, "{indent}{name:<width$} ");
        self
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
        self.fact(WARNING, words);
    }
}
