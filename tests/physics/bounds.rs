//! The planner's bounds against measured errors, method by method and over random scenes.
//!
//! Truth here is the reference backend, itself held by `stamps`. Images are compared with images: an undersampled
//! star's centroid has its own S-curve.

use crate::scene::{
    Dice, EXPOSURE_S, FOCAL_PX, Picture, Window, centroid_error_px, draw_cpu, draw_reference, everything, flux_error,
    los, planner, star,
};
use glam::DVec3;
use starloop::attitude::{JitterLine, JitterPoint, LosPath};
use starloop::base::accuracy::AccuracyBudget;
use starloop::base::time::Tai;
use starloop::exposure::plan::Verdict;
use starloop::exposure::planner::Source;
use starloop::exposure::{ExposurePlan, PixelPath, PixelPoint};
use starloop::optics::PsfModel;

/// Detector, px.
const SIZE: usize = 64;
/// Random scenes.
const SCENES: u32 = 400;
/// Of these, the planner must accept at least so many: the property is not idle.
const LEAST_ACCEPTED: usize = 280;
/// Electrons of a star.
const ELECTRONS: f64 = 2e4;
/// Read noise the scenes' instrument has, e-.
const READ_NOISE_E: f64 = 10.0;
/// A star's light and its tracker window stay within this distance of its mean place, px.
const AROUND_PX: usize = 12;
/// Rounding of a sum of a few hundred single-precision pixels.
const F32_FLUX: f64 = 2e-6;
/// Pixel errors below this share of the peak are single-precision rounding.
const F32_PIXEL: f64 = 2e-6;
/// Pixel error of the analytic path against the reference, share of the peak: f32 erf and sums (2e-7), and light the
/// footprint drops (5 % of the flux budget spread over its rim, 1e-5 of the peak).
const ANALYTIC_PIXEL: f64 = 2e-5;
/// The same with a table: its promise, 3e-5 of the peak, on top.
const TABLE_PIXEL: f64 = 5e-5;

/// Motion of a scene.
#[derive(Debug, Clone)]
struct Scene {
    sigma_px: f64,
    los: LosPath,
    path: Option<PixelPath>,
    stars: Vec<[f64; 2]>,
    kind: u32,
}

fn at(t_s: f64, dx_px: f64, dy_px: f64, roll_rad: f64) -> PixelPoint {
    PixelPoint { t_s, dx_px, dy_px, roll_rad }
}

/// Rate that moves the middle of the image by (`x`, `y`) px during the exposure and turns it by `roll_rad`.
fn rate(x: f64, y: f64, roll_rad: f64) -> DVec3 {
    DVec3::new(y / FOCAL_PX, -x / FOCAL_PX, roll_rad) / EXPOSURE_S
}

fn line_of_jitter(dice: &mut Dice) -> JitterLine {
    let amplitude_px = 2.5 * dice.unit().powi(2) + 0.02;
    let (sin, cos) = dice.between(0.0, core::f64::consts::TAU).sin_cos();
    // Roll jitter is small, but for one line in ten.
    let most = if dice.unit() < 0.1 { 0.01 } else { 2e-5 };
    let roll = dice.between(-most, most);
    JitterLine {
        frequency_hz: dice.between(1.0, 300.0),
        amplitude_rad: DVec3::new(sin * amplitude_px / FOCAL_PX, cos * amplitude_px / FOCAL_PX, roll),
        phase_rad: dice.between(0.0, core::f64::consts::TAU),
    }
}

/// A millisecond random walk that covers the exposure.
fn walk(dice: &mut Dice) -> Vec<JitterPoint> {
    let step_rad = dice.between(0.05, 0.5) / FOCAL_PX;
    let mut rotation_rad = DVec3::ZERO;
    (-1..=102)
        .map(|ms| {
            rotation_rad += step_rad * DVec3::new(dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), 0.0);
            JitterPoint { at: Tai::from_ns(ms * 1_000_000), rotation_rad }
        })
        .collect()
}

fn rows(dice: &mut Dice, count: u32, timed: bool) -> Vec<PixelPoint> {
    let size = dice.between(0.1, 4.0);
    let roll = if dice.unit() < 0.5 { 0.0 } else { dice.between(0.0, 0.04) };
    (0..count)
        .map(|i| {
            let t_s = if timed { EXPOSURE_S * f64::from(i) / f64::from(count.max(2) - 1) } else { 0.0 };
            let mut around = |most: f64| dice.between(-most, most);
            at(t_s, around(size), around(size), around(roll))
        })
        .collect()
}

