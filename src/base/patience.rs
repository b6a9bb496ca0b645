//! Patience with a thread that may block: how long it may finish nothing before it is given up.
//!
//! A disk, network or reader that is gone blocks a thread without limit. A run must end all the same, so a thread that
//! waits for a blocked one counts the wall time in which it finished nothing. Test: below.

use crate::{clock::Stopwatch, time::Span};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{SendTimeoutError, Sender};
use std::{thread::JoinHandle, time::Duration};

/// A thread that finishes nothing for this long at the end of a run is given up.
pub const END_PATIENCE: Span = Span::from_ms(5_000);
/// The same in the middle of a run on the virtual clock, which waits for slow disks: longer, as no frame is late there.
pub const STALL_PATIENCE: Span = Span::from_ms(60_000);
/// Both after [`be_short`].
const SHORT_PATIENCE: [Span; 2] = [Span::from_ms(1_000), Span::from_ms(3_000)];
static IS_SHORT: AtomicBool = AtomicBool::new(false);

/// Shortens all patience of this program to 1 and 3 s, for tests that wait until it is over.
pub fn be_short() {
    IS_SHORT.store(true, Ordering::Relaxed);
}

/// Returns the patience at the end of a run, [`END_PATIENCE`].
pub fn end() -> Span {
    if IS_SHORT.load(Ordering::Relaxed) { SHORT_PATIENCE[0] } else { END_PATIENCE }
}

/// Returns the patience in the middle of a run, [`STALL_PATIENCE`].
pub fn stall() -> Span {
    if IS_SHORT.load(Ordering::Relaxed) { SHORT_PATIENCE[1] } else { STALL_PATIENCE }
}

/// Between two looks at a thread that is to end.
pub const LOOK: Duration = Duration::from_millis(2);
/// Time between two looks at the clock of a thread that a queue wakes.
pub const QUEUE_LOOK: Duration = Duration::from_millis(50);

/// Wall time without progress, up to a limit.
#[derive(Debug)]
pub struct Patience {
    limit: Span,
    watch: Stopwatch,
    quiet: Span,
}

impl Patience {
    /// Starts to wait.
    pub fn new(limit: Span) -> Self {
        Self { limit, watch: Stopwatch::start(), quiet: Span::ZERO }
    }

    /// Starts again: something was finished.
    pub fn restart(&mut self) {
        self.quiet = Span::ZERO;
    }

    /// Returns true when nothing was finished for as long as the limit. To be asked again and again: of a pause of the
    /// whole machine at most half of the limit is counted.
    pub fn is_over(&mut self) -> bool {
        self.quiet = self.quiet + self.watch.lap().min(Span::from_ns(self.limit.ns() / 2));
        self.quiet >= self.limit
    }
}

/// Joins a thread; `None` when it ended neither in time nor moved `progress` for [`END_PATIENCE`]: it is left behind.
pub fn join_or_give_up<T>(thread: JoinHandle<T>, mut progress: impl FnMut() -> u64) -> Option<std::thread::Result<T>> {
    let (mut patience, mut seen) = (Patience::new(end()), progress());
    while !thread.is_finished() {
        let now = progress();
        if now != seen {
            seen = now;
            patience.restart();
        } else if patience.is_over() {
            return None;
        }
        std::thread::sleep(LOOK);
    }
    Some(thread.join())
}

/// Puts an item into a queue as soon as there is a place; false when there was none for as long as [`stall`]. An item
/// for a receiver that has gone is dropped.
pub fn put_in_time<T>(queue: &Sender<T>, item: T) -> bool {
    let (mut item, mut patience) = (item, Patience::new(stall()));
    while let Err(SendTimeoutError::Timeout(back)) = queue.send_timeout(item, QUEUE_LOOK) {
        if patience.is_over() {
            return false;
        }
        item = back;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::sync::atomic::AtomicU64;
    use std::sync::Arc;

    fn started<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> JoinHandle<T> {
        std::thread::Builder::new().name("work".into()).spawn(work).unwrap()
    }

    #[test]
    fn slow_thread_that_goes_on_is_waited_for_and_one_that_blocks_is_not() {
        be_short();
        let steps = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&steps);
        let slow = started(move || {
            for _ in 0..4 {
                std::thread::sleep(Duration::from_millis(400));
                counted.fetch_add(1, Ordering::Relaxed);
            }
            7
        });
        assert_eq!(join_or_give_up(slow, || steps.load(Ordering::Relaxed)).unwrap().unwrap(), 7);
        let (_never, blocks) = crossbeam_channel::bounded::<()>(0);
        assert!(join_or_give_up(started(move || blocks.recv().is_ok()), || 0).is_none());
    }
}
