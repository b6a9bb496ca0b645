//! The pixels of a band of rows, and adding vectors to them.

use crate::render::grid::LANES;
use base::fused::mul_add;

/// Rows of the image that one thread draws.
pub(super) struct Band<'a> {
    pub(super) pixels: &'a mut [f32],
    pub(super) width: usize,
    pub(super) first_row: i32,
}

impl Band<'_> {
    /// Returns rows in the band.
    #[inline(always)]
    pub(super) fn rows(&self) -> i32 {
        (self.pixels.len() / self.width) as i32
    }
}

/// Adds `gain * values` to `target`, through a copy: the compiler need not check whether the two overlap.
#[inline(always)]
pub(super) fn add_lanes<const FUSED: bool>(target: &mut [f32; LANES], values: &[f32; LANES], gain: f32) {
    let mut sum = *target;
    for lane in 0..LANES {
        sum[lane] = mul_add::<FUSED>(gain, values[lane], sum[lane]);
    }
    *target = sum;
}

/// Adds `gain * values[i]` to `line[first + i]` for the used lanes that lie on the line, through a whole vector: code
/// that reads `values` lane by lane makes the compiler take the loops that sum them up apart into single lanes.
#[inline(always)]
pub(super) fn add_clipped<const FUSED: bool>(
    line: &mut [f32],
    first: i32,
    used: usize,
    values: &[f32; LANES],
    gain: f32,
) {
    let (skipped, start) = ((-first).max(0) as usize, first.max(0) as usize);
    let used = used.min(LANES);
    if skipped >= used || start >= line.len() {
        return;
    }
    let pixels = &mut line[start..];
    let count = (used - skipped).min(pixels.len());
    let (pixels, lanes) = (&mut pixels[..count], skipped..skipped + count);
    let mut target = [0.0_f32; LANES];
    target[lanes.clone()].copy_from_slice(pixels);
    add_lanes::<FUSED>(&mut target, values, gain);
    pixels.copy_from_slice(&target[lanes]);
}