fn scene(dice: &mut Dice, number: u32) -> Scene {
    let (kind, mut los, mut path) = (number % 6, los(), None);
    if kind == 0 || dice.unit() < 0.3 {
        let most = if kind == 0 { 6.0 } else { 2.0 };
        let mut px = || dice.between(-most, most);
        // Up to a few degrees per second about the line of sight.
        los.rate_rad_s = rate(px(), px(), 0.001 * px());
        los.acceleration_rad_s2 = rate(px(), px(), 0.0) * (0.2 / EXPOSURE_S);
    }
    match kind {
        0 => {}
        1 => los.jitter.lines = vec![line_of_jitter(dice)],
        2 => los.jitter.lines = (0..3).map(|_| line_of_jitter(dice)).collect(),
        3 => los.jitter.points = walk(dice),
        4 => {
            let rows = rows(dice, 2 + number % 23, true);
            path = Some(PixelPath::line(rows, EXPOSURE_S).expect("a path"));
        }
        _ => {
            let rows = rows(dice, 1 + number % 131, false);
            path = Some(PixelPath::samples(rows).expect("a path"));
        }
    }
    let mut near = |v: f64| v + dice.between(-2.0, 2.0);
    let stars = vec![[near(17.0), near(17.0)], [near(45.0), near(20.0)], [near(28.0), near(45.0)]];
    Scene { sigma_px: dice.between(0.4, 1.5), los, path, stars, kind }
}

fn sources(places: &[[f64; 2]]) -> Vec<Source> {
    (0..).zip(places).map(|(id, px)| star(id, ELECTRONS, *px)).collect()
}

fn plan(scene: &Scene, method: &str) -> ExposurePlan {
    let psf = PsfModel::gaussian(scene.sigma_px);
    planner(SIZE, &psf, method, scene.los.clone(), scene.path.clone()).plan(&sources(&scene.stars)).clone()
}

/// Worst errors over the stars of a plan.
#[derive(Debug, Clone, Copy, Default)]
struct Measured {
    centroid_px: f64,
    flux_rel: f64,
    pixel_sigma: f64,
    pixel_peak: f64,
}

fn measure(plan: &ExposurePlan) -> Measured {
    let (image, truth) = (draw_cpu(plan), draw_reference(plan));
    let mut worst = Measured::default();
    for star in &plan.stars {
        let around = around(star.mean_px);
        let window = truth.tracker_window(&around);
        worst.centroid_px = worst.centroid_px.max(centroid_error_px(&image, &truth, &window));
        worst.flux_rel = worst.flux_rel.max(flux_error(&image, &truth, &around));
    }
    for (a, b) in image.pixels.iter().zip(&truth.pixels) {
        let error = ((a - b).abs() - F32_PIXEL * ELECTRONS * plan.psf.peak()).max(0.0);
        worst.pixel_sigma = worst.pixel_sigma.max(error / b.sqrt().hypot(READ_NOISE_E));
    }
    worst.pixel_peak = peak_error(&image, &truth);
    worst
}

/// Largest pixel error relative to the brightest pixel.
fn peak_error(image: &Picture, truth: &Picture) -> f64 {
    let peak = truth.pixels.iter().copied().fold(0.0, f64::max);
    image.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a - b).abs() / peak).fold(0.0, f64::max)
}

fn around(px: [f64; 2]) -> Window {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places on a small detector")]
    let range = |v: f64| (v.round() as usize).saturating_sub(AROUND_PX)..(v.round() as usize + AROUND_PX + 1).min(SIZE);
    Window { columns: range(px[0]), rows: range(px[1]) }
}

#[test]
fn bounds_hold_over_random_scenes() {
    let mut dice = Dice::new(2024);
    let (mut accepted, mut broken) = (0, Vec::new());
    let mut tightness: Vec<f64> = Vec::new();
    for number in 0..SCENES {
        let scene = scene(&mut dice, number);
        let plan = plan(&scene, "auto");
        let chosen = plan.chosen;
        if chosen.verdict != Verdict::Fits {
            continue;
        }
        accepted += 1;
        let measured = measure(&plan);
        tightness.push(measured.centroid_px / chosen.centroid_px);
        let holds = measured.centroid_px <= chosen.centroid_px
            && measured.flux_rel <= chosen.flux_rel + F32_FLUX
            && measured.pixel_sigma <= chosen.pixel_sigma + ELECTRONS * chosen.flux_rel / READ_NOISE_E;
        if !holds {
            broken.push(format!(
                "{number} kind {} sigma {:.2} {}: bound {:.1e} px {:.1e} flux {:.1e} sigma, got {:.1e} {:.1e} {:.1e}",
                scene.kind,
                scene.sigma_px,
                chosen.method,
                chosen.centroid_px,
                chosen.flux_rel,
                chosen.pixel_sigma,
                measured.centroid_px,
                measured.flux_rel,
                measured.pixel_sigma
            ));
        }
    }
    tightness.sort_by(f64::total_cmp);
    let quantile = |q: usize| tightness[(tightness.len() - 1) * q / 100];
    println!(
        "{accepted} of {SCENES} fit; error / bound: q50 {:.1e} q90 {:.1e} max {:.2}",
        quantile(50),
        quantile(90),
        quantile(100)
    );
    assert!(broken.is_empty(), "{} of {accepted}:\n{}", broken.len(), broken.join("\n"));
    assert!(accepted >= LEAST_ACCEPTED, "only {accepted} of {SCENES} fit");
    assert!(quantile(100) > 1e-4, "bounds divided by 1e4 would still hold: they say nothing");
}

