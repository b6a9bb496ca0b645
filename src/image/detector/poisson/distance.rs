//! Distance between the distribution that a method draws and Poisson's law: computed, not sampled.
//!
//! Inversion, Cornish-Fisher and the rounded normal turn one uniform word into a count that grows with it; bisection
//! finds the first word of every count, and so the drawn distribution function. Rounding in f32 may swap neighbouring
//! words at an edge, a few of 2^23: below 1e-6, checked by the test below. PTRS: by the area of its region of
//! acceptance. The form rounded once per multiply-add and the one rounded twice are both computed, and the larger
//! distance is returned.
//!
//! *Acceptance of PTRS.* The law of the counts that it draws: the area in the square of its two uniforms that yields
//! each count.
//!
//! The words of a candidate `k` are an interval, found by bisection. Over it, the share of words that accept is a
//! smooth function except at the three seams of the hat function, where the interval is cut; it is integrated by Gauss
//! and Legendre's six nodes, each by bisection of the second word. Accuracy: 23-bit words, 1e-7. The test below
//! compares it with draws.

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
        PoissonMethod::Ptrs => law(&Hat::new(mean), truth, saddle_point::<FUSED>),
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

/// Words of a uniform: 23 bits.
const WORDS: u32 = 1 << 23;
/// Bits of a word below the uniform's.
const SHIFT: u32 = 9;
/// Distances from the end of the uniform's range at which the acceptance has a seam, and its centre.
const SEAMS: [f64; 3] = [0.013, 0.07, 0.5];
/// Places and weights on 0 to 1.
const NODES: [(f64, f64); 6] = [
    (0.033_765_242_898_423_99, 0.085_662_246_189_585_17),
    (0.169_395_306_766_867_74, 0.180_380_786_524_069_3),
    (0.380_690_406_958_401_54, 0.233_956_967_286_345_52),
    (0.619_309_593_041_598_5, 0.233_956_967_286_345_52),
    (0.830_604_693_233_132_3, 0.180_380_786_524_069_3),
    (0.966_234_757_101_576, 0.085_662_246_189_585_17),
];

/// Returns the law of `hat`'s counts over the counts of `truth`, accepted where `is_below` says so.
pub(crate) fn law(hat: &Hat, truth: &Law, is_below: impl Fn(f32, f32, f32) -> bool + Copy) -> Law {
    let mut sum = 0.0;
    let mut begin = 0_u32;
    let mut cumulative = Vec::with_capacity(truth.cumulative.len());
    for k in truth.counts() {
        let end = first_word(begin, WORDS, |word| f64::from(hat.candidate(word << SHIFT).0) > k);
        sum += accepted(hat, begin, end, is_below);
        begin = end;
        cumulative.push(sum);
    }
    // A hat that accepts nothing draws nothing: its distribution function stays 0.
    let whole = if sum > 0.0 { sum } else { 1.0 };
    cumulative.iter_mut().for_each(|p| *p /= whole);
    Law { first: truth.first, cumulative }
}

/// Returns the first word of `begin..end` for which `is_beyond` holds, or `end`; it holds for all after the first.
pub(crate) fn first_word(begin: u32, end: u32, is_beyond: impl Fn(u32) -> bool) -> u32 {
    let (mut low, mut high) = (begin, end);
    while low < high {
        let middle = low + (high - low) / 2;
        if is_beyond(middle) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// Returns the accepted pairs whose first word lies in `begin..end`, in words.
fn accepted(hat: &Hat, begin: u32, end: u32, is_below: impl Fn(f32, f32, f32) -> bool + Copy) -> f64 {
    let mut total = 0.0;
    let mut from = begin;
    for cut in seams().into_iter().chain([WORDS]).map(|seam| seam.clamp(begin, end)) {
        let width = f64::from(cut.max(from) - from);
        if width > 0.0 {
            for (place, weight) in NODES {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 2^23")]
                let word = from + (place * width) as u32;
                total += width * weight * share(hat, word, is_below);
            }
            from = cut;
        }
    }
    total
}

/// Returns words at which the acceptance has a seam, in order.
fn seams() -> [u32; 5] {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below 2^23")]
    let word = |u: f64| (u * f64::from(WORDS)).round() as u32;
    let [low, middle, centre] = SEAMS;
    [word(low), word(middle), word(centre), word(1.0 - middle), word(1.0 - low)]
}

/// Returns the share of second words that accept the candidate of `word`.
fn share(hat: &Hat, word: u32, is_below: impl Fn(f32, f32, f32) -> bool + Copy) -> f64 {
    let candidate = hat.candidate(word << SHIFT);
    let taken = first_word(0, WORDS, |second| !hat.takes(candidate, second << SHIFT, is_below));
    f64::from(taken) / f64::from(WORDS)
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

#[cfg(test)]
mod acceptance_tests {
    use super::*;
    use crate::detector::poisson::ptrs::{draw_one, saddle_point};
    use base::random::key;

    #[test]
    fn the_law_is_that_of_the_draws() {
        const DRAWS: u32 = 200_000;
        for lambda in [10.0_f32, 250.0] {
            let truth = Law::poisson(f64::from(lambda));
            let law = law(&Hat::new(lambda), &truth, saddle_point::<false>);
            let draws: Vec<f64> = (0..DRAWS).map(|i| f64::from(draw_one::<false>(lambda, i, 1, key(2)))).collect();
            let at_most = |k: f64| draws.iter().filter(|d| **d <= k).count() as f64 / f64::from(DRAWS);
            let near = law.counts().zip(&law.cumulative).filter(|(k, _)| (k - f64::from(lambda)).abs() < 40.0);
            let most = near.map(|(k, p)| (at_most(k) - p).abs()).fold(0.0, f64::max);
            // Kolmogorov and Smirnov: sqrt(ln(2/1e-6)/2) = 2.69 at a false-alarm rate of 1e-6.
            assert!(most < 2.69 / f64::from(DRAWS).sqrt(), "mean {lambda}: {most}");
        }
    }
}
