//! One client of a gateway: a thread that reads from it and one that writes to it, on an end of the bus of its own.
//!
//! ```text
//! descriptor -> Dialogue (parser, answers) -> end of the bus
//! end of the bus (bounded) -> Scribe -> Outgoing (bounded) -> descriptor
//! ```
//!
//! A client that sends faster than the bus takes is read more slowly. One that does not read loses frames, counted, and
//! is hung up on when its patience is over. Neither holds a lock of the bus while it waits. A TCP client that speaks
//! another protocol, or sends too many malformed lines, is hung up on for good: nothing of what it sent afterwards is
//! obeyed.

use super::screen::{Admission, Screen};
use super::{CountsIfLost, Tally};
use crate::readiness::{Readiness, wait_for};
use crate::simulated::{ErrorState, SimulatedLink};
use crate::{Link, Packet, Stamped};
use base::clock::Clock;
use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use firmware_protocol::can::CanFrame;
use rustix::{event, io::Errno, net::Shutdown, termios::QueueSelector};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;

/// Interval at which a waiting thread checks for its end.
pub(super) const LOOK_MS: i64 = 100;
/// Between two tries to write to a client that has not read.
const RETRY: Span = Span::from_ms(2);
/// Between two looks at a full transmit queue.
const SPACE: Span = Span::from_ms(1);
/// Frames formatted before they are written.
const BATCH: usize = 64;

/// The reading half of a protocol.
pub(super) trait Dialogue: Send {
    /// Returns the greeting of a new client.
    fn greeting(&self) -> &'static [u8] {
        b""
    }

    /// Takes bytes of the client.
    fn read(&mut self, bytes: &[u8], client: &Client);
}

/// The writing half: adds the text of a received frame; false when the protocol has none for it.
pub(super) type Scribe = Box<dyn Fn(&Stamped<Packet>, &Listening, &mut Vec<u8>) -> bool + Send>;

/// Outcome of a frame that a client sends.
pub(super) enum Sending {
    Queued,
    Refused(&'static str),
}

/// Action for a client that does not read.
pub(super) enum OnStall {
    /// The connection is closed.
    HangUp,
    /// The channel is closed and the bytes in the line are discarded: they would be stale when they are read. Contains
    /// the device end of the line, which stays open so that the line outlives its users.
    CloseChannel(OwnedFd),
}

/// State of a client's wish for frames.
#[derive(Debug)]
pub(super) struct Listening {
    /// Frames received before this are not for the client; never, while it is closed.
    from_ns: AtomicI64,
    /// Time stamps of slcan.
    pub(super) stamps: AtomicBool,
}

impl Listening {
    pub(super) fn open(&self, from: Tai) {
        self.from_ns.store(from.ns(), Ordering::Release);
    }

    pub(super) fn close(&self) {
        self.from_ns.store(i64::MAX, Ordering::Release);
    }

    pub(super) fn is_open(&self) -> bool {
        self.from_ns.load(Ordering::Acquire) != i64::MAX
    }

    /// Returns how far `now` is before the first frame wanted; not positive when frames are wanted.
    fn starts_in(&self, now: Tai) -> Span {
        Tai::from_ns(self.from_ns.load(Ordering::Acquire)) - now
    }
}

/// One client.
pub(super) struct Client {
    pub(super) link: SimulatedLink,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) tally: Arc<Tally>,
    pub(super) listening: Listening,
    pub(super) on_stall: OnStall,
    pub(super) patience: Span,
    pub(super) ended: Arc<AtomicBool>,
    /// `None` for a pseudo-terminal.
    pub(super) admission: Option<Admission>,
    is_gone: AtomicBool,
    fd: OwnedFd,
    outgoing: Mutex<Outgoing>,
}

/// The parts of a client.
pub(super) struct ClientParts {
    /// Does not block.
    pub(super) fd: OwnedFd,
    pub(super) link: SimulatedLink,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) tally: Arc<Tally>,
    pub(super) on_stall: OnStall,
    pub(super) patience: Span,
    /// Set when all gateways end.
    pub(super) ended: Arc<AtomicBool>,
    /// Admission of a TCP connection.
    pub(super) admission: Option<Admission>,
}

impl Client {
    fn new(parts: ClientParts) -> std::io::Result<Self> {
        let ClientParts { fd, link, clock, tally, on_stall, patience, ended, admission } = parts;
        let outgoing = Mutex::new(Outgoing::new(fd.try_clone()?));
        let listening = Listening { from_ns: AtomicI64::new(i64::MAX), stamps: AtomicBool::new(false) };
        let is_gone = AtomicBool::new(false);
        Ok(Self { link, clock, tally, listening, on_stall, patience, ended, admission, is_gone, fd, outgoing })
    }

    /// Returns true if the client's lines are not obeyed any more.
    pub(super) fn is_over(&self) -> bool {
        self.is_gone.load(Ordering::Acquire) || self.ended.load(Ordering::Acquire)
    }

