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

mod link;
mod socket;
#[cfg(test)]
mod tests;

use base::time::Span;
use core::fmt;
use std::net::SocketAddr;

pub use link::UdpLink;

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
