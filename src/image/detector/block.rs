//! A block of consecutive pixels and its random words, on which one pass of every stage works.

use base::random::{Stage, counter, philox_wide};

/// Pixels of a block: small enough for the first-level cache, long enough for any vector.
pub const BLOCK: usize = 256;
/// Pixels of a block whose shot noise is drawn together: few enough to stay in registers, and one bright star slows down
/// only its own group.
pub const GROUP: usize = 32;
/// Philox blocks that serve it: one for two pixels.
pub const PAIRS: usize = BLOCK / 2;

/// Random words of a block, by pair of pixels: two for read noise, one per pixel for shot noise.
#[derive(Debug, Clone)]
pub struct Words {
    /// First word of the pair's read noise.
    pub read_a: [u32; PAIRS],
    /// Second word of the pair's read noise.
    pub read_b: [u32; PAIRS],
    /// Shot noise words, of both pixels in one number: the first in the low half.
    shot: [u64; PAIRS],
}

impl Words {
    /// Returns a block without random words.
    pub fn new() -> Self {
        Self { read_a: [0; PAIRS], read_b: [0; PAIRS], shot: [0; PAIRS] }
    }

    /// Words of the pixels from `first_pixel` (even) of `frame`.
    #[inline(always)]
    pub fn draw(&mut self, first_pixel: u32, frame: u32, key: [u32; 2]) {
        let first_pair = first_pixel / 2;
        for i in 0..PAIRS {
            // Wrapping: a check for overflow would keep the loop from being compiled to vectors.
            let pair = first_pair.wrapping_add(i as u32);
            let [a, b, c, d] = philox_wide(counter(frame, pair, Stage::Temporal), key);
            self.read_a[i] = a as u32;
            self.read_b[i] = b as u32;
            self.shot[i] = (c & 0xffff_ffff) | (d << 32);
        }
        if cfg!(target_endian = "big") {
            self.shot.iter_mut().for_each(|both| *both = both.rotate_left(32));
        }
    }

    /// Returns the shot noise word of every pixel.
    #[inline(always)]
    pub fn shot(&self) -> &[u32; BLOCK] {
        bytemuck::cast_ref(&self.shot)
    }
}

impl Default for Words {
    fn default() -> Self {
        Self::new()
    }
}
