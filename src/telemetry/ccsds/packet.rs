//! Space packets of CCSDS 133.0-B-2 with the secondary headers of ECSS-E-ST-70-41C (PUS): bytes <-> fields. Big-endian.
//!
//! The last two octets are CRC-16/IBM-3740 over all before them: the CRC of starloop's own protocol.

use base::time::{Span, Tai};
use base::units::NS_PER_S;
use firmware_protocol::crc::crc16;

/// Octets of the primary header.
pub const PRIMARY: usize = 6;
/// Octets of the secondary header of a telecommand.
const TC_SECONDARY: usize = 5;
const CRC: usize = 2;
/// Longest telecommand, octets.
pub const TC_MAX: usize = 256;
/// Octets of the secondary header of telemetry before its time code.
const TM_SECONDARY: usize = 7;
/// Octets of the time code with its P-field.
const TIME: usize = 8;
/// Longest telemetry packet that is read, octets.
pub const TELEMETRY_MAX: usize = 4096;
/// Version, type and secondary header flag of telemetry.
const TM_FIRST: u16 = 0x0800;
/// The same of a telecommand.
const TC_FIRST: u16 = 0x1800;
const APID_MASK: u16 = 0x07FF;
/// Sequence flags of a packet that is not part of another.
const UNSEGMENTED: u16 = 0xC000;
/// Sequence counts have 14 bits.
pub const COUNT_MASK: u16 = 0x3FFF;
/// PUS version 2 in the upper half.
const PUS_C: u8 = 0x20;
/// P-field of a CUC time code: TAI since 1958, four octets of seconds, three of fractions.
const CUC_TAI: u8 = 0x1F;
/// Seconds from 1958-01-01 to 1970-01-01, TAI.
const S_1958_TO_1970: i64 = 4383 * 86_400;

/// Reason why octets cannot be read as a packet.
pub type Refusal = &'static str;

const BAD_LENGTH: Refusal = "the packet has a length that none has: a telecommand at most 256 octets, telemetry 4096";
const BAD_CRC: Refusal = "the CRC differs: wanted CRC-16/IBM-3740 over all octets before it";
const NOT_PUS_C: Refusal = "the secondary header is not of PUS version 2";

/// Form of the packets of one direction.
#[derive(Debug)]
pub(crate) struct Form {
    /// Version, type and secondary header flag.
    first: u16,
    /// Fewest and most octets.
    octets: [usize; 2],
    other: Refusal,
}

pub(crate) const TELEMETRY: Form = Form {
    first: TM_FIRST,
    octets: [PRIMARY + TM_SECONDARY + TIME + CRC, TELEMETRY_MAX],
    other: "the packet is of another type: wanted telemetry with a secondary header, version 0",
};
pub(crate) const TELECOMMAND: Form = Form {
    first: TC_FIRST,
    octets: [PRIMARY + TC_SECONDARY + CRC, TC_MAX],
    other: "the packet is of another type: wanted a telecommand with a secondary header, version 0",
};

impl Form {
    /// Returns the octets of the packet that begins here; `None` when its header is not whole yet.
    fn length_of(&self, bytes: &[u8]) -> Option<Result<usize, Refusal>> {
        let [a, b, _, _, c, d] = *bytes.first_chunk::<PRIMARY>()?;
        if u16::from_be_bytes([a, b]) & !APID_MASK != self.first {
            return Some(Err(self.other));
        }
        let length = PRIMARY + usize::from(u16::from_be_bytes([c, d])) + 1;
        let is_possible = (self.octets[0]..=self.octets[1]).contains(&length);
        Some(if is_possible { Ok(length) } else { Err(BAD_LENGTH) })
    }
}

/// Returns a whole packet without its CRC.
fn content_of<'p>(packet: &'p [u8], form: &Form) -> Result<&'p [u8], Refusal> {
    let length = form.length_of(packet).unwrap_or(Err(BAD_LENGTH))?;
    let (Some((content, crc)), true) = (packet.split_last_chunk::<CRC>(), packet.len() == length) else {
        return Err(BAD_LENGTH);
    };
    if crc16(content) != u16::from_be_bytes(*crc) {
        return Err(BAD_CRC);
    }
    if content.get(PRIMARY).is_some_and(|version| version & 0xF0 == PUS_C) { Ok(content) } else { Err(NOT_PUS_C) }
}

