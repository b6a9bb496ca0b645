//! The other direction: packets of a tracker's telemetry -> what it measured. For captures of a bus, whoever was on it.
//!
//! Each reader is the counterpart of a device, in the file of its protocol, and takes what is on the line as it comes: bytes in runs of any length,
//! or CAN frames, with the instant of each. Packets without attitudes, and those of others on the same
//! line, are passed over; damaged packets are counted. A reader keeps a bounded number of bytes.
//!
//! Quaternions come out as everywhere in starloop, whatever sense the protocol has them in. Tests: beside the code,
//! round trips through the devices; `tests/fuzz/targets/tracker_telemetry.rs`; `hil_scripts/tests/test_tracker_report.py` with
//! packets that are written there.

use crate::Wire;
use base::time::Tai;

/// A tracker's answer to one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// When its last byte was on the line.
    pub at: Tai,
    /// The instant at which the attitude holds; `None` where the protocol has no time tag.
    pub time_tag: Option<Tai>,
    /// Number of the frame, where the protocol has all of it.
    pub frame: Option<u32>,
    /// The attitude, `sensor_from_icrf`, scalar first; `None`: not known.
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Stars that were used.
    pub stars: Option<u16>,
}

/// A reader of one tracker's telemetry.
pub trait Reader: Send {
    /// Takes what was on the line at `at`.
    fn take(&mut self, wire: &Wire, at: Tai, out: &mut Vec<Measured>);

    /// Returns how many packets were damaged.
    fn damaged(&self) -> u64;
}

/// Returns an attitude of norm 1; `None` of anything else, such as four zeros.
pub(crate) fn unit(q: [f64; 4]) -> Option<[f64; 4]> {
    /// A tracker's own rounding: 16 bits of NOS3 leave 6e-5.
    const NORM_TOLERANCE: f64 = 1e-3;
    let norm = q.iter().map(|part| part * part).sum::<f64>().sqrt();
    ((norm - 1.0).abs() < NORM_TOLERANCE).then(|| q.map(|part| part / norm))
}

#[cfg(test)]
mod tests;
