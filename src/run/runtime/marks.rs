//! What a replay needs to know of each frame: how many messages of each port were taken in before it, and under what load
//! it was planned.
//!
//! In: the frame engine, once per frame drawn. Out: a bounded queue that the sink's side empties before it writes the
//! frame's row. A full queue loses the newest mark and counts it; the frame thread never waits. Test: below, and
//! `tests/closed_loop/replay.rs`.

use crate::runtime::exposing::Exposed;
use crate::runtime::receiver::PORTS_MAX;
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::sync::Arc;

/// Marks that may wait: many more than frames can be on their way, and those of a long time in which a fault drops all.
const QUEUE_MARKS: usize = 16_384;

/// What one frame was drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMark {
    /// Frame number.
    pub frame: u32,
    /// Messages taken in by each port since the run began, all kinds.
    pub messages: [u64; PORTS_MAX],
    /// Measured over predicted drawing time, as the planner had it.
    pub load: f64,
    /// How far the frame was degraded.
    pub degradation: &'static str,
    /// How a commanded camera exposed it; `None` without commands.
    pub exposed: Option<Exposed>,
}

/// The frame engine's end.
#[derive(Debug, Clone)]
pub struct FrameMarks {
    queue: Sender<FrameMark>,
    lost: Arc<AtomicU64>,
}

/// The other end.
#[derive(Debug)]
pub struct FrameMarksEnd {
    queue: Receiver<FrameMark>,
    lost: Arc<AtomicU64>,
}

/// Returns a queue of marks.
#[must_use]
pub fn frame_marks() -> (FrameMarks, FrameMarksEnd) {
    let (queue, end) = bounded(QUEUE_MARKS);
    let lost = Arc::<AtomicU64>::default();
    (FrameMarks { queue, lost: Arc::clone(&lost) }, FrameMarksEnd { queue: end, lost })
}

impl FrameMarks {
    /// Puts a mark into the queue.
    pub fn put(&self, mark: FrameMark) {
        if self.queue.try_send(mark).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl FrameMarksEnd {
    /// Returns the oldest mark that waits.
    #[must_use]
    pub fn take(&self) -> Option<FrameMark> {
        self.queue.try_recv().ok()
    }

    /// Marks that were lost since it was asked last.
    #[must_use]
    pub fn take_lost(&self) -> u64 {
        self.lost.swap(0, Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_queue_loses_the_newest_and_counts_it() {
        let (marks, end) = frame_marks();
        let mark = |frame| FrameMark {
            frame,
            messages: [u64::from(frame) * 10; PORTS_MAX],
            load: 1.0,
            degradation: "full",
            exposed: None,
        };
        (0..QUEUE_MARKS as u32 + 3).for_each(|frame| marks.put(mark(frame)));
        assert_eq!(end.take_lost(), 3);
        assert_eq!(end.take(), Some(mark(0)));
        assert_eq!(core::iter::from_fn(|| end.take()).last(), Some(mark(QUEUE_MARKS as u32 - 1)));
    }
}
