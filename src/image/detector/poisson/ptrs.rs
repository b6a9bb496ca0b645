//! PTRS, transformed rejection with squeeze: mean electrons and pairs of 23-bit uniforms -> a count, after 1.33
//! pairs on average at mean 10 and 1.13 at large means (`1/alpha`, the area of the hat).
//!
//! Source: Hörmann, "The transformed rejection method for generating Poisson random variables", Insurance: Mathematics
//! and Economics 12 (1993), algorithm PTRS, for means from 10. The acceptance test is in saddle-point form (Loader,
//! "Fast and accurate computation of binomial probabilities", 2000): `ln p(k) = -ln(2 pi k)/2 - stirling_error(k) -
//! deviance(k, m)`, whose terms are of order 1 wherever `k` is likely. `Differs:` the textbook's `k ln m - m -
//! lgamma(k + 1)` is a difference of numbers near 1.4e7 at mean 1e6, where a unit of f32 is 1: its error of half a unit in the
//! logarithm is a factor of 1.6 in probability, as a test below shows.
//!
//! Candidates are floored before the whole part of the mean is added, so that no digit of them is lost. Every pixel has
//! words of its own, counted by attempt: (pixel, frame, [`Stage::Overflow`], block), two pairs a block. Domain: means
//! from 10 (Hörmann's hat) to 1e6. Tests: below and `tests/physics/poisson_methods.rs`.

use crate::detector::elementary::{ln, open_unit};
use base::random::{Stage, attempt_counter, philox};

/// Smallest mean for which Hörmann's hat lies above the law.
pub const LEAST_MEAN: f32 = 10.0;
/// Blocks of words one pixel may use: with two pairs each and at least 0.75 accepted, 1e-19 of the pixels need more
/// (and get the mean).
const MOST_BLOCKS: u32 = 16;
/// Relative error of the acceptance, averaged over the law: logarithm 3e-7, deviance and quotients 30 roundings at
/// most.
const ACCEPTANCE_REL: f64 = 3e-7 + 30.0 / 16_777_216.0;
/// Stirling's series, cut: at most 2.9e-4 at 1 and 3.5e-6 at 2, whose probabilities at mean 10 are 4.5e-4 and 2.3e-3.
const SERIES: f64 = 1.4e-7;
/// One 23-bit uniform, met by a density of 1.33 at most: `alpha p(k)` lies below the hat, whose height is 1.
const WORD: f64 = 1.33 / 8_388_608.0;
const TWO_PI: f32 = core::f32::consts::TAU;

/// Hörmann's table-mountain hat for one mean.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hat {
    pub(crate) mean: f32,
    whole: f32,
    part: f32,
    a: f32,
    b: f32,
    inverse_alpha: f32,
    always: f32,
}

impl Hat {
    #[inline(always)]
    pub(crate) fn new(mean: f32) -> Self {
        let b = 0.931 + 2.53 * mean.sqrt();
        let whole = mean.floor();
        Self {
            mean,
            whole,
            part: (mean - whole) + 0.43,
            a: -0.059 + 0.024_83 * b,
            b,
            inverse_alpha: 1.1239 + 1.1328 / (b - 3.4),
            always: 0.9277 - 3.6224 / (b - 2.0),
        }
    }

    /// Returns the candidate of a word and its distance from the nearer end of the uniform's range.
    #[inline(always)]
    pub(crate) fn candidate(&self, word: u32) -> (f32, f32) {
        let u = open_unit(word) - 0.5;
        let to_end = 0.5 - u.abs();
        (self.whole + ((2.0 * self.a / to_end + self.b) * u + self.part).floor(), to_end)
    }

    /// Returns true if a candidate is accepted; `is_below(k, mean, level)` says whether `level` is below the
    /// probability of `k`.
    #[inline(always)]
    pub(crate) fn takes(
        &self,
        (k, to_end): (f32, f32),
        word: u32,
        is_below: impl Fn(f32, f32, f32) -> bool + Copy,
    ) -> bool {
        let v = open_unit(word);
        if to_end >= 0.07 && v <= self.always {
            return true;
        }
        if k < 0.0 || (to_end < 0.013 && v > to_end) {
            return false;
        }
        is_below(k, self.mean, v * self.inverse_alpha / (self.a / (to_end * to_end) + self.b))
    }
}

/// Draws a count of mean `mean` (at least [`LEAST_MEAN`]) for one pixel of one frame.
#[inline(always)]
pub fn draw_one<const FUSED: bool>(mean: f32, pixel: u32, frame: u32, key: [u32; 2]) -> f32 {
    draw_one_with(mean, pixel, frame, key, saddle_point::<FUSED>)
}

#[inline(always)]
fn draw_one_with(
    mean: f32,
    pixel: u32,
    frame: u32,
    key: [u32; 2],
    is_below: impl Fn(f32, f32, f32) -> bool + Copy,
) -> f32 {
    let hat = Hat::new(mean);
    for block in 0..MOST_BLOCKS {
        let [a, b, c, d] = philox(attempt_counter(frame, pixel, Stage::Overflow, block), key);
        for (u, v) in [(a, b), (c, d)] {
            let candidate = hat.candidate(u);
            if hat.takes(candidate, v, is_below) {
                return candidate.0;
            }
        }
    }
    hat.whole
}

