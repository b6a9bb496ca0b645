//! Which of the bench's frames a client gets: all, each n-th, one, some, or the next after each trigger.
//!
//! The bench exposes on its own schedule; a trigger chooses, it does not start an exposure: the next frame that is
//! handed over after the trigger is sent. A lower frame rate chooses too: each n-th frame, from the first of the
//! acquisition on. [`Wanted`] is the count of frames still to be taken, shared between the control side, which adds to
//! it, and the sink, which takes from it without waiting.

use base::time::Tai;
use core::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering};

/// Every frame until the acquisition stops.
const ALL: u32 = u32::MAX;

/// Frames still wanted, and the acquisition that wants them. Both are one word: a frame is taken for the acquisition
/// that counts it, also when another one begins at that moment.
#[derive(Debug, Default)]
pub struct Wanted {
    acquisition_and_left: AtomicU64,
    /// One frame in so many; 0 is as 1.
    one_in: AtomicU32,
    /// TAI, ns: exposures that start before it belong to no acquisition.
    from_ns: AtomicI64,
}

impl Wanted {
    /// Takes one when any is wanted; the acquisition that it is for.
    pub fn take(&self) -> Option<u32> {
        let fewer = |word| match left(word) {
            0 => None,
            ALL => Some(word),
            _ => Some(word - 1),
        };
        let before = self.acquisition_and_left.fetch_update(Ordering::AcqRel, Ordering::Acquire, fewer);
        before.ok().map(acquisition)
    }

    /// Returns the acquisition for which a frame would be taken now.
    pub fn by(&self) -> Option<u32> {
        let word = self.acquisition_and_left.load(Ordering::Acquire);
        (left(word) > 0).then_some(acquisition(word))
    }

    /// Wants so many frames for an acquisition, and none for the one before.
    pub(super) fn begin(&self, acquisition: u32, frames: u32) {
        self.acquisition_and_left.store(u64::from(acquisition) << 32 | u64::from(frames), Ordering::Release);
    }

    /// Begins as [`Self::begin`], with frames whose exposures start at this instant or later.
    pub(super) fn begin_from(&self, from: Tai, acquisition: u32, frames: u32) {
        self.from_ns.store(from.ns(), Ordering::Release);
        self.begin(acquisition, frames);
    }

    /// Returns true for an exposure that started before the acquisition.
    pub fn is_before(&self, exposure_start: Tai) -> bool {
        exposure_start.ns() < self.from_ns.load(Ordering::Acquire)
    }

    /// Wants nothing any more.
    pub(super) fn end(&self) {
        self.begin(0, 0);
    }

    fn add_one(&self) {
        let more = |word| Some(if left(word) >= ALL - 1 { word } else { word + 1 });
        // The closure always returns a value.
        let _ = self.acquisition_and_left.fetch_update(Ordering::AcqRel, Ordering::Acquire, more);
    }

    /// Gives the client one of so many frames of the bench.
    pub(super) fn choose_one_in(&self, frames: u32) {
        self.one_in.store(frames, Ordering::Release);
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the low half is what is asked for")]
fn left(word: u64) -> u32 {
    word as u32
}

#[allow(clippy::cast_possible_truncation, reason = "32 bits are left")]
fn acquisition(word: u64) -> u32 {
    (word >> 32) as u32
}

/// The sink's place between two frames of a client that wants each n-th.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turn {
    acquisition: u32,
    since_last: u32,
}

impl Turn {
    /// Returns whether this frame, which comes during an acquisition, is one that its rate chooses.
    pub(super) fn comes(&mut self, acquisition: u32, wanted: &Wanted) -> bool {
        if self.acquisition != acquisition {
            *self = Self { acquisition, since_last: 0 };
        }
        let comes = self.since_last == 0;
        self.since_last = (self.since_last + 1) % wanted.one_in.load(Ordering::Acquire).max(1);
        comes
    }
}

/// How many frames one acquisition has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Continuous,
    SingleFrame,
    MultiFrame(u32),
}

/// One acquisition, from its start to its stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Acquisition {
    is_started: bool,
    /// Triggers that would still be heeded; `None`: any number.
    triggers_left: Option<u32>,
}

impl Acquisition {
    /// Begins; with `is_triggered` each frame waits for a trigger. Returns the number of frames that are wanted at
    /// once.
    pub(super) fn start(&mut self, mode: Mode, is_triggered: bool) -> u32 {
        let frames = match mode {
            Mode::Continuous => ALL,
            Mode::SingleFrame => 1,
            Mode::MultiFrame(frames) => frames,
        };
        let triggers_left = if frames == ALL { None } else { Some(frames) };
        *self = Self { is_started: true, triggers_left: if is_triggered { triggers_left } else { Some(0) } };
        if is_triggered { 0 } else { frames }
    }

