//! Frames for programs on the same machine through iceoryx2, with no copy on the reader's side.
//!
//! Input: frames. Output: samples of one publish-subscribe service: the pixels as a slice of `u16`, row by row, and
//! before them a [`SlotHead`] as the user header, the same that the ring of `shared_memory` has before its pixels.
//! A frame is copied once, into memory that was loaned from the service, and readers see it there.
//!
//! The writer never waits: a reader that is behind by more than `slots` frames loses the oldest, and sees it by
//! `serial`. A frame for which no memory is left, as readers keep all of it, is refused and counted.
//!
//! Limits: one size of frame; one publisher and at most [`READERS_MAX`] readers of a service; its name is free of the
//! file system. What a killed run has left is cleaned up by the next program that uses iceoryx2. Signals stay with the
//! run. Tests: below, and `hil_scripts/tests/test_recorders.py` with iceoryx2's own Python package in another process.

use crate::sink::line::Tally;
use crate::sink::shared_memory::{SlotHead, slot_head};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use base::refused::Refused;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{BackpressureStrategy, NodeBuilder, SignalHandlingMode, ipc_threadsafe};

/// Readers of one service at a time.
pub const READERS_MAX: usize = 16;

/// The writing end. The service goes with it, and with its last reader.
pub struct Iceoryx {
    service: String,
    size_px: [usize; 2],
    publisher: Publisher<ipc_threadsafe::Service, [u16], SlotHead>,
    serial: u64,
    bytes: u64,
    tally: Tally,
}

impl Iceoryx {
    /// Opens the service, or makes it, for frames of `size_px` (columns, rows); a reader may be `slots` frames behind.
    ///
    /// # Errors
    /// With what iceoryx2 says: another run publishes there, a reader made the service of another
    /// kind, or the memory is not there.
    pub fn create(service: String, size_px: [usize; 2], slots: u32) -> Result<Self, SinkError> {
        match publisher(&service, size_px, slots) {
            Ok(publisher) => Ok(Self { service, size_px, publisher, serial: 0, bytes: 0, tally: Tally::default() }),
            Err(why) => Err(refused(&service, &why)),
        }
    }

    fn publish(&mut self, frame: &SentFrame) -> Result<(), String> {
        let pixels = frame.image.pixels();
        let mut sample = self.publisher.loan_slice_uninit(pixels.len()).map_err(|why| why.to_string())?;
        self.serial += 1;
        *sample.user_header_mut() = SlotHead { serial: self.serial, ..slot_head(frame) };
        sample.write_from_slice(pixels).send().map_err(|why| why.to_string())?;
        Ok(())
    }
}

/// Returns the publisher of a service, or the reason why it cannot be made.
fn publisher(
    service: &str,
    size_px: [usize; 2],
    slots: u32,
) -> Result<Publisher<ipc_threadsafe::Service, [u16], SlotHead>, String> {
    let name = service.try_into().map_err(|why| format!("the name: {why}"))?;
    let node = NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled);
    let node = node.create::<ipc_threadsafe::Service>().map_err(|why| why.to_string())?;
    let service = node
        .service_builder(&name)
        .publish_subscribe::<[u16]>()
        .user_header::<SlotHead>()
        .max_publishers(1)
        .max_subscribers(READERS_MAX)
        .subscriber_max_buffer_size(slots.max(1) as usize)
        .enable_safe_overflow(true)
        .open_or_create()
        .map_err(|why| why.to_string())?;
    let publisher = service
        .publisher_builder()
        .initial_max_slice_len(size_px[0] * size_px[1])
        .backpressure_strategy(BackpressureStrategy::DiscardData);
    publisher.create().map_err(|why| why.to_string())
}

fn refused(service: &str, why: &str) -> SinkError {
    let wanted = "a service that no other run publishes, of frames of starloop, and memory for it";
    let advice = "try another name, or ending the readers of an earlier run";
    Refused(format!("iceoryx2 service \"{service}\": {why}; wanted {wanted}: {advice}")).into()
}

impl Sink for Iceoryx {
    fn name(&self) -> &'static str {
        "iceoryx2"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.tally.check(self.name(), frame)?;
        let got = [frame.image.width(), frame.image.height()];
        if got != self.size_px {
            self.tally.refuse();
            return Err(SinkError::FrameSize { path: self.service.clone().into(), wanted: self.size_px, got });
        }
        if let Err(why) = self.publish(frame) {
            self.tally.refuse();
            return Err(refused(&self.service, &why));
        }
        self.bytes += (size_of::<SlotHead>() + size_of_val(frame.image.pixels())) as u64;
        self.tally.take(self.name(), frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let summary = self.tally.finish(self.name());
        Ok(SinkSummary { bytes: self.bytes, output: Some(self.service.clone().into()), ..summary })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::{compliance::check_sink, sample::sample_frame};
    use iceoryx2::port::subscriber::Subscriber;

    /// Returns a name that no other test and no other run of the tests has.
    fn service(test: &str) -> String {
        format!("starloop test/{test}/{}", std::process::id())
    }

    /// Returns a reader with the objects that it needs to live.
    fn reader(service: &str) -> Subscriber<ipc_threadsafe::Service, [u16], SlotHead> {
        let node = NodeBuilder::new().create::<ipc_threadsafe::Service>().unwrap();
        let service = node.service_builder(&service.try_into().unwrap()).publish_subscribe::<[u16]>();
        let service = service.user_header::<SlotHead>().open().unwrap();
        service.subscriber_builder().create().unwrap()
    }

    #[test]
    fn iceoryx_complies() {
        check_sink(|| Box::new(Iceoryx::create(service("complies"), [31, 17], 2).unwrap())).unwrap();
    }

    #[test]
    fn a_reader_gets_frames_bit_by_bit_and_one_that_is_slow_the_newest() {
        let service = service("frames");
        let mut sink = Iceoryx::create(service.clone(), [31, 17], 3).unwrap();
        sink.send(&sample_frame(99)).unwrap();
        let reader = reader(&service);
        for n in 1..=8_u32 {
            sink.send(&sample_frame(100 + n)).unwrap();
        }
        let mut serials = Vec::new();
        while let Some(sample) = reader.receive().unwrap() {
            let head = *sample.user_header();
            let sent = sample_frame(head.frame);
            assert_eq!((sample.payload(), [head.width_px, head.height_px]), (sent.image.pixels(), [31, 17]));
            assert_ne!(sample.payload(), sample_frame(head.frame + 1).image.pixels(), "the comparison can fail");
            assert_eq!(head, SlotHead { serial: head.serial, ..slot_head(&sent) });
            serials.push(head.serial);
        }
        assert_eq!(serials, [7, 8, 9], "the last three of nine");
        assert_eq!(sink.finish().unwrap().frames, 9, "the writer never waited");
    }

    #[test]
    fn a_second_run_and_another_size_are_refused() {
        let service = service("refusals");
        let mut first = Iceoryx::create(service.clone(), [31, 18], 2).unwrap();
        let error = Iceoryx::create(service.clone(), [31, 18], 2).err().unwrap().to_string();
        assert!(error.contains(&service) && error.contains("Publishers"), "{error}");
        assert!(matches!(first.send(&sample_frame(1)), Err(SinkError::FrameSize { .. })));
        assert_eq!(first.finish().unwrap().refused, 1);
        drop(first);
        drop(Iceoryx::create(service, [31, 17], 2).unwrap());
    }
}
