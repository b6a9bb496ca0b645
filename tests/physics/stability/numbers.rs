//! Where numbers give way: large coordinates, tiny and huge angles, denormals, no stars, very many stars.

use crate::measure::measure;
use crate::scene::{
    Dice, EXPOSURE_S, Picture, centroid_error_px, draw_cpu, draw_reference, everything, instrument, planner, star,
};
use crate::stability::{ELECTRONS, SIZE, Scene, assert_inside, assert_replaced};
use base::clock::{Clock, Monotonic};
use base::time::Tai;
use glam::DVec3;
use image::render::{Backend, cpu::Cpu};
use plan::exposure::{ExposurePlan, Instrument, Source};
use plan::{attitude::JitterLine, optics::PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Columns of the wide detector: coordinates of an 8k sensor in an image that stays small.
const WIDE_PX: usize = 8192;
/// Single precision about the star's own pixel: rounding of 25 pixels of 1e-7 each.
const LOCAL_F32_PX: f64 = 1e-6;
/// Displacements at nodes are single precision of a few px, included in every bound.
const NODES_F32_PX: f64 = 5e-6;
/// Sum of a whole frame in single precision, and what footprints drop (5 % of the flux budget).
const SUM_REL: f64 = 1e-4;

fn camera(size: [usize; 2], focal_px: f64) -> CameraGeometry {
    let [width_px, height_px] = size;
    CameraGeometry::new(CameraParameters {
        width_px,
        height_px,
        focal_px: [focal_px; 2],
        principal_point_px: size.map(|side| 0.5 * (side as f64 - 1.0)),
        distortion: BrownConrady::default(),
    })
    .unwrap()
}

fn is_finite(image: &Picture) -> bool {
    image.pixels.iter().all(|e| e.is_finite() && *e >= -1e-3)
}

#[test]
fn a_star_at_pixel_8000_keeps_its_fraction() {
    let wide = instrument(camera([WIDE_PX, SIZE], 12_000.0), &PsfModel::gaussian(0.8));
    let at = |x: f64| vec![star(0, ELECTRONS, [x, 31.2])];
    let still = Scene { instrument: wide, stars: at(8000.37), ..Scene::still(0.8) };
    let plan = still.plan("static");
    let (image, truth) = (draw_cpu(&plan), draw_reference(&plan));
    let window = truth.tracker_window(&crate::measure::around(&plan, plan.stars[0].mean_px));
    let error = centroid_error_px(&image, &truth, &window);
    println!("x = 8000.37: {error:.1e} px");
    assert!(error < LOCAL_F32_PX, "{error:e} px");
    // Negative control: the same place in single precision.
    let rounded = Scene { stars: at(f64::from(8000.37_f32)), ..still.clone() };
    let off = centroid_error_px(&draw_cpu(&rounded.plan("static")), &truth, &window);
    assert!(off > 10.0 * LOCAL_F32_PX, "single precision at 8000 px would be off by {off:e} px");
    let mut moving = still;
    let amplitude_rad = DVec3::new(0.3, 1.0, 2e-5) * (1.5 / moving.focal_px());
    moving.los.jitter.lines = vec![JitterLine { frequency_hz: 103.0, amplitude_rad, phase_rad: 0.4 }];
    let measured = measure(&assert_inside("8000 px", &moving, "samples:1024"));
    assert!(measured.centroid_px < NODES_F32_PX, "{measured:?}");
}

#[test]
fn a_telescope_of_one_arcsecond_per_pixel() {
    const ARCSEC_PX: f64 = 206_264.806;
    let mut scene = Scene::still(0.8);
    scene.instrument = instrument(camera([SIZE; 2], ARCSEC_PX), &PsfModel::gaussian(0.8));
    // Two arcseconds of jitter.
    let amplitude_rad = DVec3::new(0.7, 2.0, 0.0) / ARCSEC_PX;
    scene.los.jitter.lines = vec![JitterLine { frequency_hz: 10.3 / EXPOSURE_S, amplitude_rad, phase_rad: 0.4 }];
    assert_inside("telescope", &scene, "auto");
    assert_replaced("telescope", &scene, "static");
}

/// Returns stars drawn by a planner that leaves none out.
fn noiseless(scene: &Scene, electrons: f64) -> ExposurePlan {
    let instrument = Instrument { read_noise_e_rms: 0.0, ..scene.instrument.clone() };
    let stars = scene.stars.iter().map(|star| Source { electrons, ..*star }).collect();
    Scene { instrument, stars, ..scene.clone() }.plan("samples:64")
}

/// Returns the time that drawing `plan` takes over and over, s.
fn drawing_s(plan: &ExposurePlan) -> f64 {
    const REPEATS: u32 = 300;
    let mut cpu = Cpu::new(SIZE, SIZE);
    let clock = Monotonic::start_at(Tai::from_ns(0));
    (0..REPEATS).for_each(|_| cpu.render(plan).unwrap());
    (clock.now() - Tai::from_ns(0)).s()
}

#[test]
fn stars_of_denormal_light_are_drawn_like_others() {
    /// Wings lie below the smallest normal number of single precision (1.2e-38): this is what their rounding leaves.
    const DENORMAL_REL: f64 = 1e-3;
    /// All of it does.
    const TINY_E: f64 = 1e-38;
    let scene = Scene::shaken(0.8, 1.0, 2.3);
    let [normal, tiny] = [1.0, TINY_E].map(|electrons| noiseless(&scene, electrons));
    assert_eq!(tiny.stars.len(), scene.stars.len(), "none is left out");
    let [bright, dim] = [&normal, &tiny].map(draw_cpu);
    assert!(is_finite(&bright) && is_finite(&dim));
    assert!(dim.pixels.iter().any(|e| *e > 0.0 && *e < f64::from(f32::MIN_POSITIVE)), "some pixels are denormal");
    let ratio = dim.sum() / TINY_E / bright.sum();
    assert!((ratio - 1.0).abs() < DENORMAL_REL, "{ratio}");
    let times = [&tiny, &normal].map(drawing_s);
    println!("denormal light takes {:.2} times as long", times[0] / times[1]);
}

#[test]
fn an_empty_field_is_dark_and_costs_no_stars() {
    for method in ["auto", "static", "samples", "effective-psf", "zonal-psf", "segments", "gaussian"] {
        let scene = Scene { stars: Vec::new(), ..Scene::shaken(0.8, 1.0, 2.3) };
        let plan = scene.plan(method);
        assert_eq!(plan.electrons_on_detector(), 0.0, "{method}");
        assert!(draw_cpu(&plan).pixels.iter().all(|e| *e == 0.0), "{method}");
        let lit = Scene::shaken(0.8, 1.0, 2.3).plan(method);
        assert!(draw_cpu(&lit).pixels.iter().any(|e| *e > 0.0), "{method}: a star would be seen");
    }
}

#[test]
fn no_motion_is_the_same_by_every_method() {
    let still = Scene::still(0.8);
    let truth = draw_cpu(&still.plan("static"));
    for method in ["auto", "gaussian", "gauss-legendre", "samples:8", "segments:4", "effective-psf", "zonal-psf"] {
        let plan = assert_inside("no motion", &still, method);
        let image = draw_cpu(&plan);
        let error = centroid_error_px(&image, &truth, &truth.tracker_window(&everything(SIZE)));
        assert!(error < 2e-5 && is_finite(&image), "{method}: {error:e} px");
    }
}

#[test]
fn three_hundred_thousand_stars_are_all_accounted_for() {
    const SIDE: usize = 1024;
    const STARS: u32 = 300_000;
    let mut dice = Dice::new(3);
    let mut place = || dice.between(-8.0, SIDE as f64 + 7.0);
    let stars: Vec<Source> = (0..STARS).map(|id| star(id, 20.0 + f64::from(id % 997), [place(), place()])).collect();
    let scene = Scene::shaken(0.8, 0.5, 2.3);
    let mut planner = planner(SIDE, &PsfModel::gaussian(0.8), "auto", scene.los, None);
    let plan = planner.plan(&stars);
    let image = draw_cpu(plan);
    let (drawn, reported) = (image.sum(), plan.electrons_on_detector());
    println!("{} stars by {}: {drawn:.6e} e- drawn, {reported:.6e} promised", plan.stars.len(), plan.chosen.method);
    assert!(plan.stars.len() + plan.cut_off.stars > 290_000, "they are there");
    assert!((drawn / reported - 1.0).abs() < SUM_REL, "{drawn} {reported}");
    assert!(is_finite(&image));
    let lost: f64 = plan.stars.iter().take(1000).map(|star| star.electrons_on_detector).sum();
    assert!(lost / reported > SUM_REL, "a thousand stars less would be seen");
}
