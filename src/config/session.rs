//! `[session]`: how the conversation with the flight computer is kept.

use crate::key::{section, taken};
use crate::{check::Checker, error::ConfigError, flight_computer::FlightComputer, key_type::Word, link::Link};
use base::time::Span;

/// When frames begin to show stars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionStart {
    /// With the first attitude. A STOP, or a HELLO of another major version, ends it until the next RUN.
    AtOnce,
    /// With an accepted RUN of the flight computer.
    OnRun,
}

/// The session, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Session {
    /// When frames begin to show stars.
    pub start: SessionStart,
    /// Gap between heartbeats after which it is reported.
    pub heartbeat_timeout: Span,
}

section! {
    /// How the conversation with the flight computer is kept.
    SessionKeys at "session" {
        /// At_once shows stars with the first attitude, on_run waits for HELLO and RUN.
        start: Word<SessionStart> = "at_once",
            [("at_once", SessionStart::AtOnce), ("on_run", SessionStart::OnRun)];
        /// Heartbeats that stop for so many seconds are an event; they come once a second.
        heartbeat_timeout_s: f64 = 3.5, Within(0.1, 3600.0);
    }
}

impl Session {
    pub(super) fn check(keys: &SessionKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        taken!(check, keys => start, heartbeat_timeout_s);
        Ok(Self { start, heartbeat_timeout: Span::from_s(heartbeat_timeout_s) })
    }

    /// Refuses to wait for RUN in lockstep: all frames would stay dark.
    pub(super) fn check_has_run(
        &self,
        link: &Link,
        computer: &FlightComputer,
        check: &Checker<'_>,
    ) -> Result<(), ConfigError> {
        if self.start == SessionStart::OnRun && computer.is_external && link.has_no_gateway() {
            let advice = "no bus leads out of the program, so no flight computer can send RUN: frames show stars with the first attitude";
            return Err(check.invalid("session.start", "\"on_run\"", "\"at_once\" with a plant in lockstep", advice));
        }
        Ok(())
    }
}
