//! A star tracker that speaks CCSDS space packets with PUS services, over UDP or TCP.
//!
//! Out: housekeeping TM(3,25) with each report, events TM(5,1) "attitude found" and TM(5,2) "attitude lost", and
//! verification TM(1,1), (1,2), (1,7), (1,8). In: TC(17,1) ping, answered by TM(17,2); TC(3,27) one housekeeping
//! packet; TC(8,1) functions.
//!
//! | source data of TM(3,25) | octets |
//! |---|---|
//! | structure 1 | u16 |
//! | time tag of the attitude: CUC, P-field 1F, seconds since 1958 TAI, 2^-24 s | 8 |
//! | mode (0 standby, 1 acquisition, 2 tracking), validity | 2 u8 |
//! | frame | u32 |
//! | stars | u16 |
//! | quaternion, scalar first | 4 f64 |
//! | rate about the sensor axes, rad/s | 3 f32 |
//! | standard deviations about the sensor axes, rad | 3 f32 |
//! | exposure, s; temperature, degrees Celsius | 2 f32 |
//!
//! Functions of TC(8,1): u8 1 with u8 0 or 2 (pause, operate), 2 with u32 microseconds (exposure), 3 (begin again).
//!
//! [`CcsdsReader`] reads housekeeping TM(3,25) of structure 1. Other packets, of any application process, are passed over; a wrong CRC is damage.

use crate::device::Continuity;
use crate::reading::{Measured, Reader, unit};
use crate::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use base::time::Tai;
use packet::{
    COUNT_MASK, PacketStream, TELECOMMAND, TELEMETRY, Telecommand, Telemetry, TelemetryView, cuc, tai_of_cuc,
};
use std::collections::BTreeMap;

pub mod packet;

const VERIFICATION: u8 = 1;
pub(crate) const HOUSEKEEPING: [u8; 2] = [3, 25];
const ONE_HOUSEKEEPING: [u8; 2] = [3, 27];
const FOUND: [u8; 2] = [5, 1];
const LOST: [u8; 2] = [5, 2];
const FUNCTION: [u8; 2] = [8, 1];
const PING: [u8; 2] = [17, 1];
const PONG: [u8; 2] = [17, 2];
/// Number of the only housekeeping structure, and of the events.
pub(crate) const STRUCTURE: u16 = 1;
const EVENT_FOUND: u16 = 1;
const EVENT_LOST: u16 = 2;
const ACCEPTANCE: u8 = 0b0001;
const COMPLETION: u8 = 0b1000;

/// Reasons for which a command is refused: the codes of TM(1,2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
enum Failure {
    Apid = 1,
    Service = 2,
    Data = 3,
    Range = 4,
}

/// A tracker that speaks PUS.
#[derive(Debug)]
pub struct CcsdsDevice {
    apid: u16,
    sense: Sense,
    limits: Limits,
    count: u16,
    type_counts: BTreeMap<[u8; 2], u16>,
    continuity: Continuity,
    newest: Option<Report>,
    stream: PacketStream,
    answered: Answered,
}

impl CcsdsDevice {
    /// Returns a tracker with an application process number of 11 bits.
    pub fn new(apid: u16, sense: Sense, limits: Limits) -> Self {
        let (count, type_counts, stream) = (0, BTreeMap::new(), PacketStream::default());
        let (continuity, newest, answered) = (Continuity::default(), None, Answered::default());
        Self { apid, sense, limits, count, type_counts, continuity, newest, stream, answered }
    }

    fn send(&mut self, service: [u8; 2], destination: u16, data: &[u8], now: Tai, out: &mut Vec<Wire>) {
        let type_count = self.type_counts.entry(service).or_default();
        let time = cuc(now);
        let packet = Telemetry {
            apid: self.apid,
            count: self.count,
            service,
            type_count: *type_count,
            destination,
            time: &time,
            data,
        };
        out.push(Wire::Bytes(packet.encode()));
        *type_count = type_count.wrapping_add(1);
        self.count = self.count.wrapping_add(1) & COUNT_MASK;
    }

