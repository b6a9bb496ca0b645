//! Captured packets in files: candump log text and pcapng, written and read.
//!
//! ```text
//! CapturedPacket -> CaptureWriter -> bus.log, bus.pcapng -> CaptureReader -> CapturedPacket
//! ```
//!
//! In and out: packets with the instant and the direction in which they passed, and the number of the interface. One
//! file holds several interfaces: pcapng blocks named link0, link1, ..., the interface column can0, can1, ... of a
//! candump log. In files of other programs the number is taken from the name, or from the place of the interface in its
//! section. Stamps are Unix time to the nanosecond in both formats; pcapng keeps the instant (TAI) beside it, a candump
//! log does not distinguish a leap second from the second after it. A candump log holds CAN only; pcapng holds CAN
//! (link type 227, SocketCAN), serial bytes (link type 147, USER0) and plain datagrams (link type 148, USER1). Readers
//! accept any bytes: errors are reported with line or offset, a file that was cut off is read up to the cut, and memory
//! is bounded by `BLOCK_MAX` and `LINE_MAX` whatever lengths a file states. Frames that have no [`Packet`] (remote and
//! error frames) are skipped and counted. Sources: candump's log format as written by
//! can-utils; pcapng, IETF draft-ietf-opsawg-pcapng; LINKTYPE_CAN_SOCKETCAN as registered by tcpdump.org. Tests:
//! `tests`, and `hil_scripts` against can-utils, python-can and tshark.

mod candump;
mod error;
mod pcapng;
mod reader;
#[cfg(test)]
mod tests;
mod writer;

use crate::Packet;
use base::time::Tai;

pub use candump::{Line, parse_line};
pub use error::CaptureError;
pub use reader::CaptureReader;
pub use writer::CaptureWriter;

/// Longest line of a candump log, bytes.
pub const LINE_MAX: usize = 1024;
/// Longest pcapng block that is read, bytes; blocks of other kinds are skipped whatever their length.
pub const BLOCK_MAX: usize = 256 * 1024;

/// Form of a capture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CaptureFormat {
    /// candump's log text: CAN only.
    Candump,
    /// pcapng: CAN, serial and plain datagrams.
    Pcapng,
}

/// Direction of a packet, as the capturing side saw it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// The packet was received.
    Received,
    /// The packet was sent.
    Sent,
}

/// A packet that passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapturedPacket {
    /// Receive stamp, or the instant at which it left.
    pub at: Tai,
    /// Direction of the packet.
    pub direction: Direction,
    /// Number of the interface it passed, from 0; the last number is used for all beyond it.
    pub interface: u8,
    /// The packet itself.
    pub packet: Packet,
}
