//! Signal-to-noise ratios and limiting magnitudes: by formulae written afresh, and by frames that are drawn, read out
//! and measured.

use crate::noise::STANDARD_ERRORS;
use crate::scene::{EXPOSURE_S, draw_cpu, planner, star};
use base::image::{DnImage, ElectronImage, Image};
use config::{Camera, Document};
use image::detector::{Detector, DetectorConditions, DetectorParams};
use plan::optics::PsfModel;
use plan::optics::snr::{PixelNoise, Window, electrons_for_snr};
use run::wiring::camera_parts::camera_params;
use run::wiring::sensitivity::{Conditions, Sensitivity};

/// Largest distance of a limiting magnitude of a camera file from the case that it represents, mag.
const CASE_MAG: f64 = 0.05;
/// How near ours must be to the formula of this file, mag.
const SAME_MAG: f64 = 1e-3;

fn camera(name: &str) -> Camera {
    Camera::from_document(&Document::built_in(&format!("cameras/{name}.toml")).unwrap()).unwrap()
}

fn sensitivity(camera: &Camera, bp_rp: f64) -> Sensitivity {
    Sensitivity::new(&camera_params(camera).unwrap(), &Conditions { bp_rp, ..Conditions::default() })
}

/// Returns the limiting magnitude of the sum over 3 x 3 pixels, from the camera file's numbers and a zero point.
fn limit_by_hand(camera: &Camera, sigma_px: f64, zero_point_e_per_s: f64, snr: f64) -> f64 {
    let d = &camera.detector.params;
    let t = camera.exposure.exposure_s;
    let share = libm::erf(1.5 / (sigma_px * core::f64::consts::SQRT_2)).powi(2);
    let noise = 9.0 * (d.dark_e_per_s * t + d.read_noise_e_rms.powi(2) + d.gain_e_per_dn.powi(2) / 12.0);
    // signal^2 - snr^2 signal - snr^2 noise = 0
    let signal = 0.5 * snr * (snr + (snr * snr + 4.0 * noise).sqrt());
    2.5 * (zero_point_e_per_s * t * share / signal).log10()
}

#[test]
fn the_case_of_magnitude_15_at_snr_3() {
    let camera = camera("detection_limit_15mag");
    let limit = sensitivity(&camera, 0.82).limiting_mag(3.0).unwrap();
    // 3.2e10 photons, a pupil of 90 mm, transmission 0.85, QE 0.70.
    let zero_point = 3.2e10 * core::f64::consts::FRAC_PI_4 * 0.09 * 0.09 * 0.85 * 0.70;
    let by_hand = limit_by_hand(&camera, 0.7, zero_point, 3.0);
    println!("15 mag at SNR 3: {limit:.4}, by hand {by_hand:.4}");
    assert!((limit - 15.0).abs() < CASE_MAG && (limit - by_hand).abs() < SAME_MAG, "{limit} {by_hand}");
    assert!((limit - limit_by_hand(&camera, 0.7, zero_point, 5.0)).abs() > CASE_MAG, "the comparison can fail");
}

#[test]
fn the_case_of_magnitude_22_at_snr_3() {
    let camera = camera("detection_limit_22mag");
    let limit = sensitivity(&camera, 0.82).limiting_mag(3.0).unwrap();
    // Electrons per second at G = 0, BP-RP = 0.82, computed by another program from Gaia's passbands at every
    // nanometre.
    let by_hand = limit_by_hand(&camera, 0.75, 3.8402e9, 3.0);
    println!("22 mag at SNR 3: {limit:.4}, by hand {by_hand:.4}");
    assert!((limit - 22.0).abs() < CASE_MAG && (limit - by_hand).abs() < SAME_MAG, "{limit} {by_hand}");
    let red = sensitivity(&camera, 3.0).limiting_mag(3.0).unwrap();
    assert!((limit - red).abs() > 0.01, "colour matters: {red}");
}