    fn housekeeping(&mut self, destination: u16, now: Tai, out: &mut Vec<Wire>) {
        let Some(report) = self.newest else { return };
        let mut data = STRUCTURE.to_be_bytes().to_vec();
        data.extend(cuc(report.time_tag));
        let mode = match report.mode {
            Mode::Standby => 0,
            Mode::Acquisition => 1,
            Mode::Tracking => 2,
        };
        data.extend([mode, u8::from(report.attitude_wxyz.is_some())]);
        data.extend(report.frame.to_be_bytes());
        data.extend(report.stars.to_be_bytes());
        let q = report.attitude_wxyz.map_or([0.0; 4], |q| self.sense.of(q));
        q.iter().for_each(|part| data.extend(part.to_be_bytes()));
        let singles = report.rate_rad_s.unwrap_or([f64::NAN; 3]).into_iter().chain(report.sigma_rad);
        for value in singles.chain([report.exposure_s, report.temperature_c]) {
            #[allow(clippy::cast_possible_truncation, reason = "single precision on the wire")]
            data.extend((value as f32).to_be_bytes());
        }
        self.send(HOUSEKEEPING, destination, &data, now, out);
    }

    fn obey(&mut self, command: &Telecommand, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let (source, request) = (command.source, command.request);
        match self.order(command) {
            Ok(order) => {
                self.answered.commands += 1;
                orders.extend(order);
                if command.acknowledge & ACCEPTANCE != 0 {
                    self.send([VERIFICATION, 1], source, &request, now, out);
                }
                match command.service {
                    PING => self.send(PONG, source, &[], now, out),
                    ONE_HOUSEKEEPING => self.housekeeping(source, now, out),
                    _an_order => {}
                }
                if command.acknowledge & COMPLETION != 0 {
                    self.send([VERIFICATION, 7], source, &request, now, out);
                }
            }
            Err(failure) => {
                self.answered.refused += 1;
                let data = [&request[..], &(failure as u16).to_be_bytes()].concat();
                self.send([VERIFICATION, 2], source, &data, now, out);
            }
        }
    }

    fn order(&self, command: &Telecommand) -> Result<Option<Order>, Failure> {
        if command.apid != self.apid {
            return Err(Failure::Apid);
        }
        match (command.service, command.data.as_slice()) {
            (PING, []) => Ok(None),
            (ONE_HOUSEKEEPING, [0, 1, 0, 1]) => Ok(None),
            (FUNCTION, [1, 0]) => Ok(Some(Order::Pause)),
            (FUNCTION, [1, 2]) => Ok(Some(Order::Operate)),
            (FUNCTION, [2, a, b, c, d]) => {
                let us = u32::from_be_bytes([*a, *b, *c, *d]);
                self.limits.exposure(f64::from(us) * 1e-6).map(Some).ok_or(Failure::Range)
            }
            (FUNCTION, [3]) => Ok(Some(Order::Reset)),
            (PING | ONE_HOUSEKEEPING | FUNCTION, _) => Err(Failure::Data),
            _other => Err(Failure::Service),
        }
    }
}

impl Device for CcsdsDevice {
    fn report(&mut self, report: &Report, now: Tai, out: &mut Vec<Wire>) {
        let attitude_wxyz = report.attitude_wxyz.map(|q| self.continuity.next(q));
        let was_valid = self.newest.is_some_and(|newest| newest.attitude_wxyz.is_some());
        self.newest = Some(Report { attitude_wxyz, ..*report });
        match (was_valid, attitude_wxyz.is_some()) {
            (false, true) => self.send(FOUND, 0, &EVENT_FOUND.to_be_bytes(), now, out),
            (true, false) => self.send(LOST, 0, &EVENT_LOST.to_be_bytes(), now, out),
            (true, true) | (false, false) => {}
        }
        self.housekeeping(0, now, out);
    }

    fn take(&mut self, wire: &Wire, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let Wire::Bytes(bytes) = wire else { return };
        let mut stream = core::mem::take(&mut self.stream);
        self.answered.refused += stream.push(bytes, &TELECOMMAND, |packet| {
            self.obey(&Telecommand::decode(packet)?, now, out, orders);
            Ok(())
        });
        self.stream = stream;
    }

    fn answered(&self) -> Answered {
        self.answered
    }
}

/// Octets of the source data.
const DATA_BYTES: usize = 82;

