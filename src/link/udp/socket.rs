//! One UDP socket: datagrams with their sender, the kernel's stamps and its count of drops.

use crate::kernel_stamp::nonzero_ns;
use crate::readiness::{Readiness, wait_for};
use crate::{DATAGRAM_MAX, Datagram, receive_buffer};
use base::time::Span;
use nix::sys::socket::sockopt::{ReceiveTimestampns, RxqOvfl};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, SockaddrStorage, recvmsg, setsockopt};
use std::io::{self, IoSliceMut};
use std::net::{SocketAddr, SocketAddrV4, SocketAddrV6, UdpSocket};
use std::os::fd::{AsFd, AsRawFd};

/// Bytes for the requested control messages: one stamp and the count of drops.
const CONTROL_BYTES: usize = 128;

/// An open socket.
pub(super) struct Socket {
    inner: UdpSocket,
    control: Box<[u8; CONTROL_BYTES]>,
    drops: u32,
}

/// Result of one read of the socket.
pub(super) struct Arrived {
    /// `None`: longer than any message.
    pub(super) datagram: Option<Datagram>,
    pub(super) from: Option<SocketAddr>,
    /// CLOCK_REALTIME at which the kernel received it, ns.
    pub(super) kernel_ns: Option<i64>,
    /// Datagrams the kernel dropped since the last look.
    pub(super) drops: u64,
}

impl Socket {
    pub(super) fn bind(listen: SocketAddr) -> io::Result<Self> {
        let inner = UdpSocket::bind(listen)?;
        inner.set_nonblocking(true)?;
        setsockopt(&inner, ReceiveTimestampns, &true)?;
        setsockopt(&inner, RxqOvfl, &1)?;
        receive_buffer::enlarge(&inner)?;
        Ok(Self { inner, control: Box::new([0; CONTROL_BYTES]), drops: 0 })
    }

    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.inner.local_addr()
    }

    /// Returns the next datagram in the kernel's queue; `None` when it is empty.
    pub(super) fn read(&mut self) -> io::Result<Option<Arrived>> {
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

    pub(super) fn send(&self, bytes: &[u8], to: SocketAddr) -> io::Result<usize> {
        self.inner.send_to(bytes, to)
    }

    /// Waits until there is something to read, for `span` at most.
    pub(super) fn wait(&self, span: Span) -> io::Result<()> {
        wait_for(self.inner.as_fd(), Readiness::Read, span).map(drop)
    }
}

fn address_of(address: &SockaddrStorage) -> Option<SocketAddr> {
    let v4 = address.as_sockaddr_in().map(|v4| SocketAddr::V4(SocketAddrV4::from(*v4)));
    v4.or_else(|| address.as_sockaddr_in6().map(|v6| SocketAddr::V6(SocketAddrV6::from(*v6))))
}