/// Side of the frames, px.
const SIZE: usize = 512;
/// Distance of the stars from each other, px.
const PITCH: usize = 16;
/// Frames of each brightness.
const FRAMES: u32 = 8;
/// PSF.
const SIGMA_PX: f64 = 0.7;

/// Returns a detector of the class of the 15 mag camera, noisy enough that its rounding is one noise among others.
fn detector() -> DetectorParams {
    let camera = camera("detection_limit_15mag");
    let params = camera_params(&camera).unwrap().detector;
    DetectorParams { gain_e_per_dn: 3.0, dark_e_per_s: 20.0, prnu: 0.0, dsnu_e_rms: 0.0, ..params }
}

fn pixel_noise(params: &DetectorParams) -> PixelNoise {
    PixelNoise {
        dark_e: params.dark_e_per_s * EXPOSURE_S,
        background_e: 0.0,
        read_noise_e_rms: params.read_noise_e_rms,
        lsb_e: params.gain_e_per_dn,
        prnu: params.prnu,
        dsnu_e_rms: params.dsnu_e_rms,
    }
}

fn psf() -> PsfModel {
    PsfModel::gaussian(SIGMA_PX)
}

/// Middles of the stars' pixels.
fn places() -> impl Iterator<Item = [usize; 2]> {
    let row = || (PITCH / 2..SIZE).step_by(PITCH);
    row().flat_map(move |y| row().map(move |x| [x, y]))
}

/// Returns the mean electrons of a frame with a star of so many electrons on each place, drawn by the CPU backend.
fn drawn(electrons: f64) -> ElectronImage {
    let stars: Vec<_> = (0..).zip(places()).map(|(id, [x, y])| star(id, electrons, [x as f64, y as f64])).collect();
    let mut planner = planner(SIZE, &psf(), "static", crate::scene::los(), None);
    let picture = draw_cpu(planner.plan(&stars));
    let mut image = Image::new(SIZE, SIZE);
    for (pixel, value) in image.pixels_mut().iter_mut().zip(&picture.pixels) {
        #[allow(clippy::cast_possible_truncation, reason = "electron images are f32")]
        let value = *value as f32;
        *pixel = value;
    }
    image
}

/// Returns weighted sums over every star's window in every frame, e-, with the dark signal taken off.
fn sums(params: DetectorParams, electrons: f64, side_px: usize, weight: impl Fn(usize) -> f64) -> Vec<f64> {
    let (mean, mut detector) = (drawn(electrons), Detector::new(params, SIZE, SIZE, 99));
    let half = side_px / 2;
    let mut dn = DnImage::new(SIZE, SIZE);
    let mut out = Vec::new();
    for frame in 0..FRAMES {
        detector.collect(&mean, frame, &DetectorConditions::dark(EXPOSURE_S), &mut dn);
        out.extend(places().map(|[x, y]| {
            let pixels = (y - half..=y + half).flat_map(|y| (x - half..=x + half).map(move |x| [x, y]));
            let electrons = pixels.map(|[x, y]| {
                let dn = f64::from(dn.get(x, y).unwrap());
                (dn - params.black_level_dn) * params.gain_e_per_dn - params.dark_e_per_s * EXPOSURE_S
            });
            electrons.enumerate().map(|(i, e)| weight(i) * e).sum::<f64>()
        }));
    }
    out
}

fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt())
}

/// Returns the relative standard error of an SNR measured on `n` sums: of the mean and of sigma.
fn standard_error(snr: f64, n: usize) -> f64 {
    (1.0 / (snr * snr) + 0.5).sqrt() / (n as f64).sqrt()
}

