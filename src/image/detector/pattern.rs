//! Fixed patterns: photo-response (PRNU), dark-signal (DSNU) and dark-current non-uniformity, drawn once from the seed
//! or given as maps.
//!
//! Given as a peak-to-peak figure, a pattern's rms is that figure over 5 to 6: so many standard deviations lie between
//! the extremes that are usually quoted.
//!
//! *Colour filter array.* Each pixel counts the share of the light that the filter of its colour lets through.
//!
//! In: mean electrons of a pixel without a filter: stars, sky and stray light together. Out: these times the response
//! of the pixel's colour. The response is a share of the electrons that a pixel without a filter counts, for light of
//! the **reference spectrum**: the colour of stars for which the responses are given. Dark signal passes no filter. The
//! response belongs to the pixel as its photo-response non-uniformity does, and is drawn with it: `e' = e (1 + p)` with
//! `1 + p = response (1 + prnu)`, so that CPU, GPU and reference have one stage for both, and a detector without
//! filters has not a bit or a step more.
//!
//! *Named approximation: one colour of light.* All light has the reference spectrum. A star of another colour gets too
//! much or too little in each colour of pixel, by `response(reference) / response(its spectrum)`; places are not
//! changed. With filters of a usual sensor behind an infrared cut at 700 nm and a reference of BP-RP 0.8 (the Sun) that
//! is at most 25 % for BP-RP from 0.3 to 1.3, and 80 % from -0.3 to 2.0. Rounding of the share to f32 adds 6e-6 at
//! most. *Not modelled:* light that crosses to the next pixel's filter. *Validation:* `tests/physics/colour_filter.rs`
//! (both), `tests/gpu/effects.rs`.

use crate::detector::read_noise::normal_pair;
use base::bayer::{BayerPattern, Colour};
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

/// Least response: rounding of the share of a darker filter would show.
pub const LEAST_RESPONSE: f64 = 0.01;

/// The filters of a detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourFilter {
    /// Pattern of the colours.
    pub pattern: BayerPattern,
    /// Share of the electrons of a pixel without a filter that red pixels get, 0.01 to 1.
    pub red: f64,
    /// The same of green pixels.
    pub green: f64,
    /// The same of blue pixels.
    pub blue: f64,
}

impl ColourFilter {
    /// Returns the response of pixels of a colour.
    pub const fn response(&self, colour: Colour) -> f64 {
        match colour {
            Colour::Red => self.red,
            Colour::Green => self.green,
            Colour::Blue => self.blue,
        }
    }

    /// Returns each pixel's response less 1, row by row: of its filter and of its own non-uniformity, where there is
    /// one.
    pub fn photo_response(&self, prnu: Option<&[f32]>, [width, height]: [usize; 2]) -> Arc<[f32]> {
        let share = |i: usize| {
            let own = prnu.and_then(|map| map.get(i)).copied().map_or(0.0, f64::from);
            let response = self.response(self.pattern.colour_at(i % width, i / width));
            #[allow(clippy::cast_possible_truncation, reason = "patterns are f32")]
            let share = (response * (1.0 + own) - 1.0) as f32;
            share
        };
        (0..width * height).map(share).collect()
    }
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
