//! The sink that hands pixels to another part of the program: a tracker that sees what a cable would carry.
//!
//! Input: frames. Output: the number and the pixels of each and what a camera says of its exposure, nothing of its
//! truth, through a bounded queue whose buffers go round. When the other end is too slow the new frame is lost and
//! counted, and the sender never waits.

use crate::sink::line::Tally;
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary};
use base::{image::DnImage, region::Regions};
use crossbeam_channel::{Receiver, Sender, bounded};

/// A frame that comes out of a tap.
#[derive(Debug, Clone, PartialEq)]
pub struct TappedFrame {
    /// Frame number.
    pub number: u32,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Parts of the image that were read out.
    pub regions: Regions,
    /// Pixels.
    pub image: DnImage,
}

/// The sending end.
#[derive(Debug)]
pub struct Tap {
    full: Sender<TappedFrame>,
    empty: Receiver<TappedFrame>,
    tally: Tally,
    lost: u64,
}

/// The receiving end.
#[derive(Debug)]
pub struct TapEnd {
    full: Receiver<TappedFrame>,
    empty: Sender<TappedFrame>,
}

/// Returns a tap that holds `space` frames of `size_px` (columns, rows), and its other end.
pub fn tap(size_px: [usize; 2], space: usize) -> (Tap, TapEnd) {
    let (full, to_take) = bounded(space);
    let (given_back, empty) = bounded(space);
    for _ in 0..space {
        let buffer = TappedFrame {
            number: 0,
            exposure_s: 0.0,
            regions: Regions::WHOLE,
            image: DnImage::new(size_px[0], size_px[1]),
        };
        let _ = given_back.try_send(buffer); // the queue has space for all buffers
    }
    let tap = Tap { full, empty, tally: Tally::default(), lost: 0 };
    (tap, TapEnd { full: to_take, empty: given_back })
}

impl Tap {
    /// Returns frames that the other end was too slow to take.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

impl TapEnd {
    /// Returns the oldest frame not yet taken; give it back with [`Self::give_back`].
    pub fn take(&self) -> Option<TappedFrame> {
        self.full.try_recv().ok()
    }

    /// Returns a frame's buffer.
    pub fn give_back(&self, frame: TappedFrame) {
        let _ = self.empty.try_send(frame); // the queue has space for all buffers
    }
}

impl Sink for Tap {
    fn name(&self) -> &'static str {
        "tap"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.tally.take(self.name(), frame)?;
        let Ok(mut buffer) = self.empty.try_recv() else {
            self.lost += 1;
            return Ok(());
        };
        buffer.number = frame.meta.number;
        (buffer.exposure_s, buffer.regions) = (frame.meta.exposure_s, frame.meta.regions);
        if buffer.image.pixels().len() == frame.image.pixels().len() {
            buffer.image.pixels_mut().copy_from_slice(frame.image.pixels());
        } else {
            buffer.image.clone_from(&frame.image);
        }
        let _ = self.full.try_send(buffer); // the other end may be gone
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        Ok(self.tally.finish(self.name()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::{compliance::check_sink, sample::sample_frame};

    #[test]
    fn the_tap_complies() {
        check_sink(|| Box::new(tap([31, 17], 2).0)).unwrap();
    }

    #[test]
    fn frames_arrive_in_order_with_their_pixels_and_buffers_go_round() {
        let (mut sender, end) = tap([31, 17], 1);
        for number in 0..5 {
            let frame = sample_frame(number);
            sender.send(&frame).unwrap();
            let taken = end.take().expect("one frame");
            assert_eq!((taken.number, taken.image.pixels()), (number, frame.image.pixels()));
            end.give_back(taken);
        }
        assert_eq!(sender.lost(), 0);
        assert!(end.take().is_none());
    }

    #[test]
    fn a_slow_end_loses_new_frames_and_they_are_counted() {
        let (mut sender, end) = tap([31, 17], 2);
        (0..5).for_each(|number| sender.send(&sample_frame(number)).unwrap());
        assert_eq!(sender.lost(), 3);
        assert_eq!(end.take().map(|frame| frame.number), Some(0), "the oldest is kept");
    }
}
