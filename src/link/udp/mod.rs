//! Datagrams over UDP: those that an outside simulator sends to an address of this machine <-> `Link`.
//!
//! * One sender at a time. The first whose datagram is a message (`UdpParams::is_message`) is the sender from then on; what
//!   comes from other addresses is refused and counted. After [`UdpParams::sender_timeout`] without a datagram of its own,
//!   another may take its place: a simulator that is started again has another port. That counts as lost and regained.
//! * Stamps are the kernel's (`SO_TIMESTAMPNS`), placed on the bench clock when the datagram is fetched (`kernel_stamp`).
//! * The receive buffer is enlarged; datagrams that the kernel drops all the same are counted as overflow.
//! * Datagrams longer than [`crate::DATAGRAM_MAX`] are refused and counted.
//!
//! Waiting is done in `poll`; a datagram costs no allocation. Tests: `tests` here, `tests/links/plain.rs`.

use crate::kernel_stamp::{StampMap, nonzero_ns};
use crate::readiness::{Readiness, wait_for};
use crate::{DATAGRAM_MAX, Datagram, Link, LinkCounters, LinkError, Packet, Stamped, readiness};
use base::clock::{Clock, PairedReading};
use base::time::{Span, Tai};
use core::fmt;
use nix::sys::socket::sockopt::{ReceiveTimestampns, RxqOvfl};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt};
use std::io::{self, IoSliceMut};
use std::net::{SocketAddr, SocketAddrV4, SocketAddrV6, UdpSocket};
use std::os::fd::{AsFd, AsRawFd};
use std::sync::Arc;

// One UDP socket: datagrams with their sender, the kernel's stamps and its count of drops.

/// Bytes for the requested control messages: one stamp and the count of drops.
const CONTROL_BYTES: usize = 128;

/// An open socket.
struct Socket {
    inner: UdpSocket,
    control: Box<[u8; CONTROL_BYTES]>,
    drops: u32,
}

/// Result of one read of the socket.
struct Arrived {
    /// `None`: longer than any message.
    datagram: Option<Datagram>,
    from: Option<SocketAddr>,
    /// CLOCK_REALTIME at which the kernel received it, ns.
    kernel_ns: Option<i64>,
    /// Datagrams the kernel dropped since the last look.
    drops: u64,
}

impl Socket {
    fn bind(listen: SocketAddr) -> io::Result<Self> {
        let inner = UdpSocket::bind(listen)?;
        inner.set_nonblocking(true)?;
        setsockopt(&inner, ReceiveTimestampns, &true)?;
        setsockopt(&inner, RxqOvfl, &1)?;
        readiness::enlarge(&inner)?;
        Ok(Self { inner, control: Box::new([0; CONTROL_BYTES]), drops: 0 })
    }

    fn address(&self) -> io::Result<SocketAddr> {
        self.inner.local_addr()
    }

    /// Returns the next datagram in the kernel's queue; `None` when it is empty.
    fn read(&mut self) -> io::Result<Option<Arrived>> {
        let mut bytes = [0; DATAGRAM_MAX + 1];
        let mut slices = [IoSliceMut::new(&mut bytes)];
        let control = Some(&mut self.control[..]);
        let flags = MsgFlags::MSG_DONTWAIT;
        let message = match recvmsg::<SockaddrStorage>(self.inner.as_raw_fd(), &mut slices, control, flags) {
            Ok(message) => message,
            // An ICMP answer to an earlier datagram: the other end was not running yet.
            Err(nix::Error::EAGAIN | nix::Error::EINTR | nix::Error::ECONNREFUSED) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let mut arrived = Arrived { datagram: None, from: None, kernel_ns: None, drops: 0 };
        for control in message.cmsgs()? {
            if let ControlMessageOwned::ScmTimestampns(stamp) = control {
                arrived.kernel_ns = nonzero_ns(stamp);
            } else if let ControlMessageOwned::RxqOvfl(total) = control {
                arrived.drops = u64::from(total.wrapping_sub(self.drops));
                self.drops = total;
            }
        }
        arrived.from = message.address.as_ref().and_then(address_of);
        let length = message.bytes;
        arrived.datagram = bytes.get(..length).and_then(Datagram::new);
        Ok(Some(arrived))
    }

    fn send(&self, bytes: &[u8], to: SocketAddr) -> io::Result<usize> {
        self.inner.send_to(bytes, to)
    }

    /// Waits until there is something to read, for `span` at most.
    fn wait(&self, span: Span) -> io::Result<()> {
        wait_for(self.inner.as_fd(), Readiness::Read, span).map(drop)
    }
}

fn address_of(address: &SockaddrStorage) -> Option<SocketAddr> {
    let v4 = address.as_sockaddr_in().map(|v4| SocketAddr::V4(SocketAddrV4::from(*v4)));
    v4.or_else(|| address.as_sockaddr_in6().map(|v6| SocketAddr::V6(SocketAddrV6::from(*v6))))
}

// `Link` over a UDP socket: one sender, stamped datagrams, counters.

/// Refused datagrams read in a row before the limit is looked at again.
const REFUSED_MAX: u32 = 64;

/// Datagrams of one sender.
pub struct UdpLink {
    params: UdpParams,
    clock: Arc<dyn Clock>,
    socket: Socket,
    address: SocketAddr,
    /// The sender that has the link, and when it was last received.
    sender: Option<(SocketAddr, Tai)>,
    stamps: StampMap,
    counters: LinkCounters,
}

/// Result of one read of the socket.
#[allow(clippy::large_enum_variant, reason = "one at a time, on the stack: a packet is its bytes")]
enum Look {
    Packet(Stamped<Packet>),
    Refused,
    Empty,
}

impl UdpLink {
    /// Opens a socket.
    ///
    /// # Errors
    /// When the address is not one of this machine, or another program has it.
    pub fn open(params: UdpParams, clock: &Arc<dyn Clock>) -> Result<Self, LinkError> {
        const ADVICE: &str = "; wanted an address of this machine that no other program has: `ss -ulpn` lists them";
        let failed = |source| failed(params.listen, "receive there", source, ADVICE);
        let socket = Socket::bind(params.listen).map_err(failed)?;
        let address = socket.address().map_err(failed)?;
        let stamps = StampMap::new(PairedReading::take(&**clock));
        let clock = Arc::clone(clock);
        Ok(Self { params, clock, socket, address, sender: None, stamps, counters: LinkCounters::default() })
    }

