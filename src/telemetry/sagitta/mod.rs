//! A Sagitta star tracker as the driver of C2A speaks with it: requests and asynchronous telemetry in SLIP frames.
//!
//! Source: `Drivers/Aocs/sagitta.c` and `.h` of ut-issl/c2a-aobc and the simulator of ut-issl/s2e-aobc. UART or RS-485,
//! 115200 8N1, address 0x21, little-endian, frames as in [`slip`]. The scalar is first, and the vector the conjugate of
//! starloop's.
//!
//! Requests are set parameter (0), get parameter (1), get telemetry (2) and action (3); answers have 128 more,
//! asynchronous telemetry is 132. Known here: telemetry 24 (solution), 27 (temperature) and 1 (time); parameter 18
//! (subscription of up to 16 telemetry numbers) and 9 (camera: its exposure is obeyed); actions 1 (boot: begins again),
//! 14 (set time: accepted, the clock is the run's). Others are answered with a status that is not 0. `Differs:` the
//! tracker is booted when the line opens and has subscribed the solution and the temperature; camera mode 0 pauses it;
//! the camera's mode has no other effect.
//!
//! [`SagittaReader`] reads telemetry 24, asynchronous or asked for.

use crate::device::{Continuity, single};
use crate::reading::{Measured, Reader, unit};
use crate::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};
use base::time::{Span, Tai};
use slip::{SlipReader, encode};

pub mod slip;

/// Address of the tracker.
pub const ADDRESS: u8 = 0x21;
const SET_PARAMETER: u8 = 0;
const GET_PARAMETER: u8 = 1;
pub(crate) const GET_TELEMETRY: u8 = 2;
const ACTION: u8 = 3;
pub(crate) const REPLY: u8 = 128;
pub(crate) const ASYNCHRONOUS: u8 = 132;
const TIME: u8 = 1;
pub(crate) const SOLUTION: u8 = 24;
const TEMPERATURE: u8 = 27;
const CAMERA: u8 = 9;
const SUBSCRIPTION: u8 = 18;
const BOOT: u8 = 1;
const SET_TIME: u8 = 14;
const SUBSCRIBED: usize = 16;
/// Bytes of the camera's parameter, and where its exposure is (f32, s).
const CAMERA_BYTES: usize = 37;
const CAMERA_EXPOSURE: usize = 5;
const OK: u8 = 0;
const BAD_LENGTH: u8 = 1;
const UNKNOWN: u8 = 2;
const OUT_OF_RANGE: u8 = 3;
/// Temperatures go out this often, as in S2E.
const TEMPERATURE_PERIOD: Span = Span::from_ms(1000);

/// A Sagitta star tracker.
#[derive(Debug)]
pub struct SagittaDevice {
    limits: Limits,
    reader: SlipReader,
    continuity: Continuity,
    newest: Option<Report>,
    counter: u32,
    stable: u32,
    subscribed: [u8; SUBSCRIBED],
    camera: [u8; CAMERA_BYTES],
    next_temperature: Option<Tai>,
    answered: Answered,
}

impl SagittaDevice {
    /// Returns a tracker that has booted; `exposure_s` is its camera's.
    pub fn new(limits: Limits, exposure_s: f64) -> Self {
        let (mut subscribed, mut camera) = ([0; SUBSCRIBED], [0; CAMERA_BYTES]);
        subscribed[..2].copy_from_slice(&[SOLUTION, TEMPERATURE]);
        camera[0] = 1;
        camera[CAMERA_EXPOSURE..CAMERA_EXPOSURE + 4].copy_from_slice(&single(exposure_s));
        let (reader, continuity, answered) = (SlipReader::default(), Continuity::default(), Answered::default());
        let (newest, next_temperature) = (None, None);
        Self {
            limits,
            reader,
            continuity,
            newest,
            counter: 0,
            stable: 0,
            subscribed,
            camera,
            next_temperature,
            answered,
        }
    }

    fn is_subscribed(&self, id: u8) -> bool {
        self.subscribed.contains(&id)
    }

