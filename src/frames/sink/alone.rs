//! One sink that is called directly, without a queue, and its line of the run summary.
//!
//! Input: frames. Output: the same frames in the sink. It adds what [`crate::sink::Fan`] keeps for several sinks: the
//! place in the bench and the first failure in words, so that a refused frame has a reason in the summary.

use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use crate::{report::SinkLine, sink::line::Loss};

/// A sink and its counts.
pub struct Alone {
    sink: Box<dyn Sink>,
    line: SinkLine,
}

impl Alone {
    /// Wraps a sink that the bench names at `place`.
    pub fn new(place: String, sink: Box<dyn Sink>) -> Self {
        let line = SinkLine { place, kind: sink.name(), ..SinkLine::default() };
        Self { sink, line }
    }

    fn keep_first<T>(&mut self, outcome: Result<T, SinkError>) -> Result<T, SinkError> {
        outcome.inspect_err(|error| {
            self.line.first_error.get_or_insert_with(|| error.to_string());
        })
    }
}

impl Sink for Alone {
    fn name(&self) -> &'static str {
        self.sink.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let sent = self.sink.send(frame);
        self.line.frames += u64::from(sent.is_ok());
        self.line.refused += u64::from(sent.is_err());
        self.keep_first(sent)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let finished = self.sink.finish();
        self.line.counts = self.sink.counts();
        if let Ok(summary) = &finished {
            self.line.take_summary(summary);
        }
        self.keep_first(finished)
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.sink.counts()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.sink.take_losses(announce);
    }

    fn lines(&self) -> Vec<SinkLine> {
        vec![self.line.clone()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::{NullSink, Recorder, RecorderOptions};
    use crate::sink::{compliance::check_sink, recorder::frame_path, sample::sample_frame};

    #[test]
    fn lone_sink_complies() {
        check_sink(|| Box::new(Alone::new("sink".into(), Box::new(NullSink::new())))).unwrap();
    }

    #[test]
    fn refused_frame_has_its_reason_in_the_line() {
        let directory = tempfile::tempdir().unwrap();
        let recorder = Recorder::create(directory.path(), RecorderOptions::default()).unwrap();
        let mut sink = Alone::new("sink".into(), Box::new(recorder));
        sink.send(&sample_frame(1)).unwrap();
        std::fs::create_dir(frame_path(directory.path(), 2, "fits")).unwrap();
        sink.send(&sample_frame(2)).unwrap_err();
        sink.finish().unwrap();
        let [line] = <[SinkLine; 1]>::try_from(sink.lines()).unwrap();
        assert_eq!((line.place.as_str(), line.kind, line.frames, line.refused), ("sink", "recorder", 1, 1));
        let why = line.first_error.expect("the reason of the refused frame");
        assert!(why.contains("frame_000002.fits"), "{why}");
    }
}
