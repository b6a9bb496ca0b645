//! The classic attitude group: parts, commit, and the check that all are of one epoch.

use crate::bytes::{Payload, Reader, Writer};
use crate::crc::Crc16;
use crate::message::{ACCELERATION, AttitudeFlags, AttitudeRecord, RATE};
use crate::{EncodeError, Reject};

/// Parts before the commit, in the order of their identifiers.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    Q01 = 0,
    Q23 = 1,
    Rate = 2,
    Acceleration = 3,
}

/// The parts received since the last commit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Group {
    parts: [Option<[u8; 8]>; 4],
}

impl Group {
    /// Returns the parts of a record.
    pub(super) fn of(record: &AttitudeRecord) -> Result<Self, EncodeError> {
        let [w, x, y, z] = record.q_wxyz;
        let rate = record.flags.rate.then(|| RATE.pack(record.rate_rad_s)).transpose()?;
        let acceleration = record.flags.acceleration.then(|| ACCELERATION.pack(record.acceleration_rad_s2));
        let acceleration = acceleration.transpose()?;
        Ok(Self {
            parts: [
                Some(pair_bytes(w, x)),
                Some(pair_bytes(y, z)),
                rate.map(u64::to_le_bytes),
                acceleration.map(u64::to_le_bytes),
            ],
        })
    }

    pub(super) fn part(&self, part: Part) -> Option<[u8; 8]> {
        self.parts.get(part as usize).copied().flatten()
    }

    /// Returns the ATT_T that closes this group.
    pub(super) fn commit(&self, record: &AttitudeRecord) -> Payload {
        let mut to = Writer::new();
        to.u32(record.t_us).u8(record.seq).u8(record.flags.bits());
        let crc = self.crc(to.finish().as_slice());
        to.u16(crc).finish()
    }

    /// Keeps a part. A part that is there already belongs to an epoch that was never committed: that one is dropped.
    pub(super) fn keep(&mut self, part: Part, data: &[u8]) -> Result<(), Reject> {
        let bytes = Reader::exact(data, 8)?.take()?;
        let torn = self.part(part).is_some();
        if torn {
            *self = Self::default();
        }
        if let Some(slot) = self.parts.get_mut(part as usize) {
            *slot = Some(bytes);
        }
        if torn { Err(Reject::TornGroup) } else { Ok(()) }
    }

    /// Closes the group: the record, when every part is there and of this epoch. Leaves no part behind.
    pub(super) fn close(&mut self, commit: &[u8]) -> Result<AttitudeRecord, Reject> {
        let group = core::mem::take(self);
        let mut from = Reader::exact(commit, 8)?;
        let (t_us, seq, flags, crc) = (from.u32()?, from.u8()?, AttitudeFlags::from_bits(from.u8()?), from.u16()?);
        let complete = group.part(Part::Rate).is_some() == flags.rate
            && group.part(Part::Acceleration).is_some() == flags.acceleration;
        let (Some(q01), Some(q23), true) = (group.part(Part::Q01), group.part(Part::Q23), complete) else {
            return Err(Reject::TornGroup);
        };
        if group.crc(commit.get(..6).unwrap_or(&[])) != crc {
            return Err(Reject::TornGroup);
        }
        let ([w, x], [y, z]) = (pair_values(q01)?, pair_values(q23)?);
        AttitudeRecord {
            t_us,
            seq,
            flags,
            q_wxyz: [w, x, y, z],
            rate_rad_s: RATE.unpack(group.word(Part::Rate))?,
            acceleration_rad_s2: ACCELERATION.unpack(group.word(Part::Acceleration))?,
        }
        .judged()
    }

    fn word(&self, part: Part) -> u64 {
        self.part(part).map_or(0, u64::from_le_bytes)
    }

    fn crc(&self, head: &[u8]) -> u16 {
        let parts = self.parts.iter().flatten().fold(Crc16::new(), |crc, part| crc.over(part));
        parts.over(head).value()
    }
}

fn pair_bytes(a: f32, b: f32) -> [u8; 8] {
    (u64::from(b.to_bits()) << 32 | u64::from(a.to_bits())).to_le_bytes()
}

fn pair_values(bytes: [u8; 8]) -> Result<[f32; 2], Reject> {
    Reader::exact(&bytes, 8)?.f32s()
}
