//! Message -> bytes on the line.

use super::{CRC, ENCODED_MAX, HEADER, PACKET_MAX, cobs};
use crate::{EncodeError, Message, version};
use crate::{bytes::Payload, crc::crc16};

/// Numbers and frames packets.
#[derive(Debug, Clone, Copy, Default)]
pub struct Encoder {
    seq: u8,
}

impl Encoder {
    /// Returns an encoder whose first packet has sequence number 0.
    pub const fn new() -> Self {
        Self { seq: 0 }
    }

    /// Returns an encoder whose first packet has this sequence number.
    pub const fn starting_at(seq: u8) -> Self {
        Self { seq }
    }

    /// Writes one packet with its delimiter to the front of `to`, which must hold [`ENCODED_MAX`] bytes; the number
    /// of bytes written.
    ///
    /// # Errors
    /// When a scaled field cannot hold its value, or `to` is too short.
    pub fn encode(&mut self, message: &Message, to: &mut [u8]) -> Result<usize, EncodeError> {
        let too_short = EncodeError::BufferTooShort { wanted: ENCODED_MAX, got: to.len() };
        if to.len() < ENCODED_MAX {
            return Err(too_short);
        }
        let (packet, len) = packet(message.id().number(), self.seq, &message.payload()?);
        let stuffed = cobs::stuff(packet.get(..len).unwrap_or(&[]), to).ok_or(too_short)?;
        *to.get_mut(stuffed).ok_or(too_short)? = 0;
        self.seq = self.seq.wrapping_add(1);
        Ok(stuffed + 1)
    }
}

/// Writes header, payload and CRC: a whole packet before COBS.
fn packet(number: u8, seq: u8, payload: &Payload) -> ([u8; PACKET_MAX], usize) {
    let mut packet = [0; PACKET_MAX];
    let data = payload.as_slice();
    let body = HEADER + data.len();
    #[allow(clippy::cast_possible_truncation, reason = "a payload has at most 64 bytes")]
    let header = [version::MAJOR, number, seq, data.len() as u8];
    for (to, from) in packet.iter_mut().zip(header.iter().chain(data)) {
        *to = *from;
    }
    let crc = crc16(packet.get(..body).unwrap_or(&[])).to_le_bytes();
    for (to, from) in packet.iter_mut().skip(body).zip(crc) {
        *to = from;
    }
    (packet, body + CRC)
}