/// Octets of a stream that are not yet packets.
#[derive(Debug, Default)]
pub(crate) struct PacketStream {
    octets: Vec<u8>,
    /// Octets that begin no packet have come since the last one.
    is_out_of_step: bool,
}

impl PacketStream {
    /// Takes octets, and hands each packet to `take`; returns how many runs of octets were none.
    pub(crate) fn push(
        &mut self,
        octets: &[u8],
        form: &Form,
        mut take: impl FnMut(&[u8]) -> Result<(), Refusal>,
    ) -> u64 {
        self.octets.extend(octets);
        let (mut at, mut damaged) = (0, 0);
        while let Some(length) = form.length_of(&self.octets[at..]) {
            let taken = match length {
                Ok(length) => match self.octets.get(at..at + length) {
                    Some(packet) => take(packet).map(|()| length),
                    None => break,
                },
                Err(refusal) => Err(refusal),
            };
            if let Ok(length) = taken {
                (at, self.is_out_of_step) = (at + length, false);
            } else {
                damaged += u64::from(!core::mem::replace(&mut self.is_out_of_step, true));
                // The next octet may begin a packet.
                at += 1;
            }
        }
        self.octets.drain(..at);
        debug_assert!(self.octets.len() < form.octets[1], "the octets kept are part of one packet");
        damaged
    }
}

/// Time as a CUC code with its P-field: seconds since 1958-01-01 TAI, and 2^-24 of a second.
pub fn cuc(at: Tai) -> [u8; 8] {
    let seconds = at.ns().div_euclid(NS_PER_S) + S_1958_TO_1970;
    let fraction = (at.ns().rem_euclid(NS_PER_S) << 24) / NS_PER_S;
    let [a, b, c, d] = u32::try_from(seconds).unwrap_or(u32::MAX).to_be_bytes();
    let [_, e, f, g] = u32::try_from(fraction).unwrap_or(0).to_be_bytes();
    [CUC_TAI, a, b, c, d, e, f, g]
}

/// The instant of such a code; `None` for a code of another kind.
pub fn tai_of_cuc(code: [u8; 8]) -> Option<Tai> {
    let [CUC_TAI, a, b, c, d, e, f, g] = code else { return None };
    let seconds = i64::from(u32::from_be_bytes([a, b, c, d])) - S_1958_TO_1970;
    let fraction_ns = (i64::from(u32::from_be_bytes([0, e, f, g])) * NS_PER_S) >> 24;
    Some(Tai::from_ns(seconds * NS_PER_S) + Span::from_ns(fraction_ns))
}

/// A telemetry packet before it is bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Telemetry<'a> {
    /// Application process, 11 bits.
    pub apid: u16,
    /// Sequence count, 14 bits.
    pub count: u16,
    /// Service and subtype.
    pub service: [u8; 2],
    /// Counter of packets of this service and subtype.
    pub type_count: u16,
    /// Whom it is for.
    pub destination: u16,
    /// Time code, with its P-field where it has one.
    pub time: &'a [u8],
    /// Source data.
    pub data: &'a [u8],
}

impl Telemetry<'_> {
    /// Returns the packet's octets.
    pub fn encode(&self) -> Vec<u8> {
        let field = TM_SECONDARY + self.time.len() + self.data.len() + CRC;
        let mut packet = Vec::with_capacity(PRIMARY + field);
        packet.extend((TM_FIRST | (self.apid & APID_MASK)).to_be_bytes());
        packet.extend((UNSEGMENTED | (self.count & COUNT_MASK)).to_be_bytes());
        packet.extend(u16::try_from(field - 1).unwrap_or(u16::MAX).to_be_bytes());
        packet.push(PUS_C);
        packet.extend(self.service);
        packet.extend(self.type_count.to_be_bytes());
        packet.extend(self.destination.to_be_bytes());
        packet.extend(self.time);
        packet.extend(self.data);
        packet.extend(crc16(&packet).to_be_bytes());
        packet
    }
}

