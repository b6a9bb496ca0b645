//! `Link` over a serial port or the master of a pseudo terminal.

use super::{DELIMITER, PseudoTerminal, RETRY, SerialParams, name, open_port};
use crate::readiness::{Readiness, wait_for};
use crate::{CHUNK_MAX, Link, LinkCounters, LinkError, Packet, SerialChunk, Stamped};
use base::time::{Span, Tai};
use base::{clock::Clock, units::NS_PER_S};
use rustix::io::Errno;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::{io, sync::Arc};

/// The shortest limit of a write, whatever the baud rate: a wake-up may take this long.
const WRITE_LIMIT_MIN: Span = Span::from_ms(2);

/// One end of a serial line.
pub struct SerialLink {
    params: SerialParams,
    clock: Arc<dyn Clock>,
    /// `None` while the port is lost.
    port: Option<Port>,
    retry_at: Tai,
    write_limit: Span,
    unmark: Unmark,
    /// The last packet was cut off: a delimiter is due.
    is_torn: bool,
    counters: LinkCounters,
}

enum Port {
    Device(OwnedFd),
    Master(PseudoTerminal),
}

impl AsFd for Port {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Device(fd) => fd.as_fd(),
            Self::Master(terminal) => terminal.as_fd(),
        }
    }
}

/// Outcome of a write.
enum Written {
    Whole,
    /// Given up; true when a part of it is out.
    GivenUp(bool),
    Lost,
}

impl SerialLink {
    /// Opens a port.
    ///
    /// # Errors
    /// When it is absent (the ports that exist are listed), in use or forbidden, or its driver does not take the
    /// settings; each with advice.
    pub fn open(params: SerialParams, clock: &Arc<dyn Clock>) -> Result<Self, LinkError> {
        let port = Port::Device(open_port(&params)?);
        Ok(Self::over(port, params, clock))
    }

    /// Returns the master's end of a pseudo terminal; `baud` is that of the line it replaces and limits the time of a
    /// write.
    pub fn of_terminal(terminal: PseudoTerminal, baud: u32, clock: &Arc<dyn Clock>) -> Self {
        let params = SerialParams::new(terminal.path(), baud);
        Self::over(Port::Master(terminal), params, clock)
    }

    fn over(port: Port, params: SerialParams, clock: &Arc<dyn Clock>) -> Self {
        let bits = 2 * CHUNK_MAX as i64 * params.bits_per_byte();
        let two_chunks = Span::from_ns(bits * NS_PER_S / i64::from(params.baud.max(1)));
        Self {
            params,
            clock: Arc::clone(clock),
            port: Some(port),
            retry_at: Tai::from_ns(i64::MIN),
            write_limit: two_chunks.max(WRITE_LIMIT_MIN),
            unmark: Unmark::default(),
            is_torn: false,
            counters: LinkCounters::default(),
        }
    }

    /// Returns true while the port is there.
    pub fn is_up(&self) -> bool {
        self.port.is_some()
    }

    /// Looks for a lost port when it is time to.
    fn regain(&mut self) {
        let now = self.clock.now();
        if self.port.is_some() || now < self.retry_at {
            return;
        }
        self.retry_at = now + RETRY;
        // Whatever is wrong may pass: the port was there once.
        if let Ok(port) = open_port(&self.params) {
            self.port = Some(Port::Device(port));
            self.unmark = Unmark::default();
            self.is_torn = false;
            self.counters.regained += 1;
        }
    }

    /// Counts the loss of the port. The master's end of a pseudo terminal cannot be opened again.
    fn lose(&mut self) {
        let was_master = matches!(self.port.take(), Some(Port::Master(_)));
        self.counters.lost += 1;
        self.retry_at = if was_master { Tai::from_ns(i64::MAX) } else { self.clock.now() + RETRY };
    }

    fn failed(&self, doing: &'static str, source: io::Error) -> LinkError {
        LinkError::System { link: name(&self.params), doing, source, advice: "" }
    }

    /// Returns one read: everything that has arrived, up to a chunk.
    fn read(&mut self) -> Result<Option<Stamped<Packet>>, LinkError> {
        self.regain();
        let Some(port) = &self.port else { return Ok(None) };
        let mut bytes = [0; CHUNK_MAX];
        let got = rustix::io::read(port, &mut bytes);
        let at = self.clock.now();
        match got {
            // The end of a file is a hang-up here.
            Ok(0) => self.lose(),
            Ok(len) => return Ok(self.take(at, &mut bytes[..len])),
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) if is_unplugged(error) => self.lose(),
            Err(error) => return Err(self.failed("receive", error.into())),
        }
        Ok(None)
    }

    /// Returns the bytes as a chunk; `None` when only the start of a mark was read.
    fn take(&mut self, at: Tai, bytes: &mut [u8]) -> Option<Stamped<Packet>> {
        let len = match self.port {
            // The master reads the bytes that its port wrote: they contain no marks.
            Some(Port::Master(_)) => bytes.len(),
            _ => {
                let (len, errors) = self.unmark.take(bytes);
                self.counters.errors += errors;
                len
            }
        };
        let chunk = SerialChunk::new(bytes.get(..len)?).filter(|_| len > 0)?;
        self.counters.received += 1;
        Some(Stamped { at, value: Packet::Serial(chunk) })
    }

    fn wait(&mut self, now: Tai, until: Tai) -> Result<(), LinkError> {
        let Some(port) = &self.port else {
            self.clock.sleep_until(until.min(self.retry_at));
            return Ok(());
        };
        wait_for(port.as_fd(), Readiness::Read, until - now)
            .map(drop)
            .map_err(|error| self.failed("wait for bytes", error))
    }

    /// Writes all of `bytes`, or as many as are sent before `limit`.
    fn write(&self, mut bytes: &[u8], limit: Tai) -> Result<Written, LinkError> {
        let Some(port) = &self.port else { return Ok(Written::GivenUp(false)) };
        let whole = bytes.len();
        while !bytes.is_empty() {
            match rustix::io::write(port, bytes) {
                Ok(len) => bytes = bytes.get(len..).unwrap_or(&[]),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => {
                    let left = limit - self.clock.now();
                    if left <= Span::ZERO || !self.clock.is_real() {
                        return Ok(Written::GivenUp(bytes.len() < whole));
                    }
                    wait_for(port.as_fd(), Readiness::Write, left)
                        .map_err(|error| self.failed("wait to send", error))?;
                }
                Err(error) if is_unplugged(error) => return Ok(Written::Lost),
                Err(error) => return Err(self.failed("send", error.into())),
            }
        }
        Ok(Written::Whole)
    }

    /// Ends a packet that was cut off; then sends.
    fn write_packet(&mut self, bytes: &[u8]) -> Result<Written, LinkError> {
        let limit = self.clock.now() + self.write_limit;
        if self.is_torn {
            match self.write(&[DELIMITER], limit)? {
                Written::Whole => self.is_torn = false,
                stuck @ (Written::GivenUp(_) | Written::Lost) => return Ok(stuck),
            }
        }
        self.write(bytes, limit)
    }
}

