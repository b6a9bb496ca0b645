//! Series of frames: tracking, loss and recovery, and the error terms.

use super::super::{AttitudePair, Mode, Outcome, Solution, Tracker, error_terms, predicted_nea_rad};
use super::draw::{Painter, Shot, gaussian, random_attitude};
use super::*;
use base::axes::{Icrf, Rotation, Sensor};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use rand::{SeedableRng, rngs::StdRng};

/// Time between frames, s.
const STEP_S: f64 = 0.1;

/// A tracker looking at a painted sky.
struct Bench {
    painter: Painter,
    tracker: Tracker,
    frame: u32,
}

impl Bench {
    fn new(camera: Camera, guide: Arc<GuideStars>, seed: u64) -> Self {
        let painter = Painter::new(camera, catalog(), noon(), seed);
        Self { painter, tracker: Tracker::new(camera.params, guide), frame: 0 }
    }

    fn look(&mut self, shot: &Shot, reported: Option<DVec3>) -> Outcome {
        let at = noon() + Span::from_s(f64::from(self.frame) * STEP_S);
        self.frame += 1;
        self.tracker.measure(&self.painter.shoot(shot), at, beta(), reported)
    }
}

fn squared_error(solution: &Solution, truth: &Rotation<Sensor, Icrf>) -> f64 {
    let error = solution.sensor_from_icrf.rotation_vector_to(truth);
    error.dot(solution.covariance_rad2.inverse() * error)
}

/// A slew of 1 deg/s, begun at rest with 0.5 deg/s^2, with a gyro and without.
#[test]
fn tracking_follows_a_slew() {
    for with_gyro in [true, false] {
        let camera = Camera { steps: 10, ..Camera::wide() };
        let mut bench = Bench::new(camera, wide_guide(), 41);
        let mut attitude = random_attitude(&mut StdRng::seed_from_u64(41));
        let (mut worst, mut tracked) = (0.0_f64, 0);
        for frame in 0..24_u32 {
            let speed = if with_gyro { (f64::from(frame) * 0.05).min(1.0) } else { 1.0 };
            let rate_rad_s = DVec3::new(0.5, -0.7, 0.5) * speed * DEG;
            let shot = Shot { rate_rad_s, ..Shot::still(attitude, beta()) };
            let outcome = bench.look(&shot, with_gyro.then_some(rate_rad_s));
            let Outcome::Solved(solution) = outcome else { panic!("frame {frame}: {outcome:?}") };
            worst = worst.max(squared_error(&solution, &attitude));
            tracked += u32::from(solution.mode == Mode::Tracking);
            let next = DVec3::new(0.5, -0.7, 0.5) * (if with_gyro { speed + 0.025 } else { 1.0 }).min(1.0) * DEG;
            attitude = attitude.rotated_by(next * STEP_S);
        }
        // Without a gyro the second frame may still be lost in space: only two attitudes give a rate.
        assert!(tracked >= 22, "gyro {with_gyro}: {tracked} of 24 tracked");
        // Chi-square with 3 degrees of freedom exceeds 35 with a probability of 1e-7.
        assert!(worst < 35.0, "gyro {with_gyro}: squared error {worst} of its covariance");
    }
}

/// Tracking's attitudes against their covariances: the mean of 300 is 3 within 0.57.
#[test]
fn tracked_attitudes_follow_the_covariance() {
    let mut bench = Bench::new(Camera::coarse(), coarse_guide(), 42);
    let mut random = StdRng::seed_from_u64(42);
    let (mut squared, mut count) = (0.0, 0.0);
    for _ in 0..30 {
        let mut attitude = random_attitude(&mut random);
        bench.tracker.forget();
        for frame in 0..11 {
            let outcome = bench.look(&Shot::still(attitude, beta()), None);
            let Outcome::Solved(solution) = outcome else { panic!("{outcome:?}") };
            if frame > 0 {
                assert_eq!(solution.mode, Mode::Tracking);
                squared += squared_error(&solution, &attitude);
                count += 1.0;
            }
            // 1.4 px of motion each: other pixel phases.
            attitude = attitude.rotated_by(DVec3::new(0.1, 0.05, 0.0) * DEG);
        }
    }
    assert!((squared / count - 3.0).abs() < 0.57, "{}", squared / count);
    assert!((squared / count / 0.7 - 3.0).abs() > 0.57, "control: covariances 0.7 times as large");
}