/// One star in the middle, one at the edge of the field, moved by `path`.
fn two_stars(los: LosPath, path: Option<PixelPath>) -> Scene {
    Scene { sigma_px: 0.8, los, path, stars: vec![[31.3, 30.8], [54.2, 53.9]], kind: 0 }
}

fn straight(length_px: f64) -> Option<PixelPath> {
    let half = 0.5 * length_px;
    Some(
        PixelPath::line(vec![at(0.0, -half, -0.3 * half, 0.0), at(EXPOSURE_S, half, 0.3 * half, 0.0)], EXPOSURE_S)
            .unwrap(),
    )
}

fn rolling(roll_rad: f64) -> Option<PixelPath> {
    let points = (0..64).map(|i| at(0.0, 0.0, 0.0, roll_rad * (f64::from(i) / 63.0 - 0.5)));
    Some(PixelPath::samples(points.collect()).unwrap())
}

fn shaken(amplitude_px: f64) -> LosPath {
    let mut los = los();
    let amplitude_rad = DVec3::new(amplitude_px / FOCAL_PX, 0.0, 0.0);
    los.jitter.lines = vec![JitterLine { frequency_hz: 87.0, amplitude_rad, phase_rad: 0.4 }];
    los
}

fn drifting(length_px: f64) -> LosPath {
    LosPath { rate_rad_s: rate(length_px, 0.4 * length_px, 0.0), ..los() }
}

#[test]
fn every_method_is_refused_outside_its_domain_and_good_inside() {
    let budget = AccuracyBudget::default();
    let inside = [
        ("static", two_stars(los(), straight(0.02))),
        ("static", two_stars(shaken(0.01), None)),
        ("gauss-legendre", two_stars(drifting(3.0), None)),
        ("effective-psf", two_stars(los(), rolling(1e-4))),
        ("effective-psf", two_stars(shaken(1.0), None)),
        ("samples:256", two_stars(los(), straight(10.0))),
    ];
    for (method, scene) in &inside {
        let plan = plan(scene, method);
        let measured = measure(&plan);
        println!("inside  {method:15} bound {:.1e} measured {:.1e} px", plan.chosen.centroid_px, measured.centroid_px);
        assert_eq!(plan.chosen.verdict, Verdict::Fits, "{method}: {:?}", plan.chosen);
        assert!(measured.centroid_px <= plan.chosen.centroid_px, "{method}: {measured:?} {:?}", plan.chosen);
    }
    let outside = [
        ("static", two_stars(los(), straight(3.0)), Verdict::CentroidOverBudget),
        ("gauss-legendre:4", two_stars(shaken(1.0), None), Verdict::NeedsSmoothMotion),
        ("effective-psf", two_stars(los(), rolling(0.1)), Verdict::CentroidOverBudget),
        ("samples:4", two_stars(los(), straight(20.0)), Verdict::CentroidOverBudget),
        ("samples:16", two_stars(drifting(20.0), None), Verdict::CentroidOverBudget),
    ];
    for (method, scene, verdict) in &outside {
        let plan = plan(scene, method);
        let measured = measure(&plan);
        println!("outside {method:15} bound {:.1e} measured {:.1e} px", plan.chosen.centroid_px, measured.centroid_px);
        assert_eq!(plan.chosen.verdict, *verdict, "{method}: {:?}", plan.chosen);
        let needed = measured.centroid_px > budget.centroid_px || measured.pixel_sigma > budget.pixel_sigma;
        assert!(needed, "{method}: refused without need, {measured:?}");
        if *verdict != Verdict::NeedsSmoothMotion {
            assert!(measured.centroid_px <= plan.chosen.centroid_px, "{method}: {measured:?} {:?}", plan.chosen);
        }
        let auto = crate::bounds::plan(scene, "auto");
        assert_eq!(auto.chosen.verdict, Verdict::Fits, "another method can: {:?}", auto.assessed);
    }
}

