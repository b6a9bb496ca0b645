//! Reaction wheel speeds: the parameter of wheel-induced jitter.

use crate::bytes::{Reader, Writer};
use crate::scaled::Scale;
use crate::{EncodeError, Reject};

const SPEED: Scale = Scale { field: "WHEELS speed_rpm", lsb: 0.25, bits: 16 };

/// `0x28n`, 8 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0..8 | speed of wheels 0 to 3, 0.25 rpm, 4 x i16 |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wheels {
    /// Speed of each wheel, revolutions per minute; zero for a wheel that does not exist.
    pub speed_rpm: [f32; 4],
}

impl Wheels {
    pub(crate) fn write(&self, to: &mut Writer) -> Result<(), EncodeError> {
        to.put(&SPEED.pack(self.speed_rpm)?.to_le_bytes());
        Ok(())
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        Ok(Self { speed_rpm: SPEED.unpack(from.take().map(u64::from_le_bytes)?)? })
    }
}
