//! Inversion: mean electrons and one 24-bit uniform -> the count at which the distribution function passes it.
//!
//! The function is summed term by term, `p(k) = p(k - 1) mean / k` from `p(0) = exp(-mean)`, in single precision.
//! Domain: 0 to [`INVERSION_LIMIT`], beyond which the steps cost more than Cornish-Fisher (and from 87 on `exp(-mean)`
//! is a subnormal f32). The tail ends at 4.8 sigma. Tests: below, `tests/physics/poisson_methods.rs` and
//! `tests/physics/noise.rs`.

use crate::detector::block::GROUP;
use crate::detector::elementary::{exp_negative, unit};

/// Mean from which Cornish-Fisher takes over (12 already fails a chi-square test; 20 passes).
pub const INVERSION_LIMIT: f32 = 20.0;
/// Steps between looks at whether all pixels are done.
const STEPS: usize = 4;
/// More steps than any mean below the limit needs (20 + 6 sqrt 20 = 47).
const MOST_STEPS: usize = 64;
/// Uniforms end here: f32 sums of the distribution reach this in any order of rounding (50 steps of 2^-25).
const LARGEST_UNIFORM: f32 = 1.0 - 1.0 / 1_048_576.0;
/// Share of the tail that [`LARGEST_UNIFORM`] cuts off.
const TAIL: f64 = 1.0 / 1_048_576.0;
/// Means below this (2^-25) are drawn as 0: `exp(-mean)` is 1 in f32, so that no uniform reaches it. Powers of smaller
/// means would be denormal numbers, which are slow.
const LEAST_MEAN: f32 = 1.0 / 33_554_432.0;
/// A term below this (2^-53) is the last: half a unit of any sum, which begins at `exp(-20)` = 2^-28.9 and more, is
/// larger, and the terms after it are smaller. Four steps from here cannot reach a denormal number.
const LEAST_TERM: f32 = 1.0 / 9_007_199_254_740_992.0;
/// Reciprocals of the steps from 1 on.
const RECIPROCALS: [f32; MOST_STEPS] = {
    let mut all = [0.0; MOST_STEPS];
    let mut i = 0;
    while i < MOST_STEPS {
        all[i] = 1.0 / (i + 1) as f32;
        i += 1;
    }
    all
};
/// Relative error of `exp_negative`, by its own test.
const EXP_REL: f64 = 4e-7;

/// Draws the counts of a group; a mean above the limit is drawn as no light: another method draws its pixel, which then adds
/// no steps to the group.
#[inline(always)]
pub fn invert<const FUSED: bool>(electrons: &mut [f32; GROUP], words: &[u32; GROUP]) {
    let mut mean = [0.0_f32; GROUP];
    let mut u = [0.0_f32; GROUP];
    let mut term = [0.0_f32; GROUP];
    for i in 0..GROUP {
        let uniform = unit(words[i]);
        u[i] = if uniform < LARGEST_UNIFORM { uniform } else { LARGEST_UNIFORM };
        let own = if electrons[i] <= INVERSION_LIMIT { electrons[i] } else { 0.0 };
        mean[i] = not_below(own, LEAST_MEAN);
        term[i] = exp_negative::<FUSED>(mean[i]);
    }
    let mut sum = term;
    let mut count = [0.0_f32; GROUP];
    for reciprocals in RECIPROCALS.as_chunks::<STEPS>().0 {
        for reciprocal in reciprocals {
            for i in 0..GROUP {
                count[i] += if u[i] >= sum[i] { 1.0 } else { 0.0 };
                term[i] *= mean[i] * reciprocal;
                sum[i] += term[i];
            }
        }
        let mut left = 0_u32;
        for i in 0..GROUP {
            left |= u32::from(u[i] >= sum[i]);
            term[i] = not_below(term[i], LEAST_TERM);
        }
        if left == 0 {
            break;
        }
    }
    *electrons = count;
}

/// Returns `x`, or 0 where it is below `least`.
#[inline(always)]
fn not_below(x: f32, least: f32) -> f32 {
    if x >= least { x } else { 0.0 }
}

