//! The instants of a run.

use base::time::Tai;

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