    fn telemetry(&mut self, kind: u8, id: u8, now: Tai) -> Option<Vec<u8>> {
        let data = match id {
            TIME => Vec::new(),
            SOLUTION => self.solution(),
            TEMPERATURE => {
                let celsius = self.newest.map_or(f64::NAN, |report| report.temperature_c);
                // Microcontroller, sensor, logic: only the sensor's is known, and the others are as warm as it.
                [single(celsius); 3].concat()
            }
            _unknown => return None,
        };
        let at = if id == SOLUTION { self.newest.map_or(now, |report| report.time_tag) } else { now };
        let unix_us = u64::try_from(at.to_unix_ns() / 1000).unwrap_or(0);
        let mut content = vec![ADDRESS, kind, id, OK];
        content.extend(self.counter.to_le_bytes());
        content.extend(unix_us.to_le_bytes());
        content.extend(data);
        self.counter = self.counter.wrapping_add(1);
        Some(content)
    }

    /// Data of telemetry 24, from offset 16 of the frame on.
    fn solution(&self) -> Vec<u8> {
        let attitude = self.newest.and_then(|report| report.attitude_wxyz);
        let q = attitude.map_or([0.0; 4], |q| Sense::Conjugate.of(q));
        let quaternion = q.map(single).concat();
        let (stars, is_tracking) =
            self.newest.map_or((0, false), |report| (report.stars, report.mode == Mode::Tracking));
        let stars = u8::try_from(stars).unwrap_or(u8::MAX);
        let confidence = single(if attitude.is_some() { 1.0 } else { 0.0 });
        let mut data = quaternion.clone();
        data.extend(confidence);
        data.extend(&quaternion);
        data.extend([0, stars, stars]);
        data.extend(&quaternion);
        data.extend(confidence);
        data.extend([stars, u8::from(!is_tracking), u8::from(attitude.is_some())]);
        data.extend(self.stable.to_le_bytes());
        data.push(u8::from(is_tracking));
        data
    }

    fn answer(&mut self, request: &[u8], now: Tai, orders: &mut Vec<Order>) -> Option<Vec<u8>> {
        let [ADDRESS, kind @ SET_PARAMETER..=ACTION, id, data @ ..] = request else {
            self.answered.refused += 1;
            return None;
        };
        let (mut content, before) = (vec![ADDRESS, kind + REPLY, *id], orders.len());
        let status = match (*kind, *id) {
            (SET_PARAMETER, _) => self.set(*id, data, orders),
            (GET_PARAMETER, CAMERA | SUBSCRIPTION) | (ACTION, SET_TIME) => OK,
            (GET_TELEMETRY, _) => match self.telemetry(REPLY + GET_TELEMETRY, *id, now) {
                Some(telemetry) => {
                    self.answered.commands += 1;
                    return Some(telemetry);
                }
                None => UNKNOWN,
            },
            (ACTION, BOOT) => {
                orders.push(Order::Reset);
                (self.counter, self.stable) = (0, 0);
                OK
            }
            _other => UNKNOWN,
        };
        content.push(status);
        match (*kind, *id, status) {
            (GET_PARAMETER, CAMERA, OK) => content.extend(self.camera),
            (GET_PARAMETER, SUBSCRIPTION, OK) => content.extend(self.subscribed),
            _nothing_more => {}
        }
        if status == OK {
            self.answered.commands += 1;
        } else {
            orders.truncate(before);
            self.answered.refused += 1;
        }
        Some(content)
    }

    fn set(&mut self, id: u8, data: &[u8], orders: &mut Vec<Order>) -> u8 {
        match id {
            SUBSCRIPTION => match data.try_into() {
                Ok(subscribed) => {
                    self.subscribed = subscribed;
                    OK
                }
                Err(_of_another_length) => BAD_LENGTH,
            },
            CAMERA => {
                let Ok(camera) = <[u8; CAMERA_BYTES]>::try_from(data) else { return BAD_LENGTH };
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| camera[CAMERA_EXPOSURE + i]);
                let asked = [a, b, c, d];
                if asked != self.camera[CAMERA_EXPOSURE..CAMERA_EXPOSURE + 4] {
                    let Some(order) = self.limits.exposure(f64::from(f32::from_le_bytes(asked))) else {
                        return OUT_OF_RANGE;
                    };
                    orders.push(order);
                }
                if camera[0] != self.camera[0] {
                    orders.push(if camera[0] == 0 { Order::Pause } else { Order::Operate });
                }
                self.camera = camera;
                OK
            }
            _other => UNKNOWN,
        }
    }
}

