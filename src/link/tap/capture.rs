//! The capture tap: a link that passes everything on unchanged and has it written to a file.
//!
//! In: a link and an output. Out: the same packets, and a capture of what was received and sent. The packet path takes no
//! lock of ours, allocates nothing and touches no file: packets go by a bounded queue to a writer thread. When the queue
//! is full they are not written and counted ([`Capture::finish`]); on the virtual clock, where waiting costs no time of
//! the run, the tap waits instead. What the writer cannot write it counts as lost too, and says why at the end. Outermost
//! of the taps, it sees what the port sees. Tests: `capture_tests`.

use crate::capture::{CaptureError, CaptureFormat, CaptureWriter, CapturedPacket, Direction};
use crate::{Departure, Link, LinkCounters, LinkError, Packet, Stamped};
use base::time::Tai;
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::{Receiver, Sender, bounded};
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
    writer: JoinHandle<(u64, Option<CaptureError>)>,
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
    to_write: Sender<Option<CapturedPacket>>,
    lost: Arc<AtomicU64>,
    waits: bool,
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
        let queue = Queue { to_write, lost: Arc::default(), waits };
        let lost = Arc::clone(&queue.lost);
        let thread = std::thread::Builder::new().name("capture".into());
        let writer = thread.spawn(move || write_all(&written, writer, &lost)).map_err(CaptureError::Write)?;
        Ok(Self { queue, writer })
    }

    /// Taps a link.
    #[must_use]
    pub fn tap(&self, inner: Box<dyn Link>) -> CapturingLink {
        CapturingLink { inner, queue: self.queue.clone() }
    }

    /// Ends the capture: what has passed so far is written. Taps that are still there lose what passes from here on.
    #[must_use]
    pub fn finish(self) -> CaptureOutcome {
        let _a_writer_that_is_gone_says_why = self.queue.to_write.send(None);
        let lost = self.queue.lost;
        let (written, error) = self.writer.join().unwrap_or((0, Some(CaptureError::WriterLost)));
        CaptureOutcome { written, lost: lost.load(Ordering::Relaxed), error }
    }
}

/// The writer thread: hands everything to the system whenever nothing waits, so that a power cut costs little. A packet
/// counts as written when the system has it: one that waits in the buffer when writing fails is lost.
fn write_all(
    queue: &Receiver<Option<CapturedPacket>>,
    mut writer: CaptureWriter<Box<dyn Write + Send>>,
    lost: &AtomicU64,
) -> (u64, Option<CaptureError>) {
    let (mut written, mut buffered, mut error) = (0, 0, None);
    for captured in queue.iter().map_while(|packet| packet) {
        buffered += 1;
        if error.is_none() {
            error = writer.write(&captured).err();
        }
        if error.is_none() && (queue.is_empty() || buffered == FLUSHED_PACKETS) {
            error = writer.flush().err();
            written += if error.is_none() { core::mem::take(&mut buffered) } else { 0 };
        }
    }
    let error = error.or_else(|| writer.flush().err());
    if error.is_none() {
        written += core::mem::take(&mut buffered);
    }
    lost.fetch_add(buffered, Ordering::Relaxed);
    (written, error)
}

impl Queue {
    fn put(&self, packet: CapturedPacket) {
        let is_lost = if self.waits {
            self.to_write.send(Some(packet)).is_err()
        } else {
            self.to_write.try_send(Some(packet)).is_err()
        };
        if is_lost {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// A link whose packets are captured.
pub struct CapturingLink {
    inner: Box<dyn Link>,
    queue: Queue,
}

impl Link for CapturingLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let received = self.inner.receive(until)?;
        if let Some(Stamped { at, value }) = received {
            self.queue.put(CapturedPacket { at, direction: Direction::Received, packet: value });
        }
        Ok(received)
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let at = self.inner.send(packet)?;
        self.queue.put(CapturedPacket { at, direction: Direction::Sent, packet: *packet });
        Ok(at)
    }

    fn counters(&self) -> LinkCounters {
        self.inner.counters()
    }

    fn departure(&mut self, sent: u64) -> Departure {
        self.inner.departure(sent)
    }
}
