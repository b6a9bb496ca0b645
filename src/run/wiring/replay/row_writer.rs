//! The frames of all heads -> `frames.csv`, a row for each that went out or was given up.
//!
//! ```text
//! head 0: engine -> marks -> RowSink \
//! head 1: engine -> marks -> RowSink -> queue -> writer thread -> frames.csv
//! ```
//!
//! A row joins what a frame was drawn from (its mark, put by the engine) with what went out (the frame, seen by the sink).
//! One thread writes the rows of all heads: one that blocks is given up, as the writer of a capture's packets is.

use super::rows::{HEADER, ORDER_FRAMES};
use super::{CapturedFate, DrawnFrom, FrameRow, ReplayError, RowCounts};
use crate::runtime::{FrameMark, FrameMarksEnd};
use base::patience::{self, join_or_give_up, put_in_time};
use base::time::Span;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use frames::sink::crc32::pixel_crc32;
use frames::sink::{FaultFlags, Loss, SentFrame, Sink, SinkError, SinkLine, SinkSummary};
use link::capture::CaptureError;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Rows between the sinks and the writer.
const QUEUE_ROWS: usize = 4096;

/// The table while it is written: the writer's thread, and what sinks are made from.
pub(super) struct RowWriter {
    queue: RowQueue,
    writer: JoinHandle<Option<String>>,
}

/// What writing came to.
#[derive(Debug)]
pub(super) struct RowsOutcome {
    /// Of the rows that were written.
    pub(super) counts: RowCounts,
    /// Frames without a row.
    pub(super) lost: u64,
    /// Why writing ended early, if it did.
    pub(super) error: Option<String>,
}

/// Where sinks put rows.
#[derive(Clone)]
struct RowQueue {
    /// Rows, and `None` at the end.
    to_write: Sender<Option<FrameRow>>,
    shared: Arc<Shared>,
    /// Whether frames wait for the writer, on the virtual clock.
    waits: bool,
}

#[derive(Default)]
struct Shared {
    /// Rows that sinks put, and frames whose mark was lost.
    offered: AtomicU64,
    lost_marks: AtomicU64,
    /// What comes from here on is lost: the capture is over, or the writer was given up.
    is_over: AtomicBool,
    written: Mutex<RowCounts>,
}

