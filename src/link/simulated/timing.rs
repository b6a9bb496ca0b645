//! How long a packet occupies the wire.
//!
//! Source: ISO 11898-1:2015, frame formats. Worst-case stuffing unless asked otherwise, so that a budget that holds
//! here holds on a bench; exact stuffing is counted in `stuffing`.

use super::stuffing::{self, Stuffing};
use crate::Packet;
use base::{time::Span, units::NS_PER_S};
use firmware_protocol::can::CanFrame;

/// Kind and speed of the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusTiming {
    /// Classic CAN; carries no FD frames.
    CanClassic {
        /// Bit rate, bit/s.
        bit_rate_bps: u32,
    },
    /// CAN FD with bit rate switching; carries classic frames at the arbitration rate.
    CanFd {
        /// Rate of arbitration and acknowledgement, bit/s.
        arbitration_bps: u32,
        /// Rate of data and CRC, bit/s.
        data_bps: u32,
    },
    /// Asynchronous serial, 8N1, each direction on its own wire.
    Serial {
        /// Bit rate, bit/s.
        baud: u32,
    },
    /// Datagrams over Ethernet, each direction on its own wire.
    Datagram {
        /// Bit rate, bit/s.
        bit_rate_bps: u32,
    },
}

/// Bytes around a UDP datagram on Ethernet: preamble 8, header 14, check sequence 4, gap 12, IPv4 20, UDP 8.
const AROUND_DATAGRAM: u64 = 66;
/// Least bytes of an Ethernet frame with preamble and gap.
const LEAST_FRAME: u64 = 84;

/// Bits of one serial byte: start, 8 data, stop.
const BITS_PER_BYTE: u64 = 10;

impl BusTiming {
    /// Returns whether both directions share the wire.
    pub fn is_shared(&self) -> bool {
        !matches!(self, Self::Serial { .. } | Self::Datagram { .. })
    }

    /// Returns the kind of packet carried, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::CanClassic { .. } => "classic CAN",
            Self::CanFd { .. } => "CAN FD or classic CAN",
            Self::Serial { .. } => "serial",
            Self::Datagram { .. } => "datagram",
        }
    }

    /// Returns the time of one bit outside the data phase of FD frames, rounded up to the nanosecond.
    pub fn bit_time(&self) -> Span {
        match self {
            Self::CanClassic { bit_rate_bps: rate } | Self::CanFd { arbitration_bps: rate, .. } => span(1, *rate),
            Self::Serial { baud } => span(1, *baud),
            Self::Datagram { bit_rate_bps } => span(1, *bit_rate_bps),
        }
    }

    /// Returns the time on the wire with the most stuff bits, rounded up to the nanosecond; `None` when this wire does
    /// not carry such packets.
    pub fn duration(&self, packet: &Packet) -> Option<Span> {
        self.duration_with(packet, Stuffing::Worst)
    }

    /// Returns the time on the wire with these stuff bits, rounded up to the nanosecond; `None` when this wire does not
    /// carry such packets.
    pub fn duration_with(&self, packet: &Packet, stuffing: Stuffing) -> Option<Span> {
        match (self, packet) {
            (Self::CanClassic { bit_rate_bps }, Packet::Can(frame)) if !frame.is_fd() => {
                Some(span(classic_bits(frame, stuffing), *bit_rate_bps))
            }
            (Self::CanFd { arbitration_bps, data_bps }, Packet::Can(frame)) => {
                let (arbitration, data) =
                    if frame.is_fd() { fd_bits(frame, stuffing) } else { (classic_bits(frame, stuffing), 0) };
                Some(span(arbitration, *arbitration_bps) + span(data, *data_bps))
            }
            (Self::Serial { baud }, Packet::Serial(chunk)) => {
                Some(span(chunk.as_slice().len() as u64 * BITS_PER_BYTE, *baud))
            }
            (Self::Datagram { bit_rate_bps }, Packet::Datagram(datagram)) => {
                let bytes = (datagram.as_slice().len() as u64 + AROUND_DATAGRAM).max(LEAST_FRAME);
                Some(span(8 * bytes, *bit_rate_bps))
            }
            _ => None,
        }
    }
}

fn span(bits: u64, bit_rate_bps: u32) -> Span {
    let ns = (bits * NS_PER_S.unsigned_abs()).div_ceil(u64::from(bit_rate_bps.max(1)));
    Span::from_ns(i64::try_from(ns).unwrap_or(i64::MAX))
}

