//! The detector's statistics: shot and read noise, fixed patterns, saturation, conversion, repeatability.
//!
//! Seeds are fixed, so a test here passes or fails for ever; the bounds are those of a random seed: moments within
//! [`STANDARD_ERRORS`] (false alarm 6e-7 each), chi-square at [`FALSE_ALARM_Z`].

use base::image::{DnImage, ElectronImage, Image};
use image::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};

/// Side of the images, px.
const SIZE: usize = 512;
/// Pixels of an image.
const PIXELS: usize = SIZE * SIZE;
/// Moments may be off by so many standard errors: false alarm 5.7e-7.
pub(crate) const STANDARD_ERRORS: f64 = 5.0;
/// Normal quantile of the chi-square tests' false-alarm rate, 1e-5.
const FALSE_ALARM_Z: f64 = 4.265;
/// Least expected count of a chi-square bin.
const LEAST_EXPECTED: f64 = 50.0;
/// Exposure, s.
const EXPOSURE_S: f64 = 0.1;
/// Seed of every detector.
const SEED: u64 = 20_240_601;

/// Returns a detector with shot noise only, one electron per DN.
pub(crate) fn shot_only() -> DetectorParams {
    DetectorParams::QUIET
}

fn flat(electrons: f64) -> ElectronImage {
    let mut image = Image::new(SIZE, SIZE);
    #[allow(clippy::cast_possible_truncation, reason = "electron images are f32")]
    image.pixels_mut().fill(electrons as f32);
    image
}

fn detector(params: DetectorParams) -> Detector {
    Detector::new(params, SIZE, SIZE, SEED)
}

fn read_out(detector: &mut Detector, mean: &ElectronImage, frame: u32) -> DnImage {
    let mut dn = DnImage::new(SIZE, SIZE);
    detector.collect(mean, frame, &DetectorConditions::dark(EXPOSURE_S), &mut dn);
    dn
}

/// Returns the DN of a flat image over `frames` frames.
fn values(params: DetectorParams, electrons: f64, frames: u32) -> Vec<f64> {
    let (mut detector, mean) = (detector(params), flat(electrons));
    let frame =
        |frame| read_out(&mut detector, &mean, frame).pixels().iter().map(|dn| f64::from(*dn)).collect::<Vec<_>>();
    (0..frames).flat_map(frame).collect()
}

