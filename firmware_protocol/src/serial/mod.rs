//! Serial framing: message -> bytes on the line, and back.
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
//!
//! Stuffed bytes have no zeros and are one byte longer per 254. Each zero is replaced by the distance to the next one; a first byte holds the distance to the first.

use crate::{EncodeError, Message, MessageId, PAYLOAD_MAX, Reject, version};
use crate::{bytes::Payload, crc::crc16, sequence::Sequences};

const HEADER: usize = 4;
const CRC: usize = 2;
/// Longest packet before COBS.
const PACKET_MAX: usize = HEADER + PAYLOAD_MAX + CRC;
/// Longest packet between delimiters: COBS adds one byte to so short a packet.
const STUFFED_MAX: usize = PACKET_MAX + 1;
/// Longest packet on the line, with its delimiter.
pub const ENCODED_MAX: usize = STUFFED_MAX + 1;

/// Distance that says "no zero follows the 254 bytes".
const FULL: u8 = 0xFF;

/// Stuffs `plain` into `stuffed`; the number of bytes written, or `None` when they do not fit.
fn stuff(plain: &[u8], stuffed: &mut [u8]) -> Option<usize> {
    let (mut distance_at, mut at, mut distance) = (0, 1, 1);
    for &byte in plain {
        if byte != 0 {
            *stuffed.get_mut(at)? = byte;
            at += 1;
            distance += 1;
        }
        if byte == 0 || distance == FULL {
            *stuffed.get_mut(distance_at)? = distance;
            (distance_at, at, distance) = (at, at + 1, 1);
        }
    }
    *stuffed.get_mut(distance_at)? = distance;
    Some(at)
}

/// Takes the stuffing out in place; the plain bytes.
fn unstuff(stuffed: &mut [u8]) -> Result<&[u8], Reject> {
    let (mut from, mut to) = (0, 0);
    while let Some(&distance) = stuffed.get(from) {
        let run = usize::from(distance).checked_sub(1).ok_or(Reject::BadFraming)?;
        let source = from + 1..from + 1 + run;
        from = source.end;
        if stuffed.get(source.clone()).is_none_or(|bytes| bytes.contains(&0)) {
            return Err(Reject::BadFraming);
        }
        stuffed.copy_within(source, to);
        to += run;
        if distance != FULL && from < stuffed.len() {
            *stuffed.get_mut(to).ok_or(Reject::BadFraming)? = 0;
            to += 1;
        }
    }
    stuffed.get(..to).ok_or(Reject::BadFraming)
}

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
        let stuffed = stuff(packet.get(..len).unwrap_or(&[]), to).ok_or(too_short)?;
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

/// Collects bytes up to each delimiter. After any damage it is back in step at the next one.
#[derive(Debug, Clone)]
pub struct Decoder {
    stuffed: [u8; STUFFED_MAX],
    len: usize,
    packets: PacketCount,
    sequences: Sequences,
}

#[derive(Debug, Clone, Copy, Default)]
struct PacketCount {
    newest: Option<u8>,
    lost: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Returns a decoder that has seen nothing.
    pub fn new() -> Self {
        let (packets, sequences) = (PacketCount::default(), Sequences::default());
        Self { stuffed: [0; STUFFED_MAX], len: 0, packets, sequences }
    }

    /// Returns packets missing from the sequence so far.
    pub const fn lost_packets(&self) -> u32 {
        self.packets.lost
    }

    /// Takes bytes off the front of `bytes` up to the first message or rejection; `None` when all are taken.
    pub fn read(&mut self, bytes: &mut &[u8]) -> Option<Result<Message, Reject>> {
        while let Some((byte, rest)) = bytes.split_first() {
            *bytes = rest;
            match self.read_byte(*byte) {
                Ok(None) => {}
                Ok(Some(message)) => return Some(Ok(message)),
                Err(reject) => return Some(Err(reject)),
            }
        }
        None
    }

