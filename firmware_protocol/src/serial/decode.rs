//! Bytes on the line -> messages.

use super::{CRC, HEADER, STUFFED_MAX, cobs};
use crate::{Message, MessageId, Reject, version};
use crate::{crc::crc16, sequence::Sequences};

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
        let (number, seq, payload) = open(cobs::unstuff(stuffed)?)?;
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
