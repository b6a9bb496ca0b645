//! Plan and measurements -> map, response, flat field, magnitudes: the contents of a calibration.
//!
//! Light: a dot's flux is what the display sends, the lens before it lets through, and the tracker's own optics
//! vignette. What the tracker does to a dot it does to a star in the sky as well, so it must stay in what the tracker
//! sees: fluxes are divided by the illumination that the tracker's file states, and the flat field holds the display
//! and its lens alone. Stars are then drawn evenly, and the tracker vignettes them itself, once. What its file does not
//! state is taken for the display's, and made up for. Test: `tests/physics/display_calibration`, a tracker that
//! vignettes.

use super::file::{Calibration, Light, Residuals};
use super::fit_map::{FEWEST_DOTS, MapFit, SeenDot, fit_map};
use super::pattern::{Pattern, bits_of, enough, numbers};
use super::{identity::TrackerIdentity, measurement::Sight, plan::Plan, report::brightest_star};
use crate::display::flat_field::{FlatField, FlatFit, fit_flat};
use crate::display::response::{GreyLevel, Response, ResponseParameters, response_of};
use crate::display::{calibration::error, latency::Latency};
use base::{least_squares::median, refused::Refused, time::Tai};
use glam::DVec2;
use sky::astrometry::CameraGeometry;
use std::collections::BTreeMap;

/// Inputs of the fit beside the measurements.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// When the calibration is made.
    pub made: Tai,
    /// When the measurements were made: its age counts from there.
    pub measured: Tai,
    /// Days for which the calibration is valid.
    pub valid_days: u32,
    /// Electrons per second that the tracker sees of a star of instrument magnitude 0; `None`: no magnitudes.
    pub zero_point_e_per_s: Option<f64>,
    /// The display's latency, where it is known.
    pub latency: Option<Latency>,
    /// Standard deviation of the Gaussians that stars are drawn as, display px: how bright they may be depends on it.
    pub spot_sigma_px: f64,
}

/// The tracker that looked.
pub struct Tracker<'a> {
    /// Its camera file's name.
    pub name: &'a str,
    /// Camera of the measurements: pixels to directions.
    pub geometry: &'a CameraGeometry,
    /// Relative illumination of its image plane by the tangents (X/Z, Y/Z) of a direction, 0 to 1, as its file states
    /// it.
    pub illumination: &'a dyn Fn(DVec2) -> f64,
}

/// A calibration and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The calibration, ready to be written.
    pub calibration: Calibration,
    /// The map's fit, dot by dot.
    pub map: MapFit,
    /// The dots by the plan's numbers, in the order of the map's residuals.
    pub dots: Vec<SeenDot>,
    /// The flat field's fit; `None`: no fluxes were given.
    pub flat: Option<FlatFit>,
    /// Centroids whose code could not be read.
    pub unread: usize,
    /// Whether the level of darkness was measured.
    pub has_dark: bool,
    /// Levels that were left out as saturated.
    pub saturated_levels: usize,
}

/// Fits everything. `tracker` is the camera whose pixels the measurements are in.
///
/// # Errors
/// When the tracker is not the plan's, or the measurements are too old, or do not make a map and a response.
pub fn fit(plan: &Plan, sights: &[Sight], tracker: &Tracker<'_>, options: &FitOptions) -> Result<Fitted, Refused> {
    let used = TrackerIdentity::of(tracker.name, tracker.geometry);
    let measured_utc = options.measured.to_rfc3339();
    super::identity::same_tracker(&measured_utc, &used, &plan.tracker)?;
    super::file::in_time(&measured_utc, options.valid_days, options.made)?;
    let SeenDots { dots, fluxes, unread, saturated } = seen_dots(plan, sights, tracker)?;
    let size_px = plan.display.size_px();
    let map = fit_map(&dots, size_px)?;
    let coverage = enough(&map.geometry, tracker.geometry)?;
    let LevelFit { response, has_dark, saturated: saturated_levels } = fit_levels(sights, plan.display.bits)?;
    let response = Response::new(response)?;
    let flat = flat_of(plan, &dots, &fluxes, &map)?;
    let light = flat.as_ref().and_then(|flat| light_of(flat, options));
    let arcsec_per_px = map.geometry.arcsec_per_px();
    let residual = Residuals {
        dots_used: map.is_used.iter().filter(|used| **used).count(),
        dots_left_out: map.is_used.iter().filter(|used| !**used).count() + unread + saturated,
        dots_saturated: saturated,
        coverage,
        rms_px: map.rms_px,
        max_px: map.max_px,
        rms_arcsec: map.rms_px * arcsec_per_px,
        map_error_px: map.map_error_px,
        response_mag: response.sigma_mag(),
        flat_mag_rms: flat.as_ref().map_or(0.0, |flat| flat.residual_mag_rms),
    };
    let calibration = Calibration {
        format: super::file::FORMAT,
        measured_utc,
        made_utc: options.made.to_rfc3339(),
        valid_days: options.valid_days,
        starloop_version: env!("CARGO_PKG_VERSION").into(),
        plan_crc32: plan.crc32(),
        display: plan.display.clone(),
        tracker: used,
        geometry: map.parameters.clone(),
        response: response.parameters().clone(),
        flat: flat.as_ref().map_or_else(|| FlatField::uniform(size_px), |flat| flat.flat.clone()).parameters().clone(),
        light,
        latency: options.latency.clone(),
        residual,
    };
    Ok(Fitted { calibration, map, dots, flat, unread, has_dark, saturated_levels })
}

