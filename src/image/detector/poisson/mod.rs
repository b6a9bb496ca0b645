//! Shot noise: mean electrons -> counted electrons, by methods with a name, a domain and an error bound.
//!
//! | method | domain, e- | error, Kolmogorov distance | words per pixel |
//! |---|---|---|---|
//! | `inversion` | 0 to 20 | rounding and a cut tail | 1 |
//! | `cornish-fisher` | 20 to 1e6 | next term of the expansion, rounding | 1 |
//! | `ptrs` | 10 to 1e6 | rounding | 4 of its own, or more |
//! | `rounded-normal` | 1000 to 1e6 | skewness left out | 1 |
//! | `auto` | 0 to 1e6 | inversion below 20, Cornish-Fisher above | 1 |
//!
//! A detector that is given a method draws with it the pixels whose mean lies in its domain, and all others as `auto`
//! does: no pixel is drawn outside a domain (means above 1e6 are drawn by Cornish-Fisher without a guaranteed error).
//! `inversion` and `cornish-fisher` by name therefore draw what `auto` draws; the two names let their errors be tested
//! apart. Tests: below, `tests/physics/poisson_methods.rs` (errors) and `tests/physics/noise.rs` (moments and
//! chi-square in frames).

pub mod cornish_fisher;
pub mod distance;
pub mod inversion;
pub mod law;
pub mod method;
pub mod ptrs;
pub mod rounded_normal;

pub use inversion::INVERSION_LIMIT;
pub use method::PoissonMethod;

use crate::detector::block::{BLOCK, GROUP};

/// Largest mean that the methods by name draw.
const MOST_MEAN: f32 = 1e6;

/// Place of a block: a method's further random words are counted by it.
#[derive(Debug, Clone, Copy)]
pub struct BlockPlace {
    /// First pixel of the block.
    pub first_pixel: u32,
    /// Frame.
    pub frame: u32,
    /// Key of the seed.
    pub key: [u32; 2],
}

/// Draws all pixels of a block by `method`: mean electrons in, counted electrons out.
#[inline(always)]
pub fn draw_by<const FUSED: bool>(
    method: PoissonMethod,
    electrons: &mut [f32; BLOCK],
    words: &[u32; BLOCK],
    place: BlockPlace,
) {
    let least = match method {
        PoissonMethod::Auto | PoissonMethod::Inversion | PoissonMethod::CornishFisher => {
            return draw::<FUSED>(electrons, words);
        }
        PoissonMethod::Ptrs => ptrs::LEAST_MEAN,
        PoissonMethod::RoundedNormal => rounded_normal::LEAST_MEAN,
    };
    let is_own = |mean: f32| (least..=MOST_MEAN).contains(&mean);
    let mean = *electrons;
    // No light costs least in the pass over the others.
    electrons.iter_mut().for_each(|e| *e = if is_own(*e) { 0.0 } else { *e });
    draw::<FUSED>(electrons, words);
    if method == PoissonMethod::Ptrs {
        for ((e, mean), pixel) in electrons.iter_mut().zip(&mean).zip(place.first_pixel..) {
            if is_own(*mean) {
                *e = ptrs::draw_one::<FUSED>(*mean, pixel, place.frame, place.key);
            }
        }
        return;
    }
    let (groups, _) = electrons.as_chunks_mut::<GROUP>();
    for ((e, mean), words) in groups.iter_mut().zip(mean.as_chunks().0).zip(words.as_chunks().0) {
        let counts = rounded_normal::rounded_normal::<FUSED>(mean, words);
        for i in 0..GROUP {
            e[i] = if is_own(mean[i]) { counts[i] } else { e[i] };
        }
    }
}

/// Draws all pixels of a block by [`PoissonMethod::Auto`].
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
        inversion::invert::<FUSED>(electrons, words);
    }
    if most >= limit {
        let bright = cornish_fisher::cornish_fisher::<FUSED>(&mean, words);
        for i in 0..GROUP {
            electrons[i] = if mean[i] >= INVERSION_LIMIT { bright[i] } else { electrons[i] };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::{key, philox};

    const PLACE: BlockPlace = BlockPlace { first_pixel: 0, frame: 7, key: [3, 0] };
    /// Means below, at and above every edge, and other values that a detector may pass on.
    const MEANS: [f32; 16] =
        [-5.0, 0.0, 0.1, 3.0, 9.9, 10.0, 19.99, 20.0, 33.3, 500.0, 999.0, 1000.0, 3e4, 1e6, 1.1e6, f32::NAN];

    fn block() -> ([f32; BLOCK], [u32; BLOCK]) {
        let words = core::array::from_fn(|i| philox([i as u32, 0, 0, 0], key(9))[0]);
        (core::array::from_fn(|i| MEANS[(i / 5) % MEANS.len()]), words)
    }

    fn drawn<const FUSED: bool>(method: PoissonMethod) -> [f32; BLOCK] {
        let (mut electrons, words) = block();
        draw_by::<FUSED>(method, &mut electrons, &words, PLACE);
        electrons
    }

    /// Returns Fowler, Noll and Vo's hash of the counts.
    fn hash(counts: &[f32]) -> u64 {
        let bytes = counts.iter().flat_map(|k| k.to_bits().to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
    }

    /// Returns the hash of many blocks drawn by `draw`, with all means and many words.
    fn hash_of(draw: impl Fn(&mut [f32; BLOCK], &[u32; BLOCK])) -> u64 {
        let mut all = Vec::new();
        for round in 0..2000_u32 {
            let words = core::array::from_fn(|i| philox([i as u32, round, 0, 0], key(9))[0]);
            let mut electrons = core::array::from_fn(|i| MEANS[(i / 7 + round as usize) % MEANS.len()]);
            draw(&mut electrons, &words);
            all.extend(electrons);
        }
        hash(&all)
    }

    #[test]
    fn auto_draws_the_bits_it_always_drew() {
        // Recorded before the methods were named.
        const TWICE: u64 = 0x2743_a62b_f514_19bc;
        const ONCE: u64 = 0xc37b_2fb4_d7dd_d799;
        for method in [PoissonMethod::Auto, PoissonMethod::Inversion, PoissonMethod::CornishFisher] {
            assert_eq!(hash_of(|e, words| draw_by::<false>(method, e, words, PLACE)), TWICE, "{method}, rounded twice");
            assert_eq!(hash_of(|e, words| draw_by::<true>(method, e, words, PLACE)), ONCE, "{method}, rounded once");
        }
    }

    #[test]
    fn a_method_draws_its_domain_and_auto_the_rest() {
        let auto = drawn::<false>(PoissonMethod::Auto);
        let (means, _) = block();
        for method in PoissonMethod::ALL {
            let counts = drawn::<false>(method);
            let is_auto = [PoissonMethod::Ptrs, PoissonMethod::RoundedNormal].iter().all(|other| *other != method);
            let differs = |i: &usize| counts[*i].to_bits() != auto[*i].to_bits();
            assert!((0..BLOCK).filter(differs).all(|i| method.is_within_domain(f64::from(means[i]))), "{method}");
            assert_eq!((0..BLOCK).filter(differs).count() == 0, is_auto, "{method}");
            let is_count = |k: &f32| *k >= 0.0 && k.fract() == 0.0;
            assert!(counts.iter().all(is_count), "{method}");
        }
    }
}
