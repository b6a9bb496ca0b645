//! Outcomes of frames and refreshes, counted without a lock: written by the presenter and the event loop, read by any
//! thread.

use core::fmt;
use core::sync::atomic::{AtomicU64, Ordering};

/// Counts at one instant. Each is read by itself: sums may differ by one while frames are on their way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts<N = u64> {
    /// New frames handed to the graphics driver.
    pub presented: N,
    /// Refreshes that showed the frame before once more, because no new one was available.
    pub repeated: N,
    /// Frames that a newer one replaced before they were shown.
    pub replaced: N,
    /// Refreshes that came more than one and a half refresh times after the one before: one or more were missed.
    pub late: N,
    /// Frames that were not shown as the monitor was away or the window closed.
    pub unseen: N,
    /// Times the surface was lost and made again.
    pub lost_surface: N,
    /// Times the surface was configured again, because the window changed its size or the driver asked for it.
    pub reconfigured: N,
    /// Times the monitor went away.
    pub monitor_lost: N,
    /// Times it came back.
    pub monitor_regained: N,
    /// Submit times that were not read in time.
    pub submits_lost: N,
    /// Pixels of presented frames that wanted more light than the display has there, and show its most.
    pub clipped_px: N,
}

impl fmt::Display for Counts {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "frames shown: {}", self.presented)?;
        let others = [
            (self.repeated, "refreshes repeated a frame"),
            (self.replaced, "frames were replaced before they were shown"),
            (self.late, "refreshes came late"),
            (self.unseen, "frames were not seen"),
            (self.lost_surface, "times the surface was lost"),
            (self.reconfigured, "times the surface was configured again"),
            (self.monitor_lost, "times the monitor went away"),
            (self.monitor_regained, "times the monitor came back"),
            (self.submits_lost, "submit times were not read"),
            (self.clipped_px, "pixels wanted more light than the display has"),
        ];
        others.iter().filter(|(count, _)| *count > 0).try_for_each(|(count, words)| write!(out, "; {count} {words}"))
    }
}

/// The same, shared.
pub(super) type Counters = Counts<AtomicU64>;

/// Adds one to a counter.
pub(super) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::Relaxed);
}

impl Counters {
    /// Returns the counts at this instant.
    pub(super) fn read(&self) -> Counts {
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Counts {
            presented: of(&self.presented),
            repeated: of(&self.repeated),
            replaced: of(&self.replaced),
            late: of(&self.late),
            unseen: of(&self.unseen),
            lost_surface: of(&self.lost_surface),
            reconfigured: of(&self.reconfigured),
            monitor_lost: of(&self.monitor_lost),
            monitor_regained: of(&self.monitor_regained),
            submits_lost: of(&self.submits_lost),
            clipped_px: of(&self.clipped_px),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_printed_in_words_and_those_of_nothing_are_left_out() {
        let counts = Counts { presented: 3, late: 2, ..Counts::default() };
        assert_eq!(counts.to_string(), "frames shown: 3; 2 refreshes came late");
        assert_eq!(Counts::default().to_string(), "frames shown: 0");
    }
}