    /// Ends the acquisition.
    pub(super) fn stop(&mut self) {
        *self = Self::default();
    }

    /// Returns true from the start to the stop, or to the last frame of a limited acquisition.
    pub(super) fn is_running(&self, wanted: &Wanted) -> bool {
        self.is_started && (self.triggers_left != Some(0) || wanted.by().is_some())
    }

    /// Returns true from the start to the stop.
    pub(super) fn is_started(&self) -> bool {
        self.is_started
    }

    /// Returns true while triggers choose frames.
    pub(super) fn waits_for_trigger(&self) -> bool {
        self.is_started && self.triggers_left != Some(0)
    }

    /// Takes a trigger; returns false when it is ignored.
    pub(super) fn trigger(&mut self, wanted: &Wanted) -> bool {
        let is_heeded = self.waits_for_trigger();
        if is_heeded {
            self.triggers_left = self.triggers_left.map(|left| left - 1);
            wanted.add_one();
        }
        is_heeded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(wanted: &Wanted) -> usize {
        (0..10).filter(|_| wanted.take().is_some()).count()
    }

    #[test]
    fn frames_are_counted_as_the_mode_says() {
        for (mode, frames, is_running_after) in
            [(Mode::Continuous, 10, true), (Mode::SingleFrame, 1, false), (Mode::MultiFrame(3), 3, false)]
        {
            let (mut acquisition, wanted) = (Acquisition::default(), Wanted::default());
            assert_eq!(taken(&wanted), 0, "nothing before the start");
            wanted.begin(1, acquisition.start(mode, false));
            assert!(acquisition.is_running(&wanted) && !acquisition.trigger(&wanted));
            assert_eq!((taken(&wanted), acquisition.is_running(&wanted)), (frames, is_running_after), "{mode:?}");
            acquisition.stop();
            wanted.end();
            assert!(taken(&wanted) == 0 && !acquisition.is_running(&wanted));
        }
    }

    #[test]
    fn each_trigger_gives_one_frame_up_to_the_mode() {
        for (mode, frames) in [(Mode::Continuous, 5), (Mode::SingleFrame, 1), (Mode::MultiFrame(3), 3)] {
            let (mut acquisition, wanted) = (Acquisition::default(), Wanted::default());
            assert!(!acquisition.trigger(&wanted), "before the start");
            wanted.begin(1, acquisition.start(mode, true));
            assert_eq!(taken(&wanted), 0, "before the trigger");
            let heeded = (0..5).filter(|_| acquisition.trigger(&wanted)).count();
            assert_eq!((heeded, taken(&wanted)), (frames, frames), "{mode:?}");
            assert_eq!(acquisition.is_running(&wanted), mode == Mode::Continuous);
        }
    }

    #[test]
    fn a_frame_is_taken_for_the_acquisition_that_counts_it() {
        let wanted = Wanted::default();
        assert_eq!((wanted.by(), wanted.take()), (None, None));
        wanted.begin(7, 1);
        // A sink that looked during the one before takes for the present one.
        wanted.begin(8, 1);
        assert_eq!((wanted.by(), wanted.take(), wanted.take()), (Some(8), Some(8), None));
        wanted.begin(u32::MAX, ALL);
        assert_eq!((wanted.take(), wanted.take()), (Some(u32::MAX), Some(u32::MAX)), "without end");
        wanted.add_one();
        assert_eq!(wanted.by(), Some(u32::MAX), "more than all is all");
    }

    #[test]
    fn an_exposure_before_the_acquisition_is_not_of_it() {
        let (wanted, start) = (Wanted::default(), Tai::from_ns(5_000));
        wanted.begin_from(start, 1, ALL);
        assert!(wanted.is_before(Tai::from_ns(4_999)) && !wanted.is_before(start));
        wanted.begin_from(Tai::from_ns(i64::MIN), 2, ALL);
        assert!(!wanted.is_before(Tai::from_ns(-1)), "control: a camera that is not commanded");
    }

    #[test]
    fn each_nth_frame_comes_from_the_first_of_an_acquisition_on() {
        let (mut turn, wanted) = (Turn::default(), Wanted::default());
        let mut chosen =
            |acquisition, frames| (0..frames).filter(|_| turn.comes(acquisition, &wanted)).collect::<Vec<_>>();
        assert_eq!(chosen(1, 3), [0, 1, 2], "all of them as it is");
        wanted.choose_one_in(3);
        assert_eq!(chosen(2, 8), [0, 3, 6]);
        assert_eq!(chosen(3, 5), [0, 3], "the next one starts again");
        wanted.choose_one_in(1);
        assert_eq!(chosen(4, 3), [0, 1, 2]);
    }
}
