//! Damages a finished frame's pixels on purpose: blank, repeated, torn, flipped bits.

use crate::runtime::conditions::FAULT_STREAM;
use base::random::{key, philox};
use frames::sink::{FaultPixels, SentFrame};

/// Sets every pixel that is read out to the black level, and removes all sources from the truth.
pub(super) fn blank(frame: &mut SentFrame) {
    let black = frame.meta.black_level_dn.round().clamp(0.0, f64::from(u16::MAX));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    frame.image.pixels_mut().fill(black as u16);
    frame.meta.regions.clear_outside(&mut frame.image);
    frame.truth.clear();
    frame.targets.clear();
}

/// Amount of the previous image that a frame shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Repeated {
    Nothing,
    UpperHalf,
    All,
}

/// Copies all or half of the previous image into the frame, and keeps the frame's own image for the next one.
pub(super) fn repeat(repeated: Repeated, frame: &mut SentFrame, previous: &mut Vec<u16>) {
    let pixels = frame.image.pixels_mut();
    if previous.len() != pixels.len() {
        previous.clear();
        previous.extend_from_slice(pixels);
        return;
    }
    let count = match repeated {
        Repeated::All => pixels.len(),
        Repeated::UpperHalf => pixels.len() / 2,
        Repeated::Nothing => 0,
    };
    pixels[..count].swap_with_slice(&mut previous[..count]);
    if repeated != Repeated::All {
        previous[count..].copy_from_slice(&pixels[count..]);
    }
}

/// Flips one bit of some pixels; random pixels are new in every frame.
pub(super) fn flip(bit: u8, pixels: FaultPixels, stream: u32, frame: &mut SentFrame) {
    let (number, seed) = (frame.meta.number, frame.meta.seed);
    let (width, height) = (frame.image.width(), frame.image.height());
    let mask = 1_u16.checked_shl(u32::from(bit)).unwrap_or(0);
    let given = pixels.at.map(|[x, y]| [x as usize, y as usize]);
    let random = (0..pixels.random).map(|i| {
        let [a, b, ..] = philox([number, i, stream, FAULT_STREAM], key(seed));
        [scaled(a, width), scaled(b, height)]
    });
    let out = frame.image.pixels_mut();
    for [x, y] in given.into_iter().chain(random).filter(|[x, y]| *x < width && *y < height) {
        out[y * width + x] ^= mask;
    }
    frame.meta.regions.clear_outside(&mut frame.image);
}

/// Returns a random whole number below `below`.
#[allow(clippy::cast_possible_truncation, reason = "the high half of a product is below `below`")]
pub(super) fn scaled(word: u32, below: usize) -> usize {
    ((u64::from(word) * below as u64) >> 32) as usize
}
