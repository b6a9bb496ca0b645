//! Records what a replay needs to know of each frame: how many messages of each port arrived before it, and the load it
//! was planned under.
//!
//! In: the frame engine, once per frame drawn. Out: a bounded queue that the sink's side empties before it writes the
//! frame's row. A full queue loses the newest mark and counts it; the frame thread never waits. Tests: below, and
//! `tests/closed_loop/replay.rs`.

use crate::runtime::{clock_intake::PORTS_MAX, exposing::Exposed};
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded};
use std::sync::Arc;

/// Capacity of the queue: many more marks than frames can be in flight, and enough for a long time in which a fault
/// drops all frames.
const QUEUE_MARKS: usize = 16_384;

/// Inputs that one frame was drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMark {
    /// Frame number.
    pub frame: u32,
    /// Messages taken in by each port since the run started, all kinds.
    pub messages: [u64; PORTS_MAX],
    /// Ratio of measured to predicted drawing time that the planner used.
    pub load: f64,
    /// Degradation of the frame.
    pub degradation: &'static str,
    /// Exposure of a camera under commands; `None` without commands.
    pub exposed: Option<Exposed>,
}

/// Sending end, owned by the frame engine.
#[derive(Debug, Clone)]
pub struct FrameMarks {
    queue: Sender<FrameMark>,
    lost: Arc<AtomicU64>,
}

/// Receiving end.
#[derive(Debug)]
pub struct FrameMarksEnd {
    queue: Receiver<FrameMark>,
    lost: Arc<AtomicU64>,
}

/// Returns a queue of marks.
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
    pub fn take(&self) -> Option<FrameMark> {
        self.queue.try_recv().ok()
    }

    /// Returns the number of marks lost since the last call.
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
