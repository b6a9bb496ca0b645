//! Motion methods on both sides of their domains. Sinusoids have a fraction of a cycle left over: whole cycles flatter
//! a method that samples.

use crate::scene::{Dice, EXPOSURE_S, FOCAL_PX};
use crate::stability::{Scene, assert_inside, assert_replaced, is_over_budget, measure, point};
use base::time::Span;
use core::f64::consts::TAU;
use glam::DVec3;
use plan::attitude::{JitterLine, JitterPoint};
use plan::exposure::{PixelPath, method::MethodName};
use sky::astrometry::CameraGeometry;

/// PSF of most scenes, px.
const SIGMA_PX: f64 = 0.8;
/// An undersampled PSF, px.
const NARROW_PX: f64 = 0.3;
/// Cycles per exposure of the sinusoids.
const CYCLES: f64 = 10.3;

/// Returns a path with power up to 40 cycles per exposure, as a structure's modes have it: amplitudes fall with
/// frequency.
fn like_a_psd(sigma_px: f64, rms_px: f64) -> Scene {
    const MODES: u32 = 24;
    let mut dice = Dice::new(5);
    let mut scene = Scene::still(sigma_px);
    let modes: Vec<[f64; 4]> = (0..MODES)
        .map(|i| {
            let cycles = 0.7 * (40.0_f64 / 0.7).powf((f64::from(i) + dice.unit()) / f64::from(MODES));
            [cycles, cycles.powf(-0.5), dice.between(0.0, TAU), dice.between(0.0, TAU)]
        })
        .collect();
    let power: f64 = modes.iter().map(|mode| 0.5 * mode[1] * mode[1]).sum();
    let line = |[cycles, amplitude, direction, phase_rad]: [f64; 4]| {
        let (sin, cos) = direction.sin_cos();
        let amplitude_rad = DVec3::new(sin, cos, 0.0) * (amplitude * rms_px / (power.sqrt() * FOCAL_PX));
        JitterLine { frequency_hz: cycles / EXPOSURE_S, amplitude_rad, phase_rad }
    };
    scene.los.jitter.lines = modes.into_iter().map(line).collect();
    scene
}

/// Returns the same motion of the image in a telescope's field, where it is the same for all stars.
pub(super) fn narrow_field(scene: &Scene) -> Scene {
    const TIMES: f64 = 16.0;
    let mut parameters = *scene.instrument.camera.parameters();
    parameters.focal_px = parameters.focal_px.map(|focal_px| TIMES * focal_px);
    let mut scene = scene.clone();
    scene.instrument.camera = CameraGeometry::new(parameters).unwrap();
    scene.los.rate_rad_s /= TIMES;
    for line in &mut scene.los.jitter.lines {
        line.amplitude_rad /= TIMES;
    }
    scene
}

/// Returns a commanded path of straight legs.
pub(super) fn zigzag(sigma_px: f64, legs: u32, size_px: f64) -> Scene {
    let mut dice = Dice::new(8);
    let corner = |i: u32| {
        let mut around = || dice.between(-size_px, size_px);
        point(EXPOSURE_S * f64::from(i) / f64::from(legs), [around(), around()], 0.0)
    };
    let path = PixelPath::line((0..=legs).map(corner).collect(), EXPOSURE_S).unwrap();
    Scene { path: Some(path), ..Scene::still(sigma_px) }
}

#[test]
fn every_method_has_a_scene_it_draws_and_one_it_is_refused() {
    let shaken = Scene::shaken(SIGMA_PX, 3.0, CYCLES);
    // Method, a scene inside, a method with its number and a scene outside.
    let cases = [
        ("static", Scene::straight(SIGMA_PX, 0.02), "static", Scene::straight(SIGMA_PX, 3.0)),
        ("gaussian", Scene::straight(SIGMA_PX, 0.5), "gaussian", Scene::straight(SIGMA_PX, 6.0)),
        ("gauss-legendre", Scene::drifting(SIGMA_PX, 3.0), "gauss-legendre:4", Scene::drifting(SIGMA_PX, 20.0)),
        ("segments:64", zigzag(SIGMA_PX, 8, 2.0), "segments:16", shaken.clone()),
        ("corners", zigzag(SIGMA_PX, 9, 2.0), "corners:2", zigzag(SIGMA_PX, 9, 4.0)),
        ("samples", shaken.clone(), "samples:16", shaken.clone()),
        ("effective-psf", narrow_field(&shaken), "effective-psf", Scene::rolled(SIGMA_PX, 0.1)),
        ("zonal-psf", Scene::rolled(SIGMA_PX, 0.0018), "zonal-psf", Scene::rolled(SIGMA_PX, 0.8)),
    ];
    assert_eq!(cases.len(), MethodName::ALL.len(), "every method");
    for (method, inside, beyond, outside) in &cases {
        assert_inside("its own", inside, method);
        assert_replaced("beyond", outside, beyond);
    }
}