    /// Ends the client at once, and counts why.
    pub(super) fn hang_up(&self, reason: &'static str) {
        self.tally.reject(reason);
        self.leave();
        let _ = rustix::net::shutdown(&self.fd, Shutdown::Both); // the client may be gone already
    }

    /// Ends both threads.
    fn leave(&self) {
        self.is_gone.store(true, Ordering::Release);
        self.link.wake();
    }

    /// Returns whether the other end has closed the connection, also while bytes of it are unread.
    pub(super) fn is_leaving(&self) -> bool {
        let mut fds = [event::PollFd::new(&self.fd, event::PollFlags::RDHUP)];
        self.is_over() || event::poll(&mut fds, Some(&event::Timespec::default())).is_ok_and(|ready| ready > 0)
    }

    /// Counts a valid line of the client.
    pub(super) fn count_valid(&self) {
        self.admission.iter().for_each(Admission::count_valid);
    }

    /// Records that the client has opened the bus.
    pub(super) fn open(&self) {
        self.admission.iter().for_each(Admission::open);
    }

    /// Counts a malformed line of the client: too many before the first valid one end it.
    pub(super) fn count_malformed(&self) {
        if self.admission.as_ref().is_some_and(Admission::count_malformed) {
            self.hang_up("malformed_lines");
        }
    }

    fn outgoing(&self) -> MutexGuard<'_, Outgoing> {
        self.outgoing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a frame on the bus; waits while the queue of its end is full.
    pub(super) fn send(&self, frame: &CanFrame) -> Sending {
        while self.link.space() == 0 && !self.is_over() {
            self.clock.sleep_until(self.clock.now() + SPACE);
        }
        if self.link.error_counters().state() == ErrorState::BusOff {
            return Sending::Refused("bus_off");
        }
        if self.link.put(&Packet::Can(*frame)).is_err() {
            return Sending::Refused("fd_on_classic_bus");
        }
        self.tally.lock().from_clients += 1;
        Sending::Queued
    }

    /// Writes an answer at once.
    pub(super) fn answer(&self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        if !self.outgoing().add(bytes) {
            self.tally.reject("answer_not_read");
        }
        self.flush();
    }

    /// Returns frames dropped and errors seen, of this gateway and this end.
    pub(super) fn losses(&self) -> (u64, u64) {
        (self.tally.dropped(), self.link.counters().errors)
    }

    fn flush(&self) -> Flow {
        let flow = self.outgoing().flush(self.clock.now(), self.patience);
        match flow {
            Flow::Clear | Flow::Waiting => {}
            Flow::Broken => self.leave(),
            Flow::Stalled => self.give_up(),
        }
        flow
    }

    fn give_up(&self) {
        self.tally.lock().stalled += 1;
        self.listening.close();
        let mut outgoing = self.outgoing();
        outgoing.clear();
        match &self.on_stall {
            OnStall::HangUp => self.leave(),
            OnStall::CloseChannel(device) => {
                let _ = rustix::termios::tcflush(device, QueueSelector::IFlush); // old bytes in the line are harmless
            }
        }
    }

    fn read_until_over(&self, dialogue: &mut dyn Dialogue) {
        let mut bytes = [0; 4096];
        let mut screen = Screen::default();
        self.answer(dialogue.greeting());
        while !self.is_over() {
            if !is_readable(&self.fd) {
                continue;
            }
            match rustix::io::read(&self.fd, &mut bytes) {
                Ok(count) if count > 0 => self.read(&bytes[..count], &mut screen, dialogue),
                Err(Errno::AGAIN | Errno::INTR) => {}
                Err(Errno::TIMEDOUT) => self.hang_up("connection_timed_out"),
                Ok(_) | Err(_) => self.leave(),
            }
        }
    }

    /// Passes on the bytes before the first foreign line, if one came, which ends the client.
    fn read(&self, bytes: &[u8], screen: &mut Screen, dialogue: &mut dyn Dialogue) {
        let foreign = self.admission.is_some().then(|| screen.look(bytes)).flatten();
        let ours = foreign.map_or(bytes, |(start, _)| bytes.get(..start).unwrap_or(&[]));
        dialogue.read(ours, self);
        if let Some((_, foreign)) = foreign
            && !self.is_over()
        {
            self.hang_up(foreign.name());
        }
    }

    fn write_until_over(&self, scribe: &Scribe) {
        let mut text = Vec::with_capacity(256);
        let (mut overflows, mut flow) = (0, Flow::Clear);
        while !self.is_over() {
            let now = self.clock.now();
            let starts_in = self.listening.starts_in(now);
            let look = Span::from_ms(LOOK_MS);
            if starts_in > Span::ZERO && starts_in < look {
                // Opened, and quiet for a moment more: frames wait at the end of the bus.
                self.clock.sleep_until(now + starts_in);
            }
            let wait = if flow == Flow::Clear { look } else { RETRY };
            let mut next = self.link.take_unless(now + wait, &self.is_gone);
            for _ in 0..BATCH {
                let Some(packet) = next else { break };
                self.show(&packet, scribe, &mut text);
                next = self.link.take(now);
            }
            if let Some(packet) = next {
                self.show(&packet, scribe, &mut text);
            }
            flow = self.flush();
            self.count_overflows(&mut overflows);
        }
    }

