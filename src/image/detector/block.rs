//! A block of consecutive pixels and its random words, on which one pass of every stage works.

use base::random::{Stage, counter, philox};

/// Pixels of a block: small enough for the first-level cache, long enough for any vector.
pub const BLOCK: usize = 256;
/// Philox blocks that serve it: one for two pixels.
pub const PAIRS: usize = BLOCK / 2;

/// Random words of a block, by pair of pixels: two for read noise, one per pixel for shot noise.
#[derive(Debug, Clone)]
pub struct Words {
    /// First word of the pair's read noise.
    pub read_a: [u32; PAIRS],
    /// Second word of the pair's read noise.
    pub read_b: [u32; PAIRS],
    /// Shot noise word of every pixel.
    pub shot: [u32; BLOCK],
}

impl Words {
    /// Returns a block without random words.
    #[must_use]
    pub fn new() -> Self {
        Self { read_a: [0; PAIRS], read_b: [0; PAIRS], shot: [0; BLOCK] }
    }

    /// Words of the pixels from `first_pixel` (even) of `frame`.
    #[inline(always)]
    pub fn draw(&mut self, first_pixel: u32, frame: u32, key: [u32; 2]) {
        let first_pair = first_pixel / 2;
        let mut even = [0_u32; PAIRS];
        let mut odd = [0_u32; PAIRS];
        for i in 0..PAIRS {
            let [a, b, c, d] = philox(counter(frame, first_pair + i as u32, Stage::Temporal), key);
            self.read_a[i] = a;
            self.read_b[i] = b;
            even[i] = c;
            odd[i] = d;
        }
        for (pair, (c, d)) in self.shot.chunks_exact_mut(2).zip(even.iter().zip(&odd)) {
            pair[0] = *c;
            pair[1] = *d;
        }
    }
}

impl Default for Words {
    fn default() -> Self {
        Self::new()
    }
}