#[test]
fn tracking_falls_back_and_recovers() {
    let camera = Camera::coarse();
    let mut bench = Bench::new(camera, coarse_guide(), 43);
    let mut random = StdRng::seed_from_u64(43);
    let (first, second) = (random_attitude(&mut random), random_attitude(&mut random));
    let mut modes = Vec::new();
    // Four frames of one field, then another one without notice.
    for frame in 0..10 {
        let attitude = if frame < 4 { first } else { second };
        let outcome = bench.look(&Shot::still(attitude, beta()), Some(DVec3::ZERO));
        modes.push(match outcome {
            Outcome::Solved(solution) => {
                assert!(squared_error(&solution, &attitude) < 35.0, "frame {frame}: {solution:?}");
                if solution.mode == Mode::Tracking { 'T' } else { 'L' }
            }
            Outcome::NoSolution(_) => '-',
        });
    }
    assert_eq!(modes.iter().collect::<String>(), "LTTT---LTT", "three misses, then lost in space");
    let counts = bench.tracker.counts;
    assert_eq!((counts.lost_in_space, counts.tracking, counts.none, counts.losses), (2, 5, 3, 1));
}

#[test]
fn tracking_bridges_a_missed_frame() {
    let mut bench = Bench::new(Camera::coarse(), coarse_guide(), 44);
    let attitude = random_attitude(&mut StdRng::seed_from_u64(44));
    for frame in 0..6 {
        let light = if frame == 3 { 2e5 } else { 0.0 };
        let outcome = bench.look(&Shot { sky_e: light, ..Shot::still(attitude, beta()) }, None);
        let mode = match outcome {
            Outcome::Solved(solution) => Some(solution.mode),
            Outcome::NoSolution(_) => None,
        };
        let wanted = [Some(Mode::LostInSpace), Some(Mode::Tracking), Some(Mode::Tracking), None][frame.min(3)];
        assert_eq!(mode, if frame > 3 { Some(Mode::Tracking) } else { wanted }, "frame {frame}: {outcome:?}");
    }
}

/// A prediction that is 5 degrees wrong must give no attitude, not a wrong one.
#[test]
fn a_wrong_prediction_is_reported() {
    let mut bench = Bench::new(Camera::coarse(), coarse_guide(), 45);
    let mut random = StdRng::seed_from_u64(45);
    let mut refused = 0;
    for _ in 0..40 {
        let attitude = random_attitude(&mut random);
        bench.tracker.forget();
        assert!(matches!(bench.look(&Shot::still(attitude, beta()), None), Outcome::Solved(_)));
        let jumped = attitude.rotated_by(DVec3::new(3.0, -4.0, 1.0) * DEG);
        let outcome = bench.look(&Shot::still(jumped, beta()), Some(DVec3::ZERO));
        refused += u32::from(matches!(outcome, Outcome::NoSolution(_)));
    }
    assert_eq!(refused, 40);
}