/// Returns the scene of a bench's jitter samples: rotations at even steps, straight in between, the same power all over the
/// band.
fn sampled_jitter(sigma_px: f64, points: u32, size_px: f64) -> Scene {
    let mut dice = Dice::new(11);
    let mut scene = Scene::still(sigma_px);
    let first = scene.los.exposure_start;
    scene.los.jitter.points = (0..points)
        .map(|i| JitterPoint {
            at: first + Span::from_s(EXPOSURE_S * f64::from(i) / f64::from(points - 1)),
            rotation_rad: DVec3::new(dice.between(-size_px, size_px), dice.between(-size_px, size_px), 0.0) / FOCAL_PX,
        })
        .collect();
    scene
}

#[test]
fn nodes_between_corners_are_fewer_than_samples_that_miss_them() {
    // Pixels wide apart from sample to sample, all over a wide field: the planner takes the corners, and fits the budget.
    let scene = sampled_jitter(SIGMA_PX, 64, 1.5);
    let plan = assert_inside("jitter samples", &scene, "auto");
    assert_eq!(plan.chosen.method.name(), MethodName::Corners, "{}", plan.chosen.method);
    assert_inside("jitter samples", &scene, "corners:6");
    // Control: as many nodes at even times are over it.
    assert_replaced("jitter samples", &scene, "samples:128");
    // A sinusoid between the corners needs more nodes, and is seen.
    let mut shaken = scene;
    shaken.los.jitter.lines = Scene::shaken(SIGMA_PX, 2.0, 40.3).los.jitter.lines;
    assert_replaced("a sinusoid between the samples", &shaken, "corners:2");
}

#[test]
fn a_long_stretch_has_the_nodes_that_were_asked_for() {
    // More nodes than one rule has: the stretch is cut into pieces. A fast sinusoid needs several nodes for each cycle.
    let mut scene = sampled_jitter(SIGMA_PX, 3, 1.5);
    scene.los.jitter.lines = Scene::shaken(SIGMA_PX, 2.0, 100.3).los.jitter.lines;
    let plan = scene.plan("corners:600");
    let measured = measure(&plan);
    assert!(measured.is_within(&plan.chosen) && !is_over_budget(&measured), "{measured:?}, promised {:?}", plan.chosen);
    assert_eq!(plan.nodes.len(), plan.chosen.method.nodes(), "{}", plan.chosen.method);
    let total: f64 = plan.nodes.iter().map(|node| node.weight).sum();
    assert!((total - 1.0).abs() < 1e-12, "{total}");
    // Control: one node for each cycle is too few.
    assert_replaced("a fast sinusoid between corners", &scene, "corners:50");
}

#[test]
fn gauss_legendre_is_refused_when_there_is_jitter() {
    assert_replaced("jitter", &Scene::shaken(SIGMA_PX, 1.0, CYCLES), "gauss-legendre:4");
}

#[test]
fn a_smear_of_twenty_pixels() {
    for sigma_px in [NARROW_PX, SIGMA_PX] {
        let scene = Scene::drifting(sigma_px, 20.0);
        assert_inside("20 px", &scene, "gauss-legendre");
        for method in ["static", "gaussian", "samples:16", "segments:1"] {
            // A straight slew is one segment; two nodes along it are two dots.
            assert_replaced("20 px", &scene, method);
        }
    }
}

#[test]
fn an_undersampled_star_asks_for_more() {
    let scene = Scene::shaken(NARROW_PX, 1.0, 2.3);
    assert_inside("narrow", &scene, "samples");
    assert_inside("narrow", &zigzag(NARROW_PX, 9, 1.0), "effective-psf");
    // As many as do for the wide PSF.
    assert_inside("wide", &Scene::straight(SIGMA_PX, 3.0), "samples:8");
    assert_replaced("narrow", &Scene::straight(NARROW_PX, 3.0), "samples:8");
    assert_replaced("narrow", &Scene::straight(NARROW_PX, 0.4), "static");
}

#[test]
fn a_random_path_with_power_up_to_forty_cycles() {
    let scene = like_a_psd(SIGMA_PX, 2.0);
    assert_inside("2 px rms", &scene, "samples");
    for method in ["effective-psf", "zonal-psf"] {
        assert_inside("2 px rms, 4 arcsec pixels", &narrow_field(&scene), method);
    }
    for method in ["static", "gaussian", "samples:64", "segments:64"] {
        assert_replaced("2 px rms", &scene, method);
    }
}
