//! The law of the counts that PTRS draws: the area in the square of its two uniforms that yields each count.
//!
//! The words of a candidate `k` are an interval, found by bisection. Over it, the share of words that accept is a
//! smooth function except at the three seams of the hat function, where the interval is cut; it is integrated by Gauss
//! and Legendre's six nodes, each by bisection of the second word. Accuracy: 23-bit words, 1e-7. The test below
//! compares it with draws.

use crate::detector::poisson::{law::Law, ptrs::Hat};

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
