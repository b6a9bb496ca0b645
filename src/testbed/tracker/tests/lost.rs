//! Frames of the sky, lost in space: what must be solved, and what must not.

use super::super::{Mode, Outcome, Reason, Solution, Tracker};
use super::draw::{Painter, Shot, random_attitude};
use super::*;
use base::axes::{Icrf, Rotation, Sensor};
use base::{image::DnImage, units::DEG};
use glam::{DMat3, DVec2};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Returns the further off than ten pixels is a wrong field; right ones are within one, roll included.
fn is_wrong(camera: &Camera, error_rad: f64) -> bool {
    error_rad > 10.0 * camera.params.geometry.ifov_rad()
}

/// Counted results of frames of random attitudes.
#[derive(Debug, Default)]
struct Tally {
    frames: u32,
    solved: u32,
    wrong: u32,
    stars: u32,
    /// Sums of the squared error in units of its covariance, and of chi-square per degree of freedom.
    squared: f64,
    chi: f64,
}

/// Gives `frames` frames of random attitudes to a tracker; `shot` has their parameters, `reported` is whether the
/// tracker gets the rate.
fn survey(camera: Camera, guide: Arc<GuideStars>, frames: u32, seed: u64, shot: &Shot, reported: bool) -> Tally {
    let mut painter = Painter::new(camera, catalog(), noon(), seed);
    let mut random = StdRng::seed_from_u64(seed);
    let mut tracker = Tracker::new(camera.params, guide);
    let mut tally = Tally { frames, ..Tally::default() };
    for _ in 0..frames {
        let attitude = random_attitude(&mut random);
        let image = painter.shoot(&Shot { attitude, ..*shot });
        tracker.forget();
        if let Outcome::Solved(s) = tracker.measure(&image, noon(), beta(), reported.then_some(shot.rate_rad_s)) {
            let error = s.sensor_from_icrf.rotation_vector_to(&attitude);
            assert_eq!((s.mode, s.at), (Mode::LostInSpace, noon()));
            tally.solved += 1;
            tally.stars += s.stars;
            tally.wrong += u32::from(is_wrong(&camera, error.length()));
            tally.squared += error.dot(s.covariance_rad2.inverse() * error);
            tally.chi += s.chi_square_per_dof;
        }
    }
    println!("{tally:?}");
    tally
}

fn still() -> Shot {
    Shot::still(Rotation::IDENTITY, beta())
}

fn dirty() -> Shot {
    Shot { missing: 0.2, false_stars: 5, hot_pixels: 30, ..still() }
}

/// Asserts that at least 99 % are solved, and none wrong.
fn assert_found(tally: &Tally) {
    assert!(f64::from(tally.solved) >= 0.99 * f64::from(tally.frames) && tally.wrong == 0, "{tally:?}");
}

#[test]
fn random_attitudes_are_found() {
    let tally = survey(Camera::coarse(), coarse_guide(), 300, 21, &still(), false);
    assert_found(&tally);
    // Chi-square with 3 degrees of freedom: the mean of 300 is 3 within 4 sqrt(6 / 300) = 0.57.
    let n = f64::from(tally.solved);
    assert!((tally.squared / n - 3.0).abs() < 0.57, "errors against covariance: {}", tally.squared / n);
    assert!((tally.squared / n / 0.7 - 3.0).abs() > 0.57, "control: covariances 0.7 times as large must be found out");
    // 80 degrees of freedom and 300 frames: 4 sqrt(2 / 80 / 300) = 0.037. Stars too faint to be clipped raise the
    // background's noise in these coarse pixels by some 6 per cent, and so lower chi-square by 12.
    assert!((0.84..1.037).contains(&(tally.chi / n)), "residuals: {}", tally.chi / n);
}

#[test]
fn random_attitudes_are_found_among_false_and_missing_stars() {
    assert_found(&survey(Camera::coarse(), coarse_guide(), 200, 22, &dirty(), false));
}

#[test]
fn random_attitudes_are_found_on_a_large_detector() {
    assert_found(&survey(Camera::wide(), wide_guide(), 20, 23, &still(), false));
    assert_found(&survey(Camera::wide(), wide_guide(), 20, 24, &dirty(), false));
}

#[test]
fn random_attitudes_are_found_through_a_distorted_narrow_lens() {
    let camera = Camera::narrow();
    assert_found(&survey(camera, guide_of(&camera), 10, 25, &dirty(), false));
}

/// Trails of 2.5, 5 and 20 px on the coarse detector: solved with a known rate, also guessed from the spots' shape;
/// never wrong.
#[test]
fn trails_are_solved_or_refused() {
    for (deg_s, steps, reported, least) in
        [(2.0, 8, true, 20), (4.0, 12, true, 20), (4.0, 12, false, 16), (16.0, 40, false, 0)]
    {
        let camera = Camera { steps, ..Camera::coarse() };
        let shot = Shot { rate_rad_s: DVec3::new(0.6, 0.8, 0.3) * deg_s * DEG, ..still() };
        let tally = survey(camera, coarse_guide(), 20, 26, &shot, reported);
        assert!(tally.wrong == 0 && tally.solved >= least, "{deg_s} deg/s, rate reported {reported}: {tally:?}");
    }
}

