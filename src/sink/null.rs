//! The sink that keeps nothing: counts frames and sums up their pixels, to compare runs and to measure without a disk.

use crate::sink::crc32::{RunCrc32, pixel_crc32};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};

/// Counts and checksums.
#[derive(Debug, Default)]
pub struct NullSink {
    frames: u64,
    refused: u64,
    run_crc32: RunCrc32,
    finished: bool,
}

impl NullSink {
    /// A sink that has seen nothing.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

impl Sink for NullSink {
    fn name(&self) -> &'static str {
        "null"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        if self.finished {
            self.refused += 1;
            return Err(SinkError::Finished { sink: self.name(), frame: frame.meta.number });
        }
        self.run_crc32.add(frame.meta.number, pixel_crc32(&frame.image));
        self.frames += 1;
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.finished = true;
        Ok(SinkSummary {
            sink: self.name(),
            frames: self.frames,
            refused: self.refused,
            bytes: 0,
            run_crc32: self.run_crc32.value(),
            output: None,
        })
    }
}
