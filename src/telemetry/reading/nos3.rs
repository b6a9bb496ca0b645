//! NOS3's generic star tracker: the answers to requests of data, `DE AD`, four u16, validity, `BE EF`. They have no time
//! tag. Echoes and housekeeping, of nine and eight bytes, are passed over: their ends are elsewhere.

use super::{Measured, Reader, unit};
use crate::nos3::from_wire;
use crate::{Sense, Wire};
use base::time::Tai;

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