    /// Returns the same with this address as the other end.
    #[must_use]
    pub fn with_peer(mut self, peer: SocketAddr) -> Self {
        self.params.peer = Some(peer);
        self
    }

    /// Returns the address at which it receives.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    fn look(&mut self) -> Result<Look, LinkError> {
        match self.socket.read() {
            Ok(Some(arrived)) => Ok(self.take(&arrived)),
            Ok(None) => {
                self.stamps.drained();
                Ok(Look::Empty)
            }
            Err(source) => Err(failed(self.address, "receive", source, "")),
        }
    }

    fn take(&mut self, arrived: &Arrived) -> Look {
        self.counters.overflows += arrived.drops;
        let placed = self.stamps.place(arrived.kernel_ns, PairedReading::take(&*self.clock));
        if !arrived.from.is_some_and(|from| self.admits(from, arrived, placed.at)) {
            self.counters.foreign += 1;
            return Look::Refused;
        }
        let Some(datagram) = arrived.datagram else {
            self.counters.oversize += 1;
            return Look::Refused;
        };
        self.counters.received += 1;
        self.counters.unstamped += u64::from(!placed.is_kernels);
        Look::Packet(Stamped { at: placed.at, value: Packet::Datagram(datagram) })
    }

    /// Returns whether a datagram is from the sender that has the link, or from one that may take it. While the link is
    /// free, all datagrams are passed on: the port counts by its reason each one that is not a message.
    fn admits(&mut self, from: SocketAddr, arrived: &Arrived, at: Tai) -> bool {
        if let Some(peer) = self.params.peer {
            return peer == from;
        }
        match &mut self.sender {
            Some((sender, last)) if *sender == from => {
                *last = at;
                return true;
            }
            Some((_, last)) if at - *last < self.params.sender_timeout => return false,
            Some(_) | None => {}
        }
        if arrived.datagram.is_some_and(|datagram| (self.params.is_message)(datagram.as_slice())) {
            let is_another = self.sender.replace((from, at)).is_some();
            self.counters.lost += u64::from(is_another);
            self.counters.regained += u64::from(is_another);
        }
        true
    }
}

fn failed(address: SocketAddr, doing: &'static str, source: io::Error, advice: &'static str) -> LinkError {
    LinkError::System { link: format!("udp {address}"), doing, source, advice }
}

impl Link for UdpLink {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let mut refused = 0;
        loop {
            match self.look()? {
                Look::Packet(packet) => return Ok(Some(packet)),
                Look::Refused if refused < REFUSED_MAX => refused += 1,
                Look::Refused | Look::Empty => {
                    let now = self.clock.now();
                    if !self.clock.is_real() || now >= until {
                        return Ok(None);
                    }
                    let waited = self.socket.wait(until - now);
                    waited.map_err(|source| failed(self.address, "wait for a datagram", source, ""))?;
                }
            }
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        let Packet::Datagram(datagram) = packet else {
            let (wanted, got) = ("datagram", packet.kind());
            return Err(LinkError::WrongPacket { link: format!("udp {}", self.address), wanted, got });
        };
        let to = self.params.peer.or(self.sender.map(|(sender, _)| sender));
        // A datagram that the system does not take now is given up: the next one is newer.
        let is_sent = to.is_some_and(|to| self.socket.send(datagram.as_slice(), to).is_ok());
        self.counters.sent += u64::from(is_sent);
        self.counters.unsent += u64::from(!is_sent);
        Ok(self.clock.now())
    }

    fn counters(&self) -> LinkCounters {
        self.counters
    }
}

#[cfg(test)]
mod tests;

/// Decides whether bytes are a message.
pub type IsMessage = Box<dyn Fn(&[u8]) -> bool + Send>;

/// Address at which datagrams are received, and their sender.
pub struct UdpParams {
    /// Address of this end.
    pub listen: SocketAddr,
    /// Address of the other end; `None`: that of the first sender of a message.
    pub peer: Option<SocketAddr>,
    /// Silence after which another sender may take the place of the first.
    pub sender_timeout: Span,
    /// Decides by whom the link is taken.
    pub is_message: IsMessage,
}

impl UdpParams {
    /// Takes any sender of any bytes, at an address of this end.
    pub fn new(listen: SocketAddr) -> Self {
        Self { listen, peer: None, sender_timeout: Span::from_ms(2000), is_message: Box::new(|_| true) }
    }
}

impl fmt::Debug for UdpParams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("UdpParams").field("listen", &self.listen).field("peer", &self.peer).finish_non_exhaustive()
    }
}
