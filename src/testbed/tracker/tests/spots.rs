//! Background, detection and centroids on painted stars.

use super::super::centroid::{SpotModel, centre_of_gravity, gaussian_fit};
use super::super::detect::{Detector, PEAK_SIGMA};
use super::super::{Reason, TrackerParams};
use super::draw::{Painter, gaussian};
use super::*;
use super::{super::background::BackgroundGrid, super::track::spot_model};
use crate::tracker::centroid::Blend;
use base::image::DnImage;
use glam::DVec2;
use rand::{SeedableRng, rngs::StdRng};

/// Returns a camera without noise and with a fine converter, so that only the method's own error is left.
fn quiet() -> Camera {
    let mut camera = Camera::coarse();
    camera.params.psf_sigma_px = 0.65;
    camera.params.detector.read_noise_e_rms = 0.0;
    (camera.dark_e, camera.dsnu_e_rms, camera.prnu) = (0.0, 0.0, 0.0);
    camera
}

fn model_of(camera: &Camera) -> SpotModel {
    SpotModel { background_sigma_e: 60.0, ..spot_model(&camera.params, DVec2::ZERO) }
}

/// Returns the mean error along x of a method at 20 sub-pixel phases, each over `repeats` stars of 80 000 e.
fn phase_errors(method: impl Fn(&DnImage, DVec2) -> Option<DVec2>, repeats: usize) -> Vec<f64> {
    let mut painter = Painter::new(quiet(), catalog(), noon(), 3);
    let mut errors = Vec::new();
    for phase in 0..20_u8 {
        let offset = f64::from(phase) / 20.0 - 0.5;
        let stars: Vec<_> = (0..repeats)
            .map(|at| (DVec2::new(20.0 + 14.0 * (at % 15) as f64 + offset, 20.0 + 14.0 * (at / 15) as f64 + 0.1), 8e4))
            .collect();
        let image = painter.paint(&stars, 0.0);
        let error = |star: &(DVec2, f64)| (method(&image, star.0.round()).expect("a star") - star.0).x;
        errors.push(stars.iter().map(error).sum::<f64>() / repeats as f64);
    }
    errors
}

fn largest(errors: &[f64]) -> f64 {
    errors.iter().fold(0.0, |most, error| error.abs().max(most))
}

/// Photon noise of 80 000 e leaves 0.0025 px for one star and 0.00018 px for 200; five times that, for 20 phases.
const FIT_PHASE_PX: f64 = 0.0009;

#[test]
fn fit_has_no_pixel_phase_error() {
    let camera = quiet();
    let errors = phase_errors(|image, start| Some(gaussian_fit(image, start, &model_of(&camera))?.place_px), 200);
    println!("fit, px: {errors:.5?}");
    assert!(largest(&errors) < FIT_PHASE_PX, "{errors:.5?}");
    // Control: a model whose spot is 20 % too wide must show the phase.
    let wrong = SpotModel { psf_sigma_px: 0.78, ..model_of(&camera) };
    let errors = phase_errors(|image, start| Some(gaussian_fit(image, start, &wrong)?.place_px), 200);
    assert!(largest(&errors) > FIT_PHASE_PX, "control: {errors:.5?}");
}

/// The pixel integral under a window sampled at pixel centres is not symmetric: for this narrow spot some 0.04 px, with
/// the period of a pixel and zero at its middle.
#[test]
fn centre_of_gravity_has_its_known_pixel_phase_error() {
    let camera = quiet();
    let errors = phase_errors(|image, start| centre_of_gravity(image, start, &model_of(&camera)), 200);
    println!("centre of gravity, px: {errors:.5?}");
    assert!((0.03..0.05).contains(&largest(&errors)), "{errors:.5?}");
    assert!(errors[10].abs() < FIT_PHASE_PX, "zero in the middle of a pixel: {}", errors[10]);
}

