//! Two sinks at once: the first keeps the record, the second gets the same frames.

use crate::sink::line::Tally;
use crate::sink::{Loss, SentFrame, Sink, SinkError, SinkLine, SinkSummary};

/// Sends every frame to both.
pub struct Tee {
    first: Box<dyn Sink>,
    second: Box<dyn Sink>,
}

impl Tee {
    /// Joins two sinks; name and summary are the first one's.
    pub fn new(first: Box<dyn Sink>, second: Box<dyn Sink>) -> Self {
        Self { first, second }
    }
}

impl Sink for Tee {
    fn name(&self) -> &'static str {
        self.first.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let second = self.second.send(frame);
        self.first.send(frame).and(second)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let second = self.second.finish();
        let first = self.first.finish()?;
        second.map(|_| first)
    }

    /// Returns the counts of the first sink.
    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.first.counts()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.first.take_losses(announce);
        self.second.take_losses(announce);
    }

    /// Returns the lines of the first sink, as the summary does.
    fn lines(&self) -> Vec<SinkLine> {
        self.first.lines()
    }
}

// The sink that keeps nothing: counts frames and sums up their pixels, to compare runs and to measure without a disk.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::{NullSink, tap};
    use crate::sink::{compliance::check_sink, sample::sample_frame};

    #[test]
    fn the_tee_complies() {
        check_sink(|| Box::new(Tee::new(Box::new(NullSink::new()), Box::new(NullSink::new())))).unwrap();
    }

    #[test]
    fn both_get_the_frame() {
        let (sender, end) = tap([31, 17], 1);
        let mut tee = Tee::new(Box::new(NullSink::new()), Box::new(sender));
        tee.send(&sample_frame(3)).unwrap();
        assert_eq!(end.take().map(|frame| frame.number), Some(3));
        assert_eq!(tee.finish().unwrap().frames, 1);
    }
}
