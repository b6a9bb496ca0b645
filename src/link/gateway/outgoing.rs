//! Output to one client: a bounded buffer in front of a descriptor that never blocks.

use base::time::{Span, Tai};
use rustix::io::Errno;
use std::os::fd::OwnedFd;

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