#[test]
fn methods_draw_what_the_reference_draws() {
    let samples = |points: &[[f64; 2]]| {
        Some(PixelPath::samples(points.iter().map(|p| at(0.0, p[0], p[1], 0.0)).collect()).unwrap())
    };
    let wander = samples(&[[0.0, 0.0], [0.31, -0.7], [1.2, 0.4], [-0.8, 0.9], [0.5, 0.5]]);
    let gaussian = PsfModel::gaussian(0.8);
    let airy = PsfModel::airy(0.978_909, 0.3);
    let places = [[20.3, 31.6], [44.5, 12.5]];
    let cases = [
        ("static", &gaussian, los(), None, ANALYTIC_PIXEL),
        ("gauss-legendre", &gaussian, drifting(3.0), None, ANALYTIC_PIXEL),
        ("samples", &gaussian, los(), wander.clone(), ANALYTIC_PIXEL),
        ("effective-psf", &gaussian, los(), wander.clone(), TABLE_PIXEL),
        ("static", &airy, los(), None, TABLE_PIXEL),
        ("samples", &airy, los(), wander.clone(), TABLE_PIXEL),
        ("effective-psf", &airy, los(), wander, TABLE_PIXEL),
    ];
    for (method, psf, los, path, bound) in cases {
        let plan = planner(SIZE, psf, method, los, path).plan(&sources(&places)).clone();
        let (image, truth) = (draw_cpu(&plan), draw_reference(&plan));
        let worst = peak_error(&image, &truth);
        println!(
            "{method:15} {:8} largest pixel error / peak {worst:.1e}",
            if bound == ANALYTIC_PIXEL || matches!(psf, PsfModel::Gaussian { .. }) { "Gaussian" } else { "Airy" }
        );
        assert!(worst <= bound, "{method}: {worst:e}, wanted at most {bound:e}");
        let mut wrong = image;
        let [x, y] = truth.brightest(&everything(SIZE));
        wrong.pixels[y * SIZE + x] *= 1.0 + 2.0 * bound;
        assert!(peak_error(&wrong, &truth) > 0.9 * bound, "{method}: one pixel off must be seen");
    }
}

#[test]
fn electrons_on_the_detector_are_all_accounted_for() {
    /// Share of a Gaussian star: what the footprint drops (5 % of the flux budget) and f32.
    const GAUSSIAN_SUM: f64 = 1e-4;
    /// Share of an Airy star cut by an edge (`exposure::share`).
    const AIRY_SUM: f64 = 1e-3;
    let end = SIZE as f64 - 0.5;
    let across = [-0.5, 0.2, -1.7, end, end - 0.8, end + 1.3];
    let mut places: Vec<[f64; 2]> = across.iter().flat_map(|v| [[*v, 20.4], [33.3, *v]]).collect();
    places.extend([[-0.5, -0.5], [end, -0.4], [0.1, end], [end, end], [31.0, 32.2]]);
    places.extend([[-200.0, 10.0], [10.0, 400.0]]);
    let scenes = [
        (PsfModel::gaussian(0.8), los(), None, "auto", GAUSSIAN_SUM),
        (PsfModel::gaussian(1.4), drifting(4.0), None, "auto", GAUSSIAN_SUM),
        (PsfModel::gaussian(0.5), shaken(1.3), None, "auto", GAUSSIAN_SUM),
        (PsfModel::gaussian(0.8), los(), straight(6.0), "effective-psf", GAUSSIAN_SUM),
        (PsfModel::gaussian(0.8), los(), straight(6.0), "samples", GAUSSIAN_SUM),
        (PsfModel::airy(0.978_909, 0.3), los(), None, "auto", AIRY_SUM),
    ];
    for (psf, los, path, method, tolerance) in scenes {
        let plan = planner(SIZE, &psf, method, los, path).plan(&sources(&places)).clone();
        let wanted = plan.electrons_on_detector();
        for (name, sum) in [("cpu", draw_cpu(&plan).sum()), ("reference", draw_reference(&plan).sum())] {
            let error = (sum / wanted - 1.0).abs();
            println!("{name:9} {method:13} {:?}: {error:.1e}", plan.chosen.method);
            assert!(error < tolerance, "{name}, {method}, {:?}: {sum} drawn, {wanted} told", plan.chosen.method);
        }
        let without: f64 = plan.stars.iter().skip(1).map(|star| star.electrons_on_detector).sum();
        assert!((without / wanted - 1.0).abs() > tolerance, "one star less must be seen");
    }
}
