//! The one seat of a TCP server: who has it, and when it goes to somebody else.
//!
//! A connection costs nothing to make, so the seat belongs to a client only once it has spoken. Until then it gives way
//! to a newcomer after [`GRACE`]; where a client must speak first, its connection is also closed after
//! [`OPENING_WITHIN`]. Of the newcomers the last one waits; all others are hung up on. A look accepts [`ACCEPTS`]
//! connections at most, and rests for [`REST`] when the system has no descriptor left for one. The owner has the
//! stream; time is an argument. Tests: `tests`.

use crate::gateway::{GRACE, OPENING_WITHIN};
use base::time::{Span, Tai};
use rustix::io::Errno;
use std::io::{self, ErrorKind};
use std::net::{TcpListener, TcpStream};

/// Connections that are accepted in one look.
const ACCEPTS: usize = 16;
/// Pause after an accept for which the system lacked a descriptor or memory.
const REST: Span = Span::from_ms(100);

/// State of the seat.
#[derive(Debug)]
pub enum SeatChange {
    /// Nothing.
    Same,
    /// It goes to this client; the present one is to be hung up on.
    Goes(TcpStream),
    /// The present client never spoke: it is to be hung up on.
    Freed,
}

/// The seat of one server.
#[derive(Debug)]
pub struct Seat {
    /// When the present client came; `None` without one.
    since: Option<Tai>,
    has_spoken: bool,
    /// A client must speak first: it is not silent because it only listens.
    must_speak: bool,
    waiting: Option<TcpStream>,
    rests_until: Tai,
    turned_away: u64,
    starved: u64,
}

impl Seat {
    /// Returns a free seat; `must_speak`: a client that is silent is of no use.
    pub fn new(must_speak: bool) -> Self {
        let rests_until = Tai::from_ns(i64::MIN);
        Self { since: None, has_spoken: false, must_speak, waiting: None, rests_until, turned_away: 0, starved: 0 }
    }

    /// Records that the client has sent what only a client of this server sends: it keeps the seat.
    pub fn speak(&mut self) {
        self.has_spoken = true;
    }

    /// Returns true when the present or the last client has spoken.
    pub fn has_spoken(&self) -> bool {
        self.has_spoken
    }

    /// Records that the client is gone.
    pub fn leave(&mut self) {
        self.since = None;
    }

    /// Returns how many newcomers were turned away since the last call.
    pub fn take_turned_away(&mut self) -> u64 {
        core::mem::take(&mut self.turned_away)
    }

    /// Returns how often the system lacked a descriptor for a newcomer since the last call.
    pub fn take_starved(&mut self) -> u64 {
        core::mem::take(&mut self.starved)
    }

    /// Returns when [`Self::look`] next has something to do without a newcomer; `None`: not before one comes.
    pub fn next_look(&self, now: Tai) -> Option<Tai> {
        let rest = (self.rests_until > now).then_some(self.rests_until);
        let limit = if self.waiting.is_some() { GRACE } else { OPENING_WITHIN };
        let leaves = self.since.filter(|_| !self.has_spoken).map(|since| since + limit);
        rest.into_iter().chain(leaves).min()
    }

    /// Returns false while newcomers are left waiting in the system's queue.
    pub fn takes_newcomers(&self, now: Tai) -> bool {
        now >= self.rests_until
    }

