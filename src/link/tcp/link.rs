//! `Link` over a TCP connection: one client or server at a time, whole messages, counters.

use super::{Framing, Got, REFUSED_MAX, RETRY, Reassembly, Seat, SeatChange, Stream, TcpParams, TcpRole};
use crate::gateway::screen::{OPENING_BYTES, opens_another_protocol};
use crate::plain::{ACKNOWLEDGE, is_end_of_message};
use crate::readiness::wait_for_any;
use crate::{Datagram, Link, LinkCounters, LinkError, Packet, Stamped};
use base::clock::Clock;
use base::time::{Span, Tai};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::{io, io::ErrorKind, sync::Arc, time::Duration};

/// Bytes of one read.
const READ_BYTES: usize = 4096;
/// A server that does not answer is given up after this long.
const CONNECT_LIMIT: Duration = Duration::from_millis(200);

/// Returns true if bytes are a message of the link's layout.
pub type IsMessage = Box<dyn Fn(&[u8]) -> bool + Send>;

/// Messages over one connection.
pub struct TcpLink {
    params: TcpParams,
    clock: Arc<dyn Clock>,
    listener: Option<TcpListener>,
    address: SocketAddr,
    stream: Option<Stream>,
    /// The client that has the connection of a server.
    seat: Seat,
    is_message: Option<IsMessage>,
    /// Records or lines since the last message.
    refused: u32,
    /// A connection was lost, and none has taken its place.
    is_lost: bool,
    retry_at: Tai,
    reassembly: Reassembly,
    /// The bytes that were read last; `read` is their number, `taken` the number of them that were used, `read_at` the
    /// time.
    bytes: Box<[u8; READ_BYTES]>,
    read: usize,
    taken: usize,
    read_at: Tai,
    /// First bytes of the connection: a web page can make a browser connect.
    opening: [u8; OPENING_BYTES],
    opened: usize,
    counters: LinkCounters,
}

impl TcpLink {
    /// Listens, or prepares to connect: a server that is not running yet is waited for.
    ///
    /// # Errors
    /// When the address of a server is not one of this machine, or another program has it.
    pub fn open(params: TcpParams, clock: &Arc<dyn Clock>) -> Result<Self, LinkError> {
        let (listener, address) = match params.role {
            TcpRole::Server(address) => listen(address).map(|(listener, address)| (Some(listener), address))?,
            TcpRole::Client(address) => (None, address),
        };
        Ok(Self {
            params,
            clock: Arc::clone(clock),
            listener,
            address,
            stream: None,
            seat: Seat::new(true),
            is_message: None,
            refused: 0,
            is_lost: false,
            retry_at: Tai::from_ns(i64::MIN),
            reassembly: Reassembly::new(params.framing),
            bytes: Box::new([0; READ_BYTES]),
            read: 0,
            taken: 0,
            read_at: Tai::from_ns(0),
            opening: [0; OPENING_BYTES],
            opened: 0,
            counters: LinkCounters::default(),
        })
    }

    /// Returns the same with what knows the messages of its layout: a connection that brings none is hung up on.
    #[must_use]
    pub fn with_reader(mut self, is_message: IsMessage) -> Self {
        self.is_message = Some(is_message);
        self
    }

    /// Returns the address at which it listens, or to which it connects.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns true while there is a connection.
    pub fn is_connected(&self) -> bool {
        self.stream.is_some()
    }

    /// Takes a client, and refuses all others; or connects when it is time to.
    fn connect(&mut self) -> Result<(), LinkError> {
        let now = self.clock.now();
        if let Some(listener) = &self.listener {
            let change = self.seat.look(listener, now);
            self.counters.foreign += self.seat.take_turned_away();
            self.counters.errors += self.seat.take_starved();
            match change.map_err(|error| failed(self.address, "accept a client", error, ""))? {
                SeatChange::Same => {}
                SeatChange::Goes(stream) => {
                    self.counters.foreign += u64::from(self.stream.is_some());
                    self.begin(stream);
                }
                SeatChange::Freed => {
                    self.counters.foreign += 1;
                    self.lose();
                }
            }
        } else if self.stream.is_none() && now >= self.retry_at {
            self.retry_at = now + RETRY;
            match TcpStream::connect_timeout(&self.address, CONNECT_LIMIT) {
                Ok(stream) => {
                    self.begin(stream);
                    self.found();
                }
                Err(error) => {
                    self.counters.unreached += 1;
                    self.counters.refused += u64::from(error.kind() == ErrorKind::ConnectionRefused);
                }
            }
        }
        Ok(())
    }

    fn begin(&mut self, stream: TcpStream) {
        (self.opened, self.refused) = (0, 0);
        self.reassembly.clear();
        // One that cannot be set up is gone already.
        self.stream = Stream::over(stream).ok();
    }

    /// Records that the other end is there, or there again.
    fn found(&mut self) {
        self.counters.regained += u64::from(core::mem::take(&mut self.is_lost));
    }

    /// Ends the connection. One that never brought a message was not the link, and is none that is lost.
    fn lose(&mut self) {
        self.stream = None;
        self.reassembly.clear();
        if self.listener.is_none() || self.seat.has_spoken() {
            self.counters.lost += u64::from(!core::mem::replace(&mut self.is_lost, true));
        }
        self.seat.leave();
        self.retry_at = self.clock.now() + RETRY;
    }

