//! GVSP: one frame -> leader, payload packets, trailer. Big-endian, over UDP.
//!
//! ```text
//! header: status u16, block u16 (1 to 65535, never 0), type << 24 | packet number
//! packet 0: leader    1 to n: payload, all of the same size but the last    n + 1: trailer
//! ```
//!
//! Packet size is the IP datagram's: 20 bytes of IP, 8 of UDP and 8 of GVSP headers are not data.

use crate::network_camera::{gvcp::Status, pixel_format::PixelFormat, regions::stacked_px, test_pattern::TestPattern};
use base::bayer::BayerPattern;
use frames::camera_control::Regions;
use std::net::SocketAddrV4;

/// Bytes of a packet's header.
pub(super) const HEADER_BYTES: usize = 8;
/// Bytes of IP and UDP headers, which the packet size counts.
pub(super) const IP_UDP_BYTES: usize = 28;
const LEADER: u32 = 1;
const TRAILER: u32 = 2;
const PAYLOAD: u32 = 3;
/// An image; with chunks behind it.
const IMAGE: u16 = 0x0001;
const IMAGE_WITH_CHUNKS: u16 = 0x4001;

/// Settings of the stream, sent from the control side to the stream side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamSettings {
    /// Goes up with every start and stop of acquisition; frames of another one are not sent.
    pub acquisition: u32,
    /// Destination of packets; `None` while no acquisition runs or the client gave no address.
    pub destination: Option<SocketAddrV4>,
    /// Packet size, bytes with IP and UDP headers.
    pub packet_bytes: usize,
    /// Pause between packets on top of the rate, ns.
    pub delay_ns: u32,
    /// Pixel format.
    pub format: PixelFormat,
    /// Colours of the sensor's pixels from its first one, where they have filters.
    pub colours: Option<BayerPattern>,
    /// Pattern that is sent in place of the image.
    pub pattern: TestPattern,
    /// Parts of the image, at least one; several are sent as one image, one below the other.
    pub regions: Regions,
    /// Truth behind each image.
    pub with_chunks: bool,
}

impl StreamSettings {
    /// No stream.
    pub(super) const NONE: Self = Self {
        acquisition: 0,
        destination: None,
        packet_bytes: 0,
        delay_ns: 0,
        format: PixelFormat::Mono16,
        colours: None,
        pattern: TestPattern::Off,
        regions: Regions::WHOLE,
        with_chunks: false,
    };
}

/// Returns the head of one packet.
pub(super) fn header(status: Status, block: u16, kind_and_number: u32) -> [u8; HEADER_BYTES] {
    let [a, b] = status.code().to_be_bytes();
    let [c, d] = block.to_be_bytes();
    let [e, f, g, h] = kind_and_number.to_be_bytes();
    [a, b, c, d, e, f, g, h]
}

/// A frame as it is sent, kept until newer ones take its place. Its buffers are made once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) id: u16,
    pub(super) settings: StreamSettings,
    /// Image and chunks.
    pub(super) payload: Vec<u8>,
    leader: Vec<u8>,
    trailer: Vec<u8>,
}

impl Block {
    /// Returns a block with capacity for so many bytes of image and chunks.
    pub(super) fn with_capacity(payload_bytes: usize, settings: StreamSettings) -> Self {
        let small = || Vec::with_capacity(64);
        Self { id: 0, settings, payload: Vec::with_capacity(payload_bytes), leader: small(), trailer: small() }
    }

    /// Writes leader and trailer for the present payload. `time_ns` is the time stamp in the leader.
    pub(super) fn seal(&mut self, id: u16, time_ns: u64) {
        let Self { settings, leader, trailer, payload, .. } = self;
        let [columns, rows] = stacked_px(&settings.regions);
        // An image of several regions begins nowhere on the sensor.
        let [x, y] = match settings.regions.as_slice() {
            [only] => [only.left_px, only.top_px],
            _ => [0; 2],
        };
        let kind = if settings.with_chunks { IMAGE_WITH_CHUNKS } else { IMAGE };
        leader.clear();
        leader.extend([0, 0]);
        leader.extend(kind.to_be_bytes());
        leader.extend(time_ns.to_be_bytes());
        [settings.format.code(settings.colours), columns, rows, x, y, 0]
            .iter()
            .for_each(|word| leader.extend(word.to_be_bytes()));
        trailer.clear();
        trailer.extend([0, 0]);
        trailer.extend(kind.to_be_bytes());
        if settings.with_chunks {
            trailer.extend(u32::try_from(payload.len()).unwrap_or(u32::MAX).to_be_bytes());
        }
        trailer.extend(rows.to_be_bytes());
        if settings.with_chunks {
            trailer.extend(1_u32.to_be_bytes());
        }
        self.id = id;
    }