/// A telemetry packet that has been read; its time code has eight octets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TelemetryView<'a> {
    /// Application process.
    pub apid: u16,
    /// Service and subtype.
    pub service: [u8; 2],
    /// Time code with its P-field.
    pub time: [u8; TIME],
    /// Source data.
    pub data: &'a [u8],
}

impl<'a> TelemetryView<'a> {
    /// Reads a whole packet.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn read(packet: &'a [u8]) -> Result<Self, Refusal> {
        let [a, b, _, _, _, _, _, service, subtype, _, _, _, _, rest @ ..] = content_of(packet, &TELEMETRY)? else {
            return Err(BAD_LENGTH);
        };
        let Some((time, data)) = rest.split_first_chunk::<TIME>() else { return Err(BAD_LENGTH) };
        let apid = u16::from_be_bytes([*a, *b]) & APID_MASK;
        Ok(Self { apid, service: [*service, *subtype], time: *time, data })
    }
}

/// A telecommand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Telecommand {
    /// Application process.
    pub apid: u16,
    /// Packet identification and sequence control, as verification reports repeat them.
    pub request: [u8; 4],
    /// Which reports are asked for: bit 0 acceptance, bit 3 completion.
    pub acknowledge: u8,
    /// Service and subtype.
    pub service: [u8; 2],
    /// Number of its sender.
    pub source: u16,
    /// Application data.
    pub data: Vec<u8>,
}

impl Telecommand {
    /// Reads a whole packet.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn decode(packet: &[u8]) -> Result<Self, Refusal> {
        let [a, b, c, d, _, _, version, service, subtype, e, f, data @ ..] = content_of(packet, &TELECOMMAND)? else {
            return Err(BAD_LENGTH);
        };
        Ok(Self {
            apid: u16::from_be_bytes([*a, *b]) & APID_MASK,
            request: [*a, *b, *c, *d],
            acknowledge: version & 0x0F,
            service: [*service, *subtype],
            source: u16::from_be_bytes([*e, *f]),
            data: data.to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Written by spacepackets 0.32.0.
    const GOLDEN: [u8; 25] = [
        0x09, 0x23, 0xc0, 0x05, 0x00, 0x12, 0x20, 0x03, 0x19, 0x00, 0x07, 0x00, 0x09, 0x2f, 0x01, 0x02, 0x03, 0x04,
        0x05, 0x06, 0x07, 0xaa, 0xbb, 0xb8, 0x08,
    ];

    #[test]
    fn telemetry_is_as_another_program_writes_it() {
        let time = [0x2f, 1, 2, 3, 4, 5, 6, 7];
        let packet = Telemetry {
            apid: 0x123,
            count: 5,
            service: [3, 25],
            type_count: 7,
            destination: 9,
            time: &time,
            data: &[0xaa, 0xbb],
        };
        assert_eq!(packet.encode(), GOLDEN);
    }

    #[test]
    fn times_come_back_within_their_resolution() {
        let at = Tai::from_ns(1_772_366_437_250_000_123);
        let back = tai_of_cuc(cuc(at)).unwrap();
        assert!((at - back).ns() >= 0 && (at - back).ns() < 60, "{} ns", (at - back).ns());
        assert_eq!(cuc(Tai::from_ns(0)), [0x1F, 0x16, 0x92, 0x5E, 0x80, 0, 0, 0], "378 691 200 s");
        assert_eq!(tai_of_cuc([0x2F, 0, 0, 0, 0, 0, 0, 0]), None, "control: another epoch");
    }

    #[test]
    fn damaged_telecommands_are_refused_each_with_its_reason() {
        let mut ping = vec![0x18, 0x64, 0xC0, 0x01, 0x00, 0x06, 0x29, 17, 1, 0, 1];
        ping.extend(crc16(&ping).to_be_bytes());
        let read = Telecommand::decode(&ping).unwrap();
        assert_eq!((read.apid, read.acknowledge, read.service, read.source), (0x64, 9, [17, 1], 1));
        for at in 0..ping.len() {
            let mut damaged = ping.clone();
            damaged[at] ^= 0x10;
            assert!(Telecommand::decode(&damaged).is_err(), "octet {at}");
        }
        assert_eq!(Telecommand::decode(&GOLDEN), Err(TELECOMMAND.other));
        assert_eq!(Telecommand::decode(&ping[..12]), Err(BAD_LENGTH));
    }
}
