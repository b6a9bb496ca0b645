//! Sagitta: telemetry 24, the solution, asynchronous or asked for.

use super::{Measured, Reader, unit};
use crate::sagitta::slip::SlipReader;
use crate::sagitta::{ADDRESS, ASYNCHRONOUS, GET_TELEMETRY, REPLY, SOLUTION};
use crate::{Sense, Wire};
use base::time::Tai;

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
