//! Stimulator to flight computer: which exposure was rendered from which attitude.

use crate::Reject;
use crate::bytes::{Reader, Writer};

const AGE_LSB_US: u32 = 10;

/// `0x18n`, 8 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | frame number, modulo 256 |
/// | 1 | sequence number of the newest attitude received when the frame was drawn |
/// | 2..6 | mid-exposure, us, u32 |
/// | 6..8 | age of that attitude at mid-exposure, 10 us, u16; 0 when interpolated |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// Frame number, modulo 256.
    pub frame: u8,
    /// Sequence number of the newest attitude received when the frame was drawn.
    pub attitude_seq: u8,
    /// Mid-exposure in the flight computer's time: SCET in microseconds, modulo 2^32.
    pub mid_exposure_us: u32,
    age: u16,
}

impl Exposure {
    /// Returns an exposure; an age above 655 350 us is sent as 655 350 us.
    pub fn new(frame: u8, attitude_seq: u8, mid_exposure_us: u32, age_us: u32) -> Self {
        let age = u16::try_from(age_us / AGE_LSB_US).unwrap_or(u16::MAX);
        Self { frame, attitude_seq, mid_exposure_us, age }
    }

    /// Returns the age of the newest attitude at mid-exposure, in steps of 10 us; 655 350 us means that or more.
    pub fn age_us(&self) -> u32 {
        u32::from(self.age) * AGE_LSB_US
    }

    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.frame).u8(self.attitude_seq).u32(self.mid_exposure_us).u16(self.age);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let (frame, attitude_seq, mid_exposure_us) = (from.u8()?, from.u8()?, from.u32()?);
        Ok(Self { frame, attitude_seq, mid_exposure_us, age: from.u16()? })
    }
}
