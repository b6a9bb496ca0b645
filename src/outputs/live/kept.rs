//! The last frames of a head that a page has asked for: pixels, stars and facts, for a look back.
//!
//! One owner, the view's thread; frames are copied when they are first asked for, never on the frame thread. Memory:
//! [`KEPT_BYTES`] of pixels for all heads together, [`KEPT_MAX`] frames of a head at most, [`KEPT_LEAST`] in any case;
//! the oldest frame's memory is used for the newest. Tests: below, and `http_tests`.

use crate::live::{frame::frame_of, latest::Picture, truth::truth_of};
use base::image::DnImage;
use frames::sink::Wcs;
use hyper::body::Bytes;
use serde_json::json;
use std::collections::VecDeque;

/// Bytes of pixels that the frames of all heads may take.
pub(super) const KEPT_BYTES: usize = 64 << 20;
/// Number of frames kept of one head, at most.
pub(super) const KEPT_MAX: usize = 32;
/// Number of frames kept of one head whatever their size.
const KEPT_LEAST: usize = 2;

/// A frame for a look back.
pub(super) struct KeptFrame {
    /// Frame number.
    pub(super) number: u32,
    /// Pixels, DN.
    pub(super) image: DnImage,
    /// Stars and facts, as JSON.
    pub(super) truth: Bytes,
    /// Map from pixels to the sky, where the frame has one.
    pub(super) wcs: Option<Wcs>,
}

/// The frames of one head, oldest first.
pub(super) struct Kept {
    frames: VecDeque<KeptFrame>,
    most: usize,
}

impl Kept {
    /// Returns an empty list for frames of this size, one of `heads` such lists.
    pub(super) fn of(size_px: [usize; 2], heads: usize) -> Self {
        let bytes = (size_px[0] * size_px[1] * size_of::<u16>()).max(1);
        let most = (KEPT_BYTES / heads.max(1) / bytes).clamp(KEPT_LEAST, KEPT_MAX);
        Self { frames: VecDeque::with_capacity(most), most }
    }

    /// Keeps a picture unless its frame is there already.
    pub(super) fn keep(&mut self, picture: &Picture) {
        let frame = &picture.frame;
        let number = frame.meta.number;
        if self.frames.back().is_some_and(|newest| newest.number == number) {
            return;
        }
        let is_full = self.frames.len() == self.most;
        let oldest = if is_full { self.frames.pop_front() } else { None };
        let mut image = oldest.map_or_else(|| DnImage::new(0, 0), |oldest| oldest.image);
        if [image.width(), image.height()] == [frame.image.width(), frame.image.height()] {
            image.pixels_mut().copy_from_slice(frame.image.pixels());
        } else {
            image.clone_from(&frame.image);
        }
        let mut truth = truth_of(frame);
        // The age is of the moment at which the frame came.
        truth["facts"] = json!(frame_of(picture, 0.0));
        truth["has_sky_map"] = json!(frame.meta.wcs.is_some());
        let truth = truth.to_string().into();
        self.frames.push_back(KeptFrame { number, image, truth, wcs: frame.meta.wcs.clone() });
    }

    /// Returns a frame by its number.
    pub(super) fn get(&self, number: u32) -> Option<&KeptFrame> {
        self.frames.iter().rev().find(|kept| kept.number == number)
    }

    /// Returns the numbers of the frames, oldest first.
    pub(super) fn numbers(&self) -> Vec<u32> {
        self.frames.iter().map(|kept| kept.number).collect()
    }

    /// Returns the number of frames kept at most.
    pub(super) fn most(&self) -> usize {
        self.most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::lateness::LatenessBins;
    use base::time::Tai;
    use frames::sink::sample::sample_frame;

    fn picture(number: u32) -> Picture {
        let (taken, lateness) = (Tai::from_ns(0), LatenessBins::reaching(1.0));
        Picture { frame: sample_frame(number), count: u64::from(number), taken, lateness }
    }

    #[test]
    fn memory_is_bounded_and_the_oldest_frames_go() {
        let mut kept = Kept::of([31, 17], 1);
        assert_eq!(kept.most(), KEPT_MAX);
        for number in 1..=40 {
            kept.keep(&picture(number));
            kept.keep(&picture(number));
        }
        assert_eq!(kept.numbers(), (9..=40).collect::<Vec<u32>>());
        assert!(kept.get(8).is_none() && kept.get(9).is_some_and(|frame| frame.number == 9));
        assert_eq!(kept.get(40).map(|frame| &frame.image), Some(&sample_frame(40).image));
        assert_ne!(kept.get(39).map(|frame| &frame.image), Some(&sample_frame(40).image), "each its own pixels");
    }

    #[test]
    fn large_frames_and_many_heads_keep_fewer() {
        let most = |side: usize, heads: usize| Kept::of([side; 2], heads).most();
        assert_eq!((most(1024, 1), most(2048, 1), most(2048, 4), most(16_384, 1)), (32, 8, 2, KEPT_LEAST));
        assert_eq!(most(0, 0), KEPT_MAX, "a size of zero is allowed");
    }
}
