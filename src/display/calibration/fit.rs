//! Plan and measurements -> map, response, flat field, magnitudes: the contents of a calibration.

use super::dot_code::{bits_of, numbers};
use super::error::CalibrationError;
use super::file::{Calibration, Light, Residuals};
use super::fit_levels::fit_levels;
use super::fit_map::{FEWEST_DOTS, MapFit, SeenDot, fit_map};
use super::identity::TrackerIdentity;
use super::measurement::Sight;
use super::pattern::Pattern;
use super::plan::Plan;
use crate::astrometry::CameraGeometry;
use crate::base::time::Tai;
use crate::display::flat_field::{FlatField, FlatFit, fit_flat};
use crate::display::latency::Latency;
use crate::display::response::Response;

/// What the fit was told beside the measurements.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// When the measurements were made.
    pub made: Tai,
    /// Days for which the calibration is valid.
    pub valid_days: u32,
    /// Electrons per second that the tracker sees of a star of instrument magnitude 0; `None`: no magnitudes.
    pub zero_point_e_per_s: Option<f64>,
    /// The display's latency, where it is known.
    pub latency: Option<Latency>,
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
}

/// Fits everything. `tracker` is the camera whose pixels the measurements are in, `name` its file's name.
///
/// # Errors
/// When the tracker is not the plan's, or the measurements do not make a map and a response.
pub fn fit(
    plan: &Plan,
    sights: &[Sight],
    tracker: (&str, &CameraGeometry),
    options: &FitOptions,
) -> Result<Fitted, CalibrationError> {
    let used = TrackerIdentity::of(tracker.0, tracker.1);
    let made_utc = options.made.to_rfc3339();
    super::identity::same_tracker(&made_utc, &used, &plan.tracker)?;
    let (dots, fluxes, unread) = seen_dots(plan, sights, tracker.1)?;
    let size_px = plan.display.size_px();
    let map = fit_map(&dots, size_px)?;
    let (response, has_dark) = fit_levels(sights, plan.display.bits)?;
    let response = Response::new(response)?;
    let flat = flat_of(plan, &dots, &fluxes, &map)?;
    let zero_point = options.zero_point_e_per_s.filter(|zero_point| *zero_point > 0.0);
    let light = flat
        .as_ref()
        .zip(zero_point)
        .map(|(flat, zero_point_e_per_s)| Light { full_px_e_per_s: flat.full_flux, zero_point_e_per_s });
    let arcsec_per_px = map.geometry.arcsec_per_px();
    let residual = Residuals {
        dots_used: map.is_used.iter().filter(|used| **used).count(),
        dots_left_out: map.is_used.iter().filter(|used| !**used).count() + unread,
        rms_px: map.rms_px,
        max_px: map.max_px,
        rms_arcsec: map.rms_px * arcsec_per_px,
        map_error_px: map.map_error_px,
        response_mag: response.sigma_mag(),
        flat_mag_rms: flat.as_ref().map_or(0.0, |flat| flat.residual_mag_rms),
    };
    let calibration = Calibration {
        format: super::file::FORMAT,
        made_utc,
        valid_days: options.valid_days,
        starloop_version: env!("CARGO_PKG_VERSION").into(),
        display: plan.display.clone(),
        tracker: used,
        geometry: map.parameters.clone(),
        response: response.parameters().clone(),
        flat: flat.as_ref().map_or_else(|| FlatField::uniform(size_px), |flat| flat.flat.clone()).parameters().clone(),
        light,
        latency: options.latency.clone(),
        residual,
    };
    Ok(Fitted { calibration, map, dots, flat, unread, has_dark })
}

type Dots = (Vec<SeenDot>, Vec<Option<f64>>, usize);

/// Dots with their numbers, directions and fluxes, and how many centroids have no number.
fn seen_dots(plan: &Plan, sights: &[Sight], tracker: &CameraGeometry) -> Result<Dots, CalibrationError> {
    let places = |pattern: Pattern| -> Vec<[f64; 2]> {
        sights.iter().filter(|sight| sight.pattern == pattern).filter_map(|sight| sight.tracker_px).collect()
    };
    let all: Vec<&Sight> =
        sights.iter().filter(|sight| sight.pattern == Pattern::Dots && sight.tracker_px.is_some()).collect();
    if all.len() < FEWEST_DOTS {
        return Err(CalibrationError::FewDots { wanted: FEWEST_DOTS, got: all.len(), unread: 0, unseen: 0 });
    }
    let count = plan.grid.count();
    let read = if all.iter().any(|sight| sight.dot.is_some()) {
        all.iter().map(|sight| sight.dot).collect()
    } else {
        let bits: Vec<_> = (0..bits_of(count)).map(|bit| places(Pattern::DotsBit(bit))).collect();
        numbers(&places(Pattern::Dots), &bits, count)?
    };
    let (mut dots, mut fluxes, mut unread, mut unseen) = (Vec::new(), Vec::new(), 0, 0);
    for (sight, number) in all.iter().zip(read) {
        let shown = number.and_then(|number| Some((number, plan.dot_px(number)?)));
        let direction = sight.tracker_px.and_then(|px| tracker.unproject(px));
        match (shown, direction) {
            (None, _) => unread += 1,
            (_, None) => unseen += 1,
            (Some((number, display_px)), Some(v_sensor)) => {
                dots.push(SeenDot { number, v_sensor, display_px });
                fluxes.push(sight.flux);
            }
        }
    }
    if dots.len() < FEWEST_DOTS {
        return Err(CalibrationError::FewDots { wanted: FEWEST_DOTS, got: dots.len(), unread, unseen });
    }
    Ok((dots, fluxes, unread))
}

/// The flat field of the dots that the map fits; `None` when no fluxes were given.
fn flat_of(
    plan: &Plan,
    dots: &[SeenDot],
    fluxes: &[Option<f64>],
    map: &MapFit,
) -> Result<Option<FlatFit>, CalibrationError> {
    let pixels = (plan.grid.dot_px * plan.grid.dot_px) as f64;
    let seen = dots.iter().zip(fluxes).zip(&map.is_used).filter(|(_, used)| **used);
    let per_pixel: Vec<_> =
        seen.filter_map(|((dot, flux), _)| flux.map(|flux| (dot.display_px, flux / pixels))).collect();
    if per_pixel.is_empty() {
        return Ok(None);
    }
    fit_flat(&per_pixel, plan.display.size_px()).map(Some).map_err(CalibrationError::Flat)
}
