//! The generic star tracker of NASA's NOS3: request and answer over a UART, 115200 8N1.
//!
//! Source: `fsw/shared/generic_star_tracker_device.c` and `sim/src/*hardware_model.cpp` of
//! nasa-itc/generic_star_tracker (144a4e0), which differ from its README. Big-endian. A command has 9 bytes: `DE AD`,
//! code, u32, `BE EF`. The device sends it back first, then the answer: to code 1 eight bytes with a counter that goes
//! up by two, to code 2 thirteen bytes with the quaternion as four u16 and a byte that says whether it is valid. `q =
//! (u16 - 32768) / 32767`, truncated: steps of 3.05e-5,
//! 12.6 arcsec. The scalar is last, and the vector the conjugate of starloop's, as in 42.
//!
//! `Differs:` code 3, "configure", which the simulator there refuses, takes orders here: 0 begins again, 1 pauses, 2
//! operates, and more is an exposure time in microseconds. What is refused gets no echo.
//!
//! [`Nos3Reader`] reads the answers to requests of data, which have no time tag. Echoes and housekeeping, of nine and eight bytes, are passed over: their ends are elsewhere.

use crate::device::Continuity;
use crate::reading::{Measured, Reader, unit};
use crate::{Answered, Device, Limits, Order, Report, Sense, Wire};
use base::time::Tai;

const HEAD: [u8; 2] = [0xDE, 0xAD];
const TAIL: [u8; 2] = [0xBE, 0xEF];
/// Bytes of a command.
pub const COMMAND_BYTES: usize = 9;
const NO_OP: u8 = 0;
const HOUSEKEEPING: u8 = 1;
const DATA: u8 = 2;
const CONFIGURE: u8 = 3;
const HALF: f64 = 32_768.0;
const SCALE: f64 = 32_767.0;

/// A component of a quaternion as the wire has it.
pub fn to_wire(component: f64) -> u16 {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "truncated as the device does, and clamped"
    )]
    let raw = (component * SCALE + HALF).clamp(0.0, 65_535.0) as u16;
    raw
}

/// Returns the component that the wire has as this number.
pub fn from_wire(raw: u16) -> f64 {
    (f64::from(raw) - HALF) / SCALE
}

/// The NOS3 star tracker.
#[derive(Debug)]
pub struct Nos3Device {
    limits: Limits,
    window: Vec<u8>,
    /// Bytes that are part of no command have come since the last one.
    is_out_of_step: bool,
    counter: u32,
    continuity: Continuity,
    newest: Option<[f64; 4]>,
    answered: Answered,
}

impl Nos3Device {
    /// Returns a tracker without an attitude.
    pub fn new(limits: Limits) -> Self {
        let (window, continuity, answered) = (Vec::new(), Continuity::default(), Answered::default());
        Self { limits, window, is_out_of_step: false, counter: 0, continuity, newest: None, answered }
    }

    fn obey(&mut self, code: u8, payload: u32, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let order = match (code, payload) {
            (NO_OP | HOUSEKEEPING | DATA, _) => None,
            (CONFIGURE, 0) => Some(Order::Reset),
            (CONFIGURE, 1) => Some(Order::Pause),
            (CONFIGURE, 2) => Some(Order::Operate),
            (CONFIGURE, us) => match self.limits.exposure(f64::from(us) * 1e-6) {
                Some(order) => Some(order),
                None => return self.answered.refused += 1,
            },
            (4.., _) => return self.answered.refused += 1,
        };
        self.answered.commands += 1;
        self.counter = self.counter.wrapping_add(2);
        orders.extend(order);
        let mut bytes = HEAD.to_vec();
        bytes.push(code);
        bytes.extend(payload.to_be_bytes());
        bytes.extend(TAIL);
        if code == HOUSEKEEPING {
            bytes.extend(HEAD);
            bytes.extend(self.counter.to_be_bytes());
            bytes.extend(TAIL);
        } else if code == DATA {
            bytes.extend(self.data());
        }
        out.push(Wire::Bytes(bytes));
    }

    fn data(&self) -> Vec<u8> {
        let [w, x, y, z] = self.newest.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let mut bytes = HEAD.to_vec();
        [x, y, z, w].iter().for_each(|part| bytes.extend(to_wire(*part).to_be_bytes()));
        bytes.push(u8::from(self.newest.is_some()));
        bytes.extend(TAIL);
        bytes
    }
}

impl Device for Nos3Device {
    fn is_polled(&self) -> bool {
        true
    }

    fn report(&mut self, report: &Report, _now: Tai, _out: &mut Vec<Wire>) {
        self.newest = report.attitude_wxyz.map(|q| Sense::Conjugate.of(self.continuity.next(q)));
    }

    fn take(&mut self, wire: &Wire, _now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>) {
        let Wire::Bytes(bytes) = wire else { return };
        for byte in bytes {
            self.window.push(*byte);
            if self.window.len() < COMMAND_BYTES {
                continue;
            }
            if let [0xDE, 0xAD, code, a, b, c, d, 0xBE, 0xEF] = self.window[..] {
                self.window.clear();
                self.is_out_of_step = false;
                self.obey(code, u32::from_be_bytes([a, b, c, d]), out, orders);
            } else {
                self.window.remove(0);
                self.answered.refused += u64::from(!core::mem::replace(&mut self.is_out_of_step, true));
            }
        }
    }

