//! The lines of sinks in the run summary as they end, and the frames that they lost.

use crate::report::SinkLine;
use crate::sink::crc32::{RunCrc32, pixel_crc32};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};

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

// The counts of every sink that keeps no files: frames taken and refused, the checksum of the run, whether it is over.

/// The counts of one sink.
#[derive(Debug, Default)]
pub(super) struct Tally {
    frames: u64,
    refused: u64,
    run_crc32: RunCrc32,
    finished: bool,
}

impl Tally {
    /// Refuses a frame after the end.
    pub(super) fn check(&mut self, sink: &'static str, frame: &SentFrame) -> Result<(), SinkError> {
        if self.finished {
            self.refuse();
            return Err(SinkError::Finished { sink, frame: frame.meta.number });
        }
        Ok(())
    }

    /// Counts a frame that was refused.
    pub(super) fn refuse(&mut self) {
        self.refused += 1;
    }

    /// Counts a frame that `sink` takes; after the end it is refused.
    pub(super) fn take(&mut self, sink: &'static str, frame: &SentFrame) -> Result<(), SinkError> {
        self.check(sink, frame)?;
        self.run_crc32.add(frame.meta.number, pixel_crc32(&frame.image));
        self.frames += 1;
        Ok(())
    }

    /// Ends the run, or answers again.
    pub(super) fn finish(&mut self, sink: &'static str) -> SinkSummary {
        self.finished = true;
        let (frames, refused, run_crc32) = (self.frames, self.refused, self.run_crc32.value());
        SinkSummary { sink, frames, refused, bytes: 0, run_crc32, output: None }
    }
}
