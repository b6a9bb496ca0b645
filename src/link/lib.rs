//! Bytes from and to the flight computer: packets stamped at the edge -> messages.
//!
//! ```text
//! Link::receive -> Stamped<Packet> -> Port (codec, reject counters) -> Stamped<Message>
//!                                     Port (plain codec)           -> Stamped<PlainRecord>
//! ```
//!
//! A [`Link`] moves packets and knows nothing of messages; a [`Port`] knows the wire format. Wrappers (fault, capture)
//! implement the trait they wrap. Nothing downstream of this crate knows about CAN or serial.

/// Files of captured packets.
pub mod capture;
/// One suite for every link.
pub mod conformance;
/// Programs outside on a simulated bus: slcan and socketcand.
pub mod gateway;
/// Edges of GPIO lines.
pub mod gpio;
#[cfg(test)]
mod gpio_tests;
mod kernel_stamp;
mod packet;
mod port;
#[cfg(test)]
mod port_tests;
pub mod plain;
/// Pulses per second from the kernel.
pub mod pps;
mod readiness;
/// Serial ports and pseudo terminals.
pub mod serial;
/// A bus in memory, for CI and for benches without hardware.
pub mod simulated;
/// CAN and CAN FD through the kernel.
pub mod socketcan;
/// Wrappers that see or change the packets that pass.
pub mod tap;
pub mod tcp;
pub mod udp;

use base::time::Tai;
use firmware_protocol::EncodeError;

pub use packet::{Bytes, CHUNK_MAX, DATAGRAM_MAX, Datagram, Packet, SerialChunk};
pub use port::{Input, Polled, Port, WireFormat};

/// A value with the instant at which it was received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamped<T> {
    /// Receive time at the edge: end of the frame on the wire, plus the link's constant latency.
    pub at: Tai,
    /// The value that was received.
    pub value: T,
}

/// Counts of one end of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkCounters {
    /// Packets received.
    pub received: u64,
    /// Packets sent.
    pub sent: u64,
    /// Packets lost because a receive queue was full, the kernel's included.
    pub overflows: u64,
    /// Packets given up because they could not be sent.
    pub unsent: u64,
    /// Errors that the controller or the line reported: bit, stuffing, form, acknowledge, CRC, framing, parity.
    pub errors: u64,
    /// Times the controller went bus-off.
    pub bus_off: u64,
    /// Times the controller came back from bus-off.
    pub restarted: u64,
    /// Packets stamped when they were read, because the kernel gave no stamp or an impossible one (a step of its
    /// clock).
    pub unstamped: u64,
    /// Times the interface or port was lost.
    pub lost: u64,
    /// Attempts to connect that failed.
    pub unreached: u64,
    /// Those of them that the machine at the address refused; nothing answered the others.
    pub refused: u64,
    /// Times it came back.
    pub regained: u64,
    /// Packets, or connections, of another sender than the one that came first: refused.
    pub foreign: u64,
    /// Datagrams, records or lines that are longer than any message: refused.
    pub oversize: u64,
}

/// Reason why a link refuses a request.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The packet is of another kind than the link carries.
    #[error("link {link}: wanted a {wanted} packet to send, got {got}; check the wire format of the port")]
    WrongPacket {
        /// Name of the link.
        link: String,
        /// Kind of packet it carries.
        wanted: &'static str,
        /// Kind of packet given.
        got: &'static str,
    },
    /// A permanent error of the system (temporary ones are counted and waited for instead).
    #[error("link {link}: cannot {doing}: {source}{advice}")]
    System {
        /// Name of the link.
        link: String,
        /// Action that failed.
        doing: &'static str,
        /// Error of the system.
        source: std::io::Error,
        /// Advice after a semicolon; or empty.
        advice: &'static str,
    },
    /// The message has no form on this wire.
    #[error("message cannot be sent: {0}")]
    Encode(#[from] EncodeError),
}

/// Outcome of a packet that was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Departure {
    /// The link has no better value than the one that [`Link::send`] returned.
    AsReported,
    /// The packet waits, or is on its way.
    Waiting,
    /// Its last bit left at this instant.
    At(Tai),
    /// The packet was given up.
    Never,
}

/// One end of a connection that moves packets.
pub trait Link: Send {
    /// Returns the next packet. On a real clock waits for it until `until` at most, without spinning; on the virtual
    /// clock returns at once with what has arrived by now.
    ///
    /// # Errors
    /// When the link is no longer able to receive.
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError>;

    /// Queues a packet, and returns the instant at which it leaves as well as the link knows: the end of the frame on
    /// the simulated bus, the return of the write on a socket or a serial port.
    ///
    /// # Errors
    /// When the link does not carry such packets, or is no longer able to send.
    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError>;

    /// Returns the counters of this end.
    fn counters(&self) -> LinkCounters;

    /// Returns the outcome of the packet that followed `sent` successful calls of [`Link::send`]: on a bus with
    /// arbitration a packet may leave later than `send` could know. Wrappers pass the question on.
    fn departure(&mut self, sent: u64) -> Departure {
        let _ = sent; // no better time is known than the one that `send` returned
        Departure::AsReported
    }
}
