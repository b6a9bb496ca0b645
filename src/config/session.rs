//! `[session]`: how the conversation with the flight computer is kept.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::time::Span;
use serde::Deserialize;

/// When frames begin to show stars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionStart {
    /// With the first attitude.
    AtOnce,
    /// With the flight computer's RUN.
    OnRun,
}

/// The session, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Session {
    /// When frames begin to show stars.
    pub start: SessionStart,
    /// Heartbeats that stop for this long are told.
    pub heartbeat_timeout: Span,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SessionKeys {
    start: Option<String>,
    heartbeat_timeout_s: Option<f64>,
}

impl Session {
    pub(super) fn check(keys: &SessionKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let starts = [("at_once", SessionStart::AtOnce), ("on_run", SessionStart::OnRun)];
        let advice = "at_once shows stars with the first attitude, on_run waits for HELLO and RUN";
        let start = check.choice("session.start", keys.start.as_deref(), &starts, advice)?;
        let key = "session.heartbeat_timeout_s";
        let rule = Rule::Within(0.1, 3600.0);
        let timeout_s = check.number(key, keys.heartbeat_timeout_s, 3.5, rule, "heartbeats come once a second")?;
        Ok(Self { start, heartbeat_timeout: Span::from_s(timeout_s) })
    }
}
