//! Errors that a CRC-16 is sure to detect, put into a codeword; the CRC itself bit by bit.
//!
//! Sure are up to three bits anywhere, and any burst of up to 16 bits in the order in which the CRC takes them: the
//! highest bit of each byte first, the CRC behind everything else, its high byte first. Other errors pass with
//! probability 2^-16, which a fuzzer is bound to meet; they are not made here.

use crate::Input;

/// Returns the CRC-16/IBM-3740, from its definition: polynomial 0x1021, start 0xFFFF, the highest bit first.
pub fn crc16<'a>(bytes: impl IntoIterator<Item = &'a u8>) -> u16 {
    bytes.into_iter().fold(0xFFFF, |crc, byte| {
        (0..8).rev().fold(crc, |crc: u16, bit| {
            let out = (crc >> 15) ^ u16::from(byte >> bit & 1);
            (crc << 1) ^ (out * 0x1021)
        })
    })
}

/// Flips one to three bits, or a burst of up to 16; false when the flips have cancelled.
pub fn flip(codeword: &mut [u8], input: &mut Input<'_>) -> bool {
    let before = codeword.to_vec();
    let bits = 8 * codeword.len();
    match input.u8() % 4 {
        3 => {
            let (pattern, begin) = (input.u16(), input.below(bits));
            let is_set = |place: &usize| pattern >> (15 - place) & 1 != 0;
            (0..16.min(bits - begin)).filter(is_set).for_each(|place| flip_bit(codeword, begin + place));
        }
        more => (0..=more).for_each(|_| flip_bit(codeword, input.below(bits))),
    }
    codeword != before
}

/// Flips a bit; bit 0 is the highest of the first byte.
fn flip_bit(codeword: &mut [u8], bit: usize) {
    codeword[bit / 8] ^= 0x80 >> (bit % 8);
}
