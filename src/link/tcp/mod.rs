//! Records or lines over TCP: the connection of an outside simulator <-> `Link`.
//!
//! * Server: listens, and takes one client at a time; another one is refused and counted. A client that has sent no
//!   message gives way to another one (`seat`). Client: connects, also again after the connection is lost, every
//!   [`RETRY`]; tries that fail are counted. A connection that ends after a message counts as lost, the next one as
//!   regained.
//! * Where the reader knows messages ([`TcpLink::with_reader`]), a connection that brings [`REFUSED_MAX`] others in a row is
//!   hung up on: after a stray byte all records would be cut wrongly for good.
//! * A stream has no borders: [`Framing`] finds them again, in bounded memory. Lines longer than [`crate::DATAGRAM_MAX`] are
//!   refused and counted. The rest of a message whose connection ended is forgotten.
//! * Stamps are the instant of reading: the kernel gives none for a stream.
//! * Where wanted ([`TcpParams::acknowledges`]), the answer of a receiver of 42 goes out after each `[ENDMSG]`.
//!
//! Nothing is read from a client that has not been taken. Tests: `tests` here, `tests/links/plain.rs`.

mod link;
mod seat;

pub use link::{IsMessage, TcpLink};
pub use seat::{Seat, SeatChange};

use crate::readiness::{Readiness, wait_for};
use crate::{DATAGRAM_MAX, Datagram};
use base::time::Span;
use rustix::net::sockopt::{set_socket_keepalive, set_tcp_keepcnt, set_tcp_keepidle, set_tcp_keepintvl};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::{os::fd::AsFd, time::Duration};

// A connection that never blocks: reads the bytes that wait, writes whole messages or gives the connection up.

/// A client that reads nothing for this long is given up.
const WRITE_LIMIT: Span = Span::from_ms(50);
/// A connection whose other end is silently gone is found to be lost after some 8 s.
const KEEP_IDLE: Duration = Duration::from_secs(5);

/// One connection.
struct Stream {
    inner: TcpStream,
}

/// Result of one read.
enum Got {
    /// So many bytes.
    Bytes(usize),
    /// No bytes for now.
    Nothing,
    /// The connection is over.
    End,
}

impl Stream {
    fn over(inner: TcpStream) -> io::Result<Self> {
        inner.set_nonblocking(true)?;
        inner.set_nodelay(true)?;
        keep_alive(&inner)?;
        Ok(Self { inner })
    }

    fn read(&mut self, bytes: &mut [u8]) -> Got {
        match self.inner.read(bytes) {
            Ok(0) => Got::End,
            Ok(count) => Got::Bytes(count),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Got::Nothing,
            Err(_) => Got::End,
        }
    }

    /// Writes all of it; false when the other end does not take it, and the connection is of no more use.
    fn write(&mut self, mut bytes: &[u8]) -> bool {
        while !bytes.is_empty() {
            match self.inner.write(bytes) {
                Ok(0) => return false,
                Ok(count) => bytes = bytes.get(count..).unwrap_or(&[]),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    if !self.is_writable() {
                        return false;
                    }
                }
                Err(_) => return false,
            }
        }
        true
    }

    fn is_writable(&self) -> bool {
        wait_for(self.inner.as_fd(), Readiness::Write, WRITE_LIMIT).is_ok_and(|is_ready| is_ready)
    }
}

/// Lets the system notice that the other end of a connection is silently gone: after some 8 s its reads fail.
///
/// # Errors
/// When the connection is gone already.
pub fn keep_alive(stream: &TcpStream) -> io::Result<()> {
    set_socket_keepalive(stream, true)?;
    set_tcp_keepidle(stream, KEEP_IDLE)?;
    set_tcp_keepintvl(stream, Duration::from_secs(1))?;
    Ok(set_tcp_keepcnt(stream, 3)?)
}

impl AsFd for Stream {
    fn as_fd(&self) -> std::os::fd::BorrowedFd<'_> {
        self.inner.as_fd()
    }
}

// Where messages end in a stream of bytes.

/// Rule for the end of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// After so many bytes, 1 to [`DATAGRAM_MAX`].
    Records(usize),
    /// At the end of a line; the line break is not part of the message. Empty lines are left out.
    Lines,
}

/// Bytes of a stream that do not yet complete a message.
struct Reassembly {
    framing: Framing,
    bytes: Vec<u8>,
    /// Whether the present line is too long: bytes up to its end are left out.
    is_skipping: bool,
    /// Lines that were too long.
    oversize: u64,
}

impl Reassembly {
    fn new(framing: Framing) -> Self {
        Self { framing, bytes: Vec::with_capacity(DATAGRAM_MAX), is_skipping: false, oversize: 0 }
    }

    /// Discards the unfinished message.
    fn clear(&mut self) {
        self.bytes.clear();
        self.is_skipping = false;
    }

    /// Takes bytes from the front of `rest` until a message is whole; `None` when there are no more.
    fn next(&mut self, rest: &mut &[u8]) -> Option<Datagram> {
        match self.framing {
            Framing::Records(length) => self.next_record(rest, length.clamp(1, DATAGRAM_MAX)),
            Framing::Lines => core::iter::from_fn(|| self.next_line(rest)).find_map(|line| line),
        }
    }

    fn next_record(&mut self, rest: &mut &[u8], length: usize) -> Option<Datagram> {
        let wanted = (length - self.bytes.len()).min(rest.len());
        let (taken, left) = rest.split_at(wanted);
        *rest = left;
        self.bytes.extend_from_slice(taken);
        (self.bytes.len() == length).then(|| self.whole()).flatten()
    }

    /// Returns the next line: `None` without a whole line; `Some(None)` for one that is left out.
    fn next_line(&mut self, rest: &mut &[u8]) -> Option<Option<Datagram>> {
        let end = rest.iter().position(|byte| *byte == b'\n');
        let (taken, left) = rest.split_at(end.unwrap_or(rest.len()));
        *rest = left.get(1..).unwrap_or(&[]);
        if self.bytes.len() + taken.len() > DATAGRAM_MAX {
            self.oversize += u64::from(!self.is_skipping);
            self.is_skipping = true;
            self.bytes.clear();
        } else if !self.is_skipping {
            self.bytes.extend_from_slice(taken);
        }
        end?;
        if core::mem::take(&mut self.is_skipping) {
            return Some(None);
        }
        if self.bytes.last() == Some(&b'\r') {
            self.bytes.pop();
        }
        Some(self.whole().filter(|line| !line.as_slice().is_empty()))
    }

    fn whole(&mut self) -> Option<Datagram> {
        let message = Datagram::new(&self.bytes);
        self.bytes.clear();
        message
    }
}

#[cfg(test)]
mod tests;

/// A lost connection is tried again this often.
pub const RETRY: Span = Span::from_ms(200);

/// Records or lines in a row that hold no message, after which a connection is hung up on.
pub const REFUSED_MAX: u32 = 32;

/// Side that connects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TcpRole {
    /// The other end, to this address.
    Server(SocketAddr),
    /// This end, to that address.
    Client(SocketAddr),
}

/// Parameters of the connection and of the messages on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpParams {
    /// Side that connects.
    pub role: TcpRole,
    /// Rule for the end of messages.
    pub framing: Framing,
    /// Answers each message of 42.
    pub acknowledges: bool,
}
