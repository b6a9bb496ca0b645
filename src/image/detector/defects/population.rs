//! A random population of defects: shares of the pixels and a seed -> defects.
//!
//! `round(share * pixels)` pixels of each kind, at places drawn from the seed (two may meet). What hot and RTS pixels
//! have more is exponentially distributed with the given mean, as radiation damage spreads it to first order
//! (Hopkinson, IEEE Trans. Nucl. Sci. 43 (1996) 614). Tests: below.

use crate::detector::defects::{Defect, DefectKind, DefectPlace, Rates};
use base::random::{Stage, counter, key, philox};

/// Numbers of defective pixels by kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DefectPopulation {
    /// Share of the pixels that are hot.
    pub hot_share: f64,
    /// Mean of their extra dark current, e-/s.
    pub hot_e_per_s: f64,
    /// Share of the pixels that are dead.
    pub dead_share: f64,
    /// Share of the light that these count.
    pub dead_response: f64,
    /// Share of the pixels with a telegraph signal.
    pub rts_share: f64,
    /// Mean of their extra dark current at the high level, e-/s.
    pub rts_e_per_s: f64,
    /// Their rates.
    pub rts_rates: Rates,
}

impl DefectPopulation {
    /// No defects.
    pub const NONE: Self = Self {
        hot_share: 0.0,
        hot_e_per_s: 0.0,
        dead_share: 0.0,
        dead_response: 0.0,
        rts_share: 0.0,
        rts_e_per_s: 0.0,
        rts_rates: Rates { up_per_s: 0.0, down_per_s: 0.0 },
    };

    /// Returns pixels of all kinds together.
    pub fn count(&self, pixels: usize) -> usize {
        [self.hot_share, self.dead_share, self.rts_share].iter().map(|share| share_of(*share, pixels)).sum()
    }

    /// Returns the defects of a detector of this size.
    pub fn draw(self, size_px: [usize; 2], seed: u64) -> impl Iterator<Item = Defect> {
        let pixels = size_px[0] * size_px[1];
        let hot = move |word| DefectKind::Hot { extra_e_per_s: exponential(self.hot_e_per_s, word) };
        let dead = move |_| DefectKind::Dead { response: self.dead_response };
        let rts =
            move |word| DefectKind::Rts { extra_e_per_s: exponential(self.rts_e_per_s, word), rates: self.rts_rates };
        let some = move |kind: u32, share: f64| (0..share_of(share, pixels)).map(move |i| draw(size_px, seed, kind, i));
        let hot = some(0, self.hot_share).map(move |(place, word)| Defect { place, kind: hot(word) });
        let dead = some(1, self.dead_share).map(move |(place, word)| Defect { place, kind: dead(word) });
        let rts = some(2, self.rts_share).map(move |(place, word)| Defect { place, kind: rts(word) });
        hot.chain(dead).chain(rts)
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a number of pixels")]
fn share_of(share: f64, pixels: usize) -> usize {
    (share * pixels as f64).round() as usize
}

/// Returns the place of the `i`-th defect of a kind, and another random word.
#[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
fn draw([width, height]: [usize; 2], seed: u64, kind: u32, i: usize) -> (DefectPlace, u32) {
    let [column, row, word, _] = philox(counter(kind, i as u32, Stage::DefectPlaces), key(seed));
    let scaled = |word: u32, side: usize| ((u64::from(word) * side as u64) >> 32) as u32;
    (DefectPlace::Pixel(scaled(column, width), scaled(row, height)), word)
}

fn exponential(mean: f64, word: u32) -> f64 {
    -mean * libm::log((f64::from(word) + 0.5) / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [200, 100];

    #[test]
    fn shares_and_means_are_those_asked_for() {
        let population = DefectPopulation {
            hot_share: 0.2,
            hot_e_per_s: 40.0,
            dead_share: 0.01,
            dead_response: 0.3,
            rts_share: 0.05,
            rts_e_per_s: 10.0,
            rts_rates: Rates { up_per_s: 1.0, down_per_s: 2.0 },
        };
        let all: Vec<Defect> = population.draw(SIZE, 3).collect();
        assert_eq!(all.len(), 4000 + 200 + 1000);
        assert_eq!(all.len(), population.count(SIZE[0] * SIZE[1]));
        let hot: Vec<f64> = all
            .iter()
            .filter_map(|defect| match defect.kind {
                DefectKind::Hot { extra_e_per_s } => Some(extra_e_per_s),
                DefectKind::Dead { .. } | DefectKind::Rts { .. } | DefectKind::Stuck { .. } => None,
            })
            .collect();
        let mean = hot.iter().sum::<f64>() / hot.len() as f64;
        let second = hot.iter().map(|e| e * e).sum::<f64>() / hot.len() as f64;
        // Exponential: standard deviation is the mean, second moment twice its square with a spread of sqrt(20).
        assert!((mean / 40.0 - 1.0).abs() < 5.0 / 4000_f64.sqrt(), "{mean}");
        assert!((second / 3200.0 - 1.0).abs() < 5.0 * 20_f64.sqrt() / 2.0 / 4000_f64.sqrt(), "{second}");
        let middle = |of: fn(&DefectPlace) -> f64| all.iter().map(|d| of(&d.place)).sum::<f64>() / all.len() as f64;
        let x = middle(|place| if let DefectPlace::Pixel(x, _) = place { f64::from(*x) } else { f64::NAN });
        let y = middle(|place| if let DefectPlace::Pixel(_, y) = place { f64::from(*y) } else { f64::NAN });
        assert!((x - 99.5).abs() < 5.0 * 58.0 / 5200_f64.sqrt() && (y - 49.5).abs() < 5.0 * 29.0 / 5200_f64.sqrt());
        assert_ne!(all, population.draw(SIZE, 4).collect::<Vec<_>>(), "another seed");
        assert_eq!(DefectPopulation::NONE.draw(SIZE, 3).count(), 0);
    }
}