/// Returns the bound on the Kolmogorov distance: one word, the cut tail, the rounding of `exp`, three roundings of
/// every term (`sum of k p(k) = mean`), half a unit of every sum up to 6 sigma. Beyond the limit nothing is promised.
pub fn error_bound(lambda: f64) -> f64 {
    const WORD: f64 = 1.0 / 16_777_216.0;
    if lambda > f64::from(INVERSION_LIMIT) {
        return 1.0;
    }
    let steps = lambda + 6.0 * lambda.sqrt() + 6.0;
    WORD + TAIL + EXP_REL + 3.0 * lambda * WORD + 0.5 * steps * WORD
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share_of_zero(lambda: f32) -> f64 {
        let words: Vec<u32> = (0..1 << 16).map(|i: u32| i << 16).collect();
        let (groups, _) = words.as_chunks::<GROUP>();
        let zeros = groups.iter().map(|words| {
            let mut counts = [lambda; GROUP];
            invert::<false>(&mut counts, words);
            counts.iter().filter(|k| **k < 0.5).count()
        });
        zeros.sum::<usize>() as f64 / 65_536.0
    }

    #[test]
    fn no_count_comes_with_probability_exp_of_minus_the_mean() {
        for lambda in [0.1_f32, 1.0, 3.0, 5.0] {
            let wanted = (-f64::from(lambda)).exp();
            let got = share_of_zero(lambda);
            assert!((got - wanted).abs() < 2.0 / 65_536.0, "mean {lambda}: {got}, wanted {wanted}");
            assert!((share_of_zero(lambda * 1.01) - wanted).abs() > 2.0 / 65_536.0, "1 % of mean {lambda} is seen");
        }
    }

    /// Returns whether all products of [`invert`] are 0 or normal numbers, with these limits.
    fn is_free_of_denormals(mean: f32, least_mean: f32, least_term: f32) -> bool {
        let is_fast = |x: f32| x == 0.0 || x.is_normal();
        let mean = not_below(mean, least_mean);
        let mut term = exp_negative::<true>(mean);
        RECIPROCALS.as_chunks::<STEPS>().0.iter().all(|reciprocals| {
            let fast = reciprocals.iter().all(|reciprocal| {
                let factor = mean * reciprocal;
                term *= factor;
                is_fast(factor) && is_fast(term)
            });
            term = not_below(term, least_term);
            fast
        })
    }

    #[test]
    fn no_mean_leads_to_denormal_numbers() {
        let means =
            || (0..=4700).map(|i| 20.0_f32 * 10.0_f32.powf(i as f32 * -0.01)).chain([0.0, 1e-40, f32::from_bits(1)]);
        assert!(means().all(|mean| is_free_of_denormals(mean, LEAST_MEAN, LEAST_TERM)));
        // Negative controls: each limit is needed.
        assert!(!means().all(|mean| is_free_of_denormals(mean, 0.0, LEAST_TERM)));
        assert!(!means().all(|mean| is_free_of_denormals(mean, LEAST_MEAN, 0.0)));
    }

    #[test]
    fn the_limits_change_no_count() {
        // Below the least mean no word reaches a count; at four times as much the largest uniform is still below 1.
        assert!(exp_negative::<true>(LEAST_MEAN) >= 1.0 && exp_negative::<false>(LEAST_MEAN) >= 1.0);
        assert!(exp_negative::<true>(4.0 * LEAST_MEAN) < 1.0, "control");
        // Half a unit of the smallest sum is above the least term.
        let sum = exp_negative::<true>(INVERSION_LIMIT);
        assert!(sum + LEAST_TERM * 0.999 <= sum && sum + 4.0 * LEAST_TERM > sum);
    }

    #[test]
    fn a_mean_above_the_limit_is_drawn_as_no_light() {
        let words = core::array::from_fn(|i| (i as u32) << 27);
        let drawn = |mean: f32| {
            let mut counts = [mean; GROUP];
            invert::<false>(&mut counts, &words);
            counts
        };
        assert_eq!(drawn(90.0), [0.0; GROUP]);
        assert!(drawn(INVERSION_LIMIT).iter().sum::<f32>() > 19.0 * GROUP as f32, "the limit itself is drawn");
        assert!(error_bound(20.0) < 1e-5 && error_bound(20.1) >= 1.0);
    }
}
