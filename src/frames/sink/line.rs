//! The result of one sink among several: a line of the run summary.
//!
//! Every frame that was given to the sinks is counted in each line once: taken, refused or dropped.

use crate::sink::{Sink, SinkSummary};
use base::time::Span;

/// One sink of a run that is over.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SinkLine {
    /// Place in the bench that names it: `sink`, `extra_sink[0]`, ...
    pub place: String,
    /// The sink's name.
    pub kind: &'static str,
    /// Frames it took.
    pub frames: u64,
    /// Frames it got no chance to take: it was too slow, or its thread was lost.
    pub dropped: u64,
    /// Frames it failed on.
    pub refused: u64,
    /// Bytes it brought out.
    pub bytes: u64,
    /// CRC-32 over the frames it took; `None` when it could not finish.
    pub run_crc32: Option<u32>,
    /// Folder, file or address of the frames.
    pub output: Option<String>,
    /// Its first failure in words; of a frame, or of its end.
    pub first_error: Option<String>,
    /// True when it broke down (a panic) or was given up because it blocked, and took nothing from then on.
    pub is_lost: bool,
    /// Handed to the sinks to taken by this one, wall time, mean; zero when nothing waits between the two.
    pub mean_delay: Span,
    /// The longest of these.
    pub longest_delay: Span,
    /// Numbers of its own ([`Sink::counts`]).
    pub counts: Vec<(&'static str, u64)>,
}

impl SinkLine {
    /// Returns the line of a sink that is alone.
    pub fn alone(sink: &dyn Sink, summary: Option<&SinkSummary>) -> Self {
        let mut line = Self { place: "sink".into(), kind: sink.name(), counts: sink.counts(), ..Self::default() };
        if let Some(summary) = summary {
            line.take_summary(summary);
        }
        line
    }

    /// Returns true if a frame was refused, or the sink failed in another way: a drop alone does not count.
    pub fn has_failed(&self) -> bool {
        self.first_error.is_some() || self.is_lost || self.refused > 0
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
