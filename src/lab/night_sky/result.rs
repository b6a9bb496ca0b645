//! All that is fitted to one frame, its figures, their limits, and whether they are within them.
//!
//! Outliers are named and counted, the figures without them are judged ([`crate::outliers`]). Limits of places and magnitudes
//! are a fixed part and the drawn frame's own distances from its truth (noise and method), added as squares.

use crate::figures::{BackgroundFigures, EnergyFigures, Pair, SnrRow, StarRow};
use crate::geometry::{FittedGeometry, Freedom, stretch_axis};
use crate::light_fit::{FittedBackground, FittedLight};
use crate::outliers::{self, Candidate, WorstStar, worst};
use crate::picture::{Flip, mean, rms};
use crate::psf_fit::{FittedPsf, Shape};
use crate::{measure::PixelNoise, response::Response};
use config::Camera;
use plan::optics::illumination::Vignetting;
use serde::Serialize;
use std::path::Path;

/// Version of the JSON that [`Comparison`] is written as.
pub const SCHEMA_VERSION: u32 = 1;
/// Least SNR of the stars whose residuals count.
pub const COUNTED_SNR: f64 = 20.0;
/// Least number of them.
pub const LEAST_STARS: usize = 6;
/// Most rms distance of real stars from drawn ones, px, along both axes together, besides the drawn frame's own.
pub const MOST_CENTROID_PX: f64 = 0.15;
/// Most rms difference of magnitudes, besides the drawn frame's own.
pub const MOST_MAG: f64 = 0.15;
/// Most outliers, a share of the stars, and one; known variables do not count.
const MOST_OUTLIERS: f64 = 0.05;
/// How far the ratio of the noises may be from 1.
pub const MOST_NOISE: f64 = 0.10;
/// A real star below this share of the drawn one's light is missing.
const MISSING_SHARE: f64 = 0.4;
/// Most missing stars, a share of those that are drawn above SNR 20, and one.
const MOST_MISSING: f64 = 0.05;
/// Most difference of the energy in 3 x 3 px, a share.
pub const MOST_ENERGY: f64 = 0.03;

/// The air's refraction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refraction {
    /// Half the difference of the scales along and across the vertical.
    pub stretch: f64,
    /// Its standard error.
    pub stretch_error: f64,
    /// Direction of the vertical on the image, degrees from right towards down, 0 to 180.
    pub vertical_deg: f64,
    /// Rms of the stars' distances along an axis with the stretch kept at 0, px.
    pub rms_without_px: f64,
}

