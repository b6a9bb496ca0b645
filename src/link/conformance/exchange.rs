//! Packets made from numbers; sending them and comparing the received packets.

use super::suite::{PATIENCE, Suite};
use crate::{CHUNK_MAX, DATAGRAM_MAX, Datagram, Link, Packet, SerialChunk, Stamped, WireFormat};
use base::time::Tai;
use firmware_protocol::can::{CanFrame, CanId};

/// Lengths of FD data (ISO 11898-1).
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];
/// Bytes that a serial line holds while its other end does not read: half of a pseudo terminal's 4 KiB.
const SERIAL_SPACE: usize = 2048;
/// Datagrams that any receive buffer holds while it is not read.
const DATAGRAMS_AT_ONCE: usize = 32;

/// Returns every length a packet can have on this wire, shortest first.
pub(super) fn all_lengths(format: WireFormat) -> Vec<usize> {
    match format {
        WireFormat::CanClassic => (0..=8).collect(),
        WireFormat::CanFd => FD_LENGTHS.to_vec(),
        WireFormat::Serial => (1..=CHUNK_MAX).collect(),
        WireFormat::Plain => (1..=DATAGRAM_MAX).collect(),
    }
}

/// Returns the packet number `number`: its own identifier and bytes, different from those of its neighbours.
pub(super) fn packet(format: WireFormat, number: usize, len: usize) -> Result<Packet, String> {
    let bytes: Vec<u8> = (0..len).map(|at| scrambled(number, at)).collect();
    let id = identifier(number).ok_or("the suite made an impossible identifier")?;
    let made = match format {
        WireFormat::CanClassic => CanFrame::classic(id, &bytes).map(Packet::Can),
        WireFormat::CanFd => CanFrame::fd(id, &bytes).map(Packet::Can),
        WireFormat::Serial => SerialChunk::new(&bytes).map(Packet::Serial),
        WireFormat::Plain => Datagram::new(&bytes).map(Packet::Datagram),
    };
    made.ok_or_else(|| format!("the suite made an impossible packet of {len} bytes"))
}

/// Returns the identifier of packet `number`: every second one has 29 bits, every fourth one the very number of the packet
/// before it.
fn identifier(number: usize) -> Option<CanId> {
    // 1999 is prime to the steps of the loops: identifiers go up and down.
    let standard = u16::try_from(number / 2 * 1999 % 0x800).ok()?;
    match number % 4 {
        1 => CanId::extended(standard.into()),
        3 => CanId::extended(u32::from(standard) << 18 | u32::from(standard)),
        _ => CanId::standard(standard),
    }
}

/// Returns one byte of packet `number`, from scrambled Weyl steps: every value occurs, and no packet is a shift of
/// another.
#[allow(clippy::cast_possible_truncation, reason = "the top byte of the product is wanted")]
fn scrambled(number: usize, at: usize) -> u8 {
    let mut x = (number as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (at as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    x ^= x >> 29;
    (x.wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 56) as u8
}

impl Suite<'_> {
    /// Sends all of them and receives them at the other end. On a serial line no more than it holds is under way.
    pub(super) fn carry(&self, from: &mut dyn Link, to: &mut dyn Link, packets: &[Packet]) -> Result<(), String> {
        let at_once = match self.format {
            WireFormat::Serial => SERIAL_SPACE / CHUNK_MAX,
            WireFormat::Plain => DATAGRAMS_AT_ONCE,
            WireFormat::CanClassic | WireFormat::CanFd => packets.len().max(1),
        };
        for some in packets.chunks(at_once) {
            for packet in some {
                from.send(packet).map_err(|error| error.to_string())?;
            }
            self.expect(to, some)?;
        }
        Ok(())
    }

    /// Receives exactly these, in this order; the stamp of the last one.
    pub(super) fn expect(&self, link: &mut dyn Link, packets: &[Packet]) -> Result<Option<Tai>, String> {
        if self.format == WireFormat::Serial {
            return self.expect_bytes(link, &joined(packets));
        }
        let mut last = None;
        for (number, wanted) in packets.iter().enumerate() {
            let got = self.next(link)?.ok_or_else(|| format!("packet {number} of {} was lost", packets.len()))?;
            if got.value != *wanted {
                return Err(format!("packet {number}: wanted {wanted:?}, got {:?}", got.value));
            }
            last = Some(got.at);
        }
        Ok(last)
    }

    fn expect_bytes(&self, link: &mut dyn Link, wanted: &[u8]) -> Result<Option<Tai>, String> {
        let (mut taken, mut last) = (0, None);
        while taken < wanted.len() {
            let got = self.next(link)?.ok_or_else(|| format!("{taken} of {} bytes, then nothing", wanted.len()))?;
            let Packet::Serial(chunk) = got.value else { return Err(format!("a {} packet", got.value.kind())) };
            let bytes = chunk.as_slice();
            if bytes.is_empty() || wanted.get(taken..taken + bytes.len()) != Some(bytes) {
                return Err(format!("other bytes than those sent after the first {taken}: {bytes:02x?}"));
            }
            taken += bytes.len();
            last = Some(got.at);
        }
        Ok(last)
    }

    /// Checks that no packet is waiting.
    pub(super) fn expect_nothing(&self, link: &mut dyn Link) -> Result<(), String> {
        match link.receive(self.clock.now()).map_err(|error| error.to_string())? {
            None => Ok(()),
            Some(packet) => Err(format!("a packet arrived that was not sent: {:?}", packet.value)),
        }
    }

    pub(super) fn next(&self, link: &mut dyn Link) -> Result<Option<Stamped<Packet>>, String> {
        link.receive(self.clock.now() + PATIENCE).map_err(|error| error.to_string())
    }
}

fn joined(packets: &[Packet]) -> Vec<u8> {
    let bytes = packets.iter().filter_map(|packet| match packet {
        Packet::Serial(chunk) => Some(chunk.as_slice()),
        Packet::Can(_) | Packet::Datagram(_) => None,
    });
    bytes.flatten().copied().collect()
}
