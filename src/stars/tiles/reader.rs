//! A thread that reads tiles: names in, blocks of stars out, so that the caller touches no file and frees no memory.
//!
//! Two queues of names: those that a field lacks go before those that a coming field may want. What was asked for so
//! many fields ago that it is of no use any more is not read. Blocks that are given up come back here, where they are
//! used again. All queues are bounded and made at the start; a full one is "not now", never a wait. A thread that
//! breaks down is known by [`Reader::is_lost`]: nothing is read from then on.

use super::store::{Decoder, TileStar};
use crate::layer::TileId;
use base::refused::Refused;
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, TryRecvError, bounded, select};
use std::{sync::Arc, thread::JoinHandle};

/// Names that may wait in each queue, and blocks.
const QUEUE: usize = 16_384;
/// Fields after which a name that still waits is of no use.
const STALE_FIELDS: u64 = 100;

/// A tile that is wanted.
#[derive(Debug, Clone, Copy)]
struct Asked {
    tile: TileId,
    /// By this field.
    field: u64,
}

/// Result of reading a tile.
#[derive(Debug)]
pub(super) struct Answer {
    pub(super) tile: TileId,
    /// `None`: it was not read, being of no use any more.
    pub(super) stars: Option<Result<Vec<TileStar>, Refused>>,
}

/// The thread's other end; the thread ends with it.
#[derive(Debug)]
pub(super) struct Reader {
    /// `None` only while it is dropped.
    ends: Option<Ends>,
    field: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Ends {
    lacking: Sender<Asked>,
    ahead: Sender<Asked>,
    answers: Receiver<Answer>,
    spent: Sender<Vec<TileStar>>,
}

impl Reader {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub(super) fn start(mut decoder: Decoder) -> std::io::Result<Self> {
        let ((lacking, lacking_asked), (ahead, ahead_asked)) = (bounded(QUEUE), bounded(QUEUE));
        let ((answer, answers), (spent, spent_blocks)) = (bounded(QUEUE), bounded(QUEUE));
        let field = Arc::new(AtomicU64::new(0));
        let at_field = Arc::clone(&field);
        let thread = std::thread::Builder::new().name("tiles".into()).spawn(move || {
            while let Some(asked) = next(&lacking_asked, &ahead_asked) {
                let stars = if asked.field + STALE_FIELDS < at_field.load(Ordering::Relaxed) {
                    None
                } else {
                    let mut block: Vec<TileStar> = spent_blocks.try_recv().unwrap_or_default();
                    // A large block would lie about its size for as long as it holds a few stars.
                    block.clear();
                    block.shrink_to(0);
                    Some(decoder.read(asked.tile, &mut block).map(|()| block))
                };
                if answer.send(Answer { tile: asked.tile, stars }).is_err() {
                    break;
                }
                // Surplus spent blocks are freed here.
                while spent_blocks.len() > 1 && spent_blocks.try_recv().is_ok() {}
            }
        })?;
        Ok(Self { ends: Some(Ends { lacking, ahead, answers, spent }), field, thread: Some(thread) })
    }

    /// Returns true when the thread has ended although its senders are alive: it broke down.
    pub(super) fn is_lost(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Makes field number `field` the present one.
    pub(super) fn begin(&self, field: u64) {
        self.field.store(field, Ordering::Relaxed);
    }

    /// Asks for a tile that the field lacks, or for one that a coming field may want; false when too many wait.
    pub(super) fn ask(&self, tile: TileId, field: u64, is_lacking: bool) -> bool {
        let Some(ends) = &self.ends else { return false };
        let queue = if is_lacking { &ends.lacking } else { &ends.ahead };
        queue.try_send(Asked { tile, field }).is_ok()
    }

    /// Returns the next answer that is there.
    pub(super) fn answer(&self) -> Option<Answer> {
        self.ends.as_ref()?.answers.try_recv().ok()
    }

    /// Gives a block back.
    pub(super) fn give_back(&self, block: Vec<TileStar>) {
        if let Some(ends) = &self.ends {
            // A full queue means that thousands are on their way: this one is freed here.
            let _ = ends.spent.try_send(block);
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        // Dropping the other ends of its queues makes the thread return.
        self.ends = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Returns the next name, those that a field lacks first; `None` when all senders are gone.
fn next(lacking: &Receiver<Asked>, ahead: &Receiver<Asked>) -> Option<Asked> {
    match lacking.try_recv() {
        Ok(asked) => return Some(asked),
        Err(TryRecvError::Disconnected) => return None,
        Err(TryRecvError::Empty) => {}
    }
    select! {
        recv(lacking) -> asked => asked.ok(),
        recv(ahead) -> asked => asked.ok(),
    }
}
