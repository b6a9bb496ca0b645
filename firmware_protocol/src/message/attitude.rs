//! The attitude record: one value for CAN FD, serial and the classic group.

use crate::bytes::{Reader, Writer};
use crate::{Reject, bytes::Scale, crc::Crc16};

/// Largest distance of a quaternion's norm from 1.
pub const NORM_TOLERANCE: f64 = 1e-3;

/// Rate in the classic group: 21 bits of 1 urad/s, +-60 deg/s.
pub(crate) const RATE: Scale = Scale { field: "ATT_W rate_rad_s", lsb: 1e-6, bits: 21 };
/// Acceleration in the classic group: 21 bits of 1 urad/s^2, +-60 deg/s^2.
pub(crate) const ACCELERATION: Scale = Scale { field: "ATT_A acceleration_rad_s2", lsb: 1e-6, bits: 21 };

const RATE_BIT: u8 = 1;
const ACCELERATION_BIT: u8 = 2;
/// Position of the CRC in the 48 bytes.
const CRC_AT: usize = 6;

/// Which optional parts of the record hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AttitudeFlags {
    /// Bit 0: the rate was measured; otherwise it reads as zero.
    pub rate: bool,
    /// Bit 1: the acceleration was estimated; otherwise it reads as zero.
    pub acceleration: bool,
}

/// `0x30n`, 48 bytes (as five classic frames: see [`crate::can`]).
///
/// | byte | field |
/// |---|---|
/// | 0..4 | time tag, us, u32 |
/// | 4 | sequence number |
/// | 5 | flags |
/// | 6..8 | CRC-16 of bytes 0..6 and 8..48 |
/// | 8..24 | `body_from_icrf`, w x y z, 4 x f32 |
/// | 24..36 | rate, rad/s, 3 x f32 |
/// | 36..48 | angular acceleration, rad/s^2, 3 x f32 |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeRecord {
    /// Epoch of the attitude: SCET in microseconds, modulo 2^32.
    pub t_us: u32,
    /// Counts up by one, wraps.
    pub seq: u8,
    /// Which optional parts hold.
    pub flags: AttitudeFlags,
    /// `body_from_icrf`: Hamilton, scalar first, passive.
    pub q_wxyz: [f32; 4],
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: [f32; 3],
    /// Angular acceleration, body axes.
    pub acceleration_rad_s2: [f32; 3],
}

impl AttitudeFlags {
    /// Rate and acceleration both hold.
    pub const ALL: Self = Self { rate: true, acceleration: true };

    /// Returns the byte on the wire.
    pub const fn bits(self) -> u8 {
        (if self.rate { RATE_BIT } else { 0 }) | (if self.acceleration { ACCELERATION_BIT } else { 0 })
    }

    /// Reads the byte on the wire; unknown bits are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        Self { rate: bits & RATE_BIT != 0, acceleration: bits & ACCELERATION_BIT != 0 }
    }
}

impl AttitudeRecord {
    pub(crate) fn write(&self, to: &mut Writer) {
        let mut values = Writer::new();
        values.f32s(&self.q_wxyz).f32s(&self.rate_rad_s).f32s(&self.acceleration_rad_s2);
        let mut head = Writer::new();
        head.u32(self.t_us).u8(self.seq).u8(self.flags.bits());
        let (head, values) = (head.finish(), values.finish());
        let crc = Crc16::new().over(head.as_slice()).over(values.as_slice()).value();
        to.put(head.as_slice()).u16(crc).put(values.as_slice());
    }

    pub(crate) fn read(from: &mut Reader<'_>, bytes: &[u8]) -> Result<Self, Reject> {
        let (t_us, seq, flags, crc) = (from.u32()?, from.u8()?, from.u8()?, from.u16()?);
        if record_crc(bytes) != crc {
            return Err(Reject::BadCrc);
        }
        Self {
            t_us,
            seq,
            flags: AttitudeFlags::from_bits(flags),
            q_wxyz: from.f32s()?,
            rate_rad_s: from.f32s()?,
            acceleration_rad_s2: from.f32s()?,
        }
        .judged()
    }

    /// Returns the record if it is legal, with the parts that do not hold at zero.
    pub(crate) fn judged(mut self) -> Result<Self, Reject> {
        if !self.q_wxyz.iter().all(|value| value.is_finite()) {
            return Err(Reject::NotFinite);
        }
        if !has_unit_norm(self.q_wxyz) {
            return Err(Reject::QuaternionNorm);
        }
        if !self.flags.rate {
            self.rate_rad_s = [0.0; 3];
        }
        if !self.flags.acceleration {
            self.acceleration_rad_s2 = [0.0; 3];
        }
        Ok(self)
    }
}

fn record_crc(bytes: &[u8]) -> u16 {
    let (head, rest) = bytes.split_at_checked(CRC_AT).unwrap_or((bytes, &[]));
    Crc16::new().over(head).over(rest.get(2..).unwrap_or(&[])).value()
}

/// Compares squares: `core` has no square root.
fn has_unit_norm(q_wxyz: [f32; 4]) -> bool {
    let square: f64 = q_wxyz.iter().map(|value| f64::from(*value) * f64::from(*value)).sum();
    let (low, high) = (1.0 - NORM_TOLERANCE, 1.0 + NORM_TOLERANCE);
    (low * low..=high * high).contains(&square)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn norm_is_judged_on_both_sides() {
        for (w, legal) in [(1.0, true), (-1.0, true), (1.0009, true), (0.9991, true), (1.0011, false), (0.9989, false)]
        {
            assert_eq!(has_unit_norm([w, 0.0, 0.0, 0.0]), legal, "{w}");
        }
        assert!(!has_unit_norm([0.0; 4]), "zero");
    }
}
