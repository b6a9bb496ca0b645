//! Recognises clients that speak another protocol: HTTP, which any web page can send to a port of this machine, and
//! TLS.
//!
//! In: the bytes of one connection, in runs of any length. Out: where the first line that belongs to another protocol
//! starts, and which protocol it is. Pure: no socket, no allocation. A web page may send a POST whose body has valid
//! lines of our protocol, so the connection must be closed at its first line, before the body. Recognised are a request
//! line (a known method and a space, or any word followed by a target and `HTTP/`), a header (`Name:`), both in either
//! case, and a TLS record that opens the connection. A WebSocket starts with an HTTP request. Tests: below.

use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use rustix::net::sockopt;
use std::{os::fd::AsFd, time::Duration};

/// Methods that are recognised without their version, in lower case; `pri` starts HTTP/2.
const METHODS: [&[u8]; 10] =
    [b"get", b"head", b"post", b"put", b"delete", b"connect", b"options", b"trace", b"patch", b"pri"];
/// Longest of them.
const METHOD_MAX: usize = 7;
/// Shortest name of a header: `TE`.
const NAME_MIN: usize = 2;
/// Start of an HTTP version, in lower case.
const VERSION: &[u8] = b"http/";
/// First bytes of a TLS record with a handshake (RFC 8446 5.1).
const TLS: [u8; 2] = [0x16, 0x03];

base::words! {
    /// A protocol that is not ours.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Foreign {
        /// HTTP, WebSocket included.
        Http = "http_request",
        /// TLS.
        Tls = "tls_handshake",
    }
}

/// Bytes after which [`opens_another_protocol`] knows.
pub(crate) const OPENING_BYTES: usize = METHOD_MAX + 1;

/// Returns true when a connection that begins with these bytes is HTTP (a method and a space, in either case) or TLS.
/// For streams of any bytes, in which a later line may look like a header.
pub(crate) fn opens_another_protocol(first: &[u8]) -> bool {
    let is_method = |method: &&[u8]| {
        let rest = first.get(..method.len()).filter(|begin| begin.eq_ignore_ascii_case(method));
        rest.is_some() && first.get(method.len()) == Some(&b' ')
    };
    METHODS.iter().any(is_method) || first.starts_with(&TLS)
}

/// Place of the screen in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// The first word, after so many of its bytes.
    Word(usize),
    /// After the first word and a space.
    Target,
    /// After a space that follows the target: so many bytes of the version have come.
    Version(usize),
    /// A line that cannot become HTTP.
    Ours,
}

/// Looks at the bytes of one connection.
#[derive(Debug, Clone)]
pub struct Screen {
    /// Bytes of a TLS record so far; `None` once the connection cannot be TLS.
    tls: Option<usize>,
    place: Place,
    /// The first word in lower case, as far as it may be a method.
    word: [u8; METHOD_MAX],
    found: Option<Foreign>,
}

impl Default for Screen {
    fn default() -> Self {
        Self { tls: Some(0), place: Place::Word(0), word: [0; METHOD_MAX], found: None }
    }
}

impl Screen {
    /// Takes the next bytes; where the first foreign line starts in them (0 when it started earlier), and its protocol.
    /// Once found, everything that follows is foreign too.
    pub fn look(&mut self, bytes: &[u8]) -> Option<(usize, Foreign)> {
        let mut line = 0;
        for (at, byte) in bytes.iter().enumerate() {
            if self.found.is_some() {
                break;
            }
            if matches!(byte, b'\r' | b'\n') {
                (self.place, line) = (Place::Word(0), at + 1);
            }
            self.take(*byte);
        }
        self.found.map(|foreign| (line, foreign))
    }

    fn take(&mut self, byte: u8) {
        if let Some(matched) = self.tls.take()
            && TLS.get(matched) == Some(&byte)
        {
            self.tls = Some(matched + 1);
            self.found = (matched + 1 == TLS.len()).then_some(Foreign::Tls);
            return;
        }
        let letter = byte.to_ascii_lowercase();
        self.place = match self.place {
            Place::Word(_) if matches!(byte, b'\r' | b'\n') => Place::Word(0),
            Place::Word(count) if is_of_a_word(byte) => self.grow(count, letter),
            Place::Word(count) if count >= NAME_MIN && byte == b':' => self.find(),
            Place::Word(count) if count > 0 && byte == b' ' => {
                let is_method = self.word.get(..count).is_some_and(|word| METHODS.contains(&word));
                if is_method { self.find() } else { Place::Target }
            }
            Place::Target if byte == b' ' => Place::Version(0),
            Place::Target => Place::Target,
            Place::Version(matched) if VERSION.get(matched) == Some(&letter) => {
                if matched + 1 == VERSION.len() {
                    self.find()
                } else {
                    Place::Version(matched + 1)
                }
            }
            Place::Version(_) if byte == b' ' => Place::Version(0),
            Place::Version(_) => Place::Target,
            Place::Word(_) | Place::Ours => Place::Ours,
        };
    }

