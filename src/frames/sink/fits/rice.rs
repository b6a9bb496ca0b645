//! Rice coding of pixels: `RICE_1` of the tiled image compression of FITS; written with 16 bits, read with 8, 16 or 32.
//!
//! In: pixels of one tile in the order of the file. Out: bytes that hold them without loss, and the way back. The first pixel is written as
//! it is; the differences to the pixel before go in blocks of [`BLOCK_PX`], each with the number of low bits that suits
//! it. Source: FITS standard 4.0, section 10.4.1; R. White, P. Greenfield, W. Pence and others, "Tiled image convention
//! for storing compressed images in FITS binary tables", version 2.3. Tests: below, and astropy reads the files in
//! `hil_scripts/tests/test_data_sets.py`.

use super::image::BZERO_U16;

/// Pixels of a block, as most programs choose it.
pub(super) const BLOCK_PX: usize = 32;
/// Bytes of a pixel before it is coded.
pub(super) const PIXEL_BYTES: usize = 2;
/// Bits of a pixel.
const PIXEL_BITS: u32 = 16;
/// Bits that give the number of low bits of a block.
const CHOICE_BITS: u32 = 4;
/// Beyond this number of low bits a block is written as it is.
const MOST_LOW_BITS: u32 = 14;

/// Returns the most bytes that this many pixels can take: every block as it is.
pub(super) fn most_bytes(pixels: usize) -> usize {
    PIXEL_BYTES * (pixels + 1) + pixels.div_ceil(BLOCK_PX).div_ceil(2) + 1
}

/// Adds the code of a tile to `out`.
pub(super) fn encode(pixels: &[u16], out: &mut Vec<u8>) {
    let Some(&first) = pixels.first() else { return };
    let mut bits = Bits { out, waiting: 0, count: 0 };
    let mut before = stored(first);
    bits.push(u64::from(before), PIXEL_BITS);
    for block in pixels.chunks(BLOCK_PX) {
        let mut differences = [0_u32; BLOCK_PX];
        for (to, &pixel) in differences.iter_mut().zip(block) {
            let pixel = stored(pixel);
            *to = folded(pixel.wrapping_sub(before));
            before = pixel;
        }
        encode_block(&differences[..block.len()], &mut bits);
    }
    bits.finish();
}

fn encode_block(differences: &[u32], bits: &mut Bits<'_>) {
    let sum: u32 = differences.iter().sum();
    let low_bits = low_bits_of(sum, differences.len());
    if low_bits >= MOST_LOW_BITS {
        bits.push(u64::from(MOST_LOW_BITS + 1), CHOICE_BITS);
        differences.iter().for_each(|difference| bits.push(u64::from(*difference), PIXEL_BITS));
    } else if sum == 0 {
        bits.push(0, CHOICE_BITS);
    } else {
        bits.push(u64::from(low_bits + 1), CHOICE_BITS);
        let mask = (1 << low_bits) - 1;
        for difference in differences {
            let zeros = difference >> low_bits;
            // The one that ends the zeros, and the low bits after it.
            let (tail, length) = (u64::from((1 << low_bits) | (difference & mask)), low_bits + 1);
            if zeros + length <= u32::BITS {
                bits.push(tail, zeros + length);
            } else {
                bits.push_zeros(zeros);
                bits.push(tail, length);
            }
        }
    }
}

/// Returns the low bits for differences of this sum: about the logarithm of half their mean.
fn low_bits_of(sum: u32, count: usize) -> u32 {
    let count = f64::from(u32::try_from(count).unwrap_or(u32::MAX));
    let mean = ((f64::from(sum) - (count / 2.0).floor() - 1.0) / count).max(0.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a mean of 16-bit numbers")]
    let half = (mean as u32) >> 1;
    u32::BITS - half.leading_zeros()
}

/// Returns the pixel as the file stores it: without the offset of unsigned numbers.
fn stored(pixel: u16) -> u16 {
    pixel ^ BZERO_U16
}

/// Returns a signed difference as a number whose low bit is its sign.
fn folded(difference: u16) -> u32 {
    let doubled = difference << 1;
    u32::from(if difference & 0x8000 == 0 { doubled } else { !doubled })
}

/// How a tile was coded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Coding {
    /// Pixels of a block.
    pub block_px: usize,
    /// Bits of the choice of a block, and the largest number of low bits: beyond it pixels are written as they are.
    choice_bits: u32,
    most_low_bits: u32,
    /// Bits of a pixel before it is coded.
    pixel_bits: u32,
}