/// Asserts that no image gives an attitude.
fn assert_refused(camera: &Camera, guide: Arc<GuideStars>, images: impl Iterator<Item = DnImage>, what: &str) {
    let mut tracker = Tracker::new(camera.params, guide);
    for image in images {
        let outcome = tracker.measure(&image, noon(), beta(), None);
        assert!(matches!(outcome, Outcome::NoSolution(_)), "{what}: {outcome:?}");
    }
}

fn mirrored(image: &DnImage) -> DnImage {
    let mut mirror = image.clone();
    mirror.pixels_mut().chunks_exact_mut(image.width()).for_each(<[u16]>::reverse);
    mirror
}

#[test]
fn mirrored_skies_and_noise_are_refused() {
    for (camera, guide, frames) in [(Camera::coarse(), coarse_guide(), 60), (Camera::wide(), wide_guide(), 6)] {
        let mut painter = Painter::new(camera, catalog(), noon(), 27);
        let mut random = StdRng::seed_from_u64(27);
        let skies =
            (0..frames).map(|_| mirrored(&painter.shoot(&Shot { attitude: random_attitude(&mut random), ..still() })));
        assert_refused(&camera, guide.clone(), skies, "mirrored");
        let (mut painter, mut random) = (Painter::new(camera, catalog(), noon(), 28), StdRng::seed_from_u64(28));
        let size = DVec2::new(camera.params.geometry.width_px as f64, camera.params.geometry.height_px as f64);
        let invented = (0..frames).map(|frame| {
            let stars: Vec<_> = (0..frame % 60)
                .map(|_| {
                    let place = DVec2::new(random.random(), random.random()) * size;
                    (place, 1e6 * 10f64.powf(-2.0 * random.random::<f64>()))
                })
                .collect();
            painter.paint(&stars, 0.0)
        });
        assert_refused(&camera, guide, invented, "invented");
    }
}

#[test]
fn images_without_stars_say_why() {
    let camera = Camera::coarse();
    let mut painter = Painter::new(camera, catalog(), noon(), 29);
    let mut tracker = Tracker::new(camera.params, coarse_guide());
    let mut reason = |image: &DnImage| match tracker.measure(image, noon(), beta(), None) {
        Outcome::NoSolution(reason) => reason,
        Outcome::Solved(solution) => panic!("{solution:?}"),
    };
    assert_eq!(reason(&painter.paint(&[], 0.0)), Reason::TooFewStars, "empty");
    assert_eq!(reason(&DnImage::new(256, 256)), Reason::TooFewStars, "all zero");
    assert_eq!(reason(&painter.paint(&[], 2e5)), Reason::Saturated, "saturated");
    assert_eq!(reason(&painter.paint(&[], 8e4)), Reason::StrayLight, "stray light");
    assert_eq!(reason(&DnImage::new(64, 64)), Reason::ImageSize, "size");
    assert_eq!((tracker.counts.frames, tracker.counts.none), (5, 5));
}

/// A step from the background of one seed to the other is the only thing that may differ.
#[test]
fn the_same_images_give_the_same_bits() {
    let camera = Camera::coarse();
    let run = |seed: u64| -> Vec<Outcome> {
        let (mut painter, mut random) = (Painter::new(camera, catalog(), noon(), seed), StdRng::seed_from_u64(30));
        let mut tracker = Tracker::new(camera.params, coarse_guide());
        let attitude = random_attitude(&mut random);
        (0..4).map(|_| tracker.measure(&painter.shoot(&Shot { attitude, ..still() }), noon(), beta(), None)).collect()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2), "control: another seed");
}

/// A false tracker: the covariance must be in the axes it says. Roll is the worst axis of a narrow field.
#[test]
fn roll_is_the_worst_axis_and_residuals_are_listed() {
    let camera = Camera::wide();
    let mut painter = Painter::new(camera, catalog(), noon(), 31);
    let mut tracker = Tracker::new(camera.params, wide_guide());
    let attitude: Rotation<Sensor, Icrf> = random_attitude(&mut StdRng::seed_from_u64(31));
    let outcome = tracker.measure(&painter.shoot(&Shot { attitude, ..still() }), noon(), beta(), None);
    let Outcome::Solved(Solution { covariance_rad2, stars, .. }) = outcome else { panic!("{outcome:?}") };
    let [x, y, z] = [covariance_rad2.x_axis.x, covariance_rad2.y_axis.y, covariance_rad2.z_axis.z];
    assert!(z > 20.0 * x && z > 20.0 * y && covariance_rad2 != DMat3::ZERO, "{covariance_rad2}");
    let used = tracker.matches.iter().filter(|star| star.used).count();
    assert_eq!(used, usize::try_from(stars).unwrap());
    let id = tracker.guide.stars[tracker.matches[0].star].id;
    assert!(catalog().sources()[id as usize].mag_g < 5.0, "the brightest spot is a bright star");
}
