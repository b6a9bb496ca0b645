//! The fuzzer's bytes -> numbers and runs of bytes. Past the end everything is zero, so that any input has a meaning.

use crate::control;

/// Takes values off the front.
#[derive(Debug, Clone)]
pub struct Input<'a> {
    rest: &'a [u8],
}

impl<'a> Input<'a> {
    /// Returns all of the fuzzer's bytes.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// Returns the bytes not taken yet.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Returns whether everything has been taken.
    pub fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Returns the next bytes, fewer at the end.
    pub fn take(&mut self, count: usize) -> &'a [u8] {
        let (taken, rest) = self.rest.split_at(count.min(self.rest.len()));
        self.rest = rest;
        taken
    }

    /// Returns the next bytes, zeros past the end.
    pub fn array<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        let taken = self.take(N);
        bytes[..taken.len()].copy_from_slice(taken);
        bytes
    }

    /// Returns one byte.
    pub fn u8(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    /// Returns two bytes.
    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.array())
    }

    /// Returns four bytes.
    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.array())
    }

    /// Returns the eight bytes.
    pub fn i64(&mut self) -> i64 {
        i64::from_le_bytes(self.array())
    }

    /// Returns a bit of one byte.
    pub fn bool(&mut self) -> bool {
        self.u8() & 1 != 0
    }

    /// Returns a number below `end`, from two bytes; 0 when `end` is.
    pub fn below(&mut self, end: usize) -> usize {
        usize::from(self.u16()).checked_rem(end).unwrap_or(0)
    }

    /// Returns a finite number of any size.
    pub fn finite(&mut self) -> f32 {
        let value = f32::from_bits(self.u32());
        if value.is_finite() { value } else { 0.0 }
    }
}

/// Reads a stream that comes in chunks of these lengths, less one, in turn, with one reader that keeps its state.
///
/// Broken: what a chunk leaves unfinished is lost.
pub fn read_in<R: Default, T>(
    stream: &[u8],
    lengths: &[u8],
    mut push: impl FnMut(&mut R, &[u8], &mut Vec<T>),
) -> Vec<T> {
    let (mut reader, mut all) = (R::default(), Vec::new());
    for chunk in chunks(stream, lengths) {
        push(&mut reader, chunk, &mut all);
        if control::is_broken() {
            reader = R::default();
        }
    }
    all
}

/// Cuts a stream into chunks of these lengths, less one, in turn; an empty stream has one empty chunk.
pub fn chunks<'a>(stream: &'a [u8], lengths: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
    let mut rest = Some(stream);
    lengths.iter().cycle().map_while(move |length| {
        let (chunk, after) = rest?.split_at((usize::from(*length) + 1).min(rest?.len()));
        rest = Some(after).filter(|after| !after.is_empty());
        Some(chunk)
    })
}
