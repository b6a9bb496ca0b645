//! Fixed patterns: photo-response (PRNU), dark-signal (DSNU) and dark-current non-uniformity, drawn once from the seed
//! or given as maps.
//!
//! Given as a peak-to-peak figure, a pattern's rms is that figure over 5 to 6: so many standard deviations lie between
//! the extremes that are usually quoted.

use crate::detector::read_noise::normal_pair;
use base::random::{Stage, counter, key, philox};
use std::sync::Arc;

/// The fixed patterns of a detector, pixel by pixel, row by row from the top; `None`: off, or not given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Patterns {
    /// Photo-response non-uniformity: share above or below the mean response.
    pub prnu: Option<Arc<[f32]>>,
    /// Dark-signal non-uniformity: offset, e-.
    pub dsnu_e: Option<Arc<[f32]>>,
    /// Dark current over the mean dark current, 0 or more.
    pub dark_factor: Option<Arc<[f32]>>,
}

/// A pattern that does not fit its detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what} map of {got} pixels for a detector of {wanted}: give a map of the detector's size")]
pub struct PatternSizeError {
    /// Name of the pattern.
    pub what: &'static str,
    /// Pixels of the map.
    pub got: usize,
    /// Pixels of the detector.
    pub wanted: usize,
}

impl Patterns {
    /// Returns true if all given patterns have so many pixels.
    ///
    /// # Errors
    /// The first pattern of another size.
    pub fn check(&self, pixels: usize) -> Result<(), PatternSizeError> {
        for (what, map) in [("PRNU", &self.prnu), ("DSNU", &self.dsnu_e), ("dark current", &self.dark_factor)] {
            if let Some(map) = map.as_ref().filter(|map| map.len() != pixels) {
                return Err(PatternSizeError { what, got: map.len(), wanted: pixels });
            }
        }
        Ok(())
    }

    /// Returns these patterns; each one that is not given is taken from `others`.
    pub fn or(&self, others: &Self) -> Self {
        let either = |mine: &Option<Arc<[f32]>>, other: &Option<Arc<[f32]>>| mine.as_ref().or(other.as_ref()).cloned();
        Self {
            prnu: either(&self.prnu, &others.prnu),
            dsnu_e: either(&self.dsnu_e, &others.dsnu_e),
            dark_factor: either(&self.dark_factor, &others.dark_factor),
        }
    }
}

/// Returns one normal deviate per pixel times `rms`, or `None` when the effect is off. The same on every machine.
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
    // Of a known size: a vector that grows would take three times the memory for a moment.
    let mut map: Vec<f32> = Vec::with_capacity(pixels + 1);
    (0..pixels.div_ceil(2)).for_each(|i| map.extend(pair(i)));
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
