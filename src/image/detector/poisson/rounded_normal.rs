//! Rounded normal: mean electrons and the normal quantile `z` of a 23-bit uniform -> `floor(m + sqrt(m) z + 1/2)`.
//!
//! Many simulators use this method. Poisson's law is skewed and this is not: by the expansion of Cornish and Fisher the
//! count is off by `(z^2 - 1)/6` electrons, a sixth in the centre, and the distribution function by that times its
//! density. Domain: means from 1000, where the bound falls below its promise, to 1e6; negative counts become 0. Tests:
//! below and `tests/physics/poisson_methods.rs`.

use crate::detector::block::GROUP;
use crate::detector::elementary::{normal_quantile, open_unit};
use crate::detector::poisson::cornish_fisher::{HALF_UNIT, NORMAL_PEAK, QUANTILE_SIGMA, QUANTILE_WORD};
use base::fused::mul_add;

/// Largest of `|z^2 - 1|/6 phi(z)`, at `z = 0`: the skewness that is left out.
const SKEWNESS: f64 = NORMAL_PEAK / 6.0;
/// Smallest mean of the domain: there the bound falls below its promise.
pub const LEAST_MEAN: f32 = 1000.0;
/// Largest of the terms in 1/mean: `|z/36 + z^3/72| phi(z)` (0.011) and the square of the first (0.004).
const NEXT_TERM: f64 = 0.015;
/// Sums at the size of the mean, each rounded.
const ROUNDINGS: f64 = 2.0;

/// Draws the counts of a group.
#[inline(always)]
pub fn rounded_normal<const FUSED: bool>(means: &[f32; GROUP], words: &[u32; GROUP]) -> [f32; GROUP] {
    let mut out = [0.0_f32; GROUP];
    for i in 0..GROUP {
        out[i] = count::<FUSED>(means[i], words[i]);
    }
    out
}

/// Returns the count of one pixel.
#[inline(always)]
pub fn count<const FUSED: bool>(mean: f32, word: u32) -> f32 {
    let z = normal_quantile::<FUSED>(open_unit(word));
    let x = (mul_add::<FUSED>(mean.sqrt(), z, mean) + 0.5).floor();
    if x > 0.0 { x } else { 0.0 }
}

/// Returns the bound on the Kolmogorov distance: skewness, the next term, the word, the quantile, two roundings.
pub fn error_bound(lambda: f64) -> f64 {
    if lambda < 1.0 {
        return 1.0;
    }
    let rounding = ROUNDINGS * HALF_UNIT * NORMAL_PEAK * lambda.sqrt();
    SKEWNESS / lambda.sqrt() + NEXT_TERM / lambda + rounding + QUANTILE_WORD + QUANTILE_SIGMA * NORMAL_PEAK
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centre_is_the_mean_and_a_sigma_is_its_root() {
        // Words of the standard normal law's quantiles at 0, 1 and -3 sigma.
        for (word, sigmas) in [(1_u32 << 31, 0.0_f32), (3_613_548_169, 1.0), (5_797_768, -3.0)] {
            let count = count::<false>(10_000.0, word);
            assert!((count - 10_000.0 - 100.0 * sigmas).abs() < 0.5, "{sigmas} sigma: {count}");
            assert!((count - 10_010.0 - 100.0 * sigmas).abs() > 0.5, "a tenth of a sigma is seen");
        }
        assert_eq!(count::<false>(1.0, 0), 0.0, "no negative counts");
    }
}
