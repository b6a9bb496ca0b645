//! SLIP frames with XXH32: bytes of a line <-> frames whose hash is right.
//!
//! Source: RFC 1055, with a C0 at both ends; the Sagitta driver of C2A for the hash: XXH32, seed 1425, over everything
//! before it, appended little-endian before the escaping.

use xxhash_rust::xxh32::xxh32;

const END: u8 = 0xC0;
const ESCAPE: u8 = 0xDB;
const ESCAPED_END: u8 = 0xDC;
const ESCAPED_ESCAPE: u8 = 0xDD;
const SEED: u32 = 1425;
const HASH_BYTES: usize = 4;
/// Longest frame before escaping, bytes: more than any request has.
pub const FRAME_MAX: usize = 512;

/// Returns the bytes on the line of a frame without its hash.
pub fn encode(content: &[u8]) -> Vec<u8> {
    let hash = xxh32(content, SEED).to_le_bytes();
    let mut line = vec![END];
    for byte in content.iter().chain(&hash) {
        match *byte {
            END => line.extend([ESCAPE, ESCAPED_END]),
            ESCAPE => line.extend([ESCAPE, ESCAPED_ESCAPE]),
            other => line.push(other),
        }
    }
    line.push(END);
    line
}

/// Why a frame is refused.
pub type Refusal = &'static str;

const TOO_LONG: Refusal = "the frame has more than 512 bytes";
const BAD_ESCAPE: Refusal = "an escape byte 0xDB is followed by neither 0xDC nor 0xDD";
const TOO_SHORT: Refusal = "the frame has fewer bytes than a hash";
const BAD_HASH: Refusal = "the hash differs: wanted XXH32 with seed 1425 over all bytes before it, little-endian";

/// Content of a frame without its hash, or what is wrong with it.
pub type Frame<'a> = Result<&'a [u8], Refusal>;

/// Puts frames together from runs of bytes of any length.
#[derive(Debug, Default)]
pub struct SlipReader {
    frame: Vec<u8>,
    is_escaped: bool,
    error: Option<Refusal>,
}

impl SlipReader {
    /// Takes bytes; `each` gets the content of every frame without its hash, or what is wrong with it.
    pub fn push(&mut self, bytes: &[u8], each: &mut dyn FnMut(Frame<'_>)) {
        for byte in bytes {
            match (core::mem::take(&mut self.is_escaped), *byte) {
                (_, END) => self.end(each),
                (false, ESCAPE) => self.is_escaped = true,
                (true, ESCAPED_END) => self.append(END),
                (true, ESCAPED_ESCAPE) => self.append(ESCAPE),
                (true, _) => self.error = self.error.or(Some(BAD_ESCAPE)),
                (false, other) => self.append(other),
            }
        }
    }

    fn append(&mut self, byte: u8) {
        if self.frame.len() >= FRAME_MAX {
            self.error = self.error.or(Some(TOO_LONG));
        } else {
            self.frame.push(byte);
        }
    }

    /// Ends a frame; between two frames there is nothing.
    fn end(&mut self, each: &mut dyn FnMut(Frame<'_>)) {
        let (frame, error) = (core::mem::take(&mut self.frame), self.error.take());
        if frame.is_empty() && error.is_none() {
            return;
        }
        let checked = match (error, frame.split_last_chunk::<HASH_BYTES>()) {
            (Some(error), _) => Err(error),
            (None, None) => Err(TOO_SHORT),
            (None, Some((content, hash))) if xxh32(content, SEED) == u32::from_le_bytes(*hash) => Ok(content),
            (None, Some(_)) => Err(BAD_HASH),
        };
        each(checked);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(bytes: &[u8]) -> Vec<Result<Vec<u8>, Refusal>> {
        let mut got = Vec::new();
        SlipReader::default().push(bytes, &mut |frame| got.push(frame.map(<[u8]>::to_vec)));
        got
    }

    /// As the driver of C2A sends it.
    const BOOT: [u8; 10] = [0xC0, 0x21, 0x03, 0x01, 0x01, 0x9C, 0x34, 0x9A, 0x61, 0xC0];

    #[test]
    fn boot_frame_is_the_published_one() {
        assert_eq!(encode(&[0x21, 3, 1, 1]), BOOT);
        assert_eq!(read(&BOOT), [Ok(vec![0x21, 3, 1, 1])]);
    }

    #[test]
    fn damage_is_refused_and_the_next_frame_is_read() {
        let mut bytes = BOOT.to_vec();
        bytes[3] ^= 1;
        bytes.extend(BOOT);
        assert_eq!(read(&bytes), [Err(BAD_HASH), Ok(vec![0x21, 3, 1, 1])]);
        assert_eq!(read(&[END, 1, END]), [Err(TOO_SHORT)]);
        assert_eq!(read(&[END, ESCAPE, 1, END]), [Err(BAD_ESCAPE)]);
        let mut long = vec![1; FRAME_MAX + 9];
        long.push(END);
        assert_eq!(read(&long), [Err(TOO_LONG)]);
    }

    proptest! {
        #[test]
        fn frames_come_back_whatever_is_in_them(content in proptest::collection::vec(any::<u8>(), 0..200)) {
            prop_assert_eq!(read(&encode(&content)), [Ok(content)]);
        }
    }
}
