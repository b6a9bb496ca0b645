//! What a link moves: one CAN frame, or one run of serial bytes.

use firmware_protocol::can::CanFrame;
use firmware_protocol::serial::ENCODED_MAX;

/// Longest run of serial bytes in one packet: holds any one encoded message.
pub const CHUNK_MAX: usize = 80;
const _: () = assert!(ENCODED_MAX <= CHUNK_MAX, "a serial message must fit one chunk");

/// Bytes that were read or written together. Their borders mean nothing.
#[derive(Debug, Clone, Copy)]
pub struct SerialChunk {
    bytes: [u8; CHUNK_MAX],
    len: usize,
}

/// One thing on the wire.
#[derive(Debug, Clone, Copy)]
pub enum Packet {
    /// A CAN or CAN FD frame.
    Can(CanFrame),
    /// Bytes on a serial line.
    Serial(SerialChunk),
}

impl SerialChunk {
    /// No bytes.
    pub const EMPTY: Self = Self { bytes: [0; CHUNK_MAX], len: 0 };

    /// A chunk of at most [`CHUNK_MAX`] bytes; `None` for more.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut chunk = Self { len: bytes.len(), ..Self::EMPTY };
        chunk.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(chunk)
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl PartialEq for SerialChunk {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl PartialEq for Packet {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Can(a), Self::Can(b)) => a == b,
            (Self::Serial(a), Self::Serial(b)) => a == b,
            _ => false,
        }
    }
}

impl Packet {
    /// Kind of packet, for messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Can(frame) if frame.is_fd() => "CAN FD",
            Self::Can(_) => "classic CAN",
            Self::Serial(_) => "serial",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_keep_their_bytes_and_refuse_too_many() {
        assert_eq!(SerialChunk::new(&[1, 2, 3]).unwrap().as_slice(), [1, 2, 3]);
        assert!(SerialChunk::new(&[0; CHUNK_MAX]).is_some());
        assert!(SerialChunk::new(&[0; CHUNK_MAX + 1]).is_none());
        assert_ne!(SerialChunk::new(&[1]), SerialChunk::new(&[1, 0]), "length counts");
    }
}
