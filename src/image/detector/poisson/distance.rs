//! Distance between the distribution that a method draws and Poisson's law: computed, not sampled.
//!
//! Inversion, Cornish-Fisher and the rounded normal turn one uniform word into a count that grows with it; bisection
//! finds the first word of every count, and so the drawn distribution function. Rounding in f32 may swap neighbouring
//! words at an edge, a few of 2^23: below 1e-6, checked by the test below. PTRS: by the area of its region of
//! acceptance. The form rounded once per multiply-add and the one rounded twice are both computed, and the larger
//! distance is returned.

use crate::detector::poisson::acceptance::{self, first_word};
use crate::detector::poisson::law::{Departure, Law};
use crate::detector::poisson::ptrs::{Hat, saddle_point};
use crate::detector::poisson::{INVERSION_LIMIT, PoissonMethod, cornish_fisher, rounded_normal};
use crate::detector::{block::GROUP, poisson::inversion::invert};

/// Largest mean that is computed: beyond it, neighbouring counts are the same f32.
const MOST_MEAN: f64 = 16_777_216.0;

/// Returns the Kolmogorov distance between Poisson's law at mean `lambda` (as f32) and what `method` draws there,
/// inside or outside its domain; none when `lambda` is not a mean above 0 and below 2^24.
pub fn distance(method: PoissonMethod, lambda: f64) -> Option<f64> {
    departure(method, lambda).map(|found| found.kolmogorov)
}

/// Returns the same with the errors of mean and variance.
#[allow(clippy::cast_possible_truncation, reason = "detectors draw from means in f32")]
pub fn departure(method: PoissonMethod, lambda: f64) -> Option<Departure> {
    let mean = lambda as f32;
    let lambda = f64::from(mean);
    if !(lambda > 0.0 && lambda < MOST_MEAN) {
        return None;
    }
    let truth = Law::poisson(lambda);
    let laws = [drawn::<true>(method, mean, &truth), drawn::<false>(method, mean, &truth)];
    let found = laws.map(|law| law.departure(&truth, lambda));
    found.into_iter().max_by(|a, b| a.kolmogorov.total_cmp(&b.kolmogorov))
}

/// Returns the law that `method` draws at `mean`, over the counts of `truth`.
fn drawn<const FUSED: bool>(method: PoissonMethod, mean: f32, truth: &Law) -> Law {
    match method {
        PoissonMethod::Auto if mean < INVERSION_LIMIT => drawn::<FUSED>(PoissonMethod::Inversion, mean, truth),
        PoissonMethod::Auto | PoissonMethod::CornishFisher => {
            by_words(truth, 23, |word| cornish_fisher::count::<FUSED>(mean, word))
        }
        PoissonMethod::RoundedNormal => by_words(truth, 23, |word| rounded_normal::count::<FUSED>(mean, word)),
        PoissonMethod::Inversion => by_words(truth, 24, |word| {
            let mut counts = [mean; GROUP];
            invert::<FUSED>(&mut counts, &[word; GROUP]);
            counts[0]
        }),
        PoissonMethod::Ptrs => acceptance::law(&Hat::new(mean), truth, saddle_point::<FUSED>),
    }
}

/// Returns the law of a count that grows with the high `bits` of a word.
fn by_words(truth: &Law, bits: u32, count: impl Fn(u32) -> f32) -> Law {
    let words = 1_u32 << bits;
    let mut begin = 0;
    let mut at_most = |k: f64| {
        begin = first_word(begin, words, |word| f64::from(count(word << (32 - bits))) > k);
        f64::from(begin) / f64::from(words)
    };
    Law { first: truth.first, cumulative: truth.counts().map(&mut at_most).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the law of every word of 23 bits, counted one by one.
    fn counted(mean: f32, truth: &Law) -> Law {
        let mut seen = vec![0.0; truth.cumulative.len()];
        for start in (0..1_u32 << 23).step_by(GROUP) {
            let words = core::array::from_fn(|i| (start + i as u32) << 9);
            for k in cornish_fisher::cornish_fisher::<false>(&[mean; GROUP], &words) {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole and positive")]
                let place = (f64::from(k) - truth.first) as usize;
                seen[place] += 1.0 / f64::from(1 << 23);
            }
        }
        let mut sum = 0.0;
        let add = |p: &f64| {
            sum += p;
            sum
        };
        Law { first: truth.first, cumulative: seen.iter().map(add).collect() }
    }

    #[test]
    fn bisection_finds_what_counting_all_words_finds() {
        for mean in [20.0_f32, 5e3] {
            let truth = Law::poisson(f64::from(mean));
            let found = drawn::<false>(PoissonMethod::CornishFisher, mean, &truth);
            let counted = counted(mean, &truth);
            let most = found.cumulative.iter().zip(&counted.cumulative).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(most < 1e-6, "mean {mean}: {most:e}");
            let other = drawn::<false>(PoissonMethod::CornishFisher, mean * 1.000_01, &truth);
            let seen = other.cumulative.iter().zip(&counted.cumulative).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(seen > 1e-6, "1e-5 of mean {mean} is seen: {seen:e}");
        }
    }

    #[test]
    fn only_means_have_a_distance() {
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e7] {
            assert_eq!(distance(PoissonMethod::Auto, wrong), None, "{wrong}");
        }
        assert!(distance(PoissonMethod::Auto, 1e-3).is_some_and(|d| d < 1e-5));
    }
}
