//! Fixed patterns: photo-response (PRNU) and dark-signal (DSNU) non-uniformity, drawn once from the seed.

use crate::base::random::{Stage, counter, key, philox};
use crate::detector::DetectorParams;
use crate::detector::read_noise::normal_pair;

/// The fixed patterns of a detector, pixel by pixel; `None`: off.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Patterns {
    /// Photo-response non-uniformity, share.
    pub prnu: Option<Vec<f32>>,
    /// Dark-signal non-uniformity, e-.
    pub dsnu_e: Option<Vec<f32>>,
}

impl Patterns {
    /// Drawn from the seed, as the parameters ask.
    #[must_use]
    pub fn draw(params: &DetectorParams, pixels: usize, seed: u64) -> Self {
        Self {
            prnu: normal_map(pixels, params.prnu, seed, Stage::Prnu),
            dsnu_e: normal_map(pixels, params.dsnu_e_rms, seed, Stage::Dsnu),
        }
    }
}

/// One normal deviate per pixel times `rms`, or `None` when the effect is off. The same on every machine.
#[must_use]
#[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels; patterns are f32")]
pub fn normal_map(pixels: usize, rms: f64, seed: u64, stage: Stage) -> Option<Vec<f32>> {
    if rms == 0.0 {
        return None;
    }
    let pair = |i: usize| {
        let [a, b, ..] = philox(counter(0, i as u32, stage), key(seed));
        let (even, odd) = normal_pair::<true>(a, b);
        [even * rms as f32, odd * rms as f32]
    };
    let mut map: Vec<f32> = (0..pixels.div_ceil(2)).flat_map(pair).collect();
    map.truncate(pixels);
    Some(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_have_their_rms_and_follow_the_seed() {
        let n = 200_000;
        let map = normal_map(n, 0.01, 7, Stage::Prnu).expect("switched on");
        let mean = map.iter().map(|v| f64::from(*v)).sum::<f64>() / n as f64;
        let rms = (map.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / n as f64).sqrt();
        // Five standard errors: 0.01 / sqrt(n) and 0.01 / sqrt(2 n).
        assert!(mean.abs() < 5.0 * 0.01 / (n as f64).sqrt(), "mean {mean}");
        assert!((rms / 0.01 - 1.0).abs() < 5.0 / (2.0 * n as f64).sqrt(), "rms {rms}");
        assert_ne!(map, normal_map(n, 0.01, 8, Stage::Prnu).expect("switched on"), "another seed");
        assert!(normal_map(n, 0.0, 7, Stage::Prnu).is_none(), "off costs nothing");
    }
}
