//! The instants between which a run goes on.

use base::time::Tai;

/// The instants of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunTimes {
    /// The clock starts, and with it the bus.
    pub start: Tai,
    /// First exposure of the first head: times of events count from here.
    pub zero: Tai,
    /// End of the last frame's period.
    pub end: Tai,
}