/// One frame's figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// The file.
    pub image: String,
    /// Every figure is within its limit.
    pub agrees: bool,
    /// Failed criteria, in words.
    pub failures: Vec<String>,
    /// Causes of most of the distances and differences, in words, where they show.
    pub limited_by: Vec<String>,
    /// The image was turned over before it was compared: "rows" or "columns".
    pub flipped: Option<String>,
    /// Right ascension of the boresight (image's middle where principal_point_px is there), degrees.
    pub ra_deg: f64,
    /// Declination, degrees.
    pub dec_deg: f64,
    /// Position angle of image up, east of north, degrees, 0 to 360.
    pub roll_deg: f64,
    /// Stars above SNR 20 that residuals are of.
    pub stars: usize,
    /// Rms distance of real stars from the places at which they were drawn, px, along both axes together.
    pub centroid_rms_px: f64,
    /// The same along columns and rows.
    pub centroid_rms_axes_px: [f64; 2],
    /// Rms difference of magnitudes.
    pub mag_rms: f64,
    /// `centroid_rms_px` without outliers: this is judged.
    pub centroid_robust_px: f64,
    /// `mag_rms` without outliers: this is judged.
    pub mag_robust: f64,
    /// Limit of `centroid_robust_px`: 0.15 px and the drawn frame's own, added as squares.
    pub centroid_limit_px: f64,
    /// Limit of `mag_robust`: 0.15 mag and the drawn frame's own, added as squares.
    pub mag_limit: f64,
    /// Stars whose place or magnitude is far off.
    pub outliers: usize,
    /// Outliers that count: all but known variables whose magnitude alone is off.
    pub unexplained_outliers: usize,
    /// Outliers, missing stars, and the worst of the others.
    pub worst_stars: Vec<WorstStar>,
    /// Noise of the drawn background over that of the real one.
    pub background_noise_ratio: f64,
    /// Share of the light within 3 x 3 px of 7 x 7 px, drawn less real.
    pub ensquared_energy_difference: f64,
    /// Rms distance of stars measured on the drawn frame from where they were drawn, px: noise and method.
    pub drawn_centroid_rms_px: f64,
    /// The same for magnitudes.
    pub drawn_mag_rms: f64,
    /// Stars found in the image, in the catalog or not.
    pub detections: usize,
    /// Stars above SNR 20 that are left out: saturated, with a neighbour in their pixels.
    pub left_out: [usize; 2],
    /// Stars that are drawn above SNR 20 and have less than 0.4 of that light in the real frame.
    pub missing: usize,
    /// Whether the attitude was given, not found.
    pub attitude_given: bool,
    /// Focal length, mm, and its standard error.
    pub focal_length_mm: [f64; 2],
    /// First radial term.
    pub k1: f64,
    /// Second radial term.
    pub k2: f64,
    /// Its standard error, where the stars call for the term; else the camera file's is kept.
    pub k2_error: Option<f64>,
    /// Where the optical axis meets the image, px.
    pub principal_point_px: [f64; 2],
    /// Its standard errors, where the stars call for another one than the camera file's.
    pub principal_point_errors_px: Option<[f64; 2]>,
    /// PSF in words.
    pub psf: String,
    /// Mean squared residual of the PSF's fit in units of noise.
    pub psf_chi2: f64,
    /// Electrons of a star of G = 0, BP - RP = 0 in one exposure.
    pub zero_point_e: f64,
    /// Colour terms.
    pub colour: [f64; 2],
    /// Illumination at half a diagonal over that in the middle.
    pub edge_illumination: f64,
    /// Further vignetting at half a diagonal from the stars, mag, and its standard error.
    pub edge_by_stars_mag: [f64; 2],
    /// The illumination follows the stars: the background's fall contradicts them.
    pub edge_is_by_stars: bool,
    /// Change of the stars' magnitudes with those of the catalog, mag per mag, and its standard error; negative where bright stars
    /// are too faint.
    pub response_slope: [f64; 2],
    /// Exponent that makes the image linear, and its standard error, where the stars show a response curve.
    pub response_gamma: Option<[f64; 2]>,
    /// Electrons per DN, taken.
    pub gain_e_per_dn: f64,
    /// The same by the frame's own photon transfer, and its error, where it says anything.
    pub transfer_gain: Option<[f64; 2]>,
    /// Noise without light, e- rms.
    pub read_noise_e: f64,
    /// The air.
    pub refraction: Option<Refraction>,
    /// SNR by magnitude.
    pub snr: Vec<SnrRow>,
    /// Mean relative difference of the SNR, drawn less real, of bins with SNR above 20.
    pub snr_difference: f64,
    /// Background.
    pub background: BackgroundFigures,
    /// Energy.
    pub energy: EnergyFigures,
    /// The stars that count.
    pub star_rows: Vec<StarRow>,
}

/// Inputs of a verdict.
pub(crate) struct Parts<'a> {
    pub path: &'a Path,
    pub fitted: &'a Fitted,
    pub camera: &'a Camera,
    pub pairs: &'a [Pair],
    pub snr: Vec<SnrRow>,
    pub background: BackgroundFigures,
    pub energy: EnergyFigures,
    pub ra_dec_roll: [f64; 3],
    pub detections: usize,
    pub is_ground: bool,
    pub is_given: bool,
    pub flip: Option<Flip>,
}

/// Returns true for a star that should be there and is not.
fn is_missing(pair: &Pair) -> bool {
    let expected = pair.drawn.snr() > COUNTED_SNR && !pair.drawn.is_saturated && !pair.is_blended;
    expected && pair.real.flux_dn < MISSING_SHARE * pair.drawn.flux_dn
}

/// Returns the illumination at the edge of the field, as a share of the middle.
fn edge_illumination(parts: &Parts<'_>) -> f64 {
    let edge = |params: &scene::camera::CameraParams| {
        params.illumination.at(glam::DVec2::X * params.geometry.half_diagonal_rad().tan())
    };
    run::wiring::camera_parts::camera_params(parts.camera).as_ref().map_or(f64::NAN, edge)
}