/// Returns bits of a classic frame with its stuff bits and the 3 bits of interframe space: at most 135 for 8 bytes, 160
/// with an identifier of 29 bits.
///
/// 34 bits of header and CRC are subject to stuffing, 10 are not. An identifier of 29 bits adds 20: SRR, 18 bits and one
/// more reserved bit.
fn classic_bits(frame: &CanFrame, stuffing: Stuffing) -> u64 {
    let data = 8 * frame.data().len() as u64;
    let header = if frame.id().is_extended() { 54 } else { 34 };
    let (stuffed, plain, interframe) = (header + data, 10, 3);
    let stuff = match stuffing {
        Stuffing::Worst => (stuffed - 1) / 4,
        Stuffing::Exact => stuffing::classic(frame),
    };
    stuffed + stuff + plain + interframe
}

/// Returns bits of an FD frame with its stuff bits: at the arbitration rate, at the data rate.
fn fd_bits(frame: &CanFrame, stuffing: Stuffing) -> (u64, u64) {
    let data = 8 * frame.data().len() as u64;
    // Start, 11 identifier bits, RRS, IDE, FDF, reserved, BRS; of 29 identifier bits also SRR. Then, after the CRC:
    // delimiter, acknowledge slot and delimiter, 7 end-of-frame and 3 interframe bits.
    let (head, tail) = (if frame.id().is_extended() { 36 } else { 17 }, 13);
    // ESI, 4 length bits and the data are stuffed where needed; the CRC field has a fixed stuff bit per 4.
    let stuffed = 5 + data;
    let (head_stuff, stuff) = match stuffing {
        Stuffing::Worst => ((head - 1) / 4, (head + stuffed - 1) / 4 - (head - 1) / 4),
        Stuffing::Exact => stuffing::fd(frame),
    };
    let (count, crc, fixed) = if frame.data().len() <= 16 { (4, 17, 6) } else { (4, 21, 7) };
    (head + head_stuff + tail, stuffed + stuff + count + crc + fixed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SerialChunk;
    use firmware_protocol::can::CanId;

    fn classic(len: usize) -> Packet {
        Packet::Can(CanFrame::classic(1, &[0; 8][..len]).unwrap())
    }

    #[test]
    fn classic_frames_take_their_worst_case_bits() {
        let bus = BusTiming::CanClassic { bit_rate_bps: 500_000 };
        // Davis, Burns, Bril and Lukkien, "CAN schedulability analysis" (2007): 55 + 10 n bits with interframe space.
        for len in 0..=8 {
            let wanted = Span::from_ns((55 + 10 * len as i64) * 2000);
            assert_eq!(bus.duration(&classic(len)), Some(wanted), "{len} bytes");
            // The same, with identifiers of 29 bits: 80 + 10 n.
            let frame = CanFrame::classic(CanId::extended(1).unwrap(), &[0; 8][..len]).unwrap();
            let wanted = Span::from_ns((80 + 10 * len as i64) * 2000);
            assert_eq!(bus.duration(&Packet::Can(frame)), Some(wanted), "{len} bytes, 29 bits");
        }
    }

    #[test]
    fn an_fd_attitude_at_100_hz_loads_the_bus_by_1_7_percent() {
        let bus = BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 5_000_000 };
        let frame = Packet::Can(CanFrame::fd(1, &[0; 48]).unwrap());
        // 34 bits of 2 us and 518 bits of 200 ns.
        assert_eq!(bus.duration(&frame), Some(Span::from_ns(34 * 2000 + 518 * 200)));
        assert_eq!(bus.duration(&classic(8)), Some(Span::from_ns(135 * 2000)));
        // 36 bits, 8 stuff bits and 13 bits of 2 us; then 389 bits with the stuff bits that are left of 36 + 389.
        let frame = Packet::Can(CanFrame::fd(CanId::extended(1).unwrap(), &[0; 48]).unwrap());
        let fast = 5 + 8 * 48 + ((36 + 389 - 1) / 4 - 8) + 4 + 21 + 7;
        assert_eq!(bus.duration(&frame), Some(Span::from_ns(57 * 2000 + fast * 200)));
    }

    #[test]
    fn serial_bytes_take_ten_bits() {
        let line = BusTiming::Serial { baud: 1_000_000 };
        let chunk = Packet::Serial(SerialChunk::new(&[0; 7]).unwrap());
        assert_eq!(line.duration(&chunk), Some(Span::from_ns(70_000)));
    }

    #[test]
    fn packets_of_another_kind_are_without_duration() {
        let fd = Packet::Can(CanFrame::fd(1, &[0; 8]).unwrap());
        assert_eq!(BusTiming::CanClassic { bit_rate_bps: 500_000 }.duration(&fd), None);
        assert_eq!(BusTiming::Serial { baud: 9600 }.duration(&fd), None);
        assert!(BusTiming::Serial { baud: 0 }.duration(&Packet::Serial(SerialChunk::EMPTY)).is_some(), "no panic");
    }
}
