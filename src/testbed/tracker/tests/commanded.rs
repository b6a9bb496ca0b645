//! A tracker that commands its camera: windows that follow the stars, and what it asks for when it has lost them.

use super::super::{CameraOrders, CameraWish, Exposed, Mode, Outcome, Tracker};
use super::draw::{Painter, Shot, random_attitude};
use super::*;
use base::{region::Regions, time::Span, units::DEG};
use rand::{SeedableRng, rngs::StdRng};

/// Time between frames, s.
const STEP_S: f64 = 0.1;
const ORDERS: CameraOrders = CameraOrders { windows: true, exposure_s: None, period: Span::from_ms(100) };

/// A tracker that looks at a painted sky through the windows that it asked for one frame before.
struct Bench {
    painter: Painter,
    tracker: Tracker,
    frame: u32,
    regions: Regions,
}

impl Bench {
    fn new(seed: u64) -> Self {
        let camera = Camera { steps: 10, ..Camera::wide() };
        let painter = Painter::new(camera, catalog(), noon(), seed);
        Self { painter, tracker: Tracker::new(camera.params, wide_guide()), frame: 0, regions: Regions::WHOLE }
    }

    fn look(&mut self, shot: &Shot, gyro: DVec3) -> (Outcome, CameraWish) {
        let at = noon() + Span::from_s(f64::from(self.frame) * STEP_S);
        self.frame += 1;
        let mut image = self.painter.shoot(shot);
        self.regions.clear_outside(&mut image);
        let exposure_s = self.painter_exposure_s();
        self.tracker.expose(&Exposed { exposure_s, regions: self.regions });
        let outcome = self.tracker.measure(&image, at, beta(), Some(gyro));
        let done = (&outcome, at + Span::from_ms(40));
        let wish = self.tracker.wish(&ORDERS, (&image, at), done, (beta(), Some(gyro)));
        self.regions = wish.regions.expect("windows are commanded");
        (outcome, wish)
    }

    fn painter_exposure_s(&self) -> f64 {
        Camera::wide().params.exposure_s
    }
}

#[test]
fn windows_follow_a_slew_and_the_attitude_is_as_good_as_it_says() {
    let mut bench = Bench::new(51);
    let mut attitude = random_attitude(&mut StdRng::seed_from_u64(51));
    let rate_rad_s = DVec3::new(0.5, -0.7, 0.5) * DEG;
    let (mut worst, mut windows) = (0.0_f64, Vec::new());
    for frame in 0..20 {
        let shot = Shot { rate_rad_s, ..Shot::still(attitude, beta()) };
        let was_whole = bench.regions.is_whole();
        let (outcome, wish) = bench.look(&shot, rate_rad_s);
        let Outcome::Solved(solution) = outcome else { panic!("frame {frame}: {outcome:?}") };
        assert_eq!(was_whole, frame == 0, "frame {frame}");
        assert_eq!(solution.mode, if was_whole { Mode::LostInSpace } else { Mode::Tracking }, "frame {frame}");
        let error = solution.sensor_from_icrf.rotation_vector_to(&attitude);
        worst = worst.max(error.dot(solution.covariance_rad2.inverse() * error));
        windows.push(wish.regions);
        attitude = attitude.rotated_by(rate_rad_s * STEP_S);
    }
    // Chi-square with 3 degrees of freedom exceeds 35 with a probability of 1e-7.
    assert!(worst < 35.0, "squared error {worst} of its covariance");
    assert!(windows.windows(2).all(|pair| pair[0] != pair[1]), "control: the windows move");
}

#[test]
fn without_an_attitude_the_whole_image_is_asked_for() {
    let mut bench = Bench::new(52);
    let mut random = StdRng::seed_from_u64(52);
    let (first, second) = (random_attitude(&mut random), random_attitude(&mut random));
    let mut seen = String::new();
    // Three frames of one field, then another one without notice.
    for frame in 0..9 {
        let was_whole = bench.regions.is_whole();
        let (outcome, _) = bench.look(&Shot::still(if frame < 3 { first } else { second }, beta()), DVec3::ZERO);
        let is_solved = matches!(outcome, Outcome::Solved(_));
        seen.push(match (was_whole, is_solved) {
            (true, true) => 'W',
            (false, true) => 'w',
            (true, false) => 'X',
            (false, false) => 'x',
        });
    }
    // One miss on windows, two more on whole images until it is lost, then found again, and windows.
    assert_eq!(seen, "WwwxXXWww");
}

#[test]
fn the_exposure_is_asked_for_by_the_signal() {
    let mut bench = Bench::new(53);
    let attitude = random_attitude(&mut StdRng::seed_from_u64(53));
    let orders = CameraOrders { exposure_s: Some([1e-3, 10.0]), ..ORDERS };
    let mut asked = |zero_magnitude: f64| {
        let camera = Camera { zero_magnitude_e: Camera::wide().zero_magnitude_e * zero_magnitude, ..Camera::wide() };
        bench.painter = Painter::new(camera, catalog(), noon(), 53);
        bench.tracker = Tracker::new(camera.params, wide_guide());
        let image = bench.painter.shoot(&Shot::still(attitude, beta()));
        let outcome = bench.tracker.measure(&image, noon(), beta(), Some(DVec3::ZERO));
        assert!(matches!(outcome, Outcome::Solved(_)), "{zero_magnitude}: {outcome:?}");
        let wish = bench.tracker.wish(&orders, (&image, noon()), (&outcome, noon()), (beta(), Some(DVec3::ZERO)));
        wish.exposure.map(|exposure| exposure.s() / camera.params.exposure_s)
    };
    let (dim, bright) = (asked(0.2), asked(20.0));
    assert_eq!(dim, Some(2.0), "much too dim: by the largest step");
    assert_eq!(bright, Some(0.5), "much too bright: by the largest step");
}
