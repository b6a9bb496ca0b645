//! Fields in and out of payload bytes, little-endian.

use crate::Reject;

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
