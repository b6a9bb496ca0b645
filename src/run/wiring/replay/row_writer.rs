//! The frames of all heads -> `frames.csv`, a row for each that went out or was given up.
//!
//! ```text
//! head 0: engine -> marks -> RowSink \
//! head 1: engine -> marks -> RowSink -> queue -> writer thread -> frames.csv
//! ```
//!
//! A row joins the inputs of a frame (its mark, put by the engine) with the frame that went out (seen by the sink). One
//! thread writes the rows of all heads; a thread that blocks is abandoned, as the writer of a capture's packets is.

use super::rows::{HEADER, ORDER_FRAMES};
use super::{CapturedFate, DrawnFrom, FrameRow, ReplayError, Result, RowCounts};
use crate::runtime::{FrameMark, FrameMarksEnd};
use base::{patience, time::Span, writer_queue::WriterQueue};
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::Receiver;
use frames::sink::crc32::pixel_crc32;
use frames::sink::{FaultFlags, Loss, SentFrame, Sink, SinkError, SinkLine, SinkSummary};
use link::capture::CaptureError;
use std::io::{BufWriter, Write};
use std::sync::{Arc, Mutex, PoisonError};
use std::{collections::VecDeque, fs::File, io, path::Path, thread::JoinHandle};

/// Capacity of the queue between the sinks and the writer.
const QUEUE_ROWS: usize = 4096;

/// The table while it is written: the writer's thread, and the data to make sinks.
pub(super) struct RowWriter {
    queue: WriterQueue<FrameRow>,
    shared: Arc<Shared>,
    writer: JoinHandle<Option<String>>,
}

/// Result of writing.
#[derive(Debug)]
pub(super) struct RowsOutcome {
    /// Sums over the written rows.
    pub(super) counts: RowCounts,
    /// Frames without a row.
    pub(super) lost: u64,
    /// Why writing ended early, if it did.
    pub(super) error: Option<String>,
}

/// State shared by sinks and the writer, besides the rows.
#[derive(Default)]
struct Shared {
    /// Number of frames whose mark was lost.
    lost_marks: AtomicU64,
    written: Mutex<RowCounts>,
}

impl Shared {
    fn written(&self) -> RowCounts {
        *self.written.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RowWriter {
    /// Starts the file of a run with this many links; `waits`: frames wait for the writer, on the virtual clock.
    pub(super) fn create(path: &Path, links: usize, waits: bool) -> Result<Self> {
        let refuse = ReplayError::file(path, "write the frames");
        let mut out = BufWriter::new(File::create_new(path).map_err(refuse)?);
        writeln!(out, "{HEADER}").and_then(|()| out.flush()).map_err(refuse)?;
        Self::start(Box::new(out), links, waits).map_err(refuse)
    }

    /// Starts the writer of a file that has been created.
    pub(super) fn start(mut out: Box<dyn Write + Send>, links: usize, waits: bool) -> io::Result<Self> {
        let (queue, rows) = WriterQueue::new(QUEUE_ROWS, waits);
        let shared = Arc::<Shared>::default();
        let counted = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("frames.csv".into());
        let writer = thread.spawn(move || write_all(&rows, links, &mut *out, &counted))?;
        Ok(Self { queue, shared, writer })
    }

    /// Returns a sink around the sink of a head; `holds`: a late frame is replaced by the previous one.
    pub(super) fn sink(&self, head: usize, inner: Box<dyn Sink>, marks: FrameMarksEnd, holds: bool) -> RowSink {
        let (queue, shared) = (self.queue.clone(), Arc::clone(&self.shared));
        RowSink { inner, head, marks, waiting: VecDeque::new(), holds, queue, shared }
    }

    /// Ends the table: rows in the queue are written, later ones are not.
    pub(super) fn finish(self) -> RowsOutcome {
        let error = match self.queue.end(self.writer) {
            Some(Ok(error)) => error,
            Some(Err(_panicked)) => Some("frames.csv: the thread that writes it broke down".into()),
            None => Some(CaptureError::GivenUp { file: super::FRAMES_FILE, patience: patience::end() }.to_string()),
        };
        // Rows that an abandoned writer writes later do not count.
        let counts = self.shared.written();
        let unwritten = self.queue.offered().saturating_sub(counts.rows);
        RowsOutcome { counts, lost: unwritten + self.shared.lost_marks.load(Ordering::SeqCst), error }
    }
}

/// Runs the writer's thread: each row is in the file before the next is taken, so that a power cut costs few rows.
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

/// A sink around a sink: writes a row for each frame that went out or was given up.
pub(super) struct RowSink {
    inner: Box<dyn Sink>,
    head: usize,
    marks: FrameMarksEnd,
    /// Marks whose frames have not come yet, by rising frame.
    waiting: VecDeque<FrameMark>,
    holds: bool,
    queue: WriterQueue<FrameRow>,
    shared: Arc<Shared>,
}

impl RowSink {
    fn put(&self, mark: &FrameMark, fate: CapturedFate, crc32: Option<u32>) {
        let FrameMark { frame, messages, load, degradation, exposed } = *mark;
        let drawn = Some(DrawnFrom { messages, load, exposed });
        self.queue.put(FrameRow { frame, head: self.head, drawn, degradation: degradation.into(), fate, crc32 });
    }

    /// Writes rows for the oldest frames that were drawn and never came.
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
        // First, so that a reader knows that no row of them comes later.
        self.put_dropped(|mark| mark.frame != number && mark.frame.saturating_add(ORDER_FRAMES) <= number);
        match self.waiting.iter().position(|mark| mark.frame == number).and_then(|place| self.waiting.remove(place)) {
            Some(mark) => self.put(&mark, fate, crc32),
            None => {
                let degradation = frame.meta.degradation.name().into();
                self.queue.put(FrameRow { frame: number, head: self.head, drawn: None, degradation, fate, crc32 });
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.take_marks();
        self.put_dropped(|_all| true);
        self.shared.lost_marks.fetch_add(self.marks.take_lost(), Ordering::SeqCst);
        self.inner.finish()
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.inner.counts()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.inner.take_losses(announce);
    }

    fn lines(&self) -> Vec<SinkLine> {
        self.inner.lines()
    }
}
