//! Conditions under which a connection may stay: the lines it must send, and their deadline.
//!
//! A TCP connection costs nothing to make, so a seat belongs to a client only once it has opened the bus (`O` or `L` of
//! slcan, `< open >` of socketcand). Until then it is closed after [`OPENING_WITHIN`], or after [`GRACE`] when another
//! client waits for its seat. A client that has opened the bus keeps its seat, however quiet it is. A connection is
//! closed at the [`MALFORMED_MAX`]th malformed line before its first valid one. TCP alone: a pseudo-terminal has one
//! line, which outlives its users.

use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use rustix::net::sockopt;
use std::{os::fd::AsFd, time::Duration};

/// Malformed lines before the first valid one at which a connection is closed.
pub const MALFORMED_MAX: u32 = 8;
/// Time that a connection has to open the bus when no other client waits.
pub const OPENING_WITHIN: Span = Span::from_ms(30_000);
/// Time that a connection has to open the bus when another client waits for its seat.
pub const GRACE: Span = Span::from_ms(1000);

/// Silence after which the system asks whether the other end is still there.
const KEEP_ALIVE_AFTER: Duration = Duration::from_secs(10);
/// Between two such questions.
const KEEP_ALIVE_EVERY: Duration = Duration::from_secs(5);
/// Questions without an answer after which a connection is lost.
const KEEP_ALIVE_TRIES: u32 = 3;
/// Time after which a connection is lost whose bytes are not acknowledged: as long as all questions take.
const UNACKNOWLEDGED_MAX_MS: u32 = 25_000;

/// Progress of one connection.
#[derive(Debug)]
pub(super) struct Admission {
    since: Tai,
    has_opened: AtomicBool,
    has_sent_a_valid_line: AtomicBool,
    malformed: AtomicU32,
}

impl Admission {
    pub(super) fn new(since: Tai) -> Self {
        let [has_opened, has_sent_a_valid_line] = [AtomicBool::new(false), AtomicBool::new(false)];
        Self { since, has_opened, has_sent_a_valid_line, malformed: AtomicU32::new(0) }
    }

    /// Records that the client has opened the bus: it keeps its place.
    pub(super) fn open(&self) {
        self.has_opened.store(true, Ordering::Release);
    }

    /// Counts a valid line of the protocol.
    pub(super) fn count_valid(&self) {
        self.has_sent_a_valid_line.store(true, Ordering::Release);
    }

    /// Counts a malformed line; returns true when the connection is to be closed.
    pub(super) fn count_malformed(&self) -> bool {
        let before = self.malformed.fetch_add(1, Ordering::AcqRel);
        !self.has_sent_a_valid_line.load(Ordering::Acquire) && before + 1 >= MALFORMED_MAX
    }

    /// Returns true if the client has not opened the bus within `limit` of its arrival.
    pub(super) fn is_idle(&self, now: Tai, limit: Span) -> bool {
        !self.has_opened.load(Ordering::Acquire) && now - self.since >= limit
    }

    /// Returns true if the client has not opened the bus.
    pub(super) fn may_lose_its_seat(&self) -> bool {
        !self.has_opened.load(Ordering::Acquire)
    }
}

/// Lets the system notice a client whose machine or cable is gone without a word: after 25 s its reads fail.
pub(super) fn keep_alive(socket: &impl AsFd) -> rustix::io::Result<()> {
    sockopt::set_socket_keepalive(socket, true)?;
    sockopt::set_tcp_keepidle(socket, KEEP_ALIVE_AFTER)?;
    sockopt::set_tcp_keepintvl(socket, KEEP_ALIVE_EVERY)?;
    sockopt::set_tcp_keepcnt(socket, KEEP_ALIVE_TRIES)?;
    sockopt::set_tcp_user_timeout(socket, UNACKNOWLEDGED_MAX_MS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn malformed_lines_count_only_before_the_first_valid_one() {
        let admission = Admission::new(Tai::from_ns(0));
        assert!((1..MALFORMED_MAX).all(|_| !admission.count_malformed()), "one short of the limit");
        assert!(admission.count_malformed(), "the limit");
        let admission = Admission::new(Tai::from_ns(0));
        admission.count_valid();
        assert!((0..10 * MALFORMED_MAX).all(|_| !admission.count_malformed()), "a noisy line of a known client");
    }

    #[test]
    fn a_connection_is_idle_until_it_has_opened_the_bus() {
        let admission = Admission::new(Tai::from_ns(0));
        let at = |ms| Tai::from_ns(0) + Span::from_ms(ms);
        assert!(!admission.is_idle(at(999), GRACE) && admission.is_idle(at(1000), GRACE));
        admission.count_valid();
        assert!(admission.is_idle(at(1000), GRACE), "asking for the version does not open the bus");
        admission.open();
        assert!(!admission.is_idle(at(1_000_000), GRACE));
    }

    #[test]
    fn a_silent_connection_is_asked_whether_it_is_there() {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let stream = std::net::TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        assert!(!sockopt::socket_keepalive(&stream).unwrap(), "not by itself");
        keep_alive(&stream).unwrap();
        assert!(sockopt::socket_keepalive(&stream).unwrap());
        assert_eq!(sockopt::tcp_keepidle(&stream).unwrap(), KEEP_ALIVE_AFTER);
        let all_ms = KEEP_ALIVE_AFTER.as_millis() + u128::from(KEEP_ALIVE_TRIES) * KEEP_ALIVE_EVERY.as_millis();
        assert_eq!(u128::from(sockopt::tcp_user_timeout(&stream).unwrap()), all_ms);
    }
}