/// Returns electrons and magnitudes, where a zero point is known.
fn light_of(flat: &FlatFit, options: &FitOptions) -> Option<Light> {
    let zero_point_e_per_s = options.zero_point_e_per_s.filter(|zero_point| *zero_point > 0.0)?;
    let (full_px_e_per_s, spot_sigma_px) = (flat.full_flux, options.spot_sigma_px);
    let light = Light { full_px_e_per_s, zero_point_e_per_s, spot_sigma_px, brightest_mag: f64::NAN };
    Some(Light { brightest_mag: brightest_star(&light, flat.flat.range()[0]), ..light })
}

/// Dots with their numbers, directions and fluxes; and how many centroids have no number or are saturated.
struct SeenDots {
    dots: Vec<SeenDot>,
    fluxes: Vec<Option<f64>>,
    unread: usize,
    saturated: usize,
}

fn seen_dots(plan: &Plan, sights: &[Sight], tracker: &Tracker<'_>) -> Result<SeenDots, Refused> {
    let places = |pattern: Pattern| -> Vec<[f64; 2]> {
        sights.iter().filter(|sight| sight.pattern == pattern).filter_map(|sight| sight.tracker_px).collect()
    };
    let all: Vec<&Sight> =
        sights.iter().filter(|sight| sight.pattern == Pattern::Dots && sight.tracker_px.is_some()).collect();
    if all.len() < FEWEST_DOTS {
        return Err(error::few_dots(FEWEST_DOTS, all.len(), 0, 0, 0));
    }
    let count = plan.grid.count();
    let read = if all.iter().any(|sight| sight.dot.is_some()) {
        all.iter().map(|sight| sight.dot).collect()
    } else {
        let bits: Vec<_> = (0..bits_of(count)).map(|bit| places(Pattern::DotsBit(bit))).collect();
        numbers(&places(Pattern::Dots), &bits, count)?
    };
    let mut seen = SeenDots { dots: Vec::new(), fluxes: Vec::new(), unread: 0, saturated: 0 };
    let mut unseen = 0;
    for (sight, number) in all.iter().zip(read) {
        let shown = number.and_then(|number| Some((number, plan.dot_px(number)?)));
        let direction = sight.tracker_px.and_then(|px| tracker.geometry.unproject(px));
        match (shown, direction) {
            // A saturated dot has neither its light nor, when it is not even, its centroid.
            _ if sight.is_saturated => seen.saturated += 1,
            (None, _) => seen.unread += 1,
            (_, None) => unseen += 1,
            (Some((number, display_px)), Some(v_sensor)) => {
                let illumination = (tracker.illumination)(v_sensor.truncate() / v_sensor.z);
                seen.dots.push(SeenDot { number, v_sensor, display_px });
                seen.fluxes.push(sight.flux.map(|flux| flux / illumination));
            }
        }
    }
    let (got, unread, saturated) = (seen.dots.len(), seen.unread, seen.saturated);
    if got < FEWEST_DOTS {
        return Err(error::few_dots(FEWEST_DOTS, got, unread, unseen, saturated));
    }
    Ok(seen)
}

/// Returns the flat field of the dots that the map fits; `None` when no fluxes were given.
fn flat_of(plan: &Plan, dots: &[SeenDot], fluxes: &[Option<f64>], map: &MapFit) -> Result<Option<FlatFit>, Refused> {
    let pixels = (plan.grid.dot_px * plan.grid.dot_px) as f64;
    let seen = dots.iter().zip(fluxes).zip(&map.is_used).filter(|(_, used)| **used);
    let per_pixel: Vec<_> =
        seen.filter_map(|((dot, flux), _)| flux.map(|flux| (dot.display_px, flux / pixels))).collect();
    if per_pixel.is_empty() {
        return Ok(None);
    }
    fit_flat(&per_pixel, plan.display.size_px()).map(Some).map_err(|e| Refused(format!("flat field: {e}")))
}

// Levels of flats at many places -> the response.
//
// At one place, light is that of darkness plus a share of the display's, whatever share that is: so a level less the
// dark one, over the same of full grey, is the luminance relative to full, and places may be averaged. Places with
// less than a third of the brightest one's light (beyond the display's edge) do not count. The standard error is that
// of the mean over places and repeats. Saturated levels are left out and counted: a place whose full grey is saturated
// does not count. Where no dark level was measured it is taken for nothing: true of a luminance meter, not of a
// camera.

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
