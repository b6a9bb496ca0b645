//! The fixed patterns of one detector: drawn from its seed, or given, as its stages read them.

use crate::detector::binning::{Binning, BinningKind, sums_of_squares};
use crate::detector::pattern::{PatternSizeError, Patterns, normal_map};
use crate::{detector::DetectorParams, detector::pattern::ColourFilter};
use base::random::Stage;
use std::sync::Arc;

impl Patterns {
    /// Returns the patterns drawn from the seed, as the parameters ask.
    pub fn draw(params: &DetectorParams, pixels: usize, seed: u64) -> Self {
        let dark = normal_map(pixels, params.dark_nonuniformity, seed, Stage::DarkCurrent);
        Self {
            prnu: normal_map(pixels, params.prnu, seed, Stage::Prnu).map(Arc::from),
            dsnu_e: normal_map(pixels, params.dsnu_e_rms, seed, Stage::Dsnu).map(Arc::from),
            // A current does not flow backwards.
            dark_factor: dark.map(|map| map.into_iter().map(|share| (1.0 + share).max(0.0)).collect()),
        }
    }

    /// Returns the patterns of a detector as its stages read them: drawn from the seed, along the stages of a TDI
    /// detector, behind the filters of the pixels.
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
