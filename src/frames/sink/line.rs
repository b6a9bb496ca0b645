//! The lines of sinks in the run summary as they end, and the frames that they lost.

use crate::report::SinkLine;
use crate::sink::{Sink, SinkSummary};

impl SinkLine {
    /// Returns the line of a sink that is alone.
    pub fn alone(sink: &dyn Sink, summary: Option<&SinkSummary>) -> Self {
        let mut line = Self { place: "sink".into(), kind: sink.name(), counts: sink.counts(), ..Self::default() };
        if let Some(summary) = summary {
            line.take_summary(summary);
        }
        line
    }

    pub(super) fn take_summary(&mut self, summary: &SinkSummary) {
        (self.frames, self.refused, self.bytes) = (summary.frames, summary.refused, summary.bytes);
        self.run_crc32 = Some(summary.run_crc32);
        self.output = summary.output.as_ref().map(|path| path.display().to_string());
    }
}

/// Returns the lines of a sink that has finished: its own when it is several, else one.
pub fn sink_lines(sink: &dyn Sink, summary: Option<&SinkSummary>) -> Vec<SinkLine> {
    let lines = sink.lines();
    if lines.is_empty() { vec![SinkLine::alone(sink, summary)] } else { lines }
}

/// A frame that a sink did not deliver, after `send` took it or instead of that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loss {
    /// Kind of the loss.
    pub kind: LossKind,
    /// Number of the frame to which it happened.
    pub frame: u32,
}

/// Kind of a lost frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LossKind {
    /// A sink was too slow for it, or is lost.
    Dropped,
    /// A sink failed on it.
    Refused,
    /// A sink gave it up after taking it: its receiver stopped or is gone, or the run ended.
    Cut,
    /// The telemetry of a tracker lost it, or a packet after it.
    TelemetryLost,
    /// A sink broke down on it; that the frame was dropped is a loss of its own.
    SinkLost,
}
