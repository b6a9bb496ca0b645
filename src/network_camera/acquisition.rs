//! Which of the bench's frames a client gets: all, one, some, or the next after each trigger.
//!
//! The bench exposes on its own schedule; a trigger chooses, it does not start an exposure: the next frame that is handed
//! over after the trigger is sent. [`Wanted`] is the count of frames still to be taken, shared between the control side,
//! which adds to it, and the sink, which takes from it without waiting.

use core::sync::atomic::{AtomicU64, Ordering};

/// Every frame until the acquisition stops.
const ALL: u64 = u64::MAX;

/// Frames still wanted.
#[derive(Debug, Default)]
pub struct Wanted {
    left: AtomicU64,
}

impl Wanted {
    /// Takes one when any is wanted.
    pub fn take(&self) -> bool {
        let fewer = |left| match left {
            0 => None,
            ALL => Some(ALL),
            left => Some(left - 1),
        };
        self.left.fetch_update(Ordering::AcqRel, Ordering::Acquire, fewer).is_ok()
    }

    /// True when a frame would be taken now.
    #[must_use]
    pub fn any(&self) -> bool {
        self.left.load(Ordering::Acquire) > 0
    }

    fn set(&self, frames: u64) {
        self.left.store(frames, Ordering::Release);
    }

    fn add_one(&self) {
        let more = |left: u64| Some(if left == ALL { ALL } else { left + 1 });
        let _never_refused = self.left.fetch_update(Ordering::AcqRel, Ordering::Acquire, more);
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
    triggers_left: Option<u64>,
}

impl Acquisition {
    /// Begins; with `is_triggered` each frame waits for a trigger.
    pub(super) fn start(&mut self, mode: Mode, is_triggered: bool, wanted: &Wanted) {
        let frames = match mode {
            Mode::Continuous => ALL,
            Mode::SingleFrame => 1,
            Mode::MultiFrame(frames) => u64::from(frames),
        };
        let triggers_left = if frames == ALL { None } else { Some(frames) };
        *self = Self { is_started: true, triggers_left: if is_triggered { triggers_left } else { Some(0) } };
        wanted.set(if is_triggered { 0 } else { frames });
    }

    /// Ends; what was wanted is no more.
    pub(super) fn stop(&mut self, wanted: &Wanted) {
        *self = Self::default();
        wanted.set(0);
    }

    /// True from the start to the stop, or to the last frame of a limited acquisition.
    pub(super) fn is_running(&self, wanted: &Wanted) -> bool {
        self.is_started && (self.triggers_left != Some(0) || wanted.any())
    }

    /// True from the start to the stop.
    pub(super) fn is_started(&self) -> bool {
        self.is_started
    }

    /// A trigger; false when it is not heeded.
    pub(super) fn trigger(&mut self, wanted: &Wanted) -> bool {
        let is_heeded = self.is_started && self.triggers_left != Some(0);
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
        (0..10).filter(|_| wanted.take()).count()
    }

    #[test]
    fn frames_are_counted_as_the_mode_says() {
        for (mode, frames, is_running_after) in
            [(Mode::Continuous, 10, true), (Mode::SingleFrame, 1, false), (Mode::MultiFrame(3), 3, false)]
        {
            let (mut acquisition, wanted) = (Acquisition::default(), Wanted::default());
            assert_eq!(taken(&wanted), 0, "nothing before the start");
            acquisition.start(mode, false, &wanted);
            assert!(acquisition.is_running(&wanted) && !acquisition.trigger(&wanted));
            assert_eq!((taken(&wanted), acquisition.is_running(&wanted)), (frames, is_running_after), "{mode:?}");
            acquisition.stop(&wanted);
            assert!(taken(&wanted) == 0 && !acquisition.is_running(&wanted));
        }
    }

    #[test]
    fn each_trigger_gives_one_frame_up_to_the_mode() {
        for (mode, frames) in [(Mode::Continuous, 5), (Mode::SingleFrame, 1), (Mode::MultiFrame(3), 3)] {
            let (mut acquisition, wanted) = (Acquisition::default(), Wanted::default());
            assert!(!acquisition.trigger(&wanted), "before the start");
            acquisition.start(mode, true, &wanted);
            assert_eq!(taken(&wanted), 0, "before the trigger");
            let heeded = (0..5).filter(|_| acquisition.trigger(&wanted)).count();
            assert_eq!((heeded, taken(&wanted)), (frames, frames), "{mode:?}");
            assert_eq!(acquisition.is_running(&wanted), mode == Mode::Continuous);
        }
    }
}