impl Coding {
    /// Returns the coding of pixels of 1, 2 or 4 bytes; `None` of others.
    pub(super) fn of(block_px: usize, pixel_bytes: usize) -> Option<Self> {
        let (choice_bits, most_low_bits, pixel_bits) = match pixel_bytes {
            1 => (3, 6, 8),
            2 => (CHOICE_BITS, MOST_LOW_BITS, PIXEL_BITS),
            4 => (5, 25, 32),
            _ => return None,
        };
        (1..=BLOCK_PX).contains(&block_px).then_some(Self { block_px, choice_bits, most_low_bits, pixel_bits })
    }

    /// Returns the fewest bits that `pixels` can take.
    pub(super) fn least_bits(&self, pixels: usize) -> usize {
        self.pixel_bits as usize + pixels.div_ceil(self.block_px).saturating_mul(self.choice_bits as usize)
    }

    /// Returns a pixel as a number: those of one byte are unsigned.
    fn number(&self, value: u32) -> i32 {
        if self.pixel_bits == 8 { (value & 0xFF).cast_signed() } else { sign_extended(value, self.pixel_bits) }
    }
}

fn sign_extended(value: u32, bits: u32) -> i32 {
    (value << (u32::BITS - bits)).cast_signed() >> (u32::BITS - bits)
}

/// Returns the stored numbers of a tile; `None` when its code ends early.
pub(super) fn decode(code: &[u8], pixels: usize, coding: &Coding) -> Option<Vec<i32>> {
    if code.len().saturating_mul(8) < coding.least_bits(pixels) {
        return None;
    }
    let mut bits = Taken { code, at: 0 };
    let mut before = bits.take(coding.pixel_bits)?;
    let mut out = Vec::with_capacity(pixels);
    while out.len() < pixels {
        let choice = bits.take(coding.choice_bits)?;
        for _ in 0..coding.block_px.min(pixels - out.len()) {
            let folded = match choice.checked_sub(1) {
                None => 0,
                Some(low) if low >= coding.most_low_bits => bits.take(coding.pixel_bits)?,
                Some(low) => (bits.zeros()?.checked_shl(low)?) | bits.take(low)?,
            };
            let half = folded >> 1;
            before = before.wrapping_add(if folded & 1 == 1 { !half } else { half });
            out.push(coding.number(before));
        }
    }
    Some(out)
}

/// Bits on their way in, the highest one of each byte first.
struct Taken<'c> {
    code: &'c [u8],
    at: usize,
}

impl Taken<'_> {
    fn bit(&mut self) -> Option<u32> {
        let byte = self.code.get(self.at / 8)?;
        let bit = u32::from(byte >> (7 - self.at % 8)) & 1;
        self.at += 1;
        Some(bit)
    }

    fn take(&mut self, count: u32) -> Option<u32> {
        (0..count).try_fold(0, |number, _| Some((number << 1) | self.bit()?))
    }

    /// Returns the number of zeros before the next one, which is taken too.
    fn zeros(&mut self) -> Option<u32> {
        let mut count = 0;
        while self.bit()? == 0 {
            count += 1;
        }
        Some(count)
    }
}

/// Bits on their way out, the highest one first.
struct Bits<'o> {
    out: &'o mut Vec<u8>,
    waiting: u64,
    /// Bits in `waiting`, below 32 between calls.
    count: u32,
}

