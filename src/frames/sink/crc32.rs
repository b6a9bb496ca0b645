//! CRC-32 (the IEEE 802.3 polynomial, as in zlib, PNG and Ethernet) of pixels, to compare runs bit by bit.
//!
//! The pixels are taken as little-endian 16-bit words, row by row from the top, so that a script can repeat it with
//! any zlib: `zlib.crc32(pixels.astype('<u2').tobytes())`.

use base::image::DnImage;
use crc32fast::Hasher;

/// A CRC-32 under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Crc32 {
    value: u32,
}

impl Crc32 {
    /// Takes in more bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        let mut hasher = Hasher::new_with_initial(self.value);
        hasher.update(bytes);
        self.value = hasher.finalize();
    }

    /// Takes in more 16-bit words, low byte first.
    pub fn update_words(&mut self, words: &[u16]) {
        if cfg!(target_endian = "little") {
            self.update(bytemuck::cast_slice(words));
        } else {
            words.iter().for_each(|word| self.update(&word.to_le_bytes()));
        }
    }

    /// Returns the checksum of everything taken in so far.
    pub fn value(self) -> u32 {
        self.value
    }
}

/// Returns the CRC-32 of an image's pixels.
pub fn pixel_crc32(image: &DnImage) -> u32 {
    let mut crc = Crc32::default();
    crc.update_words(image.pixels());
    crc.value()
}

/// The checksum of a run: the number and pixel checksum of each frame in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RunCrc32(Crc32);

impl RunCrc32 {
    /// Takes in the next frame.
    pub fn add(&mut self, frame_number: u32, pixel_crc32: u32) {
        self.0.update(&frame_number.to_le_bytes());
        self.0.update(&pixel_crc32.to_le_bytes());
    }

    /// Returns the checksum of the frames so far.
    pub fn value(self) -> u32 {
        self.0.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_check_value() {
        let mut crc = Crc32::default();
        crc.update(b"123456789");
        assert_eq!(crc.value(), 0xCBF4_3926, "CRC-32/ISO-HDLC check value");
    }

    #[test]
    fn words_equal_their_bytes_at_every_length() {
        for count in 0..40_u16 {
            let words: Vec<u16> = (0..count).map(|i| i.wrapping_mul(40_503) ^ 0x5A5A).collect();
            let (mut by_word, mut by_byte) = (Crc32::default(), Crc32::default());
            by_word.update_words(&words);
            words.iter().for_each(|w| by_byte.update(&w.to_le_bytes()));
            assert_eq!(by_word, by_byte, "{count} words");
        }
    }

    #[test]
    fn one_bit_of_one_pixel_changes_the_frame_and_the_run() {
        let a = DnImage::new(33, 17);
        let mut b = a.clone();
        b.pixels_mut()[400] ^= 1;
        assert_ne!(pixel_crc32(&a), pixel_crc32(&b));
        let (mut run_a, mut run_b) = (RunCrc32::default(), RunCrc32::default());
        run_a.add(1, pixel_crc32(&a));
        run_b.add(1, pixel_crc32(&b));
        assert_ne!(run_a.value(), run_b.value());
    }
}
