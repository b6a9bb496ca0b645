//! Dark current: `t J A / q`, the doubling law, its shot noise, and the two kinds of non-uniformity.

use crate::flats::{Flats, mean, variance, variance_error};
use crate::noise::STANDARD_ERRORS;
use image::detector::{DarkLaw, DetectorParams};

const SIZE: [usize; 2] = [256, 256];
const PIXELS: usize = SIZE[0] * SIZE[1];

/// Returns a detector with 0.02 nA/cm^2 at 20 C on 15 um pixels.
fn warm(operating_c: f64) -> DetectorParams {
    let dark_law = DarkLaw { reference_c: 20.0, operating_c, doubling_k: 6.5 };
    DetectorParams { dark_e_per_s: DarkLaw::e_per_s_of_density(0.02, 15.0), dark_law, ..DetectorParams::QUIET }
}

/// Returns the formula written afresh: seconds x A/cm^2 x cm^2 / C.
fn formula_e(exposure_s: f64, operating_c: f64) -> f64 {
    let amperes = 0.02e-9 * 15e-4 * 15e-4 * f64::powf(2.0, (operating_c - 20.0) / 6.5);
    exposure_s * amperes / 1.602_176_634e-19
}

#[test]
fn mean_and_shot_noise_follow_density_exposure_and_temperature() {
    for (exposure_s, operating_c) in [(0.1, 20.0), (0.4, 20.0), (0.1, 33.0), (1.0, -6.0)] {
        let wanted = formula_e(exposure_s, operating_c);
        let found = Flats::new(warm(operating_c), SIZE).frame_e(0.0, 3, exposure_s);
        let error = (mean(&found) - wanted) / (wanted / PIXELS as f64).sqrt();
        assert!(error.abs() < STANDARD_ERRORS, "{exposure_s} s, {operating_c} C: mean off by {error}");
        // Fourth moment of Poisson's law: the variance of a variance is (2 + 1/mean) / n of its square.
        let spread = ((2.0 + 1.0 / wanted) / PIXELS as f64).sqrt();
        let error = (variance(&found) / wanted - 1.0) / spread;
        assert!(error.abs() < STANDARD_ERRORS, "{exposure_s} s, {operating_c} C: variance off by {error}");
        // Negative control: a kelvin more is seen.
        let other = formula_e(exposure_s, operating_c + 1.0);
        assert!((mean(&found) - other).abs() > STANDARD_ERRORS * (other / PIXELS as f64).sqrt(), "one kelvin");
    }
}

#[test]
fn a_temperature_step_shows_in_the_next_frame() {
    let mut flats = Flats::new(warm(20.0), SIZE);
    let before = mean(&flats.frame_e(0.0, 1, 0.4));
    flats.warmer_k = 13.0;
    let after = mean(&flats.frame_e(0.0, 2, 0.4));
    assert!((after / before - 4.0).abs() < 0.02, "two doublings: {before} e-, then {after} e-");
}

#[test]
fn nonuniformity_of_the_current_grows_and_the_offset_does_not() {
    const FRAMES: u32 = 8;
    const GAIN: f64 = 0.1;
    let quantisation = GAIN * GAIN / 12.0;
    // Spatial variance without the temporal part that averaging leaves.
    let spatial = |params: DetectorParams, exposure_s: f64| {
        let params = DetectorParams { gain_e_per_dn: GAIN, black_level_dn: 1000.0, ..params };
        let dark_e = params.operating_dark_e_per_s() * exposure_s;
        let found = variance(&Flats::new(params, SIZE).averaged_e(0.0, FRAMES, exposure_s));
        (dark_e, found, (dark_e + quantisation) / f64::from(FRAMES))
    };
    for (exposure_s, operating_c) in [(0.1, 20.0), (0.4, 20.0), (0.1, 33.0)] {
        let share = 0.2;
        let (dark_e, found, temporal) =
            spatial(DetectorParams { dark_nonuniformity: share, ..warm(operating_c) }, exposure_s);
        let error = variance_error(found, (share * dark_e).powi(2) + temporal, PIXELS);
        assert!(error.abs() < STANDARD_ERRORS, "{exposure_s} s, {operating_c} C: off by {error}");
        let (_, found, temporal) = spatial(DetectorParams { dsnu_e_rms: 6.0, ..warm(operating_c) }, exposure_s);
        let error = variance_error(found, 36.0 + temporal, PIXELS);
        assert!(error.abs() < STANDARD_ERRORS, "offset, {exposure_s} s, {operating_c} C: off by {error}");
    }
}
