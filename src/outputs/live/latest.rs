//! The newest picture, between a thread that writes and a thread that looks.
//!
//! Three buffers change places: the writer's, the one between them, the reader's. The lock is held for the exchange of
//! two pointers, so neither waits for the other's copying or encoding. An unread picture is replaced. Test: below.

use crate::live::lateness::LatenessBins;
use base::time::Tai;
use frames::sink::SentFrame;
use std::sync::{Arc, Mutex, PoisonError};

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
