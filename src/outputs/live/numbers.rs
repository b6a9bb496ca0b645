//! The run's end of the view: counts, handed over when the queue has space, else dropped.
//!
//! A queue of one: the frame thread never waits, and as all values are counts since the start, a dropped one costs
//! nothing but its age. The last ones, after the run, are never dropped.

use crossbeam_channel::{Receiver, Sender, bounded};
use frames::report::RunNumbers;
use std::time::Duration;

/// Time that the view may take for the queue at the end of a run.
const TAKES_WITHIN: Duration = Duration::from_secs(1);

/// Numbers on their way to the view.
#[derive(Debug)]
pub(super) struct Reported {
    pub(super) numbers: RunNumbers,
    /// The run is over: these are its totals.
    pub(super) are_last: bool,
}

/// Sender of the numbers of a run.
#[derive(Debug, Clone)]
pub struct Numbers {
    to_view: Sender<Reported>,
}

impl Numbers {
    pub(super) fn new() -> (Self, Receiver<Reported>) {
        let (to_view, reported) = bounded(1);
        (Self { to_view }, reported)
    }

    /// Hands the numbers over; drops them while the view has not taken the ones before. No allocation, no wait.
    pub fn announce(&self, numbers: &RunNumbers) {
        // Dropped while the view is busy.
        let _ = self.to_view.try_send(Reported { numbers: *numbers, are_last: false });
    }

    /// Hands over the totals of a run that is over. Waits for the view, but not for long: one that has ended takes
    /// none.
    pub fn send_last(&self, numbers: &RunNumbers) {
        let last = Reported { numbers: *numbers, are_last: true };
        let _ = self.to_view.send_timeout(last, TAKES_WITHIN); // the view may have ended
    }
}
