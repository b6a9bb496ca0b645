//! The counts of every sink that keeps no files: frames taken and refused, the checksum of the run, whether it is over.

use crate::sink::crc32::{RunCrc32, pixel_crc32};
use crate::sink::{SentFrame, SinkError, SinkSummary};

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
