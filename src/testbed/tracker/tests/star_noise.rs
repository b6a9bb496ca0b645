//! Noise by the stars of a field, against the fit of painted stars and the tracker's own estimate.

use super::super::centroid::{SpotModel, gaussian_fit};
use super::super::{ExposedLight, Outcome, StarNoise, Tracker, TrackerParams};
use super::draw::{Painter, Shot, random_attitude};
use super::{super::track::spot_model, *};
use base::time::Span;
use core::f64::consts::PI;
use glam::DVec2;
use rand::{SeedableRng, rngs::StdRng};

/// Noise of a pixel of [`Camera::coarse`]: read noise, fixed pattern, rounding, dark signal.
const BACKGROUND_SIGMA_E: f64 = 62.5;

/// Relative distance of the standard deviation of a place, method to fit.
const PLACE_BOUND: f64 = 0.05;

/// Relative distance of the standard deviation of an attitude, method to the built-in tracker, root mean square over
/// attitudes.
const ATTITUDE_BOUND: f64 = 0.2;

fn light() -> ExposedLight {
    ExposedLight { zero_magnitude_e: 1.12e6, background_sigma_e: BACKGROUND_SIGMA_E, background_e: 0.0 }
}

/// Returns the mean standard deviation of a place that the fit states, over 200 pixel phases, px.
fn fitted_sigma_px(camera: &Camera, flux_e: f64) -> f64 {
    let mut painter = Painter::new(*camera, catalog(), noon(), 6);
    let places: Vec<DVec2> =
        (0..200).map(|at| DVec2::new(20.0 + 14.07 * f64::from(at % 15), 20.0 + 14.03 * f64::from(at / 15))).collect();
    let image = painter.paint_quietly(&places.iter().map(|place| (*place, flux_e)).collect::<Vec<_>>());
    let model = SpotModel { background_sigma_e: BACKGROUND_SIGMA_E, ..spot_model(&camera.params, DVec2::ZERO) };
    let squares = places.iter().map(|place| gaussian_fit(&image, *place, &model).expect("a star").sigma_px().powi(2));
    (squares.sum::<f64>() / 200.0).sqrt()
}

fn camera(psf_sigma_px: f64, saturation_dn: u16) -> Camera {
    let mut camera = Camera::coarse();
    camera.params.psf_sigma_px = psf_sigma_px;
    camera.params.prnu = 0.0;
    camera.params.detector.saturation_dn = saturation_dn;
    camera
}

#[test]
fn a_place_is_as_sure_as_the_fit_says() {
    let off = |camera: &Camera, flux_e: f64| {
        let predicted = StarNoise::place_sigma_px(&camera.params, &light(), flux_e);
        (predicted / fitted_sigma_px(camera, flux_e) - 1.0).abs()
    };
    for psf_sigma_px in [0.6, 0.8, 1.5] {
        for flux_e in [2e3, 2e4, 2e5] {
            let found = off(&camera(psf_sigma_px, u16::MAX), flux_e);
            println!("sigma {psf_sigma_px} px, {flux_e} e: {:.1} % off", 100.0 * found);
            assert!(found < PLACE_BOUND, "{psf_sigma_px} px, {flux_e} e: {found}");
        }
    }
    // A star that saturates its middle: 4000 of 9000 DN.
    let saturated = off(&camera(0.8, 4100), 1e6);
    println!("saturated: {:.1} % off", 100.0 * saturated);
    // Beyond the edge: a spot much narrower than a pixel.
    let narrow = off(&camera(0.3, u16::MAX), 2e5);
    println!("sigma 0.3 px: {:.1} % off", 100.0 * narrow);
    assert!(narrow > PLACE_BOUND, "control: {narrow}");
}

#[test]
fn a_place_has_the_bounds_of_bright_and_of_faint_stars() {
    let params = TrackerParams { prnu: 0.0, ..camera(1.0, u16::MAX).params };
    let variance_px2 = params.pixel_psf_sigma_px().powi(2);
    let bright = StarNoise::place_sigma_px(&params, &ExposedLight { background_sigma_e: 0.01, ..light() }, 1e5);
    // Light beyond the window is left out: exp(-u) (1 + u) at its edge, 0.7 %.
    assert!((bright.powi(2) * 1e5 / variance_px2 - 1.0).abs() < 0.02, "{bright}");
    let faint = StarNoise::place_sigma_px(&params, &ExposedLight { background_sigma_e: 1e4, ..light() }, 1e3);
    let wanted = 8.0 * PI * variance_px2 * variance_px2 * 1e8 / 1e6;
    assert!((faint.powi(2) / wanted - 1.0).abs() < 0.02, "{faint}");
}