    /// Accepts newcomers, and decides who has the seat.
    ///
    /// # Errors
    /// When the listener is of no more use.
    pub fn look(&mut self, listener: &TcpListener, now: Tai) -> io::Result<SeatChange> {
        for _ in 0..if self.takes_newcomers(now) { ACCEPTS } else { 0 } {
            match listener.accept() {
                // The one before is dropped, which closes it.
                Ok((stream, _)) => self.turned_away += u64::from(self.waiting.replace(stream).is_some()),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if is_gone(&error) => {}
                Err(error) if is_short(&error) => {
                    (self.rests_until, self.starved) = (now + REST, self.starved + 1);
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(self.decide(now))
    }

    fn decide(&mut self, now: Tai) -> SeatChange {
        let silent = self.since.filter(|_| !self.has_spoken).map(|since| now - since);
        let is_free = self.since.is_none() || silent.is_some_and(|silent| silent >= GRACE);
        match self.waiting.take() {
            Some(stream) if is_free => {
                (self.since, self.has_spoken) = (Some(now), false);
                SeatChange::Goes(stream)
            }
            Some(stream) if silent.is_some() => {
                self.waiting = Some(stream);
                SeatChange::Same
            }
            Some(_spoken_for) => {
                self.turned_away += 1;
                SeatChange::Same
            }
            None if self.must_speak && silent.is_some_and(|silent| silent >= OPENING_WITHIN) => {
                self.since = None;
                SeatChange::Freed
            }
            None => SeatChange::Same,
        }
    }
}

/// Returns true when a newcomer has gone before it was accepted.
fn is_gone(error: &io::Error) -> bool {
    use ErrorKind::{ConnectionAborted, ConnectionReset, Interrupted};
    matches!(error.kind(), Interrupted | ConnectionAborted | ConnectionReset)
}

/// Returns true when the system lacks a descriptor or memory: others may free some.
fn is_short(error: &io::Error) -> bool {
    let short = [Errno::MFILE, Errno::NFILE, Errno::NOBUFS, Errno::NOMEM];
    error.raw_os_error().is_some_and(|code| short.iter().any(|errno| errno.raw_os_error() == code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    fn listener() -> TcpListener {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        listener
    }

    fn at(ms: i64) -> Tai {
        Tai::from_ns(1_000_000 * ms)
    }

    /// Returns the local address of the client that the seat goes to.
    fn goes(seat: &mut Seat, listener: &TcpListener, ms: i64) -> Option<(TcpStream, u16)> {
        match seat.look(listener, at(ms)).unwrap() {
            SeatChange::Goes(stream) => {
                let port = stream.peer_addr().unwrap().port();
                Some((stream, port))
            }
            SeatChange::Same | SeatChange::Freed => None,
        }
    }

    fn connect(listener: &TcpListener) -> (TcpStream, u16) {
        let stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let port = stream.local_addr().unwrap().port();
        (stream, port)
    }

    #[test]
    fn a_silent_client_gives_way_to_a_newcomer_after_the_grace() {
        let (listener, mut seat) = (listener(), Seat::new(true));
        let (_silent, silent_port) = connect(&listener);
        let first = goes(&mut seat, &listener, 0).unwrap();
        assert_eq!(first.1, silent_port);
        let (_newcomer, port) = connect(&listener);
        assert!(goes(&mut seat, &listener, 999).is_none(), "within the grace");
        assert_eq!(seat.next_look(at(999)), Some(at(1000)));
        assert_eq!(goes(&mut seat, &listener, 1000).map(|(_, port)| port), Some(port));
        assert_eq!(seat.take_turned_away(), 0);
    }

    #[test]
    fn a_client_that_has_spoken_keeps_its_seat() {
        let (listener, mut seat) = (listener(), Seat::new(true));
        let (_client, _) = connect(&listener);
        assert!(goes(&mut seat, &listener, 0).is_some());
        seat.speak();
        let (mut newcomer, _) = connect(&listener);
        assert!(goes(&mut seat, &listener, 100_000).is_none());
        assert_eq!((seat.take_turned_away(), seat.next_look(at(0))), (1, None));
        assert!(matches!(newcomer.read(&mut [0]), Ok(0) | Err(_)), "hung up on");
        seat.leave();
        let (_next, port) = connect(&listener);
        assert_eq!(goes(&mut seat, &listener, 100_001).map(|(_, port)| port), Some(port));
        assert!(!seat.has_spoken());
    }

    #[test]
    fn a_silent_client_loses_its_seat_where_it_must_speak() {
        for must_speak in [true, false] {
            let (listener, mut seat) = (listener(), Seat::new(must_speak));
            let (_client, _) = connect(&listener);
            assert!(goes(&mut seat, &listener, 0).is_some());
            let before = OPENING_WITHIN.ns() / 1_000_000 - 1;
            assert!(matches!(seat.look(&listener, at(before)).unwrap(), SeatChange::Same));
            let freed = matches!(seat.look(&listener, at(before + 1)).unwrap(), SeatChange::Freed);
            assert_eq!(freed, must_speak);
        }
    }

    #[test]
    fn a_look_accepts_a_bounded_number() {
        let (listener, mut seat) = (listener(), Seat::new(true));
        let clients: Vec<_> = (0..2 * ACCEPTS).map(|_| connect(&listener)).collect();
        let port = goes(&mut seat, &listener, 0).unwrap().1;
        assert_eq!((port, seat.take_turned_away()), (clients[ACCEPTS - 1].1, ACCEPTS as u64 - 1));
    }

    #[test]
    fn a_lack_of_descriptors_is_waited_for() {
        let short = |errno: Errno| is_short(&io::Error::from_raw_os_error(errno.raw_os_error()));
        assert!(short(Errno::MFILE) && short(Errno::NFILE) && short(Errno::NOBUFS) && short(Errno::NOMEM));
        assert!(!short(Errno::INVAL) && !short(Errno::BADF), "control");
        let mut seat = Seat::new(true);
        seat.rests_until = at(100);
        let (listener, _) = (listener(), ());
        let _client = connect(&listener);
        assert!(goes(&mut seat, &listener, 99).is_none() && !seat.takes_newcomers(at(99)));
        assert!(goes(&mut seat, &listener, 100).is_some());
    }
}