#[test]
fn measured_snr_agrees_with_the_formula() {
    let (params, pixel) = (detector(), pixel_noise(&detector()));
    let window = Window::new(&psf(), 3);
    let noise = window.noise(&pixel);
    for asked in [3.0, 5.0, 20.0, 150.0] {
        let electrons = electrons_for_snr(asked, &noise);
        let (mean, sigma) = mean_and_sigma(&sums(params, electrons, 3, |_| 1.0));
        let (measured, n) = (mean / sigma, places().count() * FRAMES as usize);
        let allowed = STANDARD_ERRORS * standard_error(asked, n);
        println!("SNR {asked}: measured {measured:.3} on {n} stars, {:+.2} %", 100.0 * (measured / asked - 1.0));
        assert!(allowed < 0.045 && (measured / asked - 1.0).abs() < allowed, "{asked}: {measured}");
        assert!((mean / (electrons * window.share()) - 1.0).abs() < STANDARD_ERRORS / asked / (n as f64).sqrt());
        // The comparison can fail: without the rounding noise (or the readout's) faint stars would be clearer.
        if asked < 10.0 {
            for wrong in [PixelNoise { lsb_e: 0.0, ..pixel }, PixelNoise { read_noise_e_rms: 0.0, ..pixel }] {
                let predicted = window.noise(&wrong).snr(electrons);
                assert!((measured / predicted - 1.0).abs() > allowed, "{wrong:?}: {predicted}");
            }
        }
    }
}

#[test]
fn measured_snr_of_optimal_weights_agrees_and_is_better() {
    let (params, pixel) = (detector(), pixel_noise(&detector()));
    let window = Window::new(&psf(), 5);
    let shares: Vec<f64> = (0..25_i32).map(|i| psf().pixel(f64::from(i % 5 - 2), f64::from(i / 5 - 2))).collect();
    for electrons in [40.0, 400.0] {
        let weights: Vec<f64> = shares.iter().map(|share| share / (electrons * share + pixel.variance_e2())).collect();
        let (mean, sigma) = mean_and_sigma(&sums(params, electrons, 5, |i| weights[i]));
        let (predicted, measured) = (window.snr_optimal(electrons, &pixel), mean / sigma);
        let allowed = STANDARD_ERRORS * standard_error(predicted, places().count() * FRAMES as usize);
        println!("{electrons} e-, optimal weights: measured {measured:.3}, predicted {predicted:.3}");
        assert!((measured / predicted - 1.0).abs() < allowed, "{measured} {predicted}");
        let plain = window.noise(&pixel).snr(electrons);
        assert!((measured / plain - 1.0).abs() > allowed, "a plain sum is worse: {plain}");
    }
}

#[test]
fn the_pattern_of_the_photo_response_is_separate() {
    // Bright stars on a detector with 3 % PRNU: from star to star it is a noise, from frame to frame it is not.
    let params = DetectorParams { prnu: 0.03, ..detector() };
    let pixel = pixel_noise(&params);
    let terms = Window::new(&psf(), 3).terms(30_000.0, &pixel);
    let all = sums(params, 30_000.0, 3, |_| 1.0);
    let stars = places().count();
    let of_star = |i: usize| (0..FRAMES as usize).map(|frame| all[frame * stars + i]).collect::<Vec<f64>>();
    let temporal = ((0..stars).map(|i| mean_and_sigma(&of_star(i)).1.powi(2)).sum::<f64>() / stars as f64).sqrt();
    let spatial = mean_and_sigma(&(0..stars).map(|i| mean_and_sigma(&of_star(i)).0).collect::<Vec<f64>>()).1;
    let pattern = (spatial.powi(2) - temporal.powi(2) / f64::from(FRAMES)).sqrt();
    println!(
        "temporal {temporal:.1} e- ({:.1}), pattern {pattern:.1} e- ({:.1})",
        terms.signal_e / terms.snr,
        terms.prnu_e
    );
    let n = (stars * (FRAMES as usize - 1)) as f64;
    assert!((temporal * terms.snr / terms.signal_e - 1.0).abs() < STANDARD_ERRORS / (2.0 * n).sqrt());
    assert!((pattern / terms.prnu_e - 1.0).abs() < STANDARD_ERRORS / (2.0 * stars as f64).sqrt(), "{pattern}");
    assert!(pattern > 2.0 * temporal, "and matters");
}
