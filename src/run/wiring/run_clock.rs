//! The two clocks that a run may have.

use base::clock::{Clock, Monotonic, Virtual};
use base::time::Tai;
use std::sync::Arc;

/// Clock of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunClockKind {
    /// The bench clock.
    Real,
    /// Simulated time: the run repeats bit for bit.
    Virtual,
}

/// The clock of a run, which its sinks also read.
#[derive(Debug, Clone)]
pub enum RunClock {
    /// The bench clock.
    Real(Arc<Monotonic>),
    /// Simulated time.
    Virtual(Arc<Virtual>),
}

impl RunClock {
    pub(super) fn new(kind: RunClockKind, start: Tai) -> Self {
        match kind {
            RunClockKind::Real => Self::Real(Arc::new(Monotonic::start_at(start))),
            RunClockKind::Virtual => Self::Virtual(Arc::new(Virtual::new(start))),
        }
    }

    /// Returns the clock for callers that only read it.
    pub fn shared(&self) -> Arc<dyn Clock> {
        match self {
            Self::Real(clock) => clock.clone(),
            Self::Virtual(clock) => clock.clone(),
        }
    }
}
