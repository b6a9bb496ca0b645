//! `Link` over a UDP socket: one sender, stamped datagrams, counters.

use super::UdpParams;
use super::socket::{Arrived, Socket};
use crate::kernel_stamp::StampMap;
use crate::{Link, LinkCounters, LinkError, Packet, Stamped};
use base::clock::{Clock, PairedReading};
use base::time::Tai;
use std::{io, net::SocketAddr, sync::Arc};

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