    /// Returns the data bytes of all payload packets but the last.
    fn data_bytes(&self) -> usize {
        self.settings.packet_bytes.saturating_sub(IP_UDP_BYTES + HEADER_BYTES).max(1)
    }

    /// Returns packets of the frame, leader and trailer included.
    pub(super) fn packets(&self) -> u32 {
        u32::try_from(self.payload.len().div_ceil(self.data_bytes())).unwrap_or(u32::MAX - 2) + 2
    }

    /// Returns the header and data of packet `number`; `None` past the trailer.
    pub(super) fn packet(&self, number: u32) -> Option<([u8; HEADER_BYTES], &[u8])> {
        let last = self.packets() - 1;
        let (kind, data): (_, &[u8]) = match number {
            0 => (LEADER, &self.leader),
            _ if number == last => (TRAILER, &self.trailer),
            _ if number < last => {
                let start = usize::try_from(number - 1).ok()? * self.data_bytes();
                let end = self.payload.len().min(start + self.data_bytes());
                (PAYLOAD, self.payload.get(start..end)?)
            }
            _ => return None,
        };
        Some((header(Status::Success, self.id, kind << 24 | number), data))
    }
}

/// Returns the head that says that packet `number` of a block is gone.
pub(super) fn gone(block: u16, number: u32) -> [u8; HEADER_BYTES] {
    header(Status::PacketUnavailable, block, PAYLOAD << 24 | number & 0xFF_FFFF)
}

/// Returns the block after `id`.
pub(super) fn next_id(id: u16) -> u16 {
    if id == u16::MAX { 1 } else { id + 1 }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use frames::camera_control::Region;

    /// One region: first column, first row, columns, rows.
    pub(in crate::network_camera) fn one_region([left_px, top_px, width_px, height_px]: [u32; 4]) -> Regions {
        Regions::of(&[Region { left_px, top_px, width_px, height_px }]).unwrap()
    }

    /// Settings of a small stream to nowhere, without a region.
    pub(in crate::network_camera) const SETTINGS: StreamSettings = StreamSettings {
        acquisition: 1,
        destination: None,
        packet_bytes: 576,
        delay_ns: 0,
        format: PixelFormat::Mono16,
        colours: None,
        pattern: TestPattern::Off,
        regions: Regions::WHOLE,
        with_chunks: false,
    };

    fn block(bytes: usize, with_chunks: bool) -> Block {
        let mut block = Block::with_capacity(
            bytes,
            StreamSettings { with_chunks, regions: one_region([1, 2, 31, 17]), ..SETTINGS },
        );
        block.payload.extend((0..bytes).map(|at| at.to_le_bytes()[0]));
        block.seal(0xABCD, 0x0102_0304_0506_0708);
        block
    }

    #[test]
    fn packets_join_to_the_payload() {
        for bytes in [1, 539, 540, 541, 1079, 1080, 1081] {
            let block = block(bytes, false);
            let parts: Vec<_> = (0..).map_while(|number| block.packet(number)).collect();
            assert_eq!(parts.len(), usize::try_from(block.packets()).unwrap());
            let data = &parts[1..parts.len() - 1];
            assert!(data[..data.len() - 1].iter().all(|(_, data)| data.len() == 540), "all but the last are full");
            assert_eq!(data.iter().flat_map(|(_, data)| data.iter().copied()).collect::<Vec<_>>(), block.payload);
            for (number, (head, _)) in parts.iter().enumerate() {
                let kind = if number == 0 {
                    1
                } else if number + 1 == parts.len() {
                    2
                } else {
                    3
                };
                assert_eq!(*head, [0, 0, 0xAB, 0xCD, kind, 0, 0, u8::try_from(number).unwrap()]);
            }
        }
    }

    #[test]
    fn leader_and_trailer_by_hand() {
        let plain = block(31 * 17 * 2, false);
        let leader = plain.packet(0).unwrap().1;
        let wanted = [
            &[0, 0, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 1, 0x10, 0, 7, 0, 0, 0, 31, 0, 0, 0, 17][..],
            &[0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0],
        ];
        assert_eq!(leader, wanted.concat());
        assert_eq!(plain.packet(plain.packets() - 1).unwrap().1, [0, 0, 0, 1, 0, 0, 0, 17]);
        let chunked = block(2000, true);
        assert_eq!(chunked.packet(0).unwrap().1[2..4], [0x40, 1]);
        let trailer = [0, 0, 0x40, 1, 0, 0, 7, 0xD0, 0, 0, 0, 17, 0, 0, 0, 1];
        assert_eq!(chunked.packet(chunked.packets() - 1).unwrap().1, trailer);
    }

    #[test]
    fn block_numbers_are_never_zero() {
        assert_eq!((next_id(1), next_id(65_534), next_id(65_535)), (2, 65_535, 1));
        assert_eq!(gone(3, 5), [0x80, 0x0C, 0, 3, 3, 0, 0, 5]);
    }
}
