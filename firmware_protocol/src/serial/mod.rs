//! Serial framing.
//!
//! One packet: COBS of the bytes below, then one `0x00`. Any number of `0x00` may come between packets.
//!
//! | byte | field |
//! |---|---|
//! | 0 | protocol major version |
//! | 1 | type: the message number |
//! | 2 | packet sequence number, counts up by one over all types |
//! | 3 | length of the payload, 0 to 64 |
//! | 4.. | payload, as in CAN FD |
//! | last 2 | CRC-16/IBM-3740 of all bytes before it, little-endian |
//!
//! COBS: Cheshire and Baker, "Consistent overhead byte stuffing", IEEE/ACM Transactions on Networking 7 (1999).

mod cobs;
mod decode;
mod encode;

pub use decode::Decoder;
pub use encode::Encoder;

use crate::PAYLOAD_MAX;

const HEADER: usize = 4;
const CRC: usize = 2;
/// Longest packet before COBS.
const PACKET_MAX: usize = HEADER + PAYLOAD_MAX + CRC;
/// Longest packet between delimiters: COBS adds one byte to so short a packet.
const STUFFED_MAX: usize = PACKET_MAX + 1;
/// Longest packet on the line, with its delimiter.
pub const ENCODED_MAX: usize = STUFFED_MAX + 1;
