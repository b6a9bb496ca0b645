//! Packets with a wrong bit, packets without their tail, packets of nonsense.

use crate::{CHUNK_MAX, Datagram, Packet, SerialChunk, WireFormat};
use firmware_protocol::can::{CanFrame, CanId};
use rand::{RngExt, rngs::StdRng};

/// Longest payloads of CAN frames.
const CLASSIC_MAX: usize = 8;
const FD_MAX: usize = 64;

/// Changes one bit of the content, if there is any.
pub(super) fn flip_a_bit(packet: &mut Packet, dice: &mut StdRng) {
    let flip = |bytes: &mut [u8], dice: &mut StdRng| {
        if !bytes.is_empty() {
            let bit = dice.random_range(0..8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    };
    match packet {
        Packet::Can(frame) => {
            let mut bytes = frame.data().to_vec();
            flip(&mut bytes, dice);
            *frame = frame.with_data(&bytes).unwrap_or(*frame);
        }
        Packet::Serial(chunk) => {
            let mut bytes = chunk.as_slice().to_vec();
            flip(&mut bytes, dice);
            *chunk = SerialChunk::new(&bytes).unwrap_or(*chunk);
        }
        Packet::Datagram(datagram) => {
            let mut bytes = datagram.as_slice().to_vec();
            flip(&mut bytes, dice);
            *datagram = Datagram::new(&bytes).unwrap_or(*datagram);
        }
    }
}

/// Cuts the content to a random shorter length (of those that a frame can have); false when there is nothing to cut.
pub(super) fn cut_the_tail(packet: &mut Packet, dice: &mut StdRng) -> bool {
    let length = packet.data().len();
    if length == 0 {
        return false;
    }
    let kept = dice.random_range(0..length);
    match packet {
        Packet::Can(frame) => {
            let longest = (0..=kept).rev().find_map(|length| frame.with_data(&frame.data()[..length]));
            *frame = longest.unwrap_or(*frame);
        }
        Packet::Serial(chunk) => *chunk = SerialChunk::new(&chunk.as_slice()[..kept]).unwrap_or(*chunk),
        Packet::Datagram(datagram) => *datagram = Datagram::new(&datagram.as_slice()[..kept]).unwrap_or(*datagram),
    }
    true
}

/// Returns a packet of random content.
pub(super) fn babble(format: WireFormat, id: CanId, bytes: u8, dice: &mut StdRng) -> Option<Packet> {
    let mut content = [0; CHUNK_MAX];
    dice.fill(&mut content[..]);
    let content = |most: usize| &content[..usize::from(bytes).min(most)];
    match format {
        WireFormat::CanClassic => can(id, false, content(CLASSIC_MAX)).map(Packet::Can),
        WireFormat::CanFd => can(id, true, content(FD_MAX)).map(Packet::Can),
        WireFormat::Serial => SerialChunk::new(content(CHUNK_MAX)).map(Packet::Serial),
        WireFormat::Plain => Datagram::new(content(CHUNK_MAX)).map(Packet::Datagram),
    }
}

/// Returns the frame with the longest legal length that the data fill.
fn can(id: CanId, is_fd: bool, data: &[u8]) -> Option<CanFrame> {
    let empty = if is_fd { CanFrame::fd(id, &[]) } else { CanFrame::classic(id, &[]) }?;
    (0..=data.len()).rev().find_map(|length| empty.with_data(&data[..length]))
}