/// Returns the figures with their verdict.
pub(crate) fn conclude(parts: &Parts<'_>) -> Comparison {
    let fitted = parts.fitted;
    // A star counts by the brightness that it should have or has: one that is missing counts too.
    let bright = |pair: &&Pair| pair.real.snr() > COUNTED_SNR;
    let is_full = |pair: &Pair| pair.real.is_saturated || pair.drawn.is_saturated;
    let left_out = [
        parts.pairs.iter().filter(bright).filter(|pair| is_full(pair)).count(),
        parts.pairs.iter().filter(bright).filter(|pair| !is_full(pair) && pair.is_blended).count(),
    ];
    let counted: Vec<&Pair> =
        parts.pairs.iter().filter(bright).filter(|pair| !is_full(pair) && !pair.is_blended).collect();
    let mut rows: Vec<StarRow> = counted.iter().map(|pair| StarRow::of(pair)).collect();
    let off = outliers::outliers(&rows, &counted);
    rows.iter_mut().zip(&off).for_each(|(row, off)| row.is_outlier = *off != [false; 2]);
    let [figures, drawn_figures] = outliers::figures(&rows, &off);
    let worst_stars = worst(&candidates(parts.pairs, &counted, &rows, &off));
    let axis = |of: fn(&StarRow) -> f64| rms(rows.iter().map(of));
    let [ra, dec, roll] = parts.ra_dec_roll.map(f64::to_degrees);
    let (light, pitch_mm) = (fitted.light.as_ref(), parts.camera.detector.pixel_pitch_um * 1e-3);
    let counted_snr = parts.snr.iter().filter(|row| row.real > COUNTED_SNR);
    let (vertical_deg, stretch) = stretch_axis(fitted.placed.geometry.stretch);
    let mut comparison = Comparison {
        image: parts.path.display().to_string(),
        agrees: true,
        failures: Vec::new(),
        limited_by: Vec::new(),
        flipped: parts.flip.map(|flip| flip.word().into()),
        ra_deg: ra,
        dec_deg: dec,
        roll_deg: roll.rem_euclid(360.0),
        stars: rows.len(),
        centroid_rms_px: figures.px,
        centroid_rms_axes_px: [axis(|star| star.dx_px), axis(|star| star.dy_px)],
        mag_rms: figures.mag,
        centroid_robust_px: figures.robust_px,
        mag_robust: figures.robust_mag,
        centroid_limit_px: MOST_CENTROID_PX.hypot(drawn_figures.robust_px),
        mag_limit: MOST_MAG.hypot(drawn_figures.robust_mag),
        outliers: worst_stars.iter().filter(|star| star.is_outlier).count(),
        unexplained_outliers: worst_stars.iter().filter(|star| star.is_outlier && !star.is_explained).count(),
        worst_stars,
        background_noise_ratio: parts.background.noise_ratio,
        ensquared_energy_difference: parts.energy.drawn[0] - parts.energy.real[0],
        drawn_centroid_rms_px: drawn_figures.px,
        drawn_mag_rms: drawn_figures.mag,
        detections: parts.detections,
        left_out,
        missing: parts.pairs.iter().filter(|pair| is_missing(pair)).count(),
        attitude_given: parts.is_given,
        focal_length_mm: [fitted.placed.geometry.focal_px * pitch_mm, fitted.placed.focal_error_px * pitch_mm],
        k1: fitted.placed.geometry.distortion.k1,
        k2: fitted.placed.geometry.distortion.k2,
        k2_error: fitted.freedom.second_radial.then_some(fitted.placed.second_radial_error),
        principal_point_px: fitted.placed.geometry.centre_px,
        principal_point_errors_px: fitted.freedom.axis.then_some(fitted.placed.axis_errors_px),
        psf: fitted.psf.as_ref().map_or_else(|| "kept".into(), |psf| words(psf.shape)),
        psf_chi2: fitted.psf.as_ref().map_or(f64::NAN, |psf| psf.chi2_per_pixel),
        zero_point_e: light.map_or(f64::NAN, |light| light.zero_e),
        colour: light.map_or([f64::NAN; 2], |light| light.colour),
        edge_illumination: edge_illumination(parts),
        edge_by_stars_mag: light.map_or([f64::NAN; 2], |light| light.edge_mag),
        edge_is_by_stars: fitted.is_lit_by_stars,
        response_slope: fitted.response.as_ref().map_or([f64::NAN; 2], |response| response.slope),
        response_gamma: fitted.response.as_ref().and_then(|response| response.gamma),
        gain_e_per_dn: fitted.noise.gain_e_per_dn,
        transfer_gain: fitted.transfer,
        read_noise_e: fitted.noise.read_dn * fitted.noise.gain_e_per_dn,
        refraction: parts.is_ground.then_some(Refraction {
            stretch,
            stretch_error: fitted.placed.stretch_error,
            vertical_deg,
            rms_without_px: fitted.rms_without_air_px,
        }),
        snr_difference: mean(counted_snr.map(|row| row.drawn / row.real - 1.0)),
        snr: parts.snr.clone(),
        background: parts.background.clone(),
        energy: parts.energy.clone(),
        star_rows: rows,
    };
    comparison.failures = failures(&comparison);
    comparison.agrees = comparison.failures.is_empty();
    comparison
}