/// Reads a tracker that speaks PUS.
#[derive(Debug)]
pub struct CcsdsReader {
    sense: Sense,
    stream: PacketStream,
    damaged: u64,
}

impl CcsdsReader {
    /// Makes a reader of quaternions in this sense.
    pub fn new(sense: Sense) -> Self {
        Self { sense, stream: PacketStream::default(), damaged: 0 }
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
        let mut stream = core::mem::take(&mut self.stream);
        let runs = stream.push(bytes, &TELEMETRY, |packet| {
            match self.measured(&TelemetryView::read(packet)?, at) {
                Some(Ok(measured)) => out.push(measured),
                Some(Err(())) => self.damaged += 1,
                None => {}
            }
            Ok(())
        });
        self.damaged += runs;
        self.stream = stream;
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{lost, report};
    use base::time::Span;
    use firmware_protocol::crc::crc16;

    fn command(service: [u8; 2], data: &[u8]) -> Vec<u8> {
        let mut packet = vec![0x18, 0x64, 0xC0, 0x07, 0, 0, 0x29, service[0], service[1], 0, 5];
        packet.extend(data);
        packet[5] = u8::try_from(packet.len() + 2 - 7).unwrap();
        packet.extend(crc16(&packet).to_be_bytes());
        packet
    }

    fn device() -> CcsdsDevice {
        CcsdsDevice::new(0x64, Sense::Starloop, Limits { exposure_s: Some([0.001, 0.1]) })
    }

    fn services(out: &[Wire]) -> Vec<[u8; 2]> {
        out.iter().map(|wire| [wire.data()[7], wire.data()[8]]).collect()
    }

    #[test]
    fn attitude_is_in_the_housekeeping_packet_and_events_report_its_loss() {
        let (mut device, mut out) = (device(), Vec::new());
        for report in [report(), report(), lost()] {
            device.report(&report, report.time_tag + Span::from_ms(80), &mut out);
        }
        assert_eq!(services(&out), [FOUND, HOUSEKEEPING, HOUSEKEEPING, LOST, HOUSEKEEPING]);
        let data = &out[1].data()[21..];
        assert_eq!(data[..2], [0, 1]);
        assert_eq!(tai_of_cuc(data[2..10].try_into().unwrap()), Some(report().time_tag));
        assert_eq!((data[10], data[11]), (2, 1));
        let x = f64::from_be_bytes(data[26..34].try_into().unwrap());
        assert_eq!(x, -0.1_f64.sin(), "all digits of a double");
        let counts: Vec<u8> = out.iter().map(|wire| wire.data()[3]).collect();
        assert_eq!(counts, [0, 1, 2, 3, 4]);
        assert_eq!(out[4].data()[21 + 11], 0, "control: not valid");
    }

    #[test]
    fn commands_are_verified_and_split_streams_put_together() {
        let (mut device, mut out, mut orders) = (device(), Vec::new(), Vec::new());
        let now = report().time_tag;
        let mut stream = command(PING, &[]);
        stream.extend([0xFF, 0x18, 0x00]);
        stream.extend(command(FUNCTION, &[3]));
        stream.extend(command(FUNCTION, &[2, 0, 0, 0x4E, 0x20]));
        for byte in &stream {
            device.take(&Wire::Bytes(vec![*byte]), now, &mut out, &mut orders);
        }
        assert_eq!(orders, [Order::Reset, Order::Exposure(Span::from_ms(20))]);
        assert_eq!(services(&out), [[1, 1], PONG, [1, 7], [1, 1], [1, 7], [1, 1], [1, 7]]);
        assert_eq!(out[0].data()[21..25], [0x18, 0x64, 0xC0, 0x07], "the request that is verified");
        out.clear();
        orders.clear();
        let bad: [(Vec<u8>, u8); 3] =
            [(command([200, 1], &[]), 2), (command(FUNCTION, &[9]), 3), (command(FUNCTION, &[2, 9, 0, 0, 0]), 4)];
        for (packet, failure) in bad {
            device.take(&Wire::Bytes(packet), now, &mut out, &mut orders);
            let last = out.last().unwrap().data();
            assert_eq!(([last[7], last[8]], last[26]), ([1, 2], failure));
        }
        assert!(orders.is_empty());
    }
}