    fn answered(&self) -> Answered {
        self.answered
    }
}

/// Bytes of an answer.
const ANSWER_BYTES: usize = 13;

/// Reads a NOS3 star tracker.
#[derive(Debug, Default)]
pub struct Nos3Reader {
    window: Vec<u8>,
    damaged: u64,
}

impl Reader for Nos3Reader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Bytes(bytes) = wire else { return };
        for byte in bytes {
            self.window.push(*byte);
            if self.window.len() < ANSWER_BYTES {
                continue;
            }
            let [0xDE, 0xAD, a, b, c, d, e, f, g, h, validity, 0xBE, 0xEF] = self.window[..] else {
                self.window.remove(0);
                continue;
            };
            self.window.clear();
            let [x, y, z, w] = [[a, b], [c, d], [e, f], [g, h]].map(|two| from_wire(u16::from_be_bytes(two)));
            let attitude = unit(Sense::Conjugate.of([w, x, y, z])).filter(|_| validity == 1);
            if validity > 1 || (validity == 1 && attitude.is_none()) {
                self.damaged += 1;
                continue;
            }
            out.push(Measured { at, time_tag: None, frame: None, attitude_wxyz: attitude, stars: None });
        }
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

    fn exchange(device: &mut Nos3Device, bytes: &[u8]) -> (Vec<u8>, Vec<Order>) {
        let (mut out, mut orders) = (Vec::new(), Vec::new());
        device.take(&Wire::Bytes(bytes.to_vec()), Tai::from_ns(0), &mut out, &mut orders);
        (out.iter().flat_map(|wire| wire.data().to_vec()).collect(), orders)
    }

    const GET_DATA: [u8; 9] = [0xDE, 0xAD, 2, 0, 0, 0, 0, 0xBE, 0xEF];

    #[test]
    fn data_come_back_with_the_echo_and_decode_to_the_attitude() {
        let mut device = Nos3Device::new(Limits::default());
        device.report(&report(), Tai::from_ns(0), &mut Vec::new());
        let (bytes, orders) = exchange(&mut device, &GET_DATA);
        assert_eq!((bytes.len(), orders.len()), (22, 0));
        assert_eq!(bytes[..9], GET_DATA);
        let q: Vec<f64> = bytes[11..19].chunks(2).map(|two| from_wire(u16::from_be_bytes([two[0], two[1]]))).collect();
        let wanted = [0.1_f64.sin(), 0.0, 0.0, 0.1_f64.cos()];
        assert!(q.iter().zip(wanted).all(|(q, wanted)| (q - wanted).abs() <= 1.0 / SCALE), "{q:?}");
        assert_eq!((bytes[19], &bytes[20..]), (1, &TAIL[..]));
        device.report(&lost(), Tai::from_ns(0), &mut Vec::new());
        assert_eq!(exchange(&mut device, &GET_DATA).0[19], 0, "control: not valid without an attitude");
    }

    #[test]
    fn counter_goes_up_by_two_and_noise_between_commands_is_passed_over() {
        let mut device = Nos3Device::new(Limits { exposure_s: Some([0.001, 0.1]) });
        let housekeeping = [0xDE, 0xAD, 1, 0, 0, 0, 0, 0xBE, 0xEF];
        assert_eq!(exchange(&mut device, &housekeeping).0[9..], [0xDE, 0xAD, 0, 0, 0, 2, 0xBE, 0xEF]);
        let mut noisy = vec![0xDE, 0xDE, 0xAD, 0x55];
        noisy.extend(housekeeping);
        assert_eq!(exchange(&mut device, &noisy).0[9..], [0xDE, 0xAD, 0, 0, 0, 4, 0xBE, 0xEF]);
        assert_eq!(device.answered(), Answered { commands: 2, refused: 1 });
        let configure = |us: u32| {
            let [a, b, c, d] = us.to_be_bytes();
            [0xDE, 0xAD, 3, a, b, c, d, 0xBE, 0xEF]
        };
        assert_eq!(exchange(&mut device, &configure(20_000)).1, [Order::Exposure(Span::from_ms(20))]);
        assert_eq!(exchange(&mut device, &configure(0)).1, [Order::Reset]);
        assert_eq!(exchange(&mut device, &configure(2_000_000)), (Vec::new(), Vec::new()), "control: out of range");
        assert_eq!(exchange(&mut device, &[0xDE, 0xAD, 9, 0, 0, 0, 0, 0xBE, 0xEF]), (Vec::new(), Vec::new()));
    }

    #[test]
    fn ends_of_the_range_stay_in_it() {
        assert_eq!([to_wire(-1.0), to_wire(0.0), to_wire(1.0), to_wire(1.1)], [1, 32_768, 65_535, 65_535]);
    }
}
