//! The capture tap: a link that passes everything on unchanged and has it written to a file.
//!
//! In: links and an output. Out: the same packets, and one capture of what each link received and sent. The packet path takes no
//! lock of ours, allocates nothing and touches no file: packets go by a bounded queue to a writer thread. When the queue
//! is full they are not written and counted ([`Capture::finish`]); on the virtual clock, where waiting costs no time of
//! the run, the tap waits instead. What the writer cannot write it counts as lost too, and says why at the end. A writer
//! that blocks is given up, and what it has not written is lost. Outermost of the taps, it sees what the port sees. Tests: `capture_tests`.

use crate::capture::{CaptureError, CaptureFormat, CaptureWriter, CapturedPacket, Direction};
use crate::{Departure, Link, LinkCounters, LinkError, Packet, Stamped};
use base::patience::{self, join_or_give_up, put_in_time};
use base::time::Tai;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use std::io::Write;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Packets between a tap and the writer: 5 s of a full 1 Mbit/s bus of short frames.
const QUEUE_PACKETS: usize = 65_536;

/// Packets that may wait in the writer's buffer.
const FLUSHED_PACKETS: u64 = 4;

/// A capture under way: the writer thread, and what taps are made from.
pub struct Capture {
    queue: Queue,
    writer: JoinHandle<Option<CaptureError>>,
}

/// What a capture came to.
#[derive(Debug)]
pub struct CaptureOutcome {
    /// Packets written.
    pub written: u64,
    /// Packets that passed and were not written: the capture is incomplete.
    pub lost: u64,
    /// Why the writer gave up, if it did.
    pub error: Option<CaptureError>,
}

#[derive(Clone)]
struct Queue {
    /// Packets, and `None` at the end.
    to_write: Sender<Option<CapturedPacket>>,
    counts: Arc<Counts>,
    waits: bool,
}

/// What taps and the writer have counted.
#[derive(Default)]
struct Counts {
    /// Packets that passed a tap.
    passed: AtomicU64,
    /// Of these: written.
    written: AtomicU64,
    /// What passes from here on is lost: the capture is over, or its writer was given up.
    is_over: AtomicBool,
}

impl Capture {
    /// Begins a capture into `out`; `waits`: whether taps wait for the writer (on the virtual clock) or lose packets.
    ///
    /// # Errors
    /// When its beginning cannot be written or no thread can be had.
    pub fn start(out: Box<dyn Write + Send>, format: CaptureFormat, waits: bool) -> Result<Self, CaptureError> {
        Self::with_room(out, format, waits, QUEUE_PACKETS)
    }

    pub(super) fn with_room(
        out: Box<dyn Write + Send>,
        format: CaptureFormat,
        waits: bool,
        room: usize,
    ) -> Result<Self, CaptureError> {
        let writer = CaptureWriter::new(out, format)?;
        let (to_write, written) = bounded(room);
        let queue = Queue { to_write, counts: Arc::default(), waits };
        let counts = Arc::clone(&queue.counts);
        let thread = std::thread::Builder::new().name("capture".into());
        let writer = thread.spawn(move || write_all(&written, writer, &counts)).map_err(CaptureError::Write)?;
        Ok(Self { queue, writer })
    }

    /// Taps a link, whose packets the capture has under this number of an interface, from 0.
    #[must_use]
    pub fn tap(&self, inner: Box<dyn Link>, interface: u8) -> CapturingLink {
        CapturingLink { inner, queue: self.queue.clone(), interface }
    }

    /// Ends the capture: what has passed so far is written. Taps that are still there lose what passes from here on.
    #[must_use]
    pub fn finish(self) -> CaptureOutcome {
        let Queue { to_write, counts, .. } = self.queue;
        counts.is_over.store(true, Ordering::SeqCst);
        let mut is_marked = false;
        let joined = join_or_give_up(self.writer, || {
            // A full queue has no place for the mark of the end yet.
            is_marked = is_marked || !matches!(to_write.try_send(None), Err(TrySendError::Full(_)));
            to_write.len() as u64
        });
        let error = match joined {
            Some(ended) => ended.unwrap_or(Some(CaptureError::WriterLost)),
            None => Some(CaptureError::GivenUp { file: "the capture's packets", patience: patience::end() }),
        };
        let written = counts.written.load(Ordering::SeqCst);
        CaptureOutcome { written, lost: counts.passed.load(Ordering::SeqCst).saturating_sub(written), error }
    }
}

/// The writer thread: hands everything to the system whenever nothing waits, so that a power cut costs little. A packet
/// counts as written when the system has it: one that waits in the buffer when writing fails is lost.
fn write_all(
    queue: &Receiver<Option<CapturedPacket>>,
    mut writer: CaptureWriter<Box<dyn Write + Send>>,
    counts: &Counts,
) -> Option<CaptureError> {
    let (mut buffered, mut error) = (0, None);
    for captured in queue.iter().map_while(|packet| packet) {
        buffered += 1;
        if error.is_none() {
            error = writer.write(&captured).err();
        }
        if error.is_none() && (queue.is_empty() || buffered == FLUSHED_PACKETS) {
            error = writer.flush().err();
            if error.is_none() {
                counts.written.fetch_add(core::mem::take(&mut buffered), Ordering::SeqCst);
            }
        }
    }
    let error = error.or_else(|| writer.flush().err());
    if error.is_none() {
        counts.written.fetch_add(buffered, Ordering::SeqCst);
    }
    error
}

impl Queue {
    fn put(&self, packet: CapturedPacket) {
        self.counts.passed.fetch_add(1, Ordering::SeqCst);
        if self.counts.is_over.load(Ordering::SeqCst) {
            return;
        }
        if self.waits {
            // A writer that takes nothing is given up.
            if !put_in_time(&self.to_write, Some(packet)) {
                self.counts.is_over.store(true, Ordering::SeqCst);
            }
        } else {
            let _ = self.to_write.try_send(Some(packet)); // a packet that passed and is never written counts as lost
        }
    }
}

/// A link whose packets are captured.
pub struct CapturingLink {
    inner: Box<dyn Link>,
    queue: Queue,
    interface: u8,
}

impl CapturingLink {
    fn put(&self, at: Tai, direction: Direction, packet: Packet) {
        self.queue.put(CapturedPacket { at, direction, interface: self.interface, packet });
    }
}

impl Link for CapturingLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let received = self.inner.receive(until)?;
        if let Some(Stamped { at, value }) = received {
            self.put(at, Direction::Received, value);
        }
        Ok(received)
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let at = self.inner.send(packet)?;
        self.put(at, Direction::Sent, *packet);
        Ok(at)
    }

    fn counters(&self) -> LinkCounters {
        self.inner.counters()
    }

    fn departure(&mut self, sent: u64) -> Departure {
        self.inner.departure(sent)
    }
}
