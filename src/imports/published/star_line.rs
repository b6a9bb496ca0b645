//! A line of a file of bright stars: its numbers, and what is said of one that is refused.

use base::refused::Refused;
use std::path::Path;

/// One line of a file.
pub(super) struct Line<'a> {
    pub(super) path: &'a Path,
    /// From 1.
    pub(super) number: u64,
    pub(super) text: &'a str,
}

impl Line<'_> {
    /// Returns a number, or `None` where the field is blank.
    pub(super) fn number(&self, column: &str, field: &str) -> Result<Option<f64>, Refused> {
        let field = field.trim();
        if field.is_empty() {
            return Ok(None);
        }
        let number = field.parse().ok().filter(|number: &f64| number.is_finite());
        number.map(Some).ok_or_else(|| self.refuse(column, "a number, or blank", field))
    }

    /// Reads a number within limits that must be there.
    pub(super) fn required(
        &self,
        column: &str,
        field: &str,
        [low, high]: [f64; 2],
        wanted: &'static str,
    ) -> Result<f64, Refused> {
        let number = self.number(column, field)?.filter(|number| (low..=high).contains(number));
        number.ok_or_else(|| self.refuse(column, wanted, field))
    }

    pub(super) fn refuse(&self, column: &str, wanted: &'static str, got: &str) -> Refused {
        Refused(format!(
            "{path}, line {line}, column {column}: wanted {wanted}, got \"{got}\"",
            path = self.path.display(),
            line = self.number,
            got = got.trim().chars().take(40).collect::<String>()
        ))
    }

    pub(super) fn refuse_line(&self, wanted: &'static str) -> Refused {
        self.refuse("all", wanted, self.text)
    }
}