impl Device for SagittaDevice {
    fn start(&mut self, now: Tai, _out: &mut Vec<Wire>) {
        self.next_temperature = Some(now + TEMPERATURE_PERIOD);
    }

    fn report(&mut self, report: &Report, now: Tai, out: &mut Vec<Wire>) {
        let attitude_wxyz = report.attitude_wxyz.map(|q| self.continuity.next(q));
        self.stable = if attitude_wxyz.is_some() { self.stable.saturating_add(1) } else { 0 };
        self.newest = Some(Report { attitude_wxyz, ..*report });
        if self.is_subscribed(SOLUTION) {
            let content = self.telemetry(ASYNCHRONOUS, SOLUTION, now);
            out.extend(content.map(|content| Wire::Bytes(encode(&content))));
        }
    }

    fn take(&mut self, wire: &Wire, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let Wire::Bytes(bytes) = wire else { return };
        let mut frames = Vec::new();
        self.reader.push(bytes, &mut |frame| frames.push(frame.map(<[u8]>::to_vec)));
        for frame in frames {
            match frame {
                Ok(request) => {
                    let answer = self.answer(&request, now, orders);
                    out.extend(answer.map(|content| Wire::Bytes(encode(&content))));
                }
                Err(_no_frame) => self.answered.refused += 1,
            }
        }
    }

    fn step(&mut self, now: Tai, out: &mut Vec<Wire>) {
        let Some(due) = self.next_temperature.filter(|due| *due <= now) else { return };
        self.next_temperature = Some((due + TEMPERATURE_PERIOD).max(now));
        if self.is_subscribed(TEMPERATURE) {
            let content = self.telemetry(ASYNCHRONOUS, TEMPERATURE, due);
            out.extend(content.map(|content| Wire::Bytes(encode(&content))));
        }
    }

    fn next_due(&self) -> Option<Tai> {
        self.next_temperature
    }

    fn answered(&self) -> Answered {
        self.answered
    }
}

/// Bytes of the solution without its hash.
const SOLUTION_BYTES: usize = 83;
const REPLY_TO_GET: u8 = REPLY + GET_TELEMETRY;

/// Reads a Sagitta star tracker.
#[derive(Debug, Default)]
pub struct SagittaReader {
    slip: SlipReader,
    damaged: u64,
}

impl Reader for SagittaReader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Bytes(bytes) = wire else { return };
        let damaged = &mut self.damaged;
        self.slip.push(bytes, &mut |frame| match frame {
            Ok([ADDRESS, ASYNCHRONOUS | REPLY_TO_GET, SOLUTION, 0, data @ ..]) => match solution(data, at) {
                Some(measured) => out.push(measured),
                None => *damaged += 1,
            },
            Ok(_other_telemetry) => {}
            Err(_what) => *damaged += 1,
        });
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }
}

