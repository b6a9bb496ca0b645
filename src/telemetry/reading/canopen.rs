//! CANopen: the transmit PDOs 1 to 3 of one node, mapped as in `canopen`: state, known, stars and milliseconds of the
//! day; real part and i; j and k. The three of one report are those that follow one another: PDO1 begins a report, PDO3
//! ends it. Other identifiers are passed over.

use super::{Measured, Reader, unit};
use crate::canopen::{MS_PER_DAY, TPDO_IDS};
use crate::{Sense, Wire};
use base::time::{Span, Tai};

/// A report that has begun.
#[derive(Debug, Clone, Copy)]
struct Begun {
    time_tag: Tai,
    stars: u16,
    real_and_i: Option<[f64; 2]>,
}

/// Reads a CANopen star tracker.
#[derive(Debug)]
pub struct CanOpenReader {
    node: u8,
    sense: Sense,
    begun: Option<Begun>,
    damaged: u64,
}

impl CanOpenReader {
    /// Makes a reader of this node, whose quaternions are in this sense.
    pub fn new(node: u8, sense: Sense) -> Self {
        Self { node, sense, begun: None, damaged: 0 }
    }

    /// PDO1: a report without an attitude is whole; another one begins.
    fn begin(&mut self, data: [u8; 8], at: Tai, out: &mut Vec<Measured>) {
        self.damaged += u64::from(self.begun.take().is_some());
        let [_state, known, c, d, e, f, g, h] = data;
        let stars = u16::from_le_bytes([c, d]);
        let ms = i64::from(u32::from_le_bytes([e, f, g, h]));
        if known > 1 || ms >= MS_PER_DAY {
            self.damaged += 1;
            return;
        }
        let time_tag = nearest_day(ms, at);
        if known == 1 {
            self.begun = Some(Begun { time_tag, stars, real_and_i: None });
        } else {
            let (time_tag, stars) = (Some(time_tag), Some(stars));
            out.push(Measured { at, time_tag, frame: None, attitude_wxyz: None, stars });
        }
    }

    /// PDO3: the report is whole.
    fn end(&mut self, [j, k]: [f64; 2], at: Tai, out: &mut Vec<Measured>) {
        // A PDO3 without the others before it: the capture begins in the midst of a report.
        let Some(begun) = self.begun.take() else { return };
        let attitude = begun.real_and_i.and_then(|[real, i]| unit(self.sense.of([real, i, j, k])));
        if attitude.is_none() {
            self.damaged += 1;
            return;
        }
        let (time_tag, stars) = (Some(begun.time_tag), Some(begun.stars));
        out.push(Measured { at, time_tag, frame: None, attitude_wxyz: attitude, stars });
    }
}

impl Reader for CanOpenReader {
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>) {
        let Wire::Can(frame) = wire else { return };
        let pdo = TPDO_IDS.iter().position(|id| frame.id() == id + u16::from(self.node));
        let Some(pdo) = pdo.filter(|pdo| *pdo < 3) else { return };
        let Ok(data) = <[u8; 8]>::try_from(frame.data()) else {
            self.damaged += 1;
            return;
        };
        match pdo {
            0 => self.begin(data, at, out),
            1 => {
                if let Some(begun) = &mut self.begun {
                    begun.real_and_i = Some(singles(data));
                }
            }
            _third => self.end(singles(data), at, out),
        }
    }

    fn damaged(&self) -> u64 {
        self.damaged
    }
}

fn singles([a, b, c, d, e, f, g, h]: [u8; 8]) -> [f64; 2] {
    [[a, b, c, d], [e, f, g, h]].map(|four| f64::from(f32::from_le_bytes(four)))
}

/// Returns the instant of these milliseconds of a UTC day that is nearest to `at`.
fn nearest_day(ms: i64, at: Tai) -> Tai {
    let day_ns = MS_PER_DAY * 1_000_000;
    let midnight_ns = at.to_unix_ns().div_euclid(day_ns) * day_ns;
    let candidates = [-1, 0, 1].map(|day| Tai::from_unix_ns(midnight_ns + day * day_ns + ms * 1_000_000));
    let distance = |instant: &Tai| if *instant > at { *instant - at } else { at - *instant };
    candidates.into_iter().min_by_key(distance).unwrap_or(at + Span::ZERO)
}
