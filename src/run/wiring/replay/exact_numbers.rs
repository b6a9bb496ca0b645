//! Numbers of `session.json`, which are stored as text, and the refusal of a value there.

use super::{ReplayError, SESSION_FILE};

/// Returns the text of a number: the fewest digits that give the same bits again.
pub(super) fn exact(value: f64) -> String {
    format!("{value:?}")
}

/// Returns the finite number that a text is.
pub(super) fn number(name: &str, text: &str) -> Result<f64, ReplayError> {
    let value = text.parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| wrong(name, text, "a finite number"))
}

/// Returns the refusal of a value.
pub(super) fn wrong(name: &str, got: &str, wanted: &str) -> ReplayError {
    ReplayError::Session { path: SESSION_FILE.into(), why: format!("{name} is \"{got}\", wanted {wanted}") }
}
