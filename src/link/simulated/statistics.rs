//! Statistics of the wire so far.

use base::time::{Span, Tai};

/// Traffic of one bus since it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusStatistics {
    /// When the bus was made.
    pub since: Tai,
    /// When this was asked.
    pub until: Tai,
    /// Time for which the wire was not idle, interframe spaces included; of serial lines the sum of both directions.
    pub busy: Span,
    /// Frames that went through, those of a babbling node included.
    pub frames: u64,
    /// Frames of a babbling node.
    pub babbled: u64,
    /// Frames destroyed by an error flag; those of ends are sent again.
    pub error_frames: u64,
    /// Ends attached now.
    pub ends: usize,
}

impl BusStatistics {
    /// Returns the share of the time for which the wire was not idle, 0 to 1.
    pub fn load(&self) -> f64 {
        share(self.busy, self.until - self.since)
    }

    /// Returns the same since `earlier`.
    pub fn load_since(&self, earlier: &Self) -> f64 {
        share(Span::from_ns(self.busy.ns() - earlier.busy.ns()), self.until - earlier.until)
    }
}

fn share(busy: Span, time: Span) -> f64 {
    if time.ns() > 0 { busy.ns() as f64 / time.ns() as f64 } else { 0.0 }
}