    fn grow(&mut self, count: usize, letter: u8) -> Place {
        if let Some(place) = self.word.get_mut(count) {
            *place = letter;
        }
        Place::Word(count + 1)
    }

    fn find(&mut self) -> Place {
        self.found = Some(Foreign::Http);
        Place::Ours
    }
}

/// Returns true for the characters of a method or a header's name (RFC 9110 5.6.2).
fn is_of_a_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b"!#$%&'*+-.^_`|~".contains(&byte)
}

// Conditions under which a connection may stay: the lines it must send, and their deadline.
//
// A TCP connection costs nothing to make, so a seat belongs to a client only once it has opened the bus (`O` or `L` of
// slcan, `< open >` of socketcand). Until then it is closed after [`OPENING_WITHIN`], or after [`GRACE`] when another
// client waits for its seat. A client that has opened the bus keeps its seat, however quiet it is. A connection is
// closed at the [`MALFORMED_MAX`]th malformed line before its first valid one. TCP alone: a pseudo-terminal has one
// line, which outlives its users.

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

    /// Returns the protocol found in `bytes`, after checking that it is the same however they are cut in two.
    fn found(bytes: &[u8]) -> Option<Foreign> {
        let whole = Screen::default().look(bytes);
        for cut in 0..bytes.len() {
            let mut screen = Screen::default();
            let first = screen.look(&bytes[..cut]);
            let second = screen.look(&bytes[cut..]);
            assert_eq!(second.map(|(_, foreign)| foreign), whole.map(|(_, foreign)| foreign), "cut at {cut}");
            if let (Some((start, _)), None) = (whole, first) {
                assert_eq!(second.map(|(at, _)| at), Some(start.saturating_sub(cut)), "cut at {cut}");
            }
        }
        whole.map(|(_, foreign)| foreign)
    }

    #[test]
    fn http_of_every_kind_is_found() {
        let long = format!("FETCH /{} HTTP/1.1\r\n", "x".repeat(9000));
        for text in [
            "POST / HTTP/1.1\r\n",
            "POST ",
            "get /",
            "Options * HTTP/1.1",
            "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            "BREW /pot HTTP/1.1",
            "brew /a b c http/1.0",
            &long,
            "Host: 127.0.0.1:29600",
            "host:x",
            "\r\n\r\nContent-Type: text/plain",
            "O\rX-Anything:1",
            "{\"request\": \"hello\"}\nOrigin: http://evil.example",
        ] {
            assert_eq!(found(text.as_bytes()), Some(Foreign::Http), "{}", &text[..text.len().min(60)]);
        }
    }

    #[test]
    fn a_tls_handshake_is_found_at_the_start_of_a_connection_only() {
        assert_eq!(found(&[0x16, 0x03, 0x01, 0x02, 0x00, 0x01]), Some(Foreign::Tls));
        assert_eq!(found(b"O\r\x16\x03\x01"), None);
        assert_eq!(found(&[0x16, 0x04]), None);
    }

    #[test]
    fn our_own_lines_pass() {
        for text in [
            "",
            "\r\r\rC\rS6\rY2\rZ1\rO\rt1232AABB\rb30190102030405060708090A0B0C\r",
            "M00000000\rmFFFFFFFF\rV\rv\rN\rF\r",
            "< open can0 >< rawmode >\r\n< send 12 2 1 2 >  < echo >",
            "{\"request\": \"frame\", \"path\": \"a: b HTTP/1.1\"}\n",
            "[1]\nhello\nPOSTER\nGETTING ON\n:\nV:\n",
        ] {
            assert_eq!(found(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn openings_of_other_protocols_are_known_by_their_first_bytes() {
        for foreign in [&b"GET / HTTP"[..], b"post /x", b"OPTIONS ", b"\x16\x03\x01"] {
            assert!(opens_another_protocol(foreign.get(..OPENING_BYTES).unwrap_or(foreign)), "{foreign:?}");
        }
        for ours in [&b""[..], b"GE", b"GETAWAY ", b"{\"t\":1}", b"1.5, 1 0", b"TIME 2025", &1.5_f64.to_le_bytes()] {
            assert!(!opens_another_protocol(ours), "{ours:?}");
        }
    }

    #[test]
    fn the_start_of_the_foreign_line_is_given_and_what_follows_stays_foreign() {
        let mut screen = Screen::default();
        assert_eq!(screen.look(b"O\rt1230\r\nPOST / HTTP/1.1\r\n\r\nO\r"), Some((9, Foreign::Http)));
        assert_eq!(screen.look(b"O\r"), Some((0, Foreign::Http)), "for good");
    }
}

#[cfg(test)]
mod admission_tests {
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
