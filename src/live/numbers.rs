//! The frame thread's end of the view: counts, handed over when there is room, else dropped.
//!
//! A queue of one: the frame thread never waits, and as all values are counts since the start, a dropped one costs nothing
//! but its age.

use crate::report::RunNumbers;
use crossbeam_channel::{Receiver, Sender, bounded};

/// Where the numbers of a run are told.
#[derive(Debug, Clone)]
pub struct Numbers {
    to_view: Sender<RunNumbers>,
}

impl Numbers {
    pub(super) fn new() -> (Self, Receiver<RunNumbers>) {
        let (to_view, told) = bounded(1);
        (Self { to_view }, told)
    }

    /// Hands the numbers over; drops them while the view has not taken the ones before. No allocation, no wait.
    pub fn tell(&self, numbers: &RunNumbers) {
        let _the_view_is_busy = self.to_view.try_send(*numbers);
    }
}
