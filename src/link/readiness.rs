//! Waiting for a descriptor with a limit: sleeps in `ppoll`, to the nanosecond of the limit, and never spins.

use base::time::Span;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};

/// Event that is waited for. Hang-ups and errors end every wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Readiness {
    /// Something can be read.
    Read,
    /// Something can be written.
    Write,
}

/// Returns when it is so, after `span` at the latest, or when a signal came. Returns true if the event has occurred.
pub(super) fn wait_for(fd: BorrowedFd<'_>, wanted: Readiness, span: Span) -> io::Result<bool> {
    let flags = match wanted {
        Readiness::Read => PollFlags::IN,
        Readiness::Write => PollFlags::OUT,
    };
    wait(&mut [PollFd::from_borrowed_fd(fd, flags)], span)
}

/// Returns when one of them can be read, after `span` at the latest, or when a signal came.
pub(super) fn wait_for_any(fds: &[BorrowedFd<'_>], span: Span) -> io::Result<()> {
    let mut polled: Vec<PollFd<'_>> = fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)).collect();
    wait(&mut polled, span).map(drop)
}

fn wait(polled: &mut [PollFd<'_>], span: Span) -> io::Result<bool> {
    let ns = span.ns().max(0);
    let limit = Timespec { tv_sec: ns / 1_000_000_000, tv_nsec: ns % 1_000_000_000 };
    match poll(polled, Some(&limit)) {
        Ok(count) => Ok(count > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

// The receive buffer of a socket: seconds of any sender that a bench has, a quarter of a second of a full 1 Mbit/s bus of
// short frames.

/// Size asked for.
const BYTES: usize = 4 << 20;

/// Enlarges it: beyond the system's limit (`net.core.rmem_max`) where the rights suffice, else up to it.
pub(super) fn enlarge(socket: &impl AsFd) -> io::Result<()> {
    set_socket_recv_buffer_size_force(socket, BYTES).or_else(|_| set_socket_recv_buffer_size(socket, BYTES))?;
    Ok(())
}
