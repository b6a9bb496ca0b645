//! A queue to a thread that writes: what the writer does not take is lost and counted, and the run goes on.
//!
//! In: items of a run. Out: the same in the writer's thread, until the mark of the end. A writer that blocks is given
//! up ([`crate::patience`]). Test: below, and those of the capture's packets and rows.

use crate::patience::{join_or_give_up, put_in_time};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::{sync::Arc, thread::JoinHandle};

/// Where items for the writer are put; clones put them into the same queue.
#[derive(Debug)]
pub struct WriterQueue<T> {
    /// Items, and `None` at the end.
    to_write: Sender<Option<T>>,
    state: Arc<State>,
    waits: bool,
}

#[derive(Debug, Default)]
struct State {
    offered: AtomicU64,
    /// Later items are lost: the writing is over, or the writer was given up.
    is_over: AtomicBool,
}

impl<T> Clone for WriterQueue<T> {
    fn clone(&self) -> Self {
        Self { to_write: self.to_write.clone(), state: Arc::clone(&self.state), waits: self.waits }
    }
}

impl<T> WriterQueue<T> {
    /// Returns a queue of at most `items`, and the writer's end of it: items, and `None` at the end.
    /// `waits`: whether [`Self::put`] waits for the writer, as on the virtual clock, or loses items.
    pub fn new(items: usize, waits: bool) -> (Self, Receiver<Option<T>>) {
        let (to_write, written) = bounded(items);
        (Self { to_write, state: Arc::default(), waits }, written)
    }

    /// Hands an item to the writer. One that the writer does not get is lost: it was offered and is never written.
    pub fn put(&self, item: T) {
        self.state.offered.fetch_add(1, Ordering::SeqCst);
        if self.state.is_over.load(Ordering::SeqCst) {
            return;
        }
        if self.waits {
            // A writer that takes nothing is given up.
            if !put_in_time(&self.to_write, Some(item)) {
                self.state.is_over.store(true, Ordering::SeqCst);
            }
        } else {
            let _ = self.to_write.try_send(Some(item)); // offered and not written: counts as lost
        }
    }

    /// Returns how many items were offered so far, lost ones included.
    pub fn offered(&self) -> u64 {
        self.state.offered.load(Ordering::SeqCst)
    }

    /// Ends the queue, and joins its writer: what was put is written, what comes from here on is lost. `None` when the
    /// writer takes nothing for [`crate::patience::end`]: it is left behind.
    pub fn end<R>(&self, writer: JoinHandle<R>) -> Option<std::thread::Result<R>> {
        self.state.is_over.store(true, Ordering::SeqCst);
        let mut is_marked = false;
        join_or_give_up(writer, || {
            // A full queue has no place for the mark of the end yet.
            is_marked = is_marked || !matches!(self.to_write.try_send(None), Err(TrySendError::Full(_)));
            self.to_write.len() as u64
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn writer(items: Receiver<Option<u32>>) -> JoinHandle<Vec<u32>> {
        let thread = std::thread::Builder::new().name("writer".into());
        thread.spawn(move || items.iter().map_while(|item| item).collect()).unwrap()
    }

    #[test]
    fn queue_that_waits_loses_nothing_before_its_end_and_everything_after() {
        let (queue, items) = WriterQueue::new(1, true);
        let writer = writer(items);
        (0..100).for_each(|n| queue.put(n));
        assert_eq!(queue.end(writer).unwrap().unwrap(), (0..100).collect::<Vec<_>>());
        queue.put(100);
        assert_eq!(queue.offered(), 101, "the one that came too late counts");
    }

    #[test]
    fn queue_that_does_not_wait_loses_what_has_no_place() {
        let (queue, items) = WriterQueue::new(2, false);
        (0..5).for_each(|n| queue.put(n));
        assert_eq!(queue.end(writer(items)).unwrap().unwrap(), [0, 1]);
        assert_eq!(queue.offered(), 5);
    }
}
