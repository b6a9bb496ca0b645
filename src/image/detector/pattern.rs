//! Fixed patterns: photo-response (PRNU), dark-signal (DSNU) and dark-current non-uniformity, drawn once from the seed
//! or given as maps.
//!
//! Given as a peak-to-peak figure, a pattern's rms is that figure over 5 to 6: so many standard deviations lie between
//! the extremes that are usually quoted.

use crate::detector::DetectorParams;
use crate::detector::binning::{Binning, BinningKind, sums_of_squares};
use crate::detector::colour_filter::ColourFilter;
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
    /// Returns the patterns drawn from the seed, as the parameters ask.
    #[must_use]
    pub fn draw(params: &DetectorParams, pixels: usize, seed: u64) -> Self {
        let dark = normal_map(pixels, params.dark_nonuniformity, seed, Stage::DarkCurrent);
        Self {
            prnu: normal_map(pixels, params.prnu, seed, Stage::Prnu).map(Arc::from),
            dsnu_e: normal_map(pixels, params.dsnu_e_rms, seed, Stage::Dsnu).map(Arc::from),
            // A current does not flow backwards.
            dark_factor: dark.map(|map| map.into_iter().map(|share| (1.0 + share).max(0.0)).collect()),
        }
    }

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

    /// Returns the patterns of a detector as its stages read them: drawn from the seed, along the stages of a TDI
    /// detector, behind the filters of the pixels.
    #[must_use]
    pub fn of_detector(params: &DetectorParams, size_px: [usize; 2], seed: u64) -> Self {
        let [width, height] = size_px;
        let drawn = Self::draw(params, width * height, seed);
        let drawn = params.spatial.tdi.map_or(drawn.clone(), |tdi| tdi.patterns(&drawn, width));
        drawn.behind(params.spatial.colour_filter, size_px)
    }

    /// Returns these patterns, given sensor pixel by sensor pixel, as the stages of a detector read them: TDI averages
    /// them along its stages, charge binning adds up offsets, filters change the response.
    ///
    /// # Errors
    /// When the number of pixels of a map is not that of the detector.
    pub fn given_to(&self, params: &DetectorParams, size_px: [usize; 2]) -> Result<Self, PatternSizeError> {
        let [width, height] = size_px;
        self.check(width * height)?;
        let mut given = params.spatial.tdi.map_or_else(|| self.clone(), |tdi| tdi.patterns(self, width));
        if let Some(Binning { factor, kind: BinningKind::Charge { .. } }) = params.spatial.binning {
            given.dsnu_e = given.dsnu_e.map(|map| sums_of_squares(&map, size_px, factor));
        }
        Ok(if given.prnu.is_some() { given.behind(params.spatial.colour_filter, size_px) } else { given })
    }

    /// Returns how many maps a detector with these parameters keeps when these patterns are given to it.
    #[must_use]
    pub fn kept(&self, params: &DetectorParams) -> usize {
        let maps = [
            params.prnu != 0.0 || self.prnu.is_some() || params.spatial.colour_filter.is_some(),
            params.dsnu_e_rms != 0.0 || self.dsnu_e.is_some(),
            params.dark_nonuniformity != 0.0 || self.dark_factor.is_some(),
        ];
        maps.into_iter().filter(|is_on| *is_on).count()
    }

    /// Returns these of a detector whose pixels have filters: the photo-response is that of pixel and filter together.
    fn behind(self, filter: Option<ColourFilter>, size_px: [usize; 2]) -> Self {
        let Some(filter) = filter else { return self };
        Self { prnu: Some(filter.photo_response(self.prnu.as_deref(), size_px)), ..self }
    }

    /// Returns these patterns; each one that is not given is taken from `others`.
    #[must_use]
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

    #[test]
    fn given_maps_come_first_and_must_fit() {
        let params = DetectorParams { prnu: 0.01, dark_nonuniformity: 0.8, ..DetectorParams::QUIET };
        let drawn = Patterns::draw(&params, 1000, 3);
        assert!(drawn.dsnu_e.is_none(), "off");
        let factors = drawn.dark_factor.as_deref().expect("on");
        // Of a normal law 10.6 % lie more than 1 / 0.8 standard deviations below the mean.
        let stopped = factors.iter().filter(|factor| **factor == 0.0).count();
        assert!(factors.iter().all(|factor| *factor >= 0.0) && (60..160).contains(&stopped), "{stopped} at 0");
        let given = Patterns { prnu: Some(Arc::from([0.5_f32; 1000])), ..Patterns::default() };
        let both = given.or(&drawn);
        assert_eq!((&both.prnu, &both.dark_factor), (&given.prnu, &drawn.dark_factor));
        assert!(given.check(1000).is_ok() && drawn.check(1000).is_ok());
        let error = given.check(1001).expect_err("one pixel short").to_string();
        assert!(error.contains("PRNU map of 1000 pixels for a detector of 1001"), "{error}");
    }
}
