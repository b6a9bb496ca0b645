//! The state that the sink, the presenter and the event loop share without a lock.

use crate::display::counters::{Counters, count};
use crate::display::error::DisplayError;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::OnceLock;

/// Shared by the three threads of one display.
#[derive(Debug, Default)]
pub(super) struct State {
    pub(super) counters: Counters,
    /// Whether the run is over: frames on their way are shown, then the display ends.
    is_over: AtomicBool,
    /// The monitor is unplugged.
    is_away: AtomicBool,
    /// Why nothing is shown any more.
    end: OnceLock<DisplayError>,
    /// Columns and rows of the window: `columns << 32 | rows`.
    window_px: AtomicU64,
}

impl State {
    /// Ends the run.
    pub(super) fn finish(&self) {
        self.is_over.store(true, Ordering::Release);
    }

    /// Returns whether the run is over.
    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    /// Ends the display: nothing is shown from now on; the first reason counts.
    pub(super) fn end(&self, why: DisplayError) {
        let _ = self.end.set(why); // a later reason does not replace the first
    }

    /// Returns why nothing is shown any more, if so.
    pub(super) fn ended(&self) -> Option<&DisplayError> {
        self.end.get()
    }

    /// Returns whether the monitor is away.
    pub(super) fn is_away(&self) -> bool {
        self.is_away.load(Ordering::Acquire)
    }

    /// Records whether the monitor is present; returns true for a change, which is counted.
    pub(super) fn monitor_is_there(&self, is_there: bool) -> bool {
        let was_away = self.is_away.swap(!is_there, Ordering::AcqRel);
        let is_news = was_away == is_there;
        if is_news {
            count(if is_there { &self.counters.monitor_regained } else { &self.counters.monitor_lost });
        }
        is_news
    }

    /// Records the size of the window.
    pub(super) fn set_window_px(&self, [columns, rows]: [u32; 2]) {
        self.window_px.store(u64::from(columns) << 32 | u64::from(rows), Ordering::Release);
    }

    /// Returns columns and rows of the window.
    pub(super) fn window_px(&self) -> [u32; 2] {
        let packed = self.window_px.load(Ordering::Acquire);
        #[allow(clippy::cast_possible_truncation, reason = "the two halves of what was packed")]
        let size = [(packed >> 32) as u32, packed as u32];
        size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comings_and_goings_are_counted_once() {
        let state = State::default();
        let news: Vec<bool> = [true, false, false, true, true].map(|there| state.monitor_is_there(there)).into();
        assert_eq!(news, [false, true, false, true, false]);
        let counts = state.counters.read();
        assert_eq!((counts.monitor_lost, counts.monitor_regained, state.is_away()), (1, 1, false));
    }

    #[test]
    fn sizes_and_reasons_come_back() {
        let state = State::default();
        state.set_window_px([1920, 1080]);
        assert_eq!(state.window_px(), [1920, 1080]);
        state.end(DisplayError::Driver("first".into()));
        state.end(DisplayError::Driver("second".into()));
        assert_eq!(state.ended(), Some(&DisplayError::Driver("first".into())));
    }
}
