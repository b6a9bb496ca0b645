//! Frames on their way from the sink to the stream: buffers made once that go round.

use crate::network_camera::test_pattern::TestPattern;
use base::drawn::PathOrigin;
use frames::sink::{FrameMeta, SentFrame};

/// One frame that waits to be sent.
#[derive(Debug)]
pub(super) struct Slot {
    /// The acquisition it was taken for.
    pub(super) acquisition: u32,
    pub(super) pixels: Vec<u16>,
    pub(super) meta: FrameMeta,
}

impl Slot {
    pub(super) fn with_capacity(pixels: usize) -> Self {
        Self { acquisition: 0, pixels: Vec::with_capacity(pixels), meta: FrameMeta::empty("".into()) }
    }

    /// Copies a frame; no allocation after the first of its size.
    pub(super) fn take_in(&mut self, frame: &SentFrame) {
        self.pixels.clear();
        self.pixels.extend_from_slice(frame.image.pixels());
        self.meta.clone_from(&frame.meta);
    }

    /// Replaces the image by a test pattern, and says so: the frame is not one of the sky.
    pub(super) fn show(&mut self, pattern: TestPattern, width_px: usize, dn_bits: u32) {
        pattern.draw(self.meta.number, width_px, dn_bits, &mut self.pixels);
        (self.meta.test_pattern, self.meta.origin) = (pattern.name(), PathOrigin::TestPattern);
    }
}
