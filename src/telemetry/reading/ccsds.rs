//! Space packets: housekeeping TM(3,25) of structure 1, laid out as in `ccsds`. Other packets, of any application
//! process, are passed over; a wrong CRC is damage.

use super::{Measured, Reader, unit};
use crate::ccsds::packet::{PacketError, TELEMETRY_MAX, TelemetryView, tai_of_cuc, telemetry_length};
use crate::ccsds::{HOUSEKEEPING, STRUCTURE};
use crate::{Sense, Wire};
use base::time::Tai;

/// Octets of the source data.
const DATA_BYTES: usize = 82;

/// Reads a tracker that speaks PUS.
#[derive(Debug)]
pub struct CcsdsReader {
    sense: Sense,
    stream: Vec<u8>,
    is_out_of_step: bool,
    damaged: u64,
}

impl CcsdsReader {
    /// Makes a reader of quaternions in this sense.
    pub fn new(sense: Sense) -> Self {
        Self { sense, stream: Vec::new(), is_out_of_step: false, damaged: 0 }
    }

    fn measured(&self, packet: &TelemetryView<'_>, at: Tai) -> Option<Result<Measured, ()>> {
        if packet.service != HOUSEKEEPING || packet.data.first_chunk() != Some(&STRUCTURE.to_be_bytes()) {
            return None;
        }
        let of_data = |data: &[u8; DATA_BYTES]| {
            let eight = |place: usize| [0, 1, 2, 3, 4, 5, 6, 7].map(|i| data[place + i]);
            let time_tag = tai_of_cuc(eight(2))?;
            let q = [18, 26, 34, 42].map(|place| f64::from_be_bytes(eight(place)));
            let attitude = unit(self.sense.of(q));
            let is_valid = match data[11] {
                0 => false,
                1 if attitude.is_some() => true,
                _impossible => return None,
            };
            let [a, b, c, d] = [12, 13, 14, 15].map(|place| data[place]);
            Some(Measured {
                at,
                time_tag: Some(time_tag),
                frame: Some(u32::from_be_bytes([a, b, c, d])),
                attitude_wxyz: attitude.filter(|_| is_valid),
                stars: Some(u16::from_be_bytes([data[16], data[17]])),
            })
        };
        Some(packet.data.try_into().ok().and_then(of_data).ok_or(()))
    }
}

impl Reader for CcsdsReader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Bytes(bytes) = wire else { return };
        self.stream.extend(bytes);
        let mut place = 0;
        while let Some(length) = telemetry_length(&self.stream[place..]) {
            let view = match length {
                Ok(length) => match self.stream.get(place..place + length) {
                    Some(packet) => TelemetryView::read(packet).map(|view| (view, length)),
                    None => break,
                },
                Err(error) => Err(error),
            };
            match view {
                Ok((view, length)) => {
                    match self.measured(&view, at) {
                        Some(Ok(measured)) => out.push(measured),
                        Some(Err(())) => self.damaged += 1,
                        None => {}
                    }
                    (place, self.is_out_of_step) = (place + length, false);
                }
                // The next octet may begin a packet.
                Err(
                    PacketError::NoTelecommand
                    | PacketError::NoTelemetry
                    | PacketError::BadLength
                    | PacketError::BadCrc
                    | PacketError::NotPusC,
                ) => {
                    self.damaged += u64::from(!core::mem::replace(&mut self.is_out_of_step, true));
                    place += 1;
                }
            }
        }
        self.stream.drain(..place);
        debug_assert!(self.stream.len() < TELEMETRY_MAX, "what is kept is part of one packet");
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }
}