/// Reads what follows the four bytes of the head.
fn solution(data: &[u8], at: Tai) -> Option<Measured> {
    let data: &[u8; SOLUTION_BYTES - 4] = data.try_into().ok()?;
    let four = |place: usize| [0, 1, 2, 3].map(|i| data[place - 4 + i]);
    let [low, high] = [8, 12].map(|place| u64::from(u32::from_le_bytes(four(place))));
    let unix_ns = i64::try_from(high << 32 | low).ok()?.checked_mul(1000)?;
    let q = [16, 20, 24, 28].map(|place| f64::from(f32::from_le_bytes(four(place))));
    let attitude = unit(Sense::Conjugate.of(q));
    let (matched, validity) = (data[54 - 4], data[77 - 4]);
    match (validity, attitude) {
        (0, _) | (1, Some(_)) => Some(Measured {
            at,
            time_tag: Some(Tai::from_unix_ns(unix_ns)),
            frame: None,
            attitude_wxyz: attitude.filter(|_| validity == 1),
            stars: Some(u16::from(matched)),
        }),
        _impossible => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{lost, report};

    fn frames(out: &[Wire]) -> Vec<Vec<u8>> {
        let mut frames = Vec::new();
        for wire in out {
            SlipReader::default().push(wire.data(), &mut |frame| frames.push(frame.unwrap().to_vec()));
        }
        frames
    }

    fn exchange(device: &mut SagittaDevice, request: &[u8]) -> (Vec<Vec<u8>>, Vec<Order>) {
        let (mut out, mut orders) = (Vec::new(), Vec::new());
        device.take(&Wire::Bytes(encode(request)), report().time_tag, &mut out, &mut orders);
        (frames(&out), orders)
    }

    fn f32_at(frame: &[u8], at: usize) -> f32 {
        f32::from_le_bytes(frame[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn solution_has_its_fields_where_the_driver_reads_them() {
        let (mut device, mut out) = (SagittaDevice::new(Limits::default(), 0.05), Vec::new());
        device.report(&report(), report().time_tag, &mut out);
        device.report(&lost(), report().time_tag, &mut out);
        let [frame, without] = <[Vec<u8>; 2]>::try_from(frames(&out)).unwrap();
        assert_eq!((frame.len(), &frame[..4]), (83, &[0x21, 132, 24, 0][..]));
        assert_eq!(frame[8..16], 1_772_366_400_250_000_u64.to_le_bytes());
        for at in [16, 36, 55] {
            let q = [0, 4, 8, 12].map(|part| f32_at(&frame, at + part));
            let wanted = [0.1_f64.cos(), 0.1_f64.sin(), 0.0, 0.0].map(|part| f32::from_le_bytes(single(part)));
            assert_eq!(q, wanted, "at {at}");
        }
        assert_eq!((frame[53], frame[54], frame[76], frame[77], frame[82]), (21, 21, 0, 1, 1));
        assert_eq!((without[76], without[77], f32_at(&without, 16)), (1, 0, 0.0), "control: lost");
    }

    #[test]
    fn requests_are_answered_and_orders_given() {
        let mut device = SagittaDevice::new(Limits { exposure_s: Some([0.001, 0.1]) }, 0.05);
        let (answer, orders) = exchange(&mut device, &[0x21, 3, 1, 1]);
        assert_eq!((answer[0].as_slice(), orders.as_slice()), (&[0x21, 131, 1, 0][..], &[Order::Reset][..]));
        let mut subscription = vec![0x21, 0, 18];
        subscription.extend([0; 16]);
        assert_eq!(exchange(&mut device, &subscription).0, [[0x21, 128, 18, 0]]);
        let mut out = Vec::new();
        device.report(&report(), report().time_tag, &mut out);
        assert!(out.is_empty(), "nothing is subscribed");
        assert_eq!(exchange(&mut device, &[0x21, 2, 24]).0[0][..4], [0x21, 130, 24, 0], "but it can be asked for");
        let mut camera = exchange(&mut device, &[0x21, 1, 9]).0[0][4..].to_vec();
        camera[CAMERA_EXPOSURE..CAMERA_EXPOSURE + 4].copy_from_slice(&0.02_f32.to_le_bytes());
        let set = |camera: &[u8]| [&[0x21, 0, 9][..], camera].concat();
        let (answer, orders) = exchange(&mut device, &set(&camera));
        assert_eq!(answer, [[0x21, 128, 9, 0]]);
        assert!(matches!(orders[..], [Order::Exposure(span)] if (span.s() - 0.02).abs() < 1e-8), "{orders:?}");
        camera[CAMERA_EXPOSURE..CAMERA_EXPOSURE + 4].copy_from_slice(&2.0_f32.to_le_bytes());
        assert_eq!(exchange(&mut device, &set(&camera)), (vec![vec![0x21, 128, 9, OUT_OF_RANGE]], Vec::new()));
        assert_eq!(exchange(&mut device, &[0x21, 2, 99]).0, [[0x21, 130, 99, UNKNOWN]]);
        assert_eq!(exchange(&mut device, &[0x22, 2, 24]).0.len(), 0, "another tracker's");
        assert_eq!(device.answered().refused, 3);
    }

    #[test]
    fn temperatures_come_every_second() {
        let (mut device, mut out) = (SagittaDevice::new(Limits::default(), 0.05), Vec::new());
        let start = report().time_tag;
        device.start(start, &mut out);
        device.report(&report(), start, &mut Vec::new());
        for ms in (0..3500).step_by(100) {
            device.step(start + Span::from_ms(ms), &mut out);
        }
        let frames = frames(&out);
        assert_eq!((frames.len(), frames[0].len() + 4), (3, 32));
        assert_eq!((frames[0][2], f32_at(&frames[0], 20)), (27, -5.0));
    }
}
