//! The last frames of a head that a page has asked for: pixels, stars and facts, for a look back.
//!
//! One owner, the view's thread; frames are copied when they are first asked for, never on the frame thread. Memory:
//! [`KEPT_BYTES`] of pixels for all heads together, [`KEPT_MAX`] frames of a head at most, [`KEPT_LEAST`] in any case;
//! the oldest frame's memory is used for the newest. Tests: below, and `http_tests`.

use crate::live::{lateness::LatenessBins, truth::truth_of};
use base::{image::DnImage, time::Tai};
use frames::sink::facts::{FactSource, json_keys};
use frames::sink::{SentFrame, Wcs};
use hyper::body::Bytes;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

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

// The facts of one frame, as the state and a look back give them.

/// Returns the facts of a frame, and when it came.
pub(super) fn frame_of(picture: &Picture, age_s: f64) -> Map<String, Value> {
    let of_view =
        [("count", json!(picture.count)), ("taken_utc", json!(picture.taken.to_rfc3339())), ("age_s", json!(age_s))];
    let mut frame = json_keys(&FactSource::of_frame(&picture.frame, None), |row| row.live);
    frame.extend(of_view.map(|(key, value)| (key.to_owned(), value)));
    frame
}

// The newest picture, between a thread that writes and a thread that looks.
//
// Three buffers change places: the writer's, the one between them, the reader's. The lock is held for the exchange of
// two pointers, so neither waits for the other's copying or encoding. An unread picture is replaced. Test: below.

/// A frame and its data.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub(super) frame: SentFrame,
    /// Frames taken so far, this one included; 0: there is none yet.
    pub(super) count: u64,
    /// When it was taken, on the view's clock.
    pub(super) taken: Tai,
    /// Of all frames so far.
    pub(super) lateness: LatenessBins,
}

struct Between {
    picture: Box<Picture>,
    is_new: bool,
    /// The run is over: no picture comes any more.
    is_over: bool,
}

/// The writer's side.
pub(super) struct Writer {
    mine: Box<Picture>,
    between: Arc<Mutex<Between>>,
}

/// The reader's side.
pub(super) struct Reader {
    mine: Box<Picture>,
    between: Arc<Mutex<Between>>,
}

/// Returns two sides with a copy of `empty` each, and one between them.
pub(super) fn latest(empty: Picture) -> (Writer, Reader) {
    let between = Between { picture: Box::new(empty.clone()), is_new: false, is_over: false };
    let between = Arc::new(Mutex::new(between));
    let writer = Writer { mine: Box::new(empty.clone()), between: Arc::clone(&between) };
    (writer, Reader { mine: Box::new(empty), between })
}

impl Writer {
    /// Returns the writer's own buffer: an older picture, to be overwritten.
    pub(super) fn buffer(&mut self) -> &mut Picture {
        &mut self.mine
    }

    /// Publishes the buffer as the newest picture.
    pub(super) fn publish(&mut self) {
        let mut between = self.between.lock().unwrap_or_else(PoisonError::into_inner);
        core::mem::swap(&mut self.mine, &mut between.picture);
        between.is_new = true;
    }

    /// Publishes the end: nothing comes after the picture that was published last.
    pub(super) fn publish_end(&mut self) {
        self.between.lock().unwrap_or_else(PoisonError::into_inner).is_over = true;
    }
}

impl Reader {
    /// Returns the newest picture.
    pub(super) fn newest(&mut self) -> &Picture {
        let mut between = self.between.lock().unwrap_or_else(PoisonError::into_inner);
        if between.is_new {
            core::mem::swap(&mut self.mine, &mut between.picture);
            between.is_new = false;
        }
        drop(between);
        &self.mine
    }

    /// Returns true if no more pictures come.
    pub(super) fn is_over(&self) -> bool {
        self.between.lock().unwrap_or_else(PoisonError::into_inner).is_over
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

#[cfg(test)]
mod latest_tests {
    use super::*;

    fn sides() -> (Writer, Reader) {
        let frame = SentFrame::with_capacity(4, 3, 2, "c".into());
        let lateness = LatenessBins::reaching(1.0);
        latest(Picture { frame, count: 0, taken: Tai::from_ns(0), lateness })
    }

    fn write(writer: &mut Writer, count: u64) {
        writer.buffer().count = count;
        writer.buffer().frame.image.pixels_mut().fill(count as u16);
        writer.publish();
    }

    #[test]
    fn the_reader_has_the_newest_and_keeps_it_while_the_writer_goes_on() {
        let (mut writer, mut reader) = sides();
        assert_eq!(reader.newest().count, 0, "nothing yet");
        (1..=3).for_each(|count| write(&mut writer, count));
        assert_eq!(reader.newest().count, 3, "older ones were replaced");
        let held = reader.newest().frame.image.pixels().as_ptr();
        write(&mut writer, 4);
        assert_eq!(reader.mine.frame.image.pixels(), [3; 12], "not touched while the reader has it");
        assert_eq!(reader.newest().count, 4);
        assert_eq!(reader.newest().count, 4, "and stays when nothing new has come");
        write(&mut writer, 5);
        assert_eq!(writer.mine.frame.image.pixels().as_ptr(), held, "buffers go round");
    }

    #[test]
    fn no_picture_is_torn_between_two_threads() {
        let (mut writer, mut reader) = sides();
        let thread = std::thread::Builder::new().name("writer".into());
        let thread = thread.spawn(move || (1..=20_000).for_each(|count| write(&mut writer, count))).unwrap();
        let mut last = 0;
        while last < 20_000 {
            let picture = reader.newest();
            assert!(picture.count >= last, "never goes back");
            last = picture.count;
            assert!(picture.frame.image.pixels().iter().all(|dn| *dn == last as u16), "picture {last}");
        }
        thread.join().unwrap();
    }
}