    /// Judges what came whole: a message keeps the connection, too many others in a row end it.
    fn judge(&mut self, message: &Datagram) {
        let is_message = self.is_message.as_ref().is_none_or(|is_message| is_message(message.as_slice()));
        if is_message {
            self.refused = 0;
            if self.listener.is_some() && !self.seat.has_spoken() {
                self.seat.speak();
                self.found();
            }
        } else {
            self.refused += 1;
            if self.refused >= REFUSED_MAX {
                self.counters.foreign += 1;
                (self.read, self.taken) = (0, 0);
                self.lose();
            }
        }
    }

    /// Returns the next whole message of the bytes that were read.
    fn take(&mut self) -> Option<Datagram> {
        let mut rest = self.bytes.get(self.taken..self.read).unwrap_or(&[]);
        let message = self.reassembly.next(&mut rest);
        self.taken = self.read - rest.len();
        self.counters.oversize = self.reassembly.oversize;
        message
    }

    /// Reads the bytes that wait, when all earlier ones are taken; returns true when bytes were read.
    fn fill(&mut self) -> bool {
        let Some(stream) = &mut self.stream else { return false };
        let got = stream.read(&mut self.bytes[..]);
        (self.read, self.taken, self.read_at) = (0, 0, self.clock.now());
        match got {
            Got::Bytes(count) if self.is_foreign(count) => {
                self.counters.foreign += 1;
                self.lose();
            }
            Got::Bytes(count) => self.read = count,
            Got::Nothing => {}
            Got::End => self.lose(),
        }
        self.read > 0
    }

    /// Returns true when a client of the server begins as a browser does: what follows may be lines of ours in its
    /// body.
    fn is_foreign(&mut self, count: usize) -> bool {
        for (place, byte) in self.opening.iter_mut().skip(self.opened).zip(&self.bytes[..count]) {
            *place = *byte;
            self.opened += 1;
        }
        self.listener.is_some() && opens_another_protocol(&self.opening[..self.opened])
    }

    fn acknowledge(&mut self, message: &Datagram) {
        if self.params.acknowledges
            && is_end_of_message(message.as_slice())
            && let Some(stream) = &mut self.stream
            && !stream.write(ACKNOWLEDGE)
        {
            self.lose();
        }
    }

    fn wait(&self, now: Tai, until: Tai) -> Result<(), LinkError> {
        let listener = self.listener.as_ref().filter(|_| self.seat.takes_newcomers(now)).map(AsFd::as_fd);
        let until = self.seat.next_look(now).filter(|_| self.listener.is_some()).map_or(until, |at| until.min(at));
        let fds: Vec<BorrowedFd<'_>> = self.stream.as_ref().map(AsFd::as_fd).into_iter().chain(listener).collect();
        if fds.is_empty() {
            let retry = self.listener.is_none().then_some(self.retry_at);
            self.clock.sleep_until(retry.map_or(until, |retry| until.min(retry)));
            return Ok(());
        }
        wait_for_any(&fds, until - now).map_err(|error| failed(self.address, "wait for bytes", error, ""))
    }

    /// Returns the bytes of a message as they go over the stream.
    fn framed(&self, datagram: &Datagram) -> Result<Vec<u8>, LinkError> {
        let wrong = |wanted| {
            let (link, got) = (format!("tcp {}", self.address), "datagram of another length or with a line's end");
            LinkError::WrongPacket { link, wanted, got }
        };
        let bytes = datagram.as_slice();
        match self.params.framing {
            Framing::Records(length) if bytes.len() != length => Err(wrong("record of the stream's length")),
            Framing::Records(_) => Ok(bytes.to_vec()),
            Framing::Lines if bytes.contains(&b'\n') => Err(wrong("line")),
            Framing::Lines => Ok([bytes, b"\n"].concat()),
        }
    }
}

fn listen(address: SocketAddr) -> Result<(TcpListener, SocketAddr), LinkError> {
    const ADVICE: &str = "; wanted an address of this machine that no other program has: `ss -tlpn` lists them";
    let opened = TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    });
    opened.map_err(|error| failed(address, "listen there", error, ADVICE))
}

fn failed(address: SocketAddr, doing: &'static str, source: io::Error, advice: &'static str) -> LinkError {
    LinkError::System { link: format!("tcp {address}"), doing, source, advice }
}

impl Link for TcpLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        loop {
            if let Some(message) = self.take() {
                self.judge(&message);
                self.acknowledge(&message);
                self.counters.received += 1;
                return Ok(Some(Stamped { at: self.read_at, value: Packet::Datagram(message) }));
            }
            self.connect()?;
            if self.fill() {
                continue;
            }
            let now = self.clock.now();
            if !self.clock.is_real() || now >= until {
                return Ok(None);
            }
            self.wait(now, until.min(now + Span::from_ms(1000)))?;
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let Packet::Datagram(datagram) = packet else {
            let (wanted, got) = ("datagram", packet.kind());
            return Err(LinkError::WrongPacket { link: format!("tcp {}", self.address), wanted, got });
        };
        let bytes = self.framed(datagram)?;
        self.connect()?;
        match self.stream.as_mut().map(|stream| stream.write(&bytes)) {
            Some(true) => self.counters.sent += 1,
            None => self.counters.unsent += 1,
            Some(false) => {
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