/// Temporal noise of repeated frames against the prediction from the stars' own errors.
#[test]
fn noise_agrees_with_prediction() {
    let camera = Camera::coarse();
    let mut bench = Bench::new(camera, coarse_guide(), 46);
    let mut attitude = random_attitude(&mut StdRng::seed_from_u64(46));
    let (mut series, mut information, mut stars, mut frames) = (Vec::new(), 0.0, 0, 0);
    for _ in 0..25 {
        for _ in 0..8 {
            let outcome = bench.look(&Shot::still(attitude, beta()), None);
            let Outcome::Solved(solution) = outcome else { panic!("{outcome:?}") };
            series.push(AttitudePair { measured: solution.sensor_from_icrf, truth: attitude });
            let used = bench.tracker.matches.iter().filter(|star| star.used);
            information += used.map(|star| star.spot.sigma_px().powi(-2)).sum::<f64>();
            (stars, frames) = (stars + solution.stars, frames + 1);
        }
        attitude = attitude.rotated_by(DVec3::new(0.13, 0.21, 0.05) * DEG);
    }
    let terms = error_terms(&series, &camera.params.geometry).expect("25 stations");
    // The stars count by their information, which a mean of unequal stars must do too.
    let sigma_px = (f64::from(stars) / information).sqrt();
    let predicted = predicted_nea_rad(&camera.params.geometry, stars / frames, sigma_px);
    let ratio = terms.nea_rad / predicted;
    println!("NEA {} arcsec, predicted {}, terms {terms:?}", terms.nea_rad / ARCSEC, predicted / ARCSEC);
    // 175 degrees of freedom: 4 / sqrt(350) = 0.21. The PRNU is fixed, so not temporal, and lowers bright stars' noise.
    assert!((0.65..1.25).contains(&ratio.x) && (0.65..1.25).contains(&ratio.y), "{ratio}");
    // Roll hangs on how far out the few brightest stars happen to be.
    assert!((0.5..1.6).contains(&ratio.z), "{ratio}");
}

/// Made-up errors of known size, each found by its own estimator.
#[test]
fn terms_are_distinguished() {
    let geometry = Camera::coarse().params.geometry;
    let (bias, noise, pixel, slow) = (4.0, 3.0, 6.0, 8.0);
    let mut random = StdRng::seed_from_u64(47);
    let mut series = Vec::new();
    for at in 0..600_u32 {
        let truth = Rotation::IDENTITY.rotated_by(DVec3::X * f64::from(at) * 0.005);
        let phase = gaussian(&mut random) * 10.0;
        let spatial = bias
            + pixel * core::f64::consts::SQRT_2 * phase.sin()
            + slow * core::f64::consts::SQRT_2 * (f64::from(at) * core::f64::consts::TAU / 100.0).cos();
        for _ in 0..4 {
            let error = DVec3::splat(spatial) + DVec3::new(gaussian(&mut random), 0.0, gaussian(&mut random)) * noise;
            series.push(AttitudePair { measured: truth.rotated_by(error * ARCSEC), truth });
        }
    }
    let terms = error_terms(&series, &geometry).expect("600 stations");
    assert_eq!((terms.stations, terms.samples), (600, 2400));
    // 600 stations: 4 / sqrt(1200) = 12 % of a spatial term, 4 / sqrt(3600) = 7 % of the noise.
    let near = |got: f64, wanted: f64, share: f64| (got / ARCSEC / wanted - 1.0).abs() < share;
    let pixel_found = terms.pixel_spatial_rad.expect("repeats");
    assert!(near(terms.bias_rad.x, bias, 0.3), "{terms:?}");
    assert!(near(terms.nea_rad.x, noise, 0.07) && terms.nea_rad.y < 0.01 * ARCSEC, "{terms:?}");
    assert!(near(terms.fov_spatial_rad.x, slow, 0.12), "{terms:?}");
    assert!(near(pixel_found.x, pixel, 0.12) && near(pixel_found.y, pixel, 0.12), "{terms:?}");
    // Control: without repeats noise and pixel error are one.
    let single: Vec<_> = series.iter().step_by(4).copied().collect();
    let terms = error_terms(&single, &geometry).expect("600 stations");
    assert!(terms.pixel_spatial_rad.is_none() && near(terms.nea_rad.x, noise.hypot(pixel), 0.12), "{terms:?}");
    assert!(error_terms(&series[..8], &geometry).is_none(), "two stations are too few");
}
