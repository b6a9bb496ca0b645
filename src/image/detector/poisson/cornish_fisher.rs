//! Cornish-Fisher: mean electrons and the normal quantile `z` of a 23-bit uniform ->
//! `floor(m + s z + (z^2 - 1)/6 + (z - z^3)/(72 s) + 1/2)`, `s = sqrt(m - 1/12)` (rounding adds 1/12 of variance).
//!
//! Source: Cornish and Fisher 1938; skewness `1/sqrt(m)` and excess `1/m` of Poisson's law. In powers of `sqrt(m)` the
//! formula is that of Giles, "Algorithm 955: approximation of the inverse Poisson cumulative distribution function"
//! (ACM TOMS 42, 2016), up to the power -1/2; his next term, which is left out, gives the error bound.
//! Domain: means from 20, where the bound falls below its promise, to 1e6, where rounding in f32 takes it up again.
//! The tails end at 5.2 sigma. Tests: below, `tests/physics/poisson_methods.rs`, `tests/physics/noise.rs`.

use crate::detector::block::GROUP;
use crate::detector::elementary::{normal_quantile, open_unit};
use base::fused::mul_add;

/// Largest of `|-8/405 + 7 z^2/810 + z^4/270| phi(z)`, at `z = 0`: Giles's next term, electrons times mean, met by the
/// density of the count.
const NEXT_TERM: f64 = 8.0 / 405.0 * NORMAL_PEAK;
/// The next term with all after it: measured 1.02 times the next alone at mean 20, 1.08 at [`LEAST_BOUNDED`].
const LATER_TERMS: f64 = 1.1;
/// Smallest mean for which the bound holds.
const LEAST_BOUNDED: f64 = 5.0;
/// Density of the normal law at its centre.
pub(crate) const NORMAL_PEAK: f64 = 0.398_942_280_401_432_7;
/// Error of `normal_quantile`, sigma, by its own test.
pub(crate) const QUANTILE_SIGMA: f64 = 2e-6;
/// One 23-bit uniform.
pub(crate) const QUANTILE_WORD: f64 = 1.0 / 8_388_608.0;
/// Largest relative error of one f32 rounding.
pub(crate) const HALF_UNIT: f64 = 1.0 / 16_777_216.0;
/// Sums at the size of the mean, each rounded.
const ROUNDINGS: f64 = 4.0;

/// Draws the counts of a group; means below 1 are drawn as 1.
#[inline(always)]
pub fn cornish_fisher<const FUSED: bool>(means: &[f32; GROUP], words: &[u32; GROUP]) -> [f32; GROUP] {
    let mut out = [0.0_f32; GROUP];
    for i in 0..GROUP {
        out[i] = count::<FUSED>(means[i], words[i]);
    }
    out
}

/// Returns the count of one pixel; a mean below 1 is drawn as 1.
#[inline(always)]
pub fn count<const FUSED: bool>(mean: f32, word: u32) -> f32 {
    let mean = if mean > 1.0 { mean } else { 1.0 };
    let z = normal_quantile::<FUSED>(open_unit(word));
    let s = (mean - 1.0 / 12.0).sqrt();
    let skew = (z * z - 1.0) * (1.0 / 6.0);
    let tail = (z - z * z * z) / (72.0 * s);
    let x = (mul_add::<FUSED>(s, z, mean) + skew + tail + 0.5).floor();
    if x > 0.0 { x } else { 0.0 }
}

/// Returns the bound on the Kolmogorov distance: the next term of the expansion, the word, the quantile, and four
/// roundings at the size of the mean. Below mean 5 nothing is known.
pub fn error_bound(lambda: f64) -> f64 {
    if lambda < LEAST_BOUNDED {
        return 1.0;
    }
    let left_out = LATER_TERMS * NEXT_TERM / (lambda * lambda.sqrt());
    let rounding = ROUNDINGS * HALF_UNIT * NORMAL_PEAK * lambda.sqrt();
    left_out + rounding + QUANTILE_WORD + QUANTILE_SIGMA * NORMAL_PEAK
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_tails_are_those_of_poissons_law() {
        // Quantiles of Poisson's law at 1/2 and at 0.999, from its distribution function.
        for (mean, median, high) in [(20.0_f32, 20.0_f32, 35.0_f32), (100.0, 100.0, 132.0), (1000.0, 1000.0, 1099.0)] {
            assert_eq!(count::<false>(mean, 1 << 31), median, "median at {mean}");
            assert_eq!(count::<false>(mean, 4_290_672_329), high, "0.999 at {mean}");
            assert_ne!(count::<false>(1.1 * mean, 1 << 31), median, "a tenth of the mean is seen");
        }
    }

    #[test]
    fn the_next_term_is_largest_in_the_centre() {
        let term = |z: f64| (-8.0 / 405.0 + 7.0 * z * z / 810.0 + z.powi(4) / 270.0).abs();
        let density = |z: f64| (-0.5 * z * z).exp() * NORMAL_PEAK;
        let most = (0..600).map(|i| f64::from(i) * 0.01).map(|z| term(z) * density(z)).fold(0.0, f64::max);
        assert!((most - NEXT_TERM).abs() < 1e-12, "{most}");
    }
}
