//! Plan and measurements -> map, response, flat field, magnitudes: the contents of a calibration.
//!
//! Light: a dot's flux is what the display sends, the lens before it lets through, and the tracker's own optics
//! vignette. What the tracker does to a dot it does to a star in the sky as well, so it must stay in what the tracker
//! sees: fluxes are divided by the illumination that the tracker's file states, and the flat field holds the display
//! and its lens alone. Stars are then drawn evenly, and the tracker vignettes them itself, once. What its file does not
//! state is taken for the display's, and made up for. Test: `tests/physics/display_calibration`, a tracker that
//! vignettes.

use super::dot_code::{bits_of, numbers};
use super::file::{Calibration, Light, Residuals};
use super::fit_levels::{LevelFit, fit_levels};
use super::fit_map::{FEWEST_DOTS, MapFit, SeenDot, fit_map};
use super::{
    coverage::enough, identity::TrackerIdentity, measurement::Sight, pattern::Pattern, plan::Plan,
    report::brightest_star,
};
use crate::display::calibration::error;
use crate::display::flat_field::{FlatField, FlatFit, fit_flat};
use crate::display::{latency::Latency, response::Response};
use base::{refused::Refused, time::Tai};
use glam::DVec2;
use sky::astrometry::CameraGeometry;

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