/// Standard deviations at 60 attitudes against those that the tracker states there with its pixels.
#[test]
fn attitudes_are_as_sure_as_the_tracker_says() {
    let camera = Camera::coarse();
    let mut tracker = Tracker::new(camera.params, coarse_guide());
    let mut painter = Painter::new(camera, catalog(), noon(), 8);
    let mut noise = StarNoise::new(&camera.params, coarse_guide(), &light());
    let mut random = StdRng::seed_from_u64(48);
    let (mut squares, mut even, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for _ in 0..60 {
        let attitude = random_attitude(&mut random);
        tracker.forget();
        let mut look = |at| tracker.measure(&painter.shoot(&Shot::still(attitude, beta())), at, beta(), None);
        // The second frame is of all stars that it expects, not only of the clear ones.
        look(noon());
        let Outcome::Solved(solution) = look(noon() + Span::from_ms(100)) else { continue };
        let (covariance, stars) = noise.covariance_rad2(&attitude).expect("enough stars");
        let diagonal = |m: &glam::DMat3| DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z).map(f64::sqrt);
        let stated = diagonal(&solution.covariance_rad2);
        assert!(stars.abs_diff(solution.stars as usize) <= 6, "{stars} and {}", solution.stars);
        let log = |a: DVec3, b: DVec3| (a / b).map(|ratio| ratio.ln().powi(2));
        squares += log(diagonal(&covariance), stated);
        even += log(noise.sky_sigma_rad, stated);
        count += 1.0;
    }
    assert!(count > 50.0, "{count}");
    let (off, off_even) = ((squares / count).map(f64::sqrt), (even / count).map(f64::sqrt));
    println!("off by {off:.3}; a noise that is even over the sky by {off_even:.3}");
    assert!(off.max_element() < ATTITUDE_BOUND, "{off}");
    assert!(off_even.min_element() > ATTITUDE_BOUND, "control: {off_even}");
}

#[test]
fn noise_over_the_sky_has_the_root_mean_square_of_its_figures() {
    let camera = Camera::coarse();
    let mut noise = StarNoise::new(&camera.params, coarse_guide(), &light());
    let mut random = StdRng::seed_from_u64(49);
    let (mut sums, mut count, mut differ) = ([DVec3::ZERO; 2], 0.0, 0.0_f64);
    for _ in 0..1000 {
        let Some(field) = noise.at(&random_attitude(&mut random)) else { continue };
        let variances = [field.factor, field.spatial].map(|root| {
            let covariance = root * root.transpose();
            DVec3::new(covariance.x_axis.x, covariance.y_axis.y, covariance.z_axis.z)
        });
        sums = [sums[0] + variances[0], sums[1] + variances[1]];
        differ = differ.max((variances[0] / variances[1]).map(|ratio| ratio.ln().abs()).max_element());
        count += 1.0;
    }
    for sum in sums {
        let rms = (sum / count).map(f64::sqrt);
        assert!((rms - DVec3::ONE).abs().max_element() < 0.1, "{rms} of {count} attitudes");
    }
    assert!(differ > 0.2, "control: spatial errors follow the field by their own law: {differ}");
    // Fields without as many stars as it needs.
    let few = TrackerParams { limiting_mag: 7.0, fewest_stars: 200, most_stars: 300, ..camera.params };
    assert_eq!(StarNoise::new(&few, coarse_guide(), &light()).at(&random_attitude(&mut random)), None);
}

/// Fainter stars and a brighter background against the same light from the start; a full well leaves nothing.
#[test]
fn other_light_counts_as_if_present_from_the_start() {
    let camera = Camera::coarse();
    let mut noise = StarNoise::new(&camera.params, coarse_guide(), &light());
    let usual_rad = noise.sky_sigma_rad;
    let attitude = random_attitude(&mut StdRng::seed_from_u64(50));
    let before = noise.covariance_rad2(&attitude).expect("enough stars");
    let brighter = ExposedLight { background_sigma_e: 2.0 * BACKGROUND_SIGMA_E, background_e: 1e4, ..light() };
    let fainter = ExposedLight { zero_magnitude_e: 0.3 * light().zero_magnitude_e, ..light() };
    for other in [brighter, fainter] {
        noise.expose(&other);
        let mut made = StarNoise::new(&camera.params, coarse_guide(), &other);
        assert_eq!(noise.covariance_rad2(&attitude), made.covariance_rad2(&attitude));
        assert_eq!(noise.sky_sigma_rad, usual_rad, "noise is given in that of the usual light");
        let ratio = noise.covariance_rad2(&attitude).expect("enough stars").0.x_axis.x / before.0.x_axis.x;
        assert!(ratio > 1.5, "{ratio}");
    }
    noise.expose(&ExposedLight { background_e: 1e9, ..light() });
    assert_eq!(noise.at(&attitude), None, "saturated all over");
    noise.expose(&light());
    assert_eq!(noise.covariance_rad2(&attitude).expect("enough stars"), before, "control: the usual light again");
}