    fn show(&self, packet: &Stamped<Packet>, scribe: &Scribe, text: &mut Vec<u8>) {
        if !self.listening.is_open() {
            return;
        }
        text.clear();
        if !scribe(packet, &self.listening, text) {
            self.tally.lock().withheld += 1;
            return;
        }
        let fits = self.outgoing().add(text);
        self.tally.lock().to_clients += u64::from(fits);
        self.tally.dropped.fetch_add(u64::from(!fits), Ordering::Relaxed);
    }

    /// Counts frames lost at the end of the bus, because this thread did not take them in time.
    fn count_overflows(&self, counted: &mut u64) {
        let overflows = self.link.counters().overflows;
        if self.listening.is_open() {
            self.tally.dropped.fetch_add(overflows - *counted, Ordering::Relaxed);
        }
        *counted = overflows;
    }
}

/// Waits for input for a moment; true when there is some, or the other end is gone.
pub(super) fn is_readable(fd: &impl AsFd) -> bool {
    wait_for(fd.as_fd(), Readiness::Read, Span::from_ms(LOOK_MS)).unwrap_or(false)
}

/// A client that is served.
pub(super) struct Served {
    /// Ends when both threads of the client have.
    pub(super) thread: JoinHandle<()>,
    /// The client, while it is there.
    pub(super) client: Weak<Client>,
}

/// Serves a client in two threads.
pub(super) fn serve(parts: ClientParts, mut dialogue: Box<dyn Dialogue>, scribe: Scribe) -> std::io::Result<Served> {
    let client = Arc::new(Client::new(parts)?);
    {
        let mut counters = client.tally.lock();
        counters.clients += 1;
        counters.connected += 1;
    }
    let writing = Watched::new(&client);
    let writer = std::thread::Builder::new()
        .name("gateway writer".into())
        .spawn(move || writing.client.write_until_over(&scribe))?;
    let (reading, served) = (Watched::new(&client), Arc::downgrade(&client));
    let thread = std::thread::Builder::new().name("gateway reader".into()).spawn(move || {
        let _connected = Connected(Arc::clone(&client.tally));
        reading.client.read_until_over(&mut *dialogue);
        drop(reading);
        let _ = writer.join(); // one that panicked has counted itself
    })?;
    Ok(Served { thread, client: served })
}

/// A client, for one of its threads: when the thread ends, however it ends, the other one does too.
struct Watched {
    client: Arc<Client>,
    _counts: CountsIfLost,
}

impl Watched {
    fn new(client: &Arc<Client>) -> Self {
        Self { client: Arc::clone(client), _counts: CountsIfLost(Arc::clone(&client.tally)) }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.client.leave();
    }
}

/// Counts a client as connected until it is dropped.
struct Connected(Arc<Tally>);

impl Drop for Connected {
    fn drop(&mut self) {
        self.0.lock().connected -= 1;
    }
}

// Output to one client: a bounded buffer in front of a descriptor that never blocks.

/// Bytes that wait for a client; more are dropped and counted.
pub(super) const WAITING_MAX: usize = 64 * 1024;

/// State of a client's reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Flow {
    /// Everything is written.
    Clear,
    /// Something waits.
    Waiting,
    /// The client read nothing for too long.
    Stalled,
    /// The client is gone.
    Broken,
}

/// Bytes on their way to a client.
pub(super) struct Outgoing {
    fd: OwnedFd,
    waiting: Vec<u8>,
    stuck_since: Option<Tai>,
}

impl Outgoing {
    pub(super) fn new(fd: OwnedFd) -> Self {
        Self { fd, waiting: Vec::with_capacity(WAITING_MAX), stuck_since: None }
    }

    /// Adds all bytes, or returns false when they do not fit.
    pub(super) fn add(&mut self, bytes: &[u8]) -> bool {
        let fits = self.waiting.len() + bytes.len() <= WAITING_MAX;
        if fits {
            self.waiting.extend_from_slice(bytes);
        }
        fits
    }

    /// Writes as much as the client takes now.
    pub(super) fn flush(&mut self, now: Tai, patience: Span) -> Flow {
        let mut written = 0;
        let outcome = loop {
            let rest = &self.waiting[written..];
            if rest.is_empty() {
                break Ok(());
            }
            match rustix::io::write(&self.fd, rest) {
                Ok(count) => written += count,
                Err(Errno::INTR) => {}
                Err(error) => break Err(error),
            }
        };
        self.waiting.drain(..written);
        if written > 0 {
            self.stuck_since = None;
        }
        match outcome {
            Ok(()) => Flow::Clear,
            Err(Errno::AGAIN) => {
                let since = *self.stuck_since.get_or_insert(now);
                if now - since >= patience { Flow::Stalled } else { Flow::Waiting }
            }
            Err(_) => Flow::Broken,
        }
    }

    /// Discards the waiting bytes.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.stuck_since = None;
    }
}
