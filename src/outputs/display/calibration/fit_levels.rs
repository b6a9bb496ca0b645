//! Levels of flats at many places -> the response.
//!
//! At one place, light is that of darkness plus a share of the display's, whatever share that is: so a level less the
//! dark one, over the same of full grey, is the luminance relative to full, and places may be averaged. Places with
//! less than a third of the brightest one's light (beyond the display's edge) do not count. The standard error is that
//! of the mean over places and repeats. Saturated levels are left out and counted: a place whose full grey is saturated
//! does not count. Where no dark level was measured it is taken for nothing: true of a luminance meter, not of a
//! camera.

use super::{measurement::Sight, pattern::Pattern};
use crate::display::response::{GreyLevel, ResponseParameters, response_of};
use base::{least_squares::median, refused::Refused};
use std::collections::BTreeMap;

/// Least light of a place that counts, of the brightest.
const LEAST_LIGHT: f64 = 1.0 / 3.0;
const OUTLIER_SIGMA: f64 = 5.0;
const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// Levels by pattern, of one place.
#[derive(Debug, Default)]
struct Place {
    dark: Vec<f64>,
    by_grey: BTreeMap<u16, Vec<f64>>,
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Result of the fit of levels.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelFit {
    /// The response.
    pub response: ResponseParameters,
    /// Whether darkness was measured.
    pub has_dark: bool,
    /// Levels that were left out as saturated.
    pub saturated: usize,
}

/// Returns the response of a display of `bits`.
///
/// # Errors
/// When levels are missing or saturated, or do not rise.
pub fn fit_levels(sights: &[Sight], bits: u32) -> Result<LevelFit, Refused> {
    let full = u16::try_from((1_u32 << bits.min(16)) - 1).unwrap_or(u16::MAX);
    let of = sights.iter().filter(|sight| sight.luminance.is_some()).count();
    let saturated = sights.iter().filter(|sight| sight.luminance.is_some() && sight.is_saturated).count();
    let mut places: BTreeMap<Option<[u64; 2]>, Place> = BTreeMap::new();
    for sight in sights.iter().filter(|sight| !sight.is_saturated) {
        let Some(luminance) = sight.luminance else { continue };
        let place = places.entry(sight.tracker_px.map(|px| px.map(f64::to_bits))).or_default();
        match sight.pattern {
            Pattern::Dark => place.dark.push(luminance),
            Pattern::Level(grey) => place.by_grey.entry(grey).or_default().push(luminance),
            Pattern::Dots | Pattern::DotsBit(_) | Pattern::Marker(_) => {}
        }
    }
    if saturated > 0 && places.values().all(|place| !place.by_grey.contains_key(&full)) {
        return Err(Refused(format!(
            "levels of the ramp: {saturated} of {of} measurements are saturated, and full grey is nowhere below; measure the whole ramp again by one shorter exposure, which suits full grey"
        )));
    }
    let all_dark: Vec<f64> = places.values().flat_map(|place| place.dark.iter().copied()).collect();
    let dark_of = |place: &Place| match (place.dark.is_empty(), all_dark.is_empty()) {
        (false, _) => mean(&place.dark),
        (true, false) => mean(&all_dark),
        (true, true) => 0.0,
    };
    let light_of = |place: &Place| place.by_grey.get(&full).map_or(0.0, |levels| mean(levels) - dark_of(place));
    let brightest = places.values().map(light_of).fold(0.0, f64::max);
    let mut shares: BTreeMap<u16, Vec<f64>> = BTreeMap::new();
    for place in places.values().filter(|place| light_of(place) > LEAST_LIGHT * brightest) {
        let (dark, light) = (dark_of(place), light_of(place));
        for (grey, levels) in &place.by_grey {
            shares.entry(*grey).or_default().extend(levels.iter().map(|level| (level - dark) / light));
        }
    }
    let levels: Vec<GreyLevel> = shares.iter().map(|(grey, shares)| level(*grey, shares)).collect();
    Ok(LevelFit { response: response_of(bits, &levels)?, has_dark: !all_dark.is_empty(), saturated })
}

/// Returns the mean and its standard error, without outliers; no standard error of one value.
fn level(grey: u16, shares: &[f64]) -> GreyLevel {
    let middle = median(&mut shares.to_vec());
    let spread = SIGMA_PER_MEDIAN * median(&mut shares.iter().map(|share| (share - middle).abs()).collect::<Vec<_>>());
    let near = |share: &&f64| (**share - middle).abs() <= OUTLIER_SIGMA * spread;
    let kept: Vec<f64> = shares.iter().filter(near).copied().collect();
    let (luminance, count) = (mean(&kept), kept.len() as f64);
    let variance = kept.iter().map(|share| (share - luminance).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    GreyLevel { grey: f64::from(grey), luminance, sigma: (variance / count).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::response::Response;

    fn sights(with_dark: bool, gain_of: impl Fn(usize) -> f64) -> Vec<Sight> {
        let at = |pattern, place: usize, luminance| {
            let tracker_px = Some([place as f64, 0.0]);
            Sight { pattern, tracker_px, flux: None, luminance: Some(luminance), dot: None, is_saturated: false }
        };
        let mut sights = Vec::new();
        for place in 0..20 {
            let dark = 30.0 + place as f64;
            if with_dark {
                sights.push(at(Pattern::Dark, place, dark));
            }
            for grey in (0..=255_u16).step_by(15) {
                let light = 0.01 + 0.99 * (f64::from(grey) / 255.0).powf(2.2);
                sights.push(at(Pattern::Level(grey), place, dark + gain_of(place) * light));
            }
        }
        sights
    }

    #[test]
    fn places_of_any_light_give_one_response() {
        let LevelFit { response, has_dark, .. } =
            fit_levels(&sights(true, |place| 500.0 + 10.0 * place as f64), 8).unwrap();
        assert!(has_dark && (response.black_share - 0.01).abs() < 1e-9, "{}", response.black_share);
        let response = Response::new(response).unwrap();
        for grey in (0..=255).step_by(15) {
            let wanted = (f64::from(grey) / 255.0).powf(2.2);
            assert!((response.luminance()[grey as usize] - wanted).abs() < 1e-9, "grey {grey}");
        }
    }

    #[test]
    fn places_beyond_the_display_do_not_count_and_darkness_does() {
        let beyond = |place: usize| if place < 4 { 0.0 } else { 500.0 };
        assert!((fit_levels(&sights(true, beyond), 8).unwrap().response.black_share - 0.01).abs() < 1e-9);
        let LevelFit { response: undark, has_dark, .. } = fit_levels(&sights(false, |_| 500.0), 8).unwrap();
        assert!(!has_dark && undark.black_share > 0.05, "darkness taken for black: {}", undark.black_share);
        assert!(fit_levels(&[], 8).is_err());
    }

    #[test]
    fn saturated_levels_are_left_out_or_refused() {
        let clipped = |end: f64, is_reported: bool| -> Vec<Sight> {
            let all = sights(true, |place| 500.0 + 10.0 * place as f64).into_iter();
            let clip = |sight: Sight| {
                let luminance = sight.luminance.map(|l| l.min(end));
                Sight { luminance, is_saturated: is_reported && luminance == Some(end), ..sight }
            };
            all.map(clip).collect()
        };
        // Places see 530 to 739 at full grey: some are left.
        let fit = fit_levels(&clipped(650.0, true), 8).unwrap();
        let found = Response::new(fit.response).unwrap().luminance()[120];
        assert!(fit.saturated > 5 && (found - (120.0_f64 / 255.0).powf(2.2)).abs() < 1e-3, "{found}");
        let none = fit_levels(&clipped(300.0, true), 8).unwrap_err().to_string();
        assert!(none.contains("saturated") && none.contains("shorter exposure"), "{none}");
        let not_reported = fit_levels(&clipped(300.0, false), 8).unwrap_err().to_string();
        assert!(not_reported.contains("as bright as full grey"), "clipped, not marked: {not_reported}");
    }
}
