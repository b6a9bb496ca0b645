//! A calibration in words: residuals in pixels, arcseconds and magnitudes, and the stars that it can show.
//!
//! A star is drawn as a Gaussian, so its brightest pixel has at most the share `erf(1 / (sqrt 8 sigma))^2` of its
//! light: when it is at rest in the middle of that pixel. Off the middle, or moving, less. So a star may be brighter
//! than a full pixel by that share, and the brightest that is nowhere clipped has it where the display is dimmest. The
//! faintest star is one whose brightest pixel shows grey 1 in one refresh of a dither cycle; its light is then right to
//! a half. Tests below; the numbers of a simulated bench in `tests/physics/display_calibration`.

use super::file::{Calibrated, Calibration, Light};
use crate::display::{drive::Dither, luminance_code::LEAST_STEP};
use core::f64::consts::{LN_10, SQRT_2};
use core::fmt::Write as _;

/// Magnitudes a display can show, instrument magnitudes of the tracker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnitudeRange {
    /// One pixel of full grey where the flat field is 1.
    pub full_px: f64,
    /// The brightest star where the flat field is 1.
    pub brightest: f64,
    /// The brightest star that is clipped nowhere on the display.
    pub brightest_everywhere: f64,
    /// One pixel of grey 1.
    pub one_grey: f64,
    /// The faintest star that is seen at all.
    pub faintest: f64,
    /// The black level of one pixel.
    pub black_px: f64,
    /// The black level, per square arcsecond.
    pub black_arcsec2: f64,
}

/// Returns the largest share of a star's light in one pixel.
pub fn peak_share(spot_sigma_px: f64) -> f64 {
    libm::erf(0.5 / (SQRT_2 * spot_sigma_px)).powi(2)
}

/// Returns the magnitude of so many full pixels' light.
fn magnitude(light: &Light, full_pixels: f64) -> f64 {
    -2.5 / LN_10 * (full_pixels * light.full_px_e_per_s / light.zero_point_e_per_s).ln()
}

/// Returns the brightest star that is not clipped where the flat field has this value.
pub fn brightest_star(light: &Light, flat: f64) -> f64 {
    magnitude(light, flat / peak_share(light.spot_sigma_px))
}

impl MagnitudeRange {
    /// Returns the range, dithered over `dither`.
    pub fn of(light: &Light, calibrated: &Calibrated, dither: Dither) -> Self {
        let of = |full_pixels: f64| magnitude(light, full_pixels);
        let one_grey = calibrated.response.luminance()[1];
        let black = calibrated.response.parameters().black_share;
        // Above black, full grey has 1; the black level is counted in the same unit.
        let black = black / (1.0 - black);
        let arcsec = calibrated.geometry.arcsec_per_px();
        let least_luminance = (one_grey * dither.bound()).max(0.5 * LEAST_STEP);
        Self {
            full_px: of(1.0),
            brightest: brightest_star(light, 1.0),
            brightest_everywhere: brightest_star(light, calibrated.flat.range()[0]),
            one_grey: of(one_grey),
            faintest: of(least_luminance / peak_share(light.spot_sigma_px)),
            black_px: of(black),
            black_arcsec2: of(black / (arcsec * arcsec)),
        }
    }
}

/// Returns the results of a calibration as text for people.
pub fn reported(calibration: &Calibration, calibrated: &Calibrated, dither: Dither) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<16} {value}"); // writing to a string cannot fail
    };
    let (display, tracker) = (&calibration.display, &calibration.tracker);
    let Calibration { measured_utc, made_utc, valid_days, .. } = calibration;
    line(
        "display",
        format!("{}, {} x {} px, {} bits", display.name, display.width_px, display.height_px, display.bits),
    );
    line("tracker", format!("{}, {} x {} px", tracker.name, tracker.width_px, tracker.height_px));
    line("measured", format!("{measured_utc}, fitted {made_utc}, valid for {valid_days} days from the measurement"));
    for (name, value) in
        map_reported(calibration, calibrated).into_iter().chain(light_reported(calibration, calibrated, dither))
    {
        line(name, value);
    }
    let latency = calibration.latency.as_ref();
    line(
        "latency",
        latency
            .map_or_else(|| "not known: photons come after submit time by an unknown delay".into(), |l| l.reported()),
    );
    text
}

