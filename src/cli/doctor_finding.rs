//! One thing that `starloop doctor` looked for: whether it is there, and what to do where it is not.

use serde::Serialize;

/// Whether something is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum State {
    /// It is there and may be used.
    Ready,
    /// It is there, but not as good as it could be.
    Limited,
    /// It is not there.
    Missing,
}

impl State {
    /// Returns its word in the report.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Ready => "ready",
            Self::Limited => "limited",
            Self::Missing => "missing",
        }
    }
}

/// One thing that was looked for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// Short name, the same in every report.
    pub(super) name: &'static str,
    pub(super) state: State,
    /// The things that were found, in words.
    pub(super) found: String,
    /// The step that makes it ready; `None` where it is.
    pub(super) advice: Option<String>,
}

impl Finding {
    /// Returns something that is there.
    pub(super) fn ready(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, state: State::Ready, found: found.into(), advice: None }
    }

    /// Returns something that is there in part.
    pub(super) fn limited(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, state: State::Limited, found: found.into(), advice: Some(advice.into()) }
    }

    /// Returns something that is not there.
    pub(super) fn missing(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, state: State::Missing, found: found.into(), advice: Some(advice.into()) }
    }
}