impl Link for SerialLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        loop {
            if let Some(chunk) = self.read()? {
                return Ok(Some(chunk));
            }
            let now = self.clock.now();
            if !self.clock.is_real() || now >= until {
                return Ok(None);
            }
            self.wait(now, until)?;
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let Packet::Serial(chunk) = packet else {
            let (wanted, got) = ("serial", packet.kind());
            return Err(LinkError::WrongPacket { link: name(&self.params), wanted, got });
        };
        self.regain();
        match self.write_packet(chunk.as_slice())? {
            Written::Whole => self.counters.sent += 1,
            Written::GivenUp(is_torn) => {
                self.is_torn |= is_torn;
                self.counters.unsent += 1;
            }
            Written::Lost => {
                self.counters.unsent += 1;
                self.lose();
            }
        }
        Ok(self.clock.now())
    }

    fn counters(&self) -> LinkCounters {
        self.counters
    }
}

/// Returns true if the port is gone, or no program has its other end open.
fn is_unplugged(error: Errno) -> bool {
    matches!(error, Errno::IO | Errno::NODEV | Errno::NXIO | Errno::PIPE | Errno::BADF)
}

// Bytes as the terminal gives them, errors marked -> bytes of the line, errors counted.
//
// With PARMRK (POSIX, termios) a byte that came with a parity or framing error, or a break, is read as `FF 00 XX`, and
// a good byte FF as `FF FF`. A damaged byte becomes the delimiter 00: its packet ends there and is rejected, whatever
// the byte was.

const MARK: u8 = 0xFF;
const DAMAGED: u8 = 0x00;

/// Takes the marks out. A mark may begin in one read and end in the next.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unmark {
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    #[default]
    Plain,
    /// After FF.
    Marked,
    /// After FF 00.
    Damaged,
}

impl Unmark {
    /// Takes the marks out in place: number of bytes left at the front, and of damaged ones among them.
    pub(super) fn take(&mut self, bytes: &mut [u8]) -> (usize, u64) {
        let (mut len, mut errors) = (0, 0);
        for at in 0..bytes.len() {
            let byte = bytes[at];
            let (next, out) = match (self.state, byte) {
                (State::Plain, MARK) => (State::Marked, None),
                (State::Marked, DAMAGED) => (State::Damaged, None),
                (State::Damaged, _) => {
                    errors += 1;
                    (State::Plain, Some(DELIMITER))
                }
                // FF FF is a good FF. Nothing else should follow FF; another byte is taken as it is.
                (State::Plain | State::Marked, byte) => (State::Plain, Some(byte)),
            };
            self.state = next;
            if let Some(out) = out {
                bytes[len] = out;
                len += 1;
            }
        }
        (len, errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take(unmark: &mut Unmark, bytes: &[u8]) -> (Vec<u8>, u64) {
        let mut bytes = bytes.to_vec();
        let (len, errors) = unmark.take(&mut bytes);
        bytes.truncate(len);
        (bytes, errors)
    }

    #[test]
    fn marks_are_taken_out_and_damage_counted() {
        let cases: [(&[u8], &[u8], u64); 6] = [
            (&[1, 0, 2], &[1, 0, 2], 0),
            (&[0xFF, 0xFF, 0xFF, 0xFF], &[0xFF, 0xFF], 0),
            (&[1, 0xFF, 0, 0x41, 2], &[1, 0, 2], 1),
            (&[0xFF, 0, 0], &[0], 1),
            (&[0xFF, 0, 0xFF, 0xFF, 0xFF], &[0, 0xFF], 1),
            (&[0xFF, 0, 1, 0xFF, 0, 2], &[0, 0], 2),
        ];
        for (read, line, errors) in cases {
            assert_eq!(take(&mut Unmark::default(), read), (line.to_vec(), errors), "{read:02x?}");
        }
    }

    #[test]
    fn reads_may_end_anywhere() {
        let read = [1, 0xFF, 0xFF, 0xFF, 0, 0x41, 2, 0xFF, 0, 0, 3];
        for border in 0..=read.len() {
            let mut unmark = Unmark::default();
            let (front, back) = read.split_at(border);
            let (mut line, mut errors) = take(&mut unmark, front);
            let rest = take(&mut unmark, back);
            line.extend(rest.0);
            errors += rest.1;
            assert_eq!((line, errors), (vec![1, 0xFF, 0, 2, 0, 3], 2), "border at {border}");
        }
    }
}