/// Chi-square of 400 faint and 400 bright places with their covariances; 2 degrees of freedom each, so the mean is 2
/// within 4 sqrt(4 / 400) = 0.4.
#[test]
fn fit_covariance_is_true() {
    let camera = Camera::coarse();
    let mut random = StdRng::seed_from_u64(4);
    let mut painter = Painter::new(camera, catalog(), noon(), 4);
    for flux_e in [6e3, 1e5] {
        let (mut sum, mut halved, mut count, mut fluxes) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..2 {
            let stars: Vec<_> = (0..200)
                .map(|at| {
                    let jitter = DVec2::new(gaussian(&mut random), gaussian(&mut random)) * 0.5;
                    (DVec2::new(20.0 + 14.0 * f64::from(at % 15), 20.0 + 14.0 * f64::from(at / 15)) + jitter, flux_e)
                })
                .collect();
            let image = painter.paint(&stars, 0.0);
            let noise_e = (55.0_f64.powi(2) + 27.5 * 27.5 + 25.1 * 25.1 / 12.0 + 19.0).sqrt();
            let model = SpotModel {
                background_sigma_e: noise_e,
                background_dn: 100.0 + 19.0 / 25.1,
                ..spot_model(&camera.params, DVec2::ZERO)
            };
            for (truth, _) in &stars {
                let spot = gaussian_fit(&image, truth.round(), &model).expect("a star");
                let [xx, xy, yy] = spot.covariance_px2;
                let error = spot.place_px - *truth;
                let chi = glam::DMat2::from_cols_array(&[xx, xy, xy, yy]).inverse() * error;
                (sum, count, fluxes) = (sum + error.dot(chi), count + 1.0, fluxes + spot.flux_e);
                halved += error.dot(chi) / 0.7;
            }
        }
        assert!((sum / count - 2.0).abs() < 0.4, "{flux_e} e: {}", sum / count);
        assert!((halved / count - 2.0).abs() > 0.4, "control, covariance 0.7 times as large: {}", halved / count);
        assert!((fluxes / count / flux_e - 1.0).abs() < 0.02, "mean flux {}", fluxes / count);
    }
}

#[test]
fn a_trail_is_measured_at_its_middle() {
    let camera = quiet();
    let mut painter = Painter::new(camera, catalog(), noon(), 5);
    let (middle, trail) = (DVec2::new(100.3, 80.6), DVec2::new(4.5, -2.0));
    let points: Vec<_> = (0..40).map(|i| (middle + trail * ((f64::from(i) + 0.5) / 40.0 - 0.5), 2e3)).collect();
    let image = painter.paint(&points, 0.0);
    let model = SpotModel { trail_px: trail, ..model_of(&camera) };
    let spot = gaussian_fit(&image, middle.round(), &model).expect("a trail");
    assert!(spot.place_px.distance(middle) < 5.0 * spot.sigma_px(), "{}", spot.place_px);
    assert!(spot.covariance_px2[0] > 1.5 * spot.covariance_px2[2], "less sharp along the trail: {spot:?}");
    assert!((spot.flux_e / 8e4 - 1.0).abs() < 0.02, "{}", spot.flux_e);
}

#[test]
fn a_saturated_star_keeps_its_place() {
    let camera = quiet();
    let mut painter = Painter::new(camera, catalog(), noon(), 6);
    let truth = DVec2::new(60.2, 61.4);
    let image = painter.paint(&[(truth, 2e6)], 0.0);
    let spot = gaussian_fit(&image, truth.round(), &model_of(&camera)).expect("a star");
    assert!(spot.saturated && spot.place_px.distance(truth) < 0.01, "{spot:?}");
}

/// The predicted pull against the fit of painted pairs, for a faint and a bright star.
#[test]
fn a_neighbour_pulls_as_predicted() {
    let camera = Camera { params: TrackerParams { psf_sigma_px: 0.65, ..Camera::coarse().params }, ..quiet() };
    let blend = Blend::new(&camera.params);
    let model = SpotModel { background_sigma_e: 55.0, prnu: 0.0, ..spot_model(&camera.params, DVec2::ZERO) };
    let limit_e = 10.0 * 55.0 * 3.545 * camera.params.pixel_psf_sigma_px();
    let mut painter = Painter::new(quiet(), catalog(), noon(), 10);
    for (mag, ratio) in [(5.5, 0.05), (2.0, 0.02)] {
        let flux_e = limit_e * 10f64.powf(-0.4 * (mag - camera.params.limiting_mag));
        for distance_px in [0.4, 1.0, 1.6, 2.2] {
            let mut measured = 0.0;
            for phase in 0..200_u8 {
                let truth = DVec2::new(20.0 + f64::from(phase % 10) * 0.1, 40.0 + f64::from(phase / 10) * 0.05);
                let neighbour = (truth + DVec2::X * distance_px, ratio * flux_e);
                let image = painter.paint_quietly(&[(truth, flux_e), neighbour]);
                measured += (gaussian_fit(&image, truth.round(), &model).expect("a star").place_px - truth).x / 200.0;
            }
            let predicted = blend.pull_px(mag, ratio, distance_px);
            println!("G {mag}, {distance_px} px: pull {measured:.4} px, predicted {predicted:.4}");
            // First order: a fifth of the pull, and the converter's rounding.
            assert!((measured - predicted).abs() < 0.2 * predicted + 0.001, "{measured} px, predicted {predicted}");
        }
    }
}

