//! The sink that keeps nothing: counts frames and sums up their pixels, to compare runs and to measure without a disk.

use crate::sink::tally::Tally;
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};

/// Counts and checksums.
#[derive(Debug, Default)]
pub struct NullSink {
    tally: Tally,
}

impl NullSink {
    /// Returns a sink that has seen nothing.
    pub fn new() -> Self {
        Self::default()
    }
}

impl Sink for NullSink {
    fn name(&self) -> &'static str {
        "null"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.tally.take(self.name(), frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        Ok(self.tally.finish(self.name()))
    }
}
