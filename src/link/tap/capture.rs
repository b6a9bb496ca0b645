//! The capture tap: a link that passes everything on unchanged and has it written to a file.
//!
//! In: links and an output. Out: the same packets, and one capture of the packets that each link received and sent. The
//! packet path takes no lock of ours, allocates nothing and touches no file: packets go by a bounded queue to a writer
//! thread. When the queue is full they are not written and counted ([`Capture::finish`]); on the virtual clock, where
//! waiting costs no time of the run, the tap waits instead. Packets that the writer cannot write are counted as lost
//! too, and says why at the end. A writer that blocks is given up, and its unwritten packets are lost. Outermost of the
//! taps, it sees what the port sees. Tests: `capture_tests`.

use crate::capture::{CaptureError, CaptureFormat, CaptureWriter, CapturedPacket, Direction};
use crate::{Departure, Link, LinkCounters, LinkError, Packet, Stamped};
use base::{patience, time::Tai, writer_queue::WriterQueue};
use core::sync::atomic::{AtomicU64, Ordering};
use crossbeam_channel::Receiver;
use std::{io::Write, sync::Arc, thread::JoinHandle};

/// Packets between a tap and the writer: 5 s of a full 1 Mbit/s bus of short frames.
const QUEUE_PACKETS: usize = 65_536;

/// Packets that may wait in the writer's buffer.
const FLUSHED_PACKETS: u64 = 4;

/// A capture under way: the writer thread, and the parts from which taps are made.
pub struct Capture {
    queue: WriterQueue<CapturedPacket>,
    /// Packets that the system has.
    written: Arc<AtomicU64>,
    writer: JoinHandle<Option<CaptureError>>,
}

/// Result of a capture.
#[derive(Debug)]
pub struct CaptureOutcome {
    /// Packets written.
    pub written: u64,
    /// Packets that passed and were not written: the capture is incomplete.
    pub lost: u64,
    /// Why the writer gave up, if it did.
    pub error: Option<CaptureError>,
}

impl Capture {
    /// Begins a capture into `out`; `waits`: whether taps wait for the writer (on the virtual clock) or lose packets.
    ///
    /// # Errors
    /// When its header cannot be written or no thread can be started.
    pub fn start(out: Box<dyn Write + Send>, format: CaptureFormat, waits: bool) -> Result<Self, CaptureError> {
        Self::with_space(out, format, waits, QUEUE_PACKETS)
    }

    pub(super) fn with_space(
        out: Box<dyn Write + Send>,
        format: CaptureFormat,
        waits: bool,
        space: usize,
    ) -> Result<Self, CaptureError> {
        let writer = CaptureWriter::new(out, format)?;
        let (queue, packets) = WriterQueue::new(space, waits);
        let written = Arc::<AtomicU64>::default();
        let count = Arc::clone(&written);
        let thread = std::thread::Builder::new().name("capture".into());
        let writer = thread.spawn(move || write_all(&packets, writer, &count)).map_err(CaptureError::Write)?;
        Ok(Self { queue, written, writer })
    }

    /// Taps a link, whose packets the capture has under this number of an interface, from 0.
    pub fn tap(&self, inner: Box<dyn Link>, interface: u8) -> CapturingLink {
        CapturingLink { inner, queue: self.queue.clone(), interface }
    }

    /// Ends the capture: packets that have passed so far are written. Taps that still exist lose later packets.
    pub fn finish(self) -> CaptureOutcome {
        let error = match self.queue.end(self.writer) {
            Some(ended) => ended.unwrap_or(Some(CaptureError::WriterLost)),
            None => Some(CaptureError::GivenUp { file: "the capture's packets", patience: patience::end() }),
        };
        let written = self.written.load(Ordering::SeqCst);
        CaptureOutcome { written, lost: self.queue.offered().saturating_sub(written), error }
    }
}

/// Runs the writer thread: flushes to the system whenever nothing waits, so that a power cut costs little. A packet
/// counts as written when the system has it: one that waits in the buffer when writing fails is lost.
fn write_all(
    queue: &Receiver<Option<CapturedPacket>>,
    mut writer: CaptureWriter<Box<dyn Write + Send>>,
    written: &AtomicU64,
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
                written.fetch_add(core::mem::take(&mut buffered), Ordering::SeqCst);
            }
        }
    }
    let error = error.or_else(|| writer.flush().err());
    if error.is_none() {
        written.fetch_add(buffered, Ordering::SeqCst);
    }
    error
}

/// A link whose packets are captured.
pub struct CapturingLink {
    inner: Box<dyn Link>,
    queue: WriterQueue<CapturedPacket>,
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