/// Returns the stars that may be listed: those that count, and those that are missing.
fn candidates<'p>(pairs: &'p [Pair], counted: &[&'p Pair], rows: &[StarRow], off: &[[bool; 2]]) -> Vec<Candidate<'p>> {
    let is_counted = |pair: &Pair| counted.iter().any(|one| core::ptr::eq(*one, pair));
    let listed = counted.iter().zip(rows).zip(off);
    let listed =
        listed.map(|((pair, row), off)| Candidate { pair, row: row.clone(), off: *off, is_missing: is_missing(pair) });
    let missing = pairs.iter().filter(|pair| is_missing(pair) && !is_counted(pair));
    listed
        .chain(missing.map(|pair| Candidate { pair, row: StarRow::of(pair), off: [false; 2], is_missing: true }))
        .collect()
}

/// Returns what is beyond its limit, in words; a figure that is not a number is.
fn failures(of: &Comparison) -> Vec<String> {
    let mut found = Vec::new();
    let mut check = |holds: bool, words: String| {
        if !holds {
            found.push(words);
        }
    };
    check(
        of.stars >= LEAST_STARS,
        format!("{} stars above SNR {COUNTED_SNR}, wanted at least {LEAST_STARS}", of.stars),
    );
    let most_missing = one_and_share(MOST_MISSING, of.stars);
    check(of.missing <= most_missing, format!("{} stars are missing, wanted at most {most_missing}", of.missing));
    let most_outliers = most_outliers(of.stars);
    check(
        of.unexplained_outliers <= most_outliers,
        format!("{} stars are outliers, wanted at most {most_outliers}", of.unexplained_outliers),
    );
    let own = |limit: f64, fixed: f64| (limit * limit - fixed * fixed).max(0.0).sqrt();
    check(
        of.centroid_robust_px <= of.centroid_limit_px,
        format!(
            "centroids {:.3} px rms without outliers, wanted at most {:.3} ({MOST_CENTROID_PX} and the drawn frame's {:.3})",
            of.centroid_robust_px,
            of.centroid_limit_px,
            own(of.centroid_limit_px, MOST_CENTROID_PX)
        ),
    );
    check(
        of.mag_robust <= of.mag_limit,
        format!(
            "magnitudes {:.3} rms without outliers, wanted at most {:.3} ({MOST_MAG} and the drawn frame's {:.3})",
            of.mag_robust,
            of.mag_limit,
            own(of.mag_limit, MOST_MAG)
        ),
    );
    let noise = of.background_noise_ratio;
    check(
        (noise - 1.0).abs() <= MOST_NOISE,
        format!("noise of the background {noise:.3} of the real one, wanted 1 within {MOST_NOISE}"),
    );
    let energy = of.ensquared_energy_difference;
    check(
        energy.abs() <= MOST_ENERGY,
        format!("energy in 3 x 3 px {:+.1} % of the light, wanted within {:.0} %", 100.0 * energy, 100.0 * MOST_ENERGY),
    );
    found
}

/// Returns the most outliers among so many stars, known variables aside.
pub fn most_outliers(stars: usize) -> usize {
    one_and_share(MOST_OUTLIERS, stars)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of stars")]
fn one_and_share(share: f64, stars: usize) -> usize {
    1 + (share * stars as f64) as usize
}

fn words(shape: Shape) -> String {
    match shape {
        Shape::Gaussian { sigma_px } => format!("Gaussian, sigma {sigma_px:.3} px"),
        Shape::Moffat { fwhm_px, beta } => format!("Moffat, FWHM {fwhm_px:.3} px, beta {beta:.2}"),
        Shape::Halo { sigma_px, halo_sigma_px, share } => {
            format!(
                "Gaussian of {sigma_px:.3} px with {:.0} % of the light in a halo of {halo_sigma_px:.2} px",
                100.0 * share
            )
        }
    }
}

/// All that was fitted to a frame.
pub(crate) struct Fitted {
    pub placed: FittedGeometry,
    /// The terms that were fitted.
    pub freedom: Freedom,
    /// Rms distance of the stars above the SNR of ties along an axis without the stretch, px.
    pub rms_without_air_px: f64,
    pub psf: Option<FittedPsf>,
    pub light: Option<FittedLight>,
    pub vignetting: Option<Vignetting>,
    /// The vignetting is that of the stars, not of the background.
    pub is_lit_by_stars: bool,
    pub response: Option<Response>,
    pub background: FittedBackground,
    pub noise: PixelNoise,
    pub transfer: Option<[f64; 2]>,
}