/// Returns whether `level` is at most the probability of `k`, in saddle-point form.
#[inline(always)]
pub(crate) fn saddle_point<const FUSED: bool>(k: f32, mean: f32, level: f32) -> bool {
    if k < 1.0 {
        return ln::<FUSED>(level) <= -mean;
    }
    ln::<FUSED>(level * (TWO_PI * k).sqrt()) <= -deviance::<FUSED>(k, mean) - stirling_error(k)
}

/// Returns `ln k! - (ln(2 pi k)/2 + k ln k - k)` for whole `k >= 1`.
#[inline(always)]
fn stirling_error(k: f32) -> f32 {
    let r = 1.0 / k;
    let rr = r * r;
    r * (1.0 / 12.0 - rr * (1.0 / 360.0 - rr * (1.0 / 1260.0)))
}

/// Returns `k ln(k/m) + m - k`, Loader's `bd0`: by the series of the logarithm in `(k - m)/(k + m)` where `k` is near
/// `m`.
#[inline(always)]
fn deviance<const FUSED: bool>(k: f32, mean: f32) -> f32 {
    let difference = k - mean;
    let v = difference / (k + mean);
    if v.abs() > 0.2 {
        return k * ln::<FUSED>(k / mean) - difference;
    }
    let vv = v * v;
    let series = vv * (1.0 / 3.0 + vv * (1.0 / 5.0 + vv * (1.0 / 7.0 + vv * (1.0 / 9.0 + vv * (1.0 / 11.0)))));
    difference * v + 2.0 * k * v * series
}

/// Returns the bound on the Kolmogorov distance: half the acceptance's relative error on either side of a threshold,
/// the series, the word. Below [`LEAST_MEAN`] nothing is promised.
pub fn error_bound(lambda: f64) -> f64 {
    if lambda < f64::from(LEAST_MEAN) { 1.0 } else { ACCEPTANCE_REL + SERIES + WORD }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::key;

    const MEAN: f32 = 1e6;
    const DRAWS: u32 = 4_000_000;

    /// Returns the textbook's test, with the best `lgamma` that f32 can hold.
    #[allow(clippy::cast_possible_truncation, reason = "single precision is the point")]
    fn textbook(k: f32, mean: f32, level: f32) -> bool {
        level.ln() <= k * mean.ln() - mean - libm::lgamma(f64::from(k) + 1.0) as f32
    }

    fn probability(k: f64, mean: f64) -> f64 {
        (k * mean.ln() - mean - libm::lgamma(k + 1.0)).exp()
    }

    /// Returns chi-square per degree of freedom over single counts within two sigma of `MEAN`.
    fn chi_square_per_freedom(is_below: impl Fn(f32, f32, f32) -> bool + Copy) -> f64 {
        let (low, bins) = (998_000_u32, 4001_usize);
        let mut seen = vec![0.0; bins];
        for pixel in 0..DRAWS {
            let k = draw_one_with(MEAN, pixel, 5, key(11), is_below);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and positive")]
            if let Some(seen) = (k as usize).checked_sub(low as usize).and_then(|bin| seen.get_mut(bin)) {
                *seen += 1.0;
            }
        }
        let expected = |bin: usize| f64::from(DRAWS) * probability(f64::from(low) + bin as f64, f64::from(MEAN));
        let terms = seen.iter().enumerate().map(|(bin, seen)| (seen - expected(bin)).powi(2) / expected(bin));
        terms.sum::<f64>() / bins as f64
    }

    #[test]
    fn the_saddle_point_form_passes_where_the_textbook_fails() {
        // Standard error of chi-square per degree: sqrt(2/4001) = 0.022; false alarm 6e-7 at five of them.
        let ours = chi_square_per_freedom(saddle_point::<false>);
        let textbook = chi_square_per_freedom(textbook);
        println!("chi-square per degree of freedom at mean 1e6: saddle point {ours:.3}, textbook {textbook:.3}");
        assert!((ours - 1.0).abs() < 0.112, "saddle point: {ours}");
        assert!(textbook > 3.0, "textbook in f32: {textbook}");
    }

    #[test]
    fn probabilities_are_those_of_the_law() {
        let mut worst = 0.0_f64;
        for mean in [10.0_f32, 33.3, 1e3, 1e6] {
            for step in -8..=8 {
                let k = (mean + 0.5 * step as f32 * mean.sqrt()).floor().max(1.0);
                let minus_log =
                    0.5 * f64::from(TWO_PI * k).ln() + f64::from(deviance::<false>(k, mean) + stirling_error(k));
                let wanted = -probability(f64::from(k), f64::from(mean)).ln();
                let off = (minus_log - wanted).abs() / wanted.max(1.0);
                worst = worst.max(if k < 3.0 { 0.0 } else { off });
            }
        }
        assert!(worst < 2e-6, "{worst:e}");
        assert!((stirling_error(1.0) - 0.081_061_47).abs() < 3e-4 && (stirling_error(5.0) - 0.016_644_69).abs() < 1e-7);
        assert!(saddle_point::<true>(0.0, 10.0, 4.4e-5) && !saddle_point::<true>(0.0, 10.0, 4.6e-5), "exp(-10)");
        assert!(!saddle_point::<true>(100.0, 100.0, 0.0400) && saddle_point::<true>(100.0, 100.0, 0.0398));
    }

    #[test]
    fn a_pixel_replays_and_another_is_another_draw() {
        let draw = |pixel, frame| draw_one::<false>(1e5, pixel, frame, key(1));
        assert_eq!(draw(3, 4), draw(3, 4));
        assert_ne!(draw(3, 4), draw(2, 4));
        assert_ne!(draw(3, 4), draw(3, 5));
    }
}
