//! A refusal that is only a sentence: where something was refused, what was wanted, got and advised, as users read it.
//!
//! Crates have an error type of their own only where a caller matches on it.

use std::{fmt::Display, io, path::Path};

/// Why something was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub String);

impl Refused {
    /// Returns the sentence of another error.
    pub fn of(error: impl Display) -> Self {
        Self(error.to_string())
    }

    /// Returns a sentence about a file.
    pub fn at(path: impl AsRef<Path>, text: impl Display) -> Self {
        Self(format!("{}: {text}", path.as_ref().display()))
    }

    /// Returns a failure of the system with `path`.
    pub fn file(what: &str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self(format!("{what} {}: {source}", path.display()))
    }
}
