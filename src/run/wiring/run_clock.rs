//! The two clocks that a run may have.
//!
//! The instants of a run.
//!
//! Starts the clock of a run.
//!
//! `timing.start_utc = "now"` is the machine's own time. The instants of a run are planned before its parts are made,
//! which takes a while: on the real clock the plan leaves `SET_UP` for it, and the bench's clock then starts when the
//! machine's clock has come to the planned instant. A longer set-up leaves a lag, which the run reports. Tests: below.

use base::clock::{Clock, Monotonic, Virtual};
use base::time::{Span, Tai};
use config::StartTime;
use std::sync::Arc;

/// Clock of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RunClockKind {
    /// The bench clock.
    #[default]
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

/// The instants of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunTimes {
    /// Start of the clock, and of the bus.
    pub start: Tai,
    /// First exposure of the first head: time zero of events.
    pub zero: Tai,
    /// End of the last frame's period.
    pub end: Tai,
}

/// Time to make the parts of a run.
const SET_UP: Span = Span::from_ms(1000);
/// Smallest lag that is reported.
const NOTED_LAG: Span = Span::from_ms(1);

/// Returns the planned start of a run's clock.
pub(super) fn planned_start(start: StartTime, clock: RunClockKind) -> Tai {
    match (start, clock) {
        (StartTime::At(at), _) => at,
        (StartTime::Now | StartTime::Plant, RunClockKind::Virtual) => Monotonic::start().now(),
        (StartTime::Now | StartTime::Plant, RunClockKind::Real) => Monotonic::start().now() + SET_UP,
    }
}

/// Starts the bench's clock at the planned instant; with "now" it waits for the machine's clock. Returns the delay of
/// the bench's clock behind the machine's at that moment.
pub(super) fn start_clock(clock: &Monotonic, start: StartTime, planned: Tai) -> Span {
    let machine = Monotonic::start();
    if start == StartTime::Now {
        machine.sleep_until(planned);
    }
    let late = match start {
        StartTime::Now => machine.now() - planned,
        StartTime::At(_) | StartTime::Plant => Span::ZERO,
    };
    let lag = if late > NOTED_LAG { late } else { Span::ZERO };
    clock.restart_at(if lag > Span::ZERO { planned } else { planned + late });
    lag
}

/// Returns the note about a lag.
pub(super) fn note_lag(lag: Span) -> Option<String> {
    let said = || {
        format!(
            "timing.start_utc = \"now\": the bench's clock is {:.0} ms behind the machine's, because making the run took longer \
             than {} s or the machine was busy",
            lag.s() * 1e3,
            SET_UP.s()
        )
    };
    (lag > Span::ZERO).then(said)
}

#[cfg(test)]
mod start_tests {
    use super::*;

    /// Returns true when a span is short enough to be a scheduling delay of the machine.
    fn is_small(span: Span) -> bool {
        span.ns().abs() < 5_000_000
    }

    /// Returns the bench's time minus the machine's: the smallest of some readings, because the test may be interrupted
    /// between the two clocks.
    fn offset(clock: &Monotonic) -> Span {
        let readings = (0..20).map(|_| clock.now() - Monotonic::start().now());
        readings.min_by_key(|reading| reading.ns().abs()).unwrap()
    }

    #[test]
    fn now_is_the_machines_time_when_the_clock_starts_and_a_later_start_is_a_lag_that_is_said() {
        // A busy machine may wake the start too late, which is a lag, but not every time.
        let is_now = || {
            let planned = planned_start(StartTime::Now, RunClockKind::Real);
            let clock = Monotonic::start_at(planned);
            assert!(offset(&clock) > Span::from_ms(500), "control: before the start it is ahead");
            let lag = start_clock(&clock, StartTime::Now, planned);
            assert!(is_small(offset(&clock) + lag), "{:?} and {lag:?}", offset(&clock));
            lag == Span::ZERO
        };
        assert!((0..20).any(|_| is_now()), "the clock is the machine's");

        let planned = Monotonic::start().now() - Span::from_ms(200);
        let clock = Monotonic::start();
        let lag = start_clock(&clock, StartTime::Now, planned);
        assert!(lag >= Span::from_ms(200), "{lag:?}");
        assert!(is_small(offset(&clock) + lag), "behind by the lag");
        assert!(note_lag(lag).is_some_and(|text| text.contains("ms behind")) && note_lag(Span::ZERO).is_none());
    }

    #[test]
    fn a_date_is_taken_as_it_is() {
        let at = Tai::from_ns(1_772_366_400_000_000_000);
        assert_eq!(planned_start(StartTime::At(at), RunClockKind::Real), at);
        let clock = Monotonic::start();
        assert_eq!(start_clock(&clock, StartTime::At(at), at), Span::ZERO);
        assert!(is_small(clock.now() - at));
    }
}