fn mean_of(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn central(values: &[f64], order: i32) -> f64 {
    let mean = mean_of(values);
    values.iter().map(|v| (v - mean).powi(order)).sum::<f64>() / values.len() as f64
}

/// Returns the counted electrons at mean `lambda`: DN with the black level moved down so that 16 bits hold them.
fn counts(lambda: f64, frames: u32) -> Vec<f64> {
    counts_by(PoissonMethod::Auto, lambda, frames)
}

/// Returns the same, drawn by `poisson`.
pub(crate) fn counts_by(poisson: PoissonMethod, lambda: f64, frames: u32) -> Vec<f64> {
    let below = if lambda > 6e4 { (lambda - 3e4).round() } else { 0.0 };
    let params = DetectorParams { black_level_dn: -below, poisson, ..shot_only() };
    values(params, lambda, frames).into_iter().map(|dn| dn + below).collect()
}

/// Returns the probability of `k` at mean `lambda`.
fn poisson(k: f64, lambda: f64) -> f64 {
    (k * lambda.ln() - lambda - libm::lgamma(k + 1.0)).exp()
}

/// Returns chi-square of `counts` against Poisson's law, and the value it must not pass.
pub(crate) fn chi_square(counts: &[f64], lambda: f64) -> (f64, f64) {
    let n = counts.len() as f64;
    let spread = 8.0 * lambda.sqrt() + 12.0;
    let (low, high) = ((lambda - spread).floor().max(0.0), (lambda + spread).ceil());
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bins within the spread")]
    let place = |k: f64| (k.clamp(low, high) - low) as usize;
    let mut seen = vec![0.0; place(high) + 1];
    for k in counts {
        seen[place(*k)] += 1.0;
    }
    // Neighbouring values join until enough are expected; what is left joins the last bin.
    let mut bins: Vec<(f64, f64)> = vec![(0.0, 0.0)];
    for (i, seen) in seen.iter().enumerate() {
        let last = bins.last_mut().expect("there is one");
        last.0 += seen;
        last.1 += n * poisson(low + i as f64, lambda);
        if last.1 >= LEAST_EXPECTED {
            bins.push((0.0, 0.0));
        }
    }
    let rest = bins.pop().expect("there is one");
    let last = bins.last_mut().expect("more than one bin");
    *last = (last.0 + rest.0, last.1 + rest.1);
    let chi2 = bins.iter().map(|(seen, expected)| (seen - expected).powi(2) / expected).sum();
    // Wilson and Hilferty (1931).
    let freedom = bins.len() as f64 - 1.0;
    let ninth = 2.0 / (9.0 * freedom);
    (chi2, freedom * (1.0 - ninth + FALSE_ALARM_Z * ninth.sqrt()).powi(3))
}

/// Returns the standard errors by which mean and variance of `counts` are off Poisson's.
pub(crate) fn moment_errors(counts: &[f64], lambda: f64) -> [f64; 2] {
    let n = counts.len() as f64;
    // Variance of a sample variance: (mu4 - s^4) / n with mu4 = lambda + 3 lambda^2.
    let of_variance = ((lambda + 2.0 * lambda * lambda) / n).sqrt();
    [(mean_of(counts) - lambda) / (lambda / n).sqrt(), (central(counts, 2) - lambda) / of_variance]
}

#[test]
fn shot_noise_is_poisson() {
    for lambda in [0.1, 1.0, 5.0, 19.9, 20.0, 50.0, 1e3, 1e5] {
        // The image holds the nearest f32.
        #[allow(clippy::cast_possible_truncation, reason = "electron images are f32")]
        let lambda = f64::from(lambda as f32);
        let counts = counts(lambda, 4);
        let [mean, variance] = moment_errors(&counts, lambda);
        let (chi2, limit) = chi_square(&counts, lambda);
        println!(
            "mean {lambda:8.1}: off by {mean:+.1} and {variance:+.1} standard errors, chi-square {chi2:.0} < {limit:.0}"
        );
        assert!(mean.abs() < STANDARD_ERRORS, "mean {lambda}: off by {mean} standard errors");
        assert!(variance.abs() < STANDARD_ERRORS, "variance at {lambda}: off by {variance} standard errors");
        assert!(chi2 < limit, "law at {lambda}: chi-square {chi2}, wanted below {limit}");
    }
}

#[test]
fn another_law_fails_the_same_tests() {
    // The textbook's rounded normal, from the detector's own read noise at zero light.
    let params = DetectorParams { read_noise_e_rms: 5.0_f64.sqrt(), black_level_dn: 1005.0, ..shot_only() };
    let rounded: Vec<f64> = values(params, 0.0, 4).into_iter().map(|dn| (dn - 1000.0).max(0.0)).collect();
    let (chi2, limit) = chi_square(&rounded, 5.0);
    assert!(chi2 > 10.0 * limit, "a rounded normal at mean 5: chi-square {chi2}, limit {limit}");
    let counts = counts(50.0, 4);
    let [mean, variance] = moment_errors(&counts, 50.0 * 1.002);
    assert!(mean.abs() > STANDARD_ERRORS, "0.2 % of mean: {mean}");
    let scaled: Vec<f64> = counts.iter().map(|v| 50.0 + (v - 50.0) * 1.005).collect();
    assert!(moment_errors(&scaled, 50.0)[1].abs() > STANDARD_ERRORS, "1 % of variance: {variance}");
}

/// Returns the read noise of 10 e- at 10 DN per electron, dark.
fn read_noise() -> DetectorParams {
    DetectorParams { read_noise_e_rms: 10.0, gain_e_per_dn: 0.1, black_level_dn: 30_000.0, ..shot_only() }
}

#[test]
fn read_noise_is_normal() {
    let values = values(read_noise(), 0.0, 4);
    let n = values.len() as f64;
    let variance = 1e4 + 1.0 / 12.0;
    let mean = (mean_of(&values) - 30_000.0) / (variance / n).sqrt();
    let spread = (central(&values, 2) / variance - 1.0) / (2.0 / n).sqrt();
    let kurtosis = (central(&values, 4) / (variance * variance) - 3.0) / (24.0 / n).sqrt();
    let skewness = central(&values, 3) / variance.powf(1.5) / (6.0 / n).sqrt();
    for (what, errors) in [("mean", mean), ("variance", spread), ("skewness", skewness), ("kurtosis", kurtosis)] {
        assert!(errors.abs() < STANDARD_ERRORS, "{what}: off by {errors} standard errors");
    }
    for sigmas in [1.0, 2.0, 3.0, 4.0] {
        // A DN counts as beyond when its rounding interval is.
        let limit = (sigmas * 100.0_f64).round() + 0.5;
        let share = libm::erfc(limit / 100.0 * core::f64::consts::FRAC_1_SQRT_2);
        let beyond = values.iter().filter(|v| (**v - 30_000.0).abs() > limit).count() as f64;
        let errors = (beyond - n * share) / (n * share).sqrt();
        assert!(errors.abs() < STANDARD_ERRORS, "beyond {sigmas} sigma: {beyond}, wanted {}", n * share);
    }
    let furthest = values.iter().fold(0.0_f64, |most, v| most.max((v - 30_000.0).abs()));
    assert!((430.0..570.0).contains(&furthest), "the tail reaches {furthest} DN of 100 DN rms");
}

#[test]
fn photon_transfer_slope_is_the_reciprocal_gain() {
    for gain_e_per_dn in [0.5, 2.0] {
        let params = DetectorParams { gain_e_per_dn, read_noise_e_rms: 8.0, black_level_dn: 200.0, ..shot_only() };
        // Least squares of variance on mean, each level weighted by its standard error.
        let (mut w, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        // A frame of its own for every level: the draws of one frame are the same at all levels.
        let mut detector = detector(params);
        for (frame, electrons) in (0..).zip([200.0, 1000.0, 3000.0, 8000.0, 15_000.0, 25_000.0]) {
            let dn = read_out(&mut detector, &flat(electrons), frame);
            let values: Vec<f64> = dn.pixels().iter().map(|dn| f64::from(*dn)).collect();
            let (mean, variance) = (mean_of(&values), central(&values, 2));
            let weight = PIXELS as f64 / (2.0 * variance * variance);
            w += weight;
            x += weight * mean;
            y += weight * variance;
            xx += weight * mean * mean;
            xy += weight * mean * variance;
        }
        let slope = (w * xy - x * y) / (w * xx - x * x);
        let error = (w / (w * xx - x * x)).sqrt();
        let wanted = 1.0 / gain_e_per_dn;
        println!("gain {gain_e_per_dn}: slope {slope:.4} +- {error:.4}, wanted {wanted}");
        assert!((slope - wanted).abs() < STANDARD_ERRORS * error, "slope {slope} +- {error}, wanted {wanted}");
        assert!((slope - 1.02 * wanted).abs() > STANDARD_ERRORS * error, "2 % of gain would be seen");
    }
}

/// Returns the mean DN of every pixel over `frames` frames of a flat image.
fn averaged(detector: &mut Detector, electrons: f64, frames: u32) -> Vec<f64> {
    let mean = flat(electrons);
    let mut sum = vec![0.0; PIXELS];
    for frame in 0..frames {
        for (sum, dn) in sum.iter_mut().zip(read_out(detector, &mean, frame).pixels()) {
            *sum += f64::from(*dn) / f64::from(frames);
        }
    }
    sum
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean_of(a), mean_of(b));
    let covariance = a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / a.len() as f64;
    covariance / (central(a, 2) * central(b, 2)).sqrt()
}

#[test]
fn fixed_patterns_have_their_size_and_stay() {
    const FRAMES: u32 = 16;
    let check = |params: DetectorParams, electrons: f64, pattern_dn: f64, temporal_dn2: f64| {
        let mut detector = detector(params);
        let pixels = averaged(&mut detector, electrons, FRAMES);
        let wanted = pattern_dn * pattern_dn + temporal_dn2 / f64::from(FRAMES);
        let errors = (central(&pixels, 2) / wanted - 1.0) / (2.0 / PIXELS as f64).sqrt();
        assert!(errors.abs() < STANDARD_ERRORS, "spread: off by {errors} standard errors");
        let patterns = detector.patterns();
        let map = patterns.prnu.as_ref().or(patterns.dsnu_e.as_ref());
        let map: Vec<f64> = map.expect("one is on").iter().map(|v| f64::from(*v)).collect();
        let expected = pattern_dn / wanted.sqrt();
        let found = correlation(&pixels, &map);
        // Standard error of a correlation r: (1 - r^2) / sqrt n.
        let error = (1.0 - expected * expected) / (PIXELS as f64).sqrt();
        assert!((found - expected).abs() < STANDARD_ERRORS * error, "correlation {found}, wanted {expected}");
    };
    // PRNU adds its square to the shot noise of the mean; rounding adds 1/12 DN^2 to every frame.
    let prnu = DetectorParams { prnu: 0.02, ..shot_only() };
    check(prnu, 1e4, 200.0, 1e4 + 1.0 / 12.0);
    let dsnu = DetectorParams {
        dsnu_e_rms: 4.0,
        read_noise_e_rms: 3.0,
        gain_e_per_dn: 0.1,
        black_level_dn: 1000.0,
        ..shot_only()
    };
    check(dsnu, 0.0, 40.0, 900.0 + 1.0 / 12.0);
}

#[test]
fn dark_current_adds_its_mean_and_its_shot_noise() {
    let params = DetectorParams { dark_e_per_s: 300.0, ..shot_only() };
    let counts = values(params, 0.0, 4);
    let [mean, variance] = moment_errors(&counts, 300.0 * EXPOSURE_S);
    assert!(mean.abs() < STANDARD_ERRORS && variance.abs() < STANDARD_ERRORS, "off by {mean} and {variance}");
}

/// Returns every DN of a pixel that is full to exactly `full_well_e`.
fn full(full_well_e: f64, params: DetectorParams) -> Vec<f64> {
    let params = DetectorParams { full_well_e, ..params };
    values(params, 3.0 * full_well_e + 1000.0, 1)
}

#[test]
fn wells_fill_and_numbers_clip() {
    let at_two = DetectorParams { gain_e_per_dn: 2.0, black_level_dn: 10.0, ..shot_only() };
    let all = |values: Vec<f64>, wanted: f64| values.iter().all(|v| (v - wanted).abs() < 0.5);
    assert!(all(full(1e5, at_two), 50_010.0), "full wells carry no shot noise");
    assert!(all(full(101.0, at_two), 61.0), "60.5 rounds up");
    assert!(all(full(100.9, at_two), 60.0), "60.45 rounds down");
    assert!(!all(full(101.0, at_two), 60.0), "the comparison sees one DN");
    assert!(all(full(1e5, DetectorParams { bits: 12, ..at_two }), 4095.0), "the ADC ends at its bits");
    assert!(all(full(1e6, at_two), 65_535.0), "and at 16 bits does not wrap");
    // Half of a dark frame's read noise is negative: it clips at 0.
    let dark = DetectorParams { read_noise_e_rms: 10.0, ..shot_only() };
    let values = values(dark, 0.0, 1);
    let zero = values.iter().filter(|v| **v < 0.5).count() as f64;
    let share = 0.5 * libm::erfc(-0.05 * core::f64::consts::FRAC_1_SQRT_2);
    let errors = (zero - share * PIXELS as f64) / (share * (1.0 - share) * PIXELS as f64).sqrt();
    assert!(errors.abs() < STANDARD_ERRORS, "zeros: off by {errors} standard errors");
    assert!(values.iter().all(|v| *v < 70.0), "nothing wraps round");
}

/// Returns the correlation of values with those `lag` places on, and of their squares about the mean.
fn lagged(values: &[f64], lag: usize) -> [f64; 2] {
    let mean = mean_of(values);
    let squares: Vec<f64> = values.iter().map(|v| (v - mean).powi(2)).collect();
    [values, &squares].map(|v| correlation(&v[..v.len() - lag], &v[lag..]))
}

#[test]
fn pixels_and_frames_are_independent() {
    let limit = STANDARD_ERRORS / (PIXELS as f64).sqrt();
    for (what, params, electrons) in
        [("read noise", read_noise(), 0.0), ("low light", shot_only(), 8.0), ("light", shot_only(), 900.0)]
    {
        let (mut detector, mean) = (detector(params), flat(electrons));
        let frames: Vec<Vec<f64>> = (0..3)
            .map(|frame| read_out(&mut detector, &mean, frame).pixels().iter().map(|dn| f64::from(*dn)).collect())
            .collect();
        for lag in [1, 2, 3, SIZE - 1, SIZE, SIZE + 1] {
            for r in lagged(&frames[0], lag) {
                assert!(r.abs() < limit, "{what}, {lag} pixels on: {r}, limit {limit}");
            }
        }
        for other in &frames[1..] {
            let r = correlation(&frames[0], other);
            assert!(r.abs() < limit, "{what}, frame to frame: {r}");
        }
        let leak: Vec<f64> = frames[0].iter().zip(&frames[1]).map(|(a, b)| b + 0.02 * a).collect();
        assert!(correlation(&frames[0], &leak) > limit, "{what}: two per cent of leak must be seen");
    }
}

#[test]
fn a_frame_replays_alone_and_bit_for_bit() {
    let params =
        DetectorParams { prnu: 0.01, dsnu_e_rms: 2.0, read_noise_e_rms: 10.0, black_level_dn: 100.0, ..shot_only() };
    let mean = flat(300.0);
    let mut running = detector(params);
    let in_order: Vec<DnImage> = (0..8).map(|frame| read_out(&mut running, &mean, frame)).collect();
    assert_eq!(read_out(&mut running, &mean, 7), in_order[7], "again");
    assert_eq!(read_out(&mut detector(params), &mean, 7), in_order[7], "alone");
    assert_ne!(in_order[6], in_order[7], "another frame is another draw");
    let mut other = Detector::new(params, SIZE, SIZE, SEED + 1);
    assert_ne!(read_out(&mut other, &mean, 7), in_order[7], "another seed is another draw");
}