    /// Reads one byte: a message when it is the delimiter of a good packet.
    ///
    /// # Errors
    /// At the delimiter, the reason why the bytes before it are not a legal packet.
    pub fn read_byte(&mut self, byte: u8) -> Result<Option<Message>, Reject> {
        if byte == 0 {
            return self.delimited();
        }
        if let Some(slot) = self.stuffed.get_mut(self.len) {
            *slot = byte;
        }
        self.len = self.len.saturating_add(1);
        Ok(None)
    }

    fn delimited(&mut self) -> Result<Option<Message>, Reject> {
        let len = core::mem::take(&mut self.len);
        if len == 0 {
            return Ok(None);
        }
        let stuffed = self.stuffed.get_mut(..len).ok_or(Reject::Oversize)?;
        let (number, seq, payload) = open(unstuff(stuffed)?)?;
        self.packets.count(seq);
        let message = Message::from_payload(MessageId::from_number(number)?, payload)?;
        self.sequences.admit(message).map(Some)
    }
}

/// Returns type, sequence number and payload of a packet whose length, CRC and version are right.
fn open(packet: &[u8]) -> Result<(u8, u8, &[u8]), Reject> {
    let ([major, number, seq, len], _) = packet.split_first_chunk::<HEADER>().ok_or(Reject::WrongLength)?;
    let body = HEADER + usize::from(*len);
    let (head, crc) = packet.split_at_checked(body).ok_or(Reject::WrongLength)?;
    let crc: [u8; CRC] = crc.try_into().map_err(|_| Reject::WrongLength)?;
    if crc16(head) != u16::from_le_bytes(crc) {
        return Err(Reject::BadCrc);
    }
    if *major != version::MAJOR {
        return Err(Reject::WrongVersion);
    }
    Ok((*number, *seq, head.get(HEADER..).unwrap_or(&[])))
}

impl PacketCount {
    fn count(&mut self, seq: u8) {
        if let Some(newest) = self.newest {
            let missing = seq.wrapping_sub(newest).wrapping_sub(1);
            // Half the range ahead is behind: a repeat or a restart, not a loss.
            let lost = if missing < 128 { missing } else { 0 };
            self.lost = self.lost.saturating_add(u32::from(lost));
        }
        self.newest = Some(seq);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stuffed(plain: &[u8]) -> ([u8; 600], usize) {
        let mut space = [0xEE; 600];
        let len = stuff(plain, &mut space).unwrap();
        (space, len)
    }

    #[test]
    fn examples_worked_by_hand() {
        for (plain, wanted) in [
            (&[][..], &[1][..]),
            (&[0], &[1, 1]),
            (&[0, 0], &[1, 1, 1]),
            (&[0x11, 0x22, 0, 0x33], &[3, 0x11, 0x22, 2, 0x33]),
            (&[0x11, 0, 0, 0], &[2, 0x11, 1, 1, 1]),
        ] {
            let (space, len) = stuffed(plain);
            assert_eq!(&space[..len], wanted, "{plain:?}");
        }
    }

    #[test]
    fn broken_stuffing_is_refused() {
        for bytes in [&[3, 1][..], &[0], &[2, 0], &[1, 0, 1]] {
            let mut space = [0; 3];
            space[..bytes.len()].copy_from_slice(bytes);
            assert_eq!(unstuff(&mut space[..bytes.len()]), Err(Reject::BadFraming), "{bytes:?}");
        }
    }

    #[test]
    fn too_little_space_does_not_panic() {
        assert_eq!(stuff(&[1, 2, 3], &mut [0; 3]), None);
        assert_eq!(stuff(&[], &mut []), None);
    }

    proptest! {
        #[test]
        fn round_trips_without_zeros(plain in prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], 0..520)) {
            let (mut space, len) = stuffed(&plain);
            prop_assert!(!space[..len].contains(&0), "a zero on the line");
            prop_assert!(len <= plain.len() + 1 + plain.len() / 254);
            prop_assert_eq!(unstuff(&mut space[..len]).unwrap(), &plain[..]);
        }

        #[test]
        fn any_bytes_are_no_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = unstuff(&mut bytes);
        }
    }
}
