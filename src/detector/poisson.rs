//! Shot noise: mean electrons -> counted electrons.
//!
//! Below [`INVERSION_LIMIT`]: inversion of the distribution function by its recurrence, one 24-bit uniform. Above:
//! Cornish-Fisher on the normal quantile of the same word, `floor(m + s z + (z^2 - 1)/6 + (z - z^3)/(72 s) + 1/2)`
//! with `s = sqrt(m - 1/12)` (rounding adds 1/12 of variance). Source: Cornish and Fisher 1938; skewness `1/sqrt(m)`
//! and excess `1/m` of the Poisson law. Tails end at 4.8 sigma (inversion) and 5.2 sigma. Mean, variance and
//! chi-square are held for means 0.1 to 1e5 by `tests/physics/noise.rs`.

use crate::base::fused::mul_add;
use crate::detector::block::BLOCK;
use crate::detector::elementary::{exp_negative, normal_quantile, open_unit, unit};

/// Mean from which Cornish-Fisher takes over (12 already fails a chi-square test; 20 passes).
pub const INVERSION_LIMIT: f32 = 20.0;
/// Steps between looks at whether all pixels are done.
const STEPS: usize = 4;
/// More steps than any mean below the limit needs (20 + 6 sqrt 20 = 47).
const MOST_STEPS: f32 = 64.0;

/// Pixels drawn together: few enough to stay in registers, and one bright star slows down only its own group.
const GROUP: usize = 32;
/// Uniforms end here: f32 sums of the distribution reach this in any order of rounding (50 steps of 2^-25).
const LARGEST_UNIFORM: f32 = 1.0 - 1.0 / 1_048_576.0;

/// Draws all pixels of a block: mean electrons in, counted electrons out.
#[inline(always)]
pub fn draw<const FUSED: bool>(electrons: &mut [f32; BLOCK], words: &[u32; BLOCK]) {
    let (groups, _) = electrons.as_chunks_mut::<GROUP>();
    let (words, _) = words.as_chunks::<GROUP>();
    for (group, words) in groups.iter_mut().zip(words) {
        draw_group::<FUSED>(group, words);
    }
}

#[inline(always)]
fn draw_group<const FUSED: bool>(electrons: &mut [f32; GROUP], words: &[u32; GROUP]) {
    // Bits of non-negative floats sort like the floats, and integer reductions vectorise.
    let (mut least, mut most) = (u32::MAX, 0_u32);
    for mean in electrons.iter_mut() {
        *mean = if *mean > 0.0 { *mean } else { 0.0 };
        least = least.min(mean.to_bits());
        most = most.max(mean.to_bits());
    }
    let limit = INVERSION_LIMIT.to_bits();
    let mean = *electrons;
    if least < limit {
        invert::<FUSED>(electrons, words);
    }
    if most >= limit {
        let bright = cornish_fisher::<FUSED>(&mean, words);
        for i in 0..GROUP {
            electrons[i] = if mean[i] >= INVERSION_LIMIT { bright[i] } else { electrons[i] };
        }
    }
}

/// Inversion of the distribution function; means at or above the limit are drawn as the limit.
#[inline(always)]
fn invert<const FUSED: bool>(electrons: &mut [f32; GROUP], words: &[u32; GROUP]) {
    let mut mean = [0.0_f32; GROUP];
    let mut u = [0.0_f32; GROUP];
    let mut term = [0.0_f32; GROUP];
    for i in 0..GROUP {
        let uniform = unit(words[i]);
        u[i] = if uniform < LARGEST_UNIFORM { uniform } else { LARGEST_UNIFORM };
        mean[i] = if electrons[i] < INVERSION_LIMIT { electrons[i] } else { INVERSION_LIMIT };
        term[i] = exp_negative::<FUSED>(mean[i]);
    }
    let mut sum = term;
    let mut count = [0.0_f32; GROUP];
    let mut step = 0.0_f32;
    while step < MOST_STEPS {
        for _ in 0..STEPS {
            step += 1.0;
            let reciprocal = 1.0 / step;
            for i in 0..GROUP {
                count[i] += if u[i] >= sum[i] { 1.0 } else { 0.0 };
                term[i] *= mean[i] * reciprocal;
                sum[i] += term[i];
            }
        }
        let mut left = 0_u32;
        for i in 0..GROUP {
            left |= u32::from(u[i] >= sum[i]);
        }
        if left == 0 {
            break;
        }
    }
    *electrons = count;
}

#[inline(always)]
fn cornish_fisher<const FUSED: bool>(means: &[f32; GROUP], words: &[u32; GROUP]) -> [f32; GROUP] {
    let mut out = [0.0_f32; GROUP];
    for i in 0..GROUP {
        let mean = if means[i] > 1.0 { means[i] } else { 1.0 };
        let z = normal_quantile::<FUSED>(open_unit(words[i]));
        let s = (mean - 1.0 / 12.0).sqrt();
        let skew = (z * z - 1.0) * (1.0 / 6.0);
        let tail = (z - z * z * z) / (72.0 * s);
        let x = (mul_add::<FUSED>(s, z, mean) + skew + tail + 0.5).floor();
        out[i] = if x > 0.0 { x } else { 0.0 };
    }
    out
}