#[test]
fn background_is_found_under_stars() {
    let camera = Camera::coarse();
    let mut painter = Painter::new(camera, catalog(), noon(), 7);
    let stars: Vec<_> = (0..60).map(|i| (DVec2::new(f64::from(i * 37 % 256), f64::from(i * 91 % 256)), 2e4)).collect();
    let image = painter.paint(&stars, 5000.0);
    let mut grid = BackgroundGrid::new(256, 256);
    grid.measure(&image, PEAK_SIGMA);
    let (level, noise) = (100.0 + 5019.0 / 25.1, (55.0_f64.powi(2) + 27.5 * 27.5 + 5019.0).sqrt() / 25.1);
    for (x, y) in [(10.0, 20.0), (128.0, 100.0), (250.0, 255.0)] {
        let found = grid.at(x, y);
        // A thousand samples: 4 / sqrt(1000) of the noise, and the same for stars that clipping leaves.
        assert!((found.level_dn - level).abs() < 0.25 * noise, "{found:?}, wanted {level}");
        assert!((found.sigma_dn / noise - 1.0).abs() < 0.15, "{found:?}, wanted {noise}");
    }
}

#[test]
fn background_follows_a_slope() {
    let mut image = DnImage::new(1024, 1024);
    for (at, dn) in image.pixels_mut().iter_mut().enumerate() {
        *dn = u16::try_from(100 + at % 1024 / 8 + at / 1024 / 16).unwrap();
    }
    let mut grid = BackgroundGrid::new(1024, 1024);
    grid.measure(&image, PEAK_SIGMA);
    for (x, y) in [(512.0, 100.0), (100.0, 900.0), (640.0, 333.0)] {
        let wanted = 100.0 + x / 8.0 + y / 16.0;
        assert!((grid.at(x, y).level_dn - wanted).abs() < 1.5, "{:?}, wanted {wanted}", grid.at(x, y));
    }
}

#[test]
fn stars_are_found_and_hot_pixels_are_not() {
    let camera = Camera::wide();
    let mut painter = Painter::new(camera, catalog(), noon(), 8);
    let stars: Vec<_> = (0..30)
        .map(|i| (DVec2::new(30.2 + 31.3 * f64::from(i), 40.7 + 29.1 * f64::from(i)), 1e4 + 1e4 * f64::from(i)))
        .collect();
    let mut image = painter.paint(&stars, 0.0);
    for i in 0..20 {
        image.pixels_mut()[(900 - 20 * i) * 1024 + 50 + 13 * i] = if i % 2 == 0 { 4095 } else { 300 };
    }
    let (mut grid, mut detector) = (BackgroundGrid::new(1024, 1024), Detector::new(&camera.params));
    grid.measure(&image, PEAK_SIGMA);
    let blobs = detector.find(&image, &grid, 30).expect("a dark sky");
    assert_eq!(blobs.len(), 30);
    for (blob, (place, _)) in blobs.iter().zip(stars.iter().rev()) {
        assert!(blob.place_px.distance(*place) < 0.5, "brightest first: {blob:?} for {place}");
    }
}

#[test]
fn noise_gives_few_spots() {
    let camera = Camera::wide();
    let mut painter = Painter::new(camera, catalog(), noon(), 9);
    let image = painter.paint(&[], 0.0);
    let (mut grid, mut detector) = (BackgroundGrid::new(1024, 1024), Detector::new(&camera.params));
    grid.measure(&image, PEAK_SIGMA);
    // 0.3 peaks are expected in 1e6 pixels; 5 have a probability below 1e-5.
    let blobs = detector.find(&image, &grid, 60).expect("a dark sky").len();
    assert!(blobs < 5, "{blobs}");
    // Control: one bright pixel in eight is light.
    let stripes = image_of_stripes(&mut grid);
    assert_eq!(detector.find(&stripes, &grid, 60).map(<[_]>::len), Err(Reason::StrayLight));
}

/// Returns an image with one bright pixel in eight, measured by a grid that has not seen it.
fn image_of_stripes(grid: &mut BackgroundGrid) -> DnImage {
    let mut image = DnImage::new(1024, 1024);
    image.pixels_mut().fill(100);
    grid.measure(&image, PEAK_SIGMA);
    image.pixels_mut().iter_mut().step_by(8).for_each(|dn| *dn = 1000);
    image
}
