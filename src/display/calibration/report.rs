//! A calibration in words: residuals in pixels, arcseconds and magnitudes, and the range of stars it can show.

use super::file::{Calibrated, Calibration, Light};
use crate::display::dither::Dither;
use core::f64::consts::LN_10;
use core::fmt::Write as _;

/// Magnitudes a display can show, instrument magnitudes of the tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnitudeRange {
    /// One pixel of full grey where the flat field is 1: brighter stars spread over more pixels.
    pub full_px: f64,
    /// The same where the flat field is least: what every place can show.
    pub full_px_everywhere: f64,
    /// One pixel of grey 1.
    pub one_grey: f64,
    /// One pixel of half a refresh in a cycle of grey 1: the step that dithering leaves.
    pub dithered_step: f64,
    /// The black level of one pixel.
    pub black_px: f64,
    /// The black level, per square arcsecond.
    pub black_arcsec2: f64,
}

impl MagnitudeRange {
    /// The range, dithered over `dither`.
    #[must_use]
    pub fn of(light: &Light, calibrated: &Calibrated, dither: Dither) -> Self {
        let full_px = -2.5 * (light.full_px_e_per_s / light.zero_point_e_per_s).log10();
        let fainter = |share: f64| full_px - 2.5 / LN_10 * share.ln();
        let one_grey = calibrated.response.luminance()[1];
        let black = calibrated.response.parameters().black_share;
        // Above black, full grey has 1; the black level is counted in the same unit.
        let black = black / (1.0 - black);
        let arcsec = calibrated.geometry.arcsec_per_px();
        Self {
            full_px,
            full_px_everywhere: fainter(calibrated.flat.range()[0]),
            one_grey: fainter(one_grey),
            dithered_step: fainter(one_grey * dither.bound()),
            black_px: fainter(black),
            black_arcsec2: fainter(black / (arcsec * arcsec)),
        }
    }
}

/// What people want to know of a calibration.
#[must_use]
pub fn told(calibration: &Calibration, calibrated: &Calibrated, dither: Dither) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        let _text_only_grows = writeln!(text, "  {name:<16} {value}");
    };
    let (display, tracker, r) = (&calibration.display, &calibration.tracker, &calibration.residual);
    let geometry = &calibration.geometry;
    let arcsec = calibrated.geometry.arcsec_per_px();
    line(
        "display",
        format!("{}, {} x {} px, {} bits", display.name, display.width_px, display.height_px, display.bits),
    );
    line("tracker", format!("{}, {} x {} px", tracker.name, tracker.width_px, tracker.height_px));
    line("made", format!("{}, valid {} days", calibration.made_utc, calibration.valid_days));
    let mirrored = if geometry.mirrored { ", seen mirrored" } else { "" };
    line("map", format!("homography and degree {}, {arcsec:.2} arcsec per display px{mirrored}", geometry.degree));
    let [left, right, top, bottom] = geometry.covered_px;
    line(
        "dots",
        format!(
            "{} fitted, {} left out, columns {left} to {right}, rows {top} to {bottom}",
            r.dots_used, r.dots_left_out
        ),
    );
    let worst = format!("largest {:.4} px = {:.3} arcsec", r.max_px, r.max_px * arcsec);
    line("residual", format!("{:.4} display px rms = {:.3} arcsec, {worst}", r.rms_px, r.rms_arcsec));
    line(
        "map error",
        format!("{:.4} display px rms = {:.3} arcsec left by the dots' noise", r.map_error_px, r.map_error_px * arcsec),
    );
    let black = 100.0 * calibration.response.black_share;
    line(
        "response",
        format!(
            "{} greys, +- {:.4} mag; black is {black:.4} % of full",
            calibration.response.level.len(),
            r.response_mag
        ),
    );
    let [least, _] = calibrated.flat.range();
    line(
        "flat field",
        format!(
            "degree {}, least {least:.3} of the brightest, residual {:.4} mag rms",
            calibration.flat.degree, r.flat_mag_rms
        ),
    );
    match &calibration.light {
        None => line("magnitudes", "not known: no fluxes, or no zero point".into()),
        Some(light) => {
            let m = MagnitudeRange::of(light, calibrated, dither);
            line(
                "brightest px",
                format!("{:.3} mag, {:.3} everywhere on the display", m.full_px, m.full_px_everywhere),
            );
            let step = format!("{:.2} mag with dithering over {} refreshes", m.dithered_step, dither.cycle());
            line("faintest px", format!("{:.2} mag at grey 1, steps of {step}", m.one_grey));
            line("black level", format!("{:.2} mag per px, {:.2} mag per arcsec2", m.black_px, m.black_arcsec2));
        }
    }
    let latency = calibration.latency.as_ref();
    line(
        "latency",
        latency.map_or_else(|| "not known: photons come after submit time by an unknown delay".into(), |l| l.told()),
    );
    text
}
