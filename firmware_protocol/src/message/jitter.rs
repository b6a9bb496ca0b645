//! Sampled jitter: rotation vector of the body away from the smooth attitude, about body X and body Y.
//!
//! Rotation about body Z is not carried. Where the boresight is far from body Z, send the disturbance as parameters.
//!
//! WHEELS has reaction wheel speeds: the parameter of wheel-induced jitter.

use crate::bytes::{Reader, Scale, Writer};
use crate::{EncodeError, Reject};

/// Samples in one [`JitterBurst`] at most.
pub const JITTER_BURST_MAX: usize = 14;
/// Time between the samples of [`JitterPair`]s, us.
pub const PAIR_PERIOD_US: u32 = 1000;

const BURST: Scale = Scale { field: "JITTER_FD sample, arcsec", lsb: 0.01, bits: 16 };
const PAIR: Scale = Scale { field: "JITTER sample, arcsec", lsb: 0.02, bits: 14 };

/// `0x31n`, 64 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0..4 | time tag of the first sample, us, u32 |
/// | 4..6 | time between samples, us, u16, not zero |
/// | 6 | sequence number |
/// | 7 | number of samples, 1 to 14 |
/// | 8..64 | 14 x (about X, about Y), 0.01 arcsec, i16; unused ones zero |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterBurst {
    /// Time tag of the first sample: SCET in microseconds, modulo 2^32.
    pub t_first_us: u32,
    /// Time between samples.
    pub period_us: u16,
    /// Counts up by one, wraps.
    pub seq: u8,
    count: u8,
    samples_arcsec: [[f32; 2]; JITTER_BURST_MAX],
}

/// `0x2An`, 8 bytes: two samples, 1 ms apart, of a stream of 1 kHz.
///
/// | bit | field |
/// |---|---|
/// | 0..8 | slot: the first sample's SCET in units of 2 ms, modulo 256 |
/// | 8..64 | 2 x (about X, about Y), 0.02 arcsec, i14 |
///
/// The slot is the time tag: it is unambiguous for a receiver that knows the sender's time to +-256 ms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterPair {
    /// The first sample's SCET in units of 2 ms, modulo 256.
    pub slot: u8,
    /// The samples, oldest first: rotation about body X and body Y.
    pub samples_arcsec: [[f32; 2]; 2],
}

impl JitterBurst {
    /// Returns a burst of the first 14 samples (about body X, about body Y); `None` without samples or period.
    pub fn new(t_first_us: u32, period_us: u16, seq: u8, samples_arcsec: &[[f32; 2]]) -> Option<Self> {
        let mut samples = [[0.0; 2]; JITTER_BURST_MAX];
        let mut count = 0;
        for (slot, sample) in samples.iter_mut().zip(samples_arcsec) {
            *slot = *sample;
            count += 1;
        }
        (count > 0 && period_us > 0).then_some(Self { t_first_us, period_us, seq, count, samples_arcsec: samples })
    }

    /// Returns the samples, oldest first: rotation about body X and body Y, arcsec.
    pub fn samples_arcsec(&self) -> &[[f32; 2]] {
        self.samples_arcsec.get(..usize::from(self.count)).unwrap_or(&[])
    }

    pub(crate) fn write(&self, to: &mut Writer) -> Result<(), EncodeError> {
        to.u32(self.t_first_us).u16(self.period_us).u8(self.seq).u8(self.count);
        for sample in self.samples_arcsec.as_flattened() {
            let [a, b, ..] = BURST.counts(*sample)?.to_le_bytes();
            to.put(&[a, b]);
        }
        Ok(())
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let (t_first_us, period_us, seq, count) = (from.u32()?, from.u16()?, from.u8()?, from.u8()?);
        let mut samples = [[0.0; 2]; JITTER_BURST_MAX];
        let used = samples.get_mut(..usize::from(count)).ok_or(Reject::UnknownValue)?;
        for sample in used.as_flattened_mut() {
            *sample = BURST.value(i32::from(from.i16()?))?;
        }
        Self::new(t_first_us, period_us, seq, used).ok_or(Reject::UnknownValue)
    }
}

impl JitterPair {
    pub(crate) fn write(&self, to: &mut Writer) -> Result<(), EncodeError> {
        let [[a, b], [c, d]] = self.samples_arcsec;
        let word = PAIR.pack([a, b, c, d])? << 8 | u64::from(self.slot);
        to.put(&word.to_le_bytes());
        Ok(())
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let word = from.take().map(u64::from_le_bytes)?;
        let [slot, ..] = word.to_le_bytes();
        let [a, b, c, d] = PAIR.unpack(word >> 8)?;
        Ok(Self { slot, samples_arcsec: [[a, b], [c, d]] })
    }
}

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
