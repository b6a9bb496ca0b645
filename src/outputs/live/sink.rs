//! The sink that shows: keeps a copy of the newest frame for the page.
//!
//! In: frames, in a sink's thread. Out: the newest picture, and lateness counted over all frames. `send` copies the
//! frame into a buffer that is there already (a frame of another size takes a new one, once) and waits for no client.
//! Tests: the compliance suite of sinks, and below.

use crate::live::{kept::Writer, lateness::LatenessBins};
use base::clock::Clock;
use frames::sink::{NullSink, SentFrame, Sink, SinkError, SinkSummary};
use std::sync::Arc;

/// The live view as a sink.
pub struct LiveSink {
    writer: Writer,
    clock: Arc<dyn Clock>,
    /// Counts and checksums.
    tally: NullSink,
    /// Pictures published.
    published: u64,
    lateness: LatenessBins,
}

impl LiveSink {
    pub(super) fn new(mut writer: Writer, clock: Arc<dyn Clock>) -> Self {
        let lateness = writer.buffer().lateness;
        Self { writer, clock, tally: NullSink::new(), published: 0, lateness }
    }

    fn show(&mut self, frame: &SentFrame) {
        self.lateness.record(frame.meta.lateness);
        self.published += 1;
        let picture = self.writer.buffer();
        copy_frame(frame, &mut picture.frame);
        (picture.count, picture.taken) = (self.published, self.clock.now());
        picture.lateness = self.lateness;
        self.writer.publish();
    }
}

/// Copies a frame into another's buffers.
fn copy_frame(from: &SentFrame, to: &mut SentFrame) {
    let size = |frame: &SentFrame| [frame.image.width(), frame.image.height()];
    if size(from) == size(to) {
        to.image.pixels_mut().copy_from_slice(from.image.pixels());
    } else {
        to.image.clone_from(&from.image);
    }
    to.truth.clone_from(&from.truth);
    to.meta.clone_from(&from.meta);
}

impl Sink for LiveSink {
    fn name(&self) -> &'static str {
        "live"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let refused = |_| SinkError::Finished { sink: "live", frame: frame.meta.number };
        self.tally.send(frame).map_err(refused)?;
        self.show(frame);
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.writer.publish_end();
        Ok(SinkSummary { sink: self.name(), ..self.tally.finish()? })
    }
}

impl Drop for LiveSink {
    fn drop(&mut self) {
        self.writer.publish_end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::kept::{Picture, Reader, latest};
    use base::{clock::Virtual, time::Tai};
    use frames::sink::{compliance::check_sink, sample::sample_frame};

    fn view(size_px: [usize; 2]) -> (LiveSink, Reader) {
        let frame = SentFrame::with_capacity(size_px[0], size_px[1], 4, "camera".into());
        let lateness = LatenessBins::reaching(0.1);
        let at = Tai::from_ns(5);
        let (writer, reader) = latest(Picture { frame, count: 0, taken: at, lateness });
        (LiveSink::new(writer, Arc::new(Virtual::new(at))), reader)
    }

    #[test]
    fn the_live_sink_complies() {
        check_sink(|| Box::new(view([31, 17]).0)).unwrap();
    }

    #[test]
    fn the_newest_frame_is_shown_whole_also_when_it_has_another_size() {
        for size_px in [[31, 17], [8, 8]] {
            let (mut sink, mut reader) = view(size_px);
            (1..=5).for_each(|number| sink.send(&sample_frame(number)).unwrap());
            let picture = reader.newest();
            assert_eq!((&picture.frame, picture.count), (&sample_frame(5), 5));
            assert_ne!(picture.frame, sample_frame(4), "the comparison can fail");
            assert_eq!(picture.lateness.total(), 5);
            assert!(!reader.is_over());
        }
    }

    #[test]
    fn the_end_is_reported_and_the_last_frame_stays() {
        for is_finished in [true, false] {
            let (mut sink, mut reader) = view([31, 17]);
            (1..=2).for_each(|number| sink.send(&sample_frame(number)).unwrap());
            if is_finished {
                sink.finish().unwrap();
            }
            drop(sink);
            assert!(reader.is_over(), "{is_finished}");
            let picture = reader.newest();
            assert_eq!((picture.frame.meta.number, picture.count), (2, 2));
        }
    }
}
