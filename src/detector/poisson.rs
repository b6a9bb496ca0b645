//! Shot noise: mean electrons -> counted electrons.
//!
//! Below [`INVERSION_LIMIT`]: inversion of the distribution function by its recurrence, one 24-bit uniform. Above:
//! Cornish-Fisher on the normal quantile of the same word, `floor(m + s z + (z^2 - 1)/6 + (z - z^3)/(72 s) + 1/2)`
//! with `s = sqrt(m - 1/12)` (rounding adds 1/12 of variance). Source: Cornish and Fisher 1938; skewness `1/sqrt(m)`
//! and excess `1/m` of the Poisson law. Tails end where a 24-bit uniform ends (5.2 sigma). Mean, variance and
//! chi-square are held for means 0.1 to 1e5 by `tests/physics/noise.rs`.

use crate::base::fused::mul_add;
use crate::detector::block::BLOCK;
use crate::detector::elementary::{exp_negative, normal_quantile, open_unit, unit};

/// Mean from which Cornish-Fisher takes over (12 already fails a chi-square test; 20 passes).
pub const INVERSION_LIMIT: f32 = 20.0;
/// Steps between looks at whether all pixels are done.
const STEPS: usize = 4;
/// More steps than any mean below the limit needs (20 + 6 sqrt 20 = 47).
const MOST_STEPS: usize = 64;

/// Draws all pixels of a block.
#[inline(always)]
pub fn draw<const FUSED: bool>(mean_e: &mut [f32; BLOCK], words: &[u32; BLOCK]) {
    let (mut least, mut most) = (f32::MAX, 0.0_f32);
    for mean in mean_e.iter_mut() {
        *mean = mean.max(0.0);
        least = least.min(*mean);
        most = most.max(*mean);
    }
    if most < INVERSION_LIMIT {
        invert::<FUSED>(mean_e, words);
    } else if least >= INVERSION_LIMIT {
        cornish_fisher::<FUSED>(mean_e, words);
    } else {
        let mut faint = *mean_e;
        let bright: [bool; BLOCK] = core::array::from_fn(|i| mean_e[i] >= INVERSION_LIMIT);
        for mean in &mut faint {
            *mean = mean.min(INVERSION_LIMIT);
        }
        invert::<FUSED>(&mut faint, words);
        cornish_fisher::<FUSED>(mean_e, words);
        for i in 0..BLOCK {
            mean_e[i] = if bright[i] { mean_e[i] } else { faint[i] };
        }
    }
}

#[inline(always)]
fn invert<const FUSED: bool>(mean_e: &mut [f32; BLOCK], words: &[u32; BLOCK]) {
    let mut u = [0.0_f32; BLOCK];
    let mut term = [0.0_f32; BLOCK];
    let mut sum = [0.0_f32; BLOCK];
    let mut before = [0.0_f32; BLOCK];
    let mut count = [0.0_f32; BLOCK];
    for i in 0..BLOCK {
        u[i] = unit(words[i]);
        term[i] = exp_negative::<FUSED>(mean_e[i]);
        sum[i] = term[i];
    }
    let mut step = 0;
    while step < MOST_STEPS {
        for _ in 0..STEPS {
            step += 1;
            let reciprocal = 1.0 / step as f32;
            for i in 0..BLOCK {
                // A sum that no longer grows has ended: the uniform lies beyond what f32 can tell from 1.
                let on = u[i] >= sum[i] && sum[i] > before[i];
                count[i] += if on { 1.0 } else { 0.0 };
                before[i] = sum[i];
                term[i] *= mean_e[i] * reciprocal;
                sum[i] += term[i];
            }
        }
        let mut left = 0_u32;
        for i in 0..BLOCK {
            left |= u32::from(u[i] >= sum[i] && sum[i] > before[i]);
        }
        if left == 0 {
            break;
        }
    }
    *mean_e = count;
}

#[inline(always)]
fn cornish_fisher<const FUSED: bool>(mean_e: &mut [f32; BLOCK], words: &[u32; BLOCK]) {
    for i in 0..BLOCK {
        let mean = mean_e[i].max(1.0);
        let z = normal_quantile::<FUSED>(open_unit(words[i]));
        let s = (mean - 1.0 / 12.0).sqrt();
        let skew = (z * z - 1.0) * (1.0 / 6.0);
        let tail = (z - z * z * z) / (72.0 * s);
        let x = mul_add::<FUSED>(s, z, mean) + skew + tail + 0.5;
        mean_e[i] = x.floor().max(0.0);
    }
}
