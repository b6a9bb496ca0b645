//! The packets of a link: one CAN frame, one run of serial bytes, or one datagram.

use firmware_protocol::{can::CanFrame, serial::ENCODED_MAX};

/// Longest run of serial bytes in one packet: holds any one encoded message.
pub const CHUNK_MAX: usize = 80;
const _: () = assert!(ENCODED_MAX <= CHUNK_MAX, "a serial message must fit one chunk");

/// Longest datagram: holds any plain message of an outside simulator, and any line of one.
pub const DATAGRAM_MAX: usize = 512;

/// At most `MOST` bytes, in place.
#[derive(Debug, Clone, Copy)]
pub struct Bytes<const MOST: usize> {
    bytes: [u8; MOST],
    len: usize,
}

/// Bytes that were read or written together. Their borders mean nothing.
pub type SerialChunk = Bytes<CHUNK_MAX>;

/// Bytes of one datagram, or of one record or line of a stream. Their borders mean the border of a message.
pub type Datagram = Bytes<DATAGRAM_MAX>;

/// One thing on the wire.
#[derive(Debug, Clone, Copy)]
#[allow(clippy::large_enum_variant, reason = "a box would be an allocation for each packet of the receiving thread")]
pub enum Packet {
    /// A CAN or CAN FD frame.
    Can(CanFrame),
    /// Bytes on a serial line.
    Serial(SerialChunk),
    /// A plain datagram.
    Datagram(Datagram),
}

impl<const MOST: usize> Bytes<MOST> {
    /// No bytes.
    pub const EMPTY: Self = Self { bytes: [0; MOST], len: 0 };

    /// Returns at most `MOST` bytes; `None` for more.
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut all = Self { len: bytes.len(), ..Self::EMPTY };
        all.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(all)
    }

    /// Returns the bytes.
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.len]
    }
}

impl<const MOST: usize> PartialEq for Bytes<MOST> {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl PartialEq for Packet {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Can(a), Self::Can(b)) => a == b,
            (Self::Serial(a), Self::Serial(b)) => a == b,
            (Self::Datagram(a), Self::Datagram(b)) => a == b,
            _ => false,
        }
    }
}

impl Packet {
    /// Returns the kind of packet, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Can(frame) if frame.is_fd() => "CAN FD",
            Self::Can(_) => "classic CAN",
            Self::Serial(_) => "serial",
            Self::Datagram(_) => "datagram",
        }
    }

    /// Returns the number of bytes that the packet carries, without those of its frame.
    pub fn data(&self) -> &[u8] {
        match self {
            Self::Can(frame) => frame.data(),
            Self::Serial(chunk) => chunk.as_slice(),
            Self::Datagram(datagram) => datagram.as_slice(),
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
        assert!(Datagram::new(&[7; DATAGRAM_MAX]).is_some() && Datagram::new(&[7; DATAGRAM_MAX + 1]).is_none());
    }

    #[test]
    fn packets_of_two_kinds_are_never_equal() {
        let (chunk, datagram) = (SerialChunk::new(&[1]).unwrap(), Datagram::new(&[1]).unwrap());
        assert_ne!(Packet::Serial(chunk), Packet::Datagram(datagram));
        assert_eq!(Packet::Serial(chunk).data(), Packet::Datagram(datagram).data(), "of the same bytes");
    }
}
