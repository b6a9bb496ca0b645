//! A connection that never blocks: reads the bytes that wait, writes whole messages or gives the connection up.

use crate::readiness::{Readiness, wait_for};
use base::time::Span;
use rustix::net::sockopt::{set_socket_keepalive, set_tcp_keepcnt, set_tcp_keepidle, set_tcp_keepintvl};
use std::io::{self, ErrorKind, Read, Write};
use std::{net::TcpStream, os::fd::AsFd, time::Duration};

/// A client that reads nothing for this long is given up.
const WRITE_LIMIT: Span = Span::from_ms(50);
/// A connection whose other end is silently gone is found to be lost after some 8 s.
const KEEP_IDLE: Duration = Duration::from_secs(5);

/// One connection.
pub(super) struct Stream {
    inner: TcpStream,
}

/// Result of one read.
pub(super) enum Got {
    /// So many bytes.
    Bytes(usize),
    /// No bytes for now.
    Nothing,
    /// The connection is over.
    End,
}

impl Stream {
    pub(super) fn over(inner: TcpStream) -> io::Result<Self> {
        inner.set_nonblocking(true)?;
        inner.set_nodelay(true)?;
        keep_alive(&inner)?;
        Ok(Self { inner })
    }

    pub(super) fn read(&mut self, bytes: &mut [u8]) -> Got {
        match self.inner.read(bytes) {
            Ok(0) => Got::End,
            Ok(count) => Got::Bytes(count),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Got::Nothing,
            Err(_) => Got::End,
        }
    }

    /// Writes all of it; false when the other end does not take it, and the connection is of no more use.
    pub(super) fn write(&mut self, mut bytes: &[u8]) -> bool {
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