type Line = (&'static str, String);

fn map_reported(calibration: &Calibration, calibrated: &Calibrated) -> Vec<Line> {
    let (r, geometry) = (&calibration.residual, &calibration.geometry);
    let arcsec = calibrated.geometry.arcsec_per_px();
    let mirrored = if geometry.mirrored { ", seen mirrored" } else { "" };
    let [left, right, top, bottom] = calibrated.geometry.covered().range_px();
    let worst = format!("largest {:.4} px = {:.3} arcsec", r.max_px, r.max_px * arcsec);
    vec![
        ("map", format!("homography and degree {}, {arcsec:.2} arcsec per display px{mirrored}", geometry.degree)),
        ("dots", format!("{} fitted, {} left out ({} saturated)", r.dots_used, r.dots_left_out, r.dots_saturated)),
        (
            "coverage",
            format!(
                "{:.0} % of what the tracker sees of the display, columns {left} to {right}, rows {top} to {bottom}; beyond, the map is a guess",
                100.0 * r.coverage
            ),
        ),
        ("residual", format!("{:.4} display px rms = {:.3} arcsec, {worst}", r.rms_px, r.rms_arcsec)),
        (
            "map error",
            format!(
                "{:.4} display px rms = {:.3} arcsec left by the dots' noise",
                r.map_error_px,
                r.map_error_px * arcsec
            ),
        ),
    ]
}

fn light_reported(calibration: &Calibration, calibrated: &Calibrated, dither: Dither) -> Vec<Line> {
    let (r, response) = (&calibration.residual, &calibration.response);
    let [least, _] = calibrated.flat.range();
    let (greys, black) = (response.level.len(), 100.0 * response.black_share);
    let mut lines = vec![
        ("response", format!("{greys} greys, +- {:.4} mag; black is {black:.4} % of full", r.response_mag)),
        (
            "flat field",
            format!(
                "degree {}, least {least:.3} of the brightest, residual {:.4} mag rms",
                calibration.flat.degree, r.flat_mag_rms
            ),
        ),
    ];
    let Some(light) = &calibration.light else {
        lines.push(("magnitudes", "not known: no fluxes, or no zero point".into()));
        return lines;
    };
    let m = MagnitudeRange::of(light, calibrated, dither);
    lines.push((
        "brightest star",
        format!(
            "{:.2} mag anywhere on the display, {:.2} where it is brightest; brighter ones are clipped",
            light.brightest_mag, m.brightest
        ),
    ));
    let cycle = dither.cycle();
    lines.push((
        "faintest star",
        format!("{:.2} mag, dithered over {cycle} refreshes; one pixel of grey 1 is {:.2} mag", m.faintest, m.one_grey),
    ));
    lines.push(("black level", format!("{:.2} mag per px, {:.2} mag per arcsec2", m.black_px, m.black_arcsec2)));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_that_of_a_sum_over_the_pixel() {
        for sigma in [0.5, 0.7, 1.3] {
            const STEPS: i32 = 2000;
            let at = |i: i32| (f64::from(i) + 0.5) / f64::from(STEPS) - 0.5;
            let sum: f64 = (0..STEPS).map(|i| (-0.5 * (at(i) / sigma).powi(2)).exp()).sum();
            let along = sum / f64::from(STEPS) / (sigma * core::f64::consts::TAU.sqrt());
            assert!((peak_share(sigma) - along * along).abs() < 1e-6, "sigma {sigma}");
        }
    }

    #[test]
    fn the_brightest_star_just_fits_its_pixel() {
        let light = Light { full_px_e_per_s: 5e4, zero_point_e_per_s: 4e7, spot_sigma_px: 0.7, brightest_mag: 0.0 };
        for flat in [1.0, 0.7] {
            let star_e_per_s = 4e7 * 10_f64.powf(-0.4 * brightest_star(&light, flat));
            // Light for its middle pixel, in full pixels at the display's brightest place.
            let wanted = star_e_per_s * peak_share(0.7) / 5e4;
            assert!((wanted - flat).abs() < 1e-12, "{wanted}");
        }
        assert!((peak_share(0.7) - 0.2755).abs() < 1e-3, "1.4 mag brighter than one pixel");
    }
}
