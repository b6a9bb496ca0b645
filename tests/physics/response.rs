//! Response of the detector to charge: bent response, gain by the full well, rounding and truncation.

use crate::flats::{Flats, mean, variance};
use crate::noise::STANDARD_ERRORS;
use image::detector::{DetectorParams, Nonlinearity, Rounding};

const SIZE: [usize; 2] = [256, 256];
const PIXELS: usize = SIZE[0] * SIZE[1];

#[test]
fn means_follow_the_knots_and_noise_their_slope() {
    let knots = [[4000.0, 3960.0], [20_000.0, 19_500.0], [40_000.0, 38_000.0], [60_000.0, 54_000.0]];
    let nonlinearity = Nonlinearity::through(&knots).expect("rising");
    let params = DetectorParams { nonlinearity, black_level_dn: 100.0, ..DetectorParams::QUIET };
    // Between two knots: what is seen, and the slope there, by hand.
    for (electrons, seen, slope) in [
        (2000.0, 1980.0, 0.99),
        (12_000.0, 11_730.0, 15_540.0 / 16_000.0),
        (30_000.0, 28_750.0, 0.925),
        (50_000.0, 46_000.0, 0.8),
    ] {
        let found = Flats::new(params, SIZE).frame_e(electrons, 2, 0.1);
        let sigma_e = slope * f64::sqrt(electrons);
        let error = (mean(&found) - seen) / (sigma_e / (PIXELS as f64).sqrt());
        assert!(error.abs() < STANDARD_ERRORS, "{electrons} e-: mean off by {error}");
        let wanted = sigma_e * sigma_e + 1.0 / 12.0;
        let error = (variance(&found) / wanted - 1.0) / (2.0 / PIXELS as f64).sqrt();
        assert!(error.abs() < STANDARD_ERRORS, "{electrons} e-: variance off by {error}");
        assert!((mean(&found) - electrons).abs() > STANDARD_ERRORS * sigma_e / (PIXELS as f64).sqrt(), "it is bent");
    }
}

#[test]
fn a_truncating_converter_reads_half_a_number_less() {
    let params =
        DetectorParams { gain_e_per_dn: 4.0, read_noise_e_rms: 30.0, black_level_dn: 200.0, ..DetectorParams::QUIET };
    let rounded = Flats::new(params, SIZE).frame_e(500.0, 1, 0.1);
    let cut = Flats::new(DetectorParams { rounding: Rounding::Truncate, ..params }, SIZE).frame_e(500.0, 1, 0.1);
    let steps: Vec<f64> = rounded.iter().zip(&cut).map(|(rounded, cut)| (rounded - cut) / 4.0).collect();
    assert!(steps.iter().all(|step| [0.0, 1.0].contains(step)), "the same noise, one step apart at most");
    // A binomial of one half.
    let error = (mean(&steps) - 0.5) / (0.5 / (PIXELS as f64).sqrt());
    assert!(error.abs() < STANDARD_ERRORS, "off by {error}");
    assert!(mean(&rounded) > mean(&cut), "a truncating converter is lower");
}

#[test]
fn one_lsb_is_the_full_well_over_all_numbers() {
    let params = DetectorParams {
        full_well_e: 40_960.0,
        bits: 12,
        gain_e_per_dn: DetectorParams::lsb_e(40_960.0, 12),
        rounding: Rounding::Truncate,
        ..DetectorParams::QUIET
    };
    assert_eq!(params.gain_e_per_dn, 10.0);
    let found = Flats::new(params, SIZE).frame_e(1e6, 1, 0.1);
    assert!(found.iter().all(|e| *e == 40_950.0), "a full pixel is the largest number, 4095");
    let found = mean(&Flats::new(params, SIZE).frame_e(20_004.7, 1, 0.1));
    // int(S / LSB) is half an LSB low in the mean.
    let error = (found + 5.0 - 20_004.7) / (20_004.7 / PIXELS as f64).sqrt();
    assert!(error.abs() < STANDARD_ERRORS, "off by {error}");
}