impl Bits<'_> {
    /// Adds the low `count` bits of a number; at most 32.
    #[inline(always)]
    fn push(&mut self, number: u64, count: u32) {
        self.waiting = (self.waiting << count) | number;
        self.count += count;
        if self.count >= 32 {
            self.count -= 32;
            #[allow(clippy::cast_possible_truncation, reason = "the 32 bits above those that wait")]
            let word = (self.waiting >> self.count) as u32;
            self.out.extend_from_slice(&word.to_be_bytes());
        }
    }

    fn push_zeros(&mut self, mut count: u32) {
        while count > 0 {
            let some = count.min(32);
            self.push(0, some);
            count -= some;
        }
    }

    /// Fills the last byte with zeros.
    fn finish(mut self) {
        self.push(0, (8 - self.count % 8) % 8);
        #[allow(clippy::cast_possible_truncation, reason = "at most four bytes wait")]
        for byte in (0..self.count / 8).rev() {
            self.out.push((self.waiting >> (8 * byte)) as u8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reads a code back: written from the description of the format, apart from the writer and the reader.
    fn read_back(code: &[u8], pixels: usize) -> Vec<u16> {
        let mut at = 0;
        let mut take = |count: usize| {
            let mut number = 0_u32;
            for place in at..at + count {
                number = (number << 1) | u32::from(code[place / 8] >> (7 - place % 8) & 1);
            }
            at += count;
            number
        };
        let mut before = take(16) as u16;
        let mut out = Vec::new();
        while out.len() < pixels {
            let choice = take(4);
            for _ in 0..(pixels - out.len()).min(32) {
                let difference = match choice {
                    0 => 0,
                    15 => take(16),
                    _ => {
                        let mut high = 0;
                        while take(1) == 0 {
                            high += 1;
                        }
                        (high << (choice - 1)) | take(choice as usize - 1)
                    }
                };
                let sign = if difference & 1 == 1 { !(difference >> 1) } else { difference >> 1 };
                before = before.wrapping_add(sign as u16);
                out.push(before ^ 0x8000);
            }
        }
        out
    }

    fn coded(pixels: &[u16]) -> Vec<u8> {
        let mut code = Vec::new();
        encode(pixels, &mut code);
        code
    }

    #[test]
    fn even_tiles_take_four_bits_a_block() {
        assert_eq!(coded(&[7; 64]).len(), 3, "16 bits of the first pixel, 4 of each block");
        assert_eq!(coded(&[]), [] as [u8; 0]);
    }

    #[test]
    fn noise_of_a_few_numbers_takes_a_few_bits() {
        let pixels: Vec<u16> = (0..4096_u32).map(|i| 100 + (i.wrapping_mul(2_654_435_761) >> 29) as u16).collect();
        let code = coded(&pixels);
        assert!(code.len() < 4096 * 5 / 8, "{} bytes", code.len());
        assert_eq!(read_back(&code, 4096), pixels);
        let mut damaged = code;
        damaged[100] ^= 1;
        assert_ne!(read_back(&damaged, 4096)[..200], pixels[..200], "control: another bit is another image");
    }

    proptest! {
        #[test]
        fn pixels_read_back(pixels in proptest::collection::vec(any::<u16>(), 1..200), shift in 0_u32..16) {
            let pixels: Vec<u16> = pixels.iter().map(|pixel| pixel >> shift).collect();
            let code = coded(&pixels);
            prop_assert!(code.len() <= most_bytes(pixels.len()));
            let coding = Coding::of(BLOCK_PX, PIXEL_BYTES).unwrap();
            let numbers = decode(&code, pixels.len(), &coding).unwrap();
            prop_assert_eq!(numbers, pixels.iter().map(|pixel| i32::from(*pixel) - 0x8000).collect::<Vec<_>>());
            prop_assert_eq!(decode(&code[..code.len() - 1], pixels.len() + 64, &coding), None, "cut short");
            prop_assert_eq!(read_back(&code, pixels.len()), pixels);
        }
    }
}