impl Shared {
    fn written(&self) -> RowCounts {
        *self.written.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RowWriter {
    /// Begins the file of a run with so many links; `waits`: whether frames wait for the writer, on the virtual clock.
    pub(super) fn create(path: &Path, links: usize, waits: bool) -> Result<Self, ReplayError> {
        let refuse = |source| ReplayError::File { path: path.into(), doing: "write the frames", source };
        let mut out = BufWriter::new(File::create_new(path).map_err(refuse)?);
        writeln!(out, "{HEADER}").and_then(|()| out.flush()).map_err(refuse)?;
        Self::start(Box::new(out), links, waits).map_err(refuse)
    }

    /// Starts the writer of a file that has begun.
    pub(super) fn start(mut out: Box<dyn Write + Send>, links: usize, waits: bool) -> io::Result<Self> {
        let (to_write, rows) = bounded(QUEUE_ROWS);
        let queue = RowQueue { to_write, shared: Arc::default(), waits };
        let shared = Arc::clone(&queue.shared);
        let thread = std::thread::Builder::new().name("frames.csv".into());
        let writer = thread.spawn(move || write_all(&rows, links, &mut *out, &shared))?;
        Ok(Self { queue, writer })
    }

    /// A sink around the sink of a head; `holds`: whether a late frame is replaced by the one before.
    pub(super) fn sink(&self, head: usize, inner: Box<dyn Sink>, marks: FrameMarksEnd, holds: bool) -> RowSink {
        RowSink { inner, head, marks, waiting: VecDeque::new(), holds, queue: self.queue.clone() }
    }

    /// Ends the table: rows that sinks have put are written, and none that comes from here on.
    pub(super) fn finish(self) -> RowsOutcome {
        let RowQueue { to_write, shared, .. } = self.queue;
        shared.is_over.store(true, Ordering::SeqCst);
        let mut is_marked = false;
        let joined = join_or_give_up(self.writer, || {
            // A full queue has no place for the mark of the end yet.
            is_marked = is_marked || !matches!(to_write.try_send(None), Err(TrySendError::Full(_)));
            shared.written().rows
        });
        let error = match joined {
            Some(Ok(error)) => error,
            Some(Err(_panicked)) => Some("frames.csv: the thread that writes it broke down".into()),
            None => Some(CaptureError::GivenUp { file: super::FRAMES_FILE, patience: patience::end() }.to_string()),
        };
        // What a writer that was given up writes later does not count.
        let counts = shared.written();
        let unwritten = shared.offered.load(Ordering::SeqCst).saturating_sub(counts.rows);
        RowsOutcome { counts, lost: unwritten + shared.lost_marks.load(Ordering::SeqCst), error }
    }
}

/// The writer's thread: each row is in the file before the next is taken, as a power cut should cost few rows.
fn write_all(rows: &Receiver<Option<FrameRow>>, links: usize, out: &mut dyn Write, shared: &Shared) -> Option<String> {
    let mut error = None;
    for row in rows.iter().map_while(|row| row) {
        if error.is_some() {
            continue; // the run goes on, and the row is lost
        }
        match row.write(links, out).and_then(|()| out.flush()) {
            Ok(()) => shared.written.lock().unwrap_or_else(PoisonError::into_inner).add(&row),
            Err(failed) => error = Some(format!("frames.csv: {failed}")),
        }
    }
    error
}

impl RowQueue {
    /// Hands a row to the writer. One that cannot be written is lost and counted: the run goes on.
    fn put(&self, row: FrameRow) {
        self.shared.offered.fetch_add(1, Ordering::SeqCst);
        if self.shared.is_over.load(Ordering::SeqCst) {
            return;
        }
        if self.waits {
            // A writer that takes nothing is given up.
            if !put_in_time(&self.to_write, Some(row)) {
                self.shared.is_over.store(true, Ordering::SeqCst);
            }
        } else {
            let _ = self.to_write.try_send(Some(row)); // a row that is not written counts as lost
        }
    }
}

/// A sink around a sink: writes a row for each frame that went out or was given up.
pub(super) struct RowSink {
    inner: Box<dyn Sink>,
    head: usize,
    marks: FrameMarksEnd,
    /// Marks whose frames have not been seen, by rising frame.
    waiting: VecDeque<FrameMark>,
    holds: bool,
    queue: RowQueue,
}

impl RowSink {
    fn put(&self, mark: &FrameMark, fate: CapturedFate, crc32: Option<u32>) {
        let FrameMark { frame, messages, load, rung } = *mark;
        let drawn = Some(DrawnFrom { messages, load });
        self.queue.put(FrameRow { frame, head: self.head, drawn, rung: rung.into(), fate, crc32 });
    }

    /// Puts rows of the oldest frames that were drawn and never came.
    fn put_dropped(&mut self, is_dropped: impl Fn(&FrameMark) -> bool) {
        while let Some(mark) = self.waiting.front().copied().filter(&is_dropped) {
            self.waiting.pop_front();
            self.put(&mark, CapturedFate::Dropped, None);
        }
    }

    fn take_marks(&mut self) {
        self.waiting.extend(core::iter::from_fn(|| self.marks.take()));
    }

    fn fate(&self, frame: &SentFrame) -> CapturedFate {
        let (meta, is_late) = (&frame.meta, frame.meta.lateness > Span::ZERO);
        // A fault that duplicates frames has the same flag: there, the frame went out late or in time.
        match is_late && self.holds && meta.faults.contains(FaultFlags::FRAME_DUPLICATE) {
            true => CapturedFate::Held,
            false if is_late => CapturedFate::Late,
            false => CapturedFate::Sent,
        }
    }
}

impl Sink for RowSink {
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.inner.send(frame)?;
        let (number, fate, crc32) = (frame.meta.number, self.fate(frame), Some(pixel_crc32(&frame.image)));
        self.take_marks();
        // First: a reader knows then that no row of them comes later.
        self.put_dropped(|mark| mark.frame != number && mark.frame.saturating_add(ORDER_FRAMES) <= number);
        match self.waiting.iter().position(|mark| mark.frame == number).and_then(|place| self.waiting.remove(place)) {
            Some(mark) => self.put(&mark, fate, crc32),
            None => {
                let rung = frame.meta.rung.into();
                self.queue.put(FrameRow { frame: number, head: self.head, drawn: None, rung, fate, crc32 });
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.take_marks();
        self.put_dropped(|_all| true);
        self.queue.shared.lost_marks.fetch_add(self.marks.take_lost(), Ordering::SeqCst);
        self.inner.finish()
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.inner.counts()
    }

    fn take_losses(&mut self, tell: &mut dyn FnMut(Loss)) {
        self.inner.take_losses(tell);
    }

    fn lines(&self) -> Vec<SinkLine> {
        self.inner.lines()
    }
}
