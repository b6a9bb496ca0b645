//! Fields in and out of payload bytes, little-endian: numbers as integers times a resolution, and integers packed into 64 bits.

use crate::{EncodeError, Reject};

/// Longest payload: one CAN FD frame.
pub const PAYLOAD_MAX: usize = 64;

/// The bytes of one message, without identifier or framing.
#[derive(Debug, Clone, Copy)]
pub struct Payload {
    bytes: [u8; PAYLOAD_MAX],
    len: usize,
}

impl Payload {
    /// Returns the bytes.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }
}

/// Appends fields. What exceeds [`PAYLOAD_MAX`] is dropped; no layout does (the frozen bytes hold each length).
#[derive(Debug)]
pub(crate) struct Writer {
    payload: Payload,
}

impl Writer {
    pub(crate) fn new() -> Self {
        Self { payload: Payload { bytes: [0; PAYLOAD_MAX], len: 0 } }
    }

    pub(crate) fn put(&mut self, bytes: &[u8]) -> &mut Self {
        let end = self.payload.len + bytes.len();
        if let Some(space) = self.payload.bytes.get_mut(self.payload.len..end) {
            space.copy_from_slice(bytes);
            self.payload.len = end;
        }
        self
    }

    pub(crate) fn u8(&mut self, value: u8) -> &mut Self {
        self.put(&[value])
    }

    pub(crate) fn u16(&mut self, value: u16) -> &mut Self {
        self.put(&value.to_le_bytes())
    }

    /// Returns the low 24 bits.
    pub(crate) fn u24(&mut self, value: u32) -> &mut Self {
        let [a, b, c, _] = value.to_le_bytes();
        self.put(&[a, b, c])
    }

    pub(crate) fn u32(&mut self, value: u32) -> &mut Self {
        self.put(&value.to_le_bytes())
    }

    pub(crate) fn f32s(&mut self, values: &[f32]) -> &mut Self {
        for value in values {
            self.put(&value.to_le_bytes());
        }
        self
    }

    pub(crate) fn finish(&self) -> Payload {
        self.payload
    }
}

/// Takes fields from the front; running out is [`Reject::WrongLength`].
#[derive(Debug)]
pub(crate) struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Reads a payload that must have exactly `len` bytes.
    pub(crate) fn exact(bytes: &'a [u8], len: usize) -> Result<Self, Reject> {
        if bytes.len() == len { Ok(Self { rest: bytes }) } else { Err(Reject::WrongLength) }
    }

    pub(crate) fn take<const N: usize>(&mut self) -> Result<[u8; N], Reject> {
        let (taken, rest) = self.rest.split_first_chunk::<N>().ok_or(Reject::WrongLength)?;
        self.rest = rest;
        Ok(*taken)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, Reject> {
        self.take().map(|[byte]| byte)
    }

    pub(crate) fn u16(&mut self) -> Result<u16, Reject> {
        self.take().map(u16::from_le_bytes)
    }

    pub(crate) fn i16(&mut self) -> Result<i16, Reject> {
        self.take().map(i16::from_le_bytes)
    }

    pub(crate) fn u24(&mut self) -> Result<u32, Reject> {
        self.take().map(|[a, b, c]| u32::from_le_bytes([a, b, c, 0]))
    }

    pub(crate) fn u32(&mut self) -> Result<u32, Reject> {
        self.take().map(u32::from_le_bytes)
    }

    /// Returns the finite floats only.
    pub(crate) fn f32s<const N: usize>(&mut self) -> Result<[f32; N], Reject> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.take().map(f32::from_le_bytes)?;
        }
        if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(Reject::NotFinite) }
    }
}

/// One fixed-point field: signed, symmetric, `bits` wide, `lsb` per count. The lowest count has no positive
/// counterpart: it is not sent, and refused when it comes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    pub(crate) field: &'static str,
    pub(crate) lsb: f64,
    pub(crate) bits: u32,
}

impl Scale {
    const fn limit(self) -> i32 {
        (1 << (self.bits - 1)) - 1
    }

    /// Returns the nearest count; refused when it does not fit.
    pub(crate) fn counts(self, value: f32) -> Result<i32, EncodeError> {
        let counts = f64::from(value) / self.lsb;
        let nearest = counts + 0.5_f64.copysign(counts);
        if nearest.abs() < f64::from(self.limit()) + 1.0 {
            #[allow(clippy::cast_possible_truncation, reason = "bounded just above; truncation finishes the rounding")]
            Ok(nearest as i32)
        } else {
            let limit = f64::from(self.limit()) * self.lsb;
            Err(EncodeError::OutOfRange { field: self.field, got: f64::from(value), limit })
        }
    }

    /// Returns the value of a count; the lowest count is reserved.
    pub(crate) fn value(self, counts: i32) -> Result<f32, Reject> {
        if counts < -self.limit() {
            return Err(Reject::UnknownValue);
        }
        #[allow(clippy::cast_possible_truncation, reason = "the wire's resolution is coarser than f32 on its range")]
        let value = (f64::from(counts) * self.lsb) as f32;
        Ok(value)
    }

    /// Values packed from bit 0 upwards, each in two's complement.
    pub(crate) fn pack<const N: usize>(self, values: [f32; N]) -> Result<u64, EncodeError> {
        let mut word = 0;
        for value in values.into_iter().rev() {
            let counts = self.counts(value)?;
            word = (word << self.bits) | (u64::from(counts.cast_unsigned()) & ((1 << self.bits) - 1));
        }
        Ok(word)
    }

    /// Returns the inverse of [`Self::pack`].
    pub(crate) fn unpack<const N: usize>(self, word: u64) -> Result<[f32; N], Reject> {
        let mut values = [0.0; N];
        let mut rest = word;
        for value in &mut values {
            *value = self.value(self.sign_extended(rest))?;
            rest >>= self.bits;
        }
        Ok(values)
    }

    #[allow(clippy::cast_possible_truncation, reason = "only the low bits are wanted")]
    fn sign_extended(self, word: u64) -> i32 {
        let unused = 32 - self.bits;
        ((word as u32) << unused).cast_signed() >> unused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: Scale = Scale { field: "rate", lsb: 1e-6, bits: 21 };

    #[test]
    fn packs_signs_and_rounds_to_nearest() {
        let word = RATE.pack([1e-6, -1e-6, 1.6e-6]).unwrap();
        assert_eq!(word, 1 | (0x1F_FFFF << 21) | (2 << 42));
        assert_eq!(RATE.unpack::<3>(word), Ok([1e-6, -1e-6, 2e-6]));
        assert_eq!(RATE.counts(1.048_575).unwrap(), 1_048_575, "the largest");
    }

    #[test]
    fn the_lowest_count_is_no_value_and_the_next_is_the_lowest() {
        for place in 0..3 {
            let field = |counts: u64| counts << (21 * place);
            assert_eq!(RATE.unpack::<3>(field(1 << 20)), Err(Reject::UnknownValue), "field {place}");
            let lowest = RATE.unpack::<3>(field((1 << 20) + 1)).unwrap();
            assert_eq!(lowest[place], -1.048_575, "field {place}");
            assert_eq!(RATE.pack(lowest).unwrap(), field((1 << 20) + 1), "and is sent again");
        }
    }

    #[test]
    fn values_out_of_range_are_refused_not_clipped() {
        for value in [1.048_576_f32, -1.05, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(RATE.counts(value).is_err(), "{value}");
        }
    }
}
