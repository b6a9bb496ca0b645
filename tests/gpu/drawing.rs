//! Electrons: GPU against CPU for every method and PSF.

use crate::scene::{Difference, Motion, Scene, device, draw_cpu, draw_gpu, star};
use base::image::Image;
use plan::exposure::{Shutter, Source};
use plan::optics::PsfModel;
use starloop_image::{gpu::GpuDevice, render::gpu::Gpu};
use std::sync::Arc;

/// Both sides draw in f32 with 1e-6 of rounding at most per star (erf 5e-7 twice); overlapping stars add up.
const PEAK_SHARE: f64 = 3e-6;
/// Half a unit of fixed point (3e-5 e-) for each of the few stars over a pixel, several slices each.
const FLOOR_E: f64 = 5e-4;
/// Rounding to units is unbiased except for wings below half a unit, which vanish.
const FLUX_REL: f64 = 5e-6;

fn compare(scene: &Scene, count: u32) {
    if let Some(device) = device() {
        compare_on(&device, scene, count);
    }
}

fn compare_on(device: &Arc<GpuDevice>, scene: &Scene, count: u32) {
    let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(count));
    let truth = draw_cpu(plan, scene.size);
    let drawn = draw_gpu(&mut gpu, plan, scene.size);
    let difference = Difference::between(&truth, &drawn);
    println!(
        "{}, half {} px, {} stars: max {:.1e} of peak ({:.1e} e-), flux {:.1e}",
        plan.chosen.method,
        plan.half_px,
        plan.stars.len(),
        difference.largest_e / difference.peak_e,
        difference.largest_e,
        difference.flux_rel
    );
    assert!(difference.peak_e > 30.0, "something was drawn: {difference:?}");
    assert!(difference.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{difference:?}");
}

#[test]
fn static_gaussian() {
    compare(&Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static"), 400);
}

#[test]
fn slew_by_gauss_legendre() {
    compare(&Scene::new(PsfModel::gaussian(0.8), Motion::Slew([0.012, -0.02, 0.05]), "gauss-legendre"), 300);
}

#[test]
fn jitter_by_samples() {
    compare(&Scene::new(PsfModel::gaussian(0.8), Motion::Jitter(64, 1.7), "samples:64"), 300);
}

#[test]
fn long_path_of_many_slices() {
    compare(&Scene::new(PsfModel::gaussian(0.6), Motion::Jitter(700, 30.0), "samples:700"), 40);
}

#[test]
fn wide_gaussian_analytic_and_from_a_table() {
    // Half-widths of 21 (tables on both sides) and 12 (analytic here, a table on the CPU: agreement to its error).
    let Some(device) = device() else { return };
    compare_on(&device, &Scene::new(PsfModel::gaussian(5.0), Motion::Jitter(4, 1.0), "samples:4"), 60);
    let scene = Scene::new(PsfModel::gaussian(2.8), Motion::Jitter(4, 1.0), "samples:4");
    let mut gpu = Gpu::new(device, scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(60));
    assert!((8..=15).contains(&plan.half_px), "half {}", plan.half_px);
    let difference = Difference::between(&draw_cpu(plan, scene.size), &draw_gpu(&mut gpu, plan, scene.size));
    // The table's own promise, and stars that overlap.
    assert!(difference.within(2.0 * plan::exposure::sampling::TABLE_ERROR, 0.0, 1e-4), "{difference:?}");
}

#[test]
fn jitter_by_effective_psf() {
    compare(&Scene::new(PsfModel::gaussian(0.8), Motion::Jitter(64, 1.7), "effective-psf:64"), 400);
}

#[test]
fn roll_by_zonal_kernels() {
    compare(&Scene::new(PsfModel::gaussian(0.8), Motion::Roll(0.04), "zonal-psf:64"), 400);
}

#[test]
fn a_rolling_shutter_by_zonal_kernels_and_by_bands() {
    let Some(device) = device() else { return };
    let rolling = Shutter::Rolling { line_s: 1e-4 };
    for (method, motion) in [
        ("zonal-psf:64", Motion::Slew([0.008, -0.006, 0.02])),
        ("zonal-psf:64", Motion::Jitter(64, 1.7)),
        ("samples:32", Motion::Slew([0.008, -0.006, 0.02])),
    ] {
        let scene = Scene::new(PsfModel::gaussian(0.8), motion, method).with_shutter(rolling);
        let lists = scene.planner().plan(&scene.stars(300)).lists.len();
        assert!(lists > 1, "{method}: {lists} lists");
        compare_on(&device, &scene, 300);
    }
}

#[test]
fn bright_and_faint_stars_by_methods_of_their_own() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Slew([0.02, -0.03, 0.05]), "auto");
    let mut gpu = Gpu::new(device, scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let stars: Vec<_> =
        scene.stars(300).into_iter().map(|s| Source { electrons: if s.id < 10 { 2e5 } else { 60.0 }, ..s }).collect();
    let plan = planner.plan(&stars);
    assert!(plan.classes.len() > 1, "classes: {:?}", plan.classes);
    let truth = draw_cpu(plan, scene.size);
    let difference = Difference::between(&truth, &draw_gpu(&mut gpu, plan, scene.size));
    println!("{} classes: {difference:?}", plan.classes.len());
    assert!(difference.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{difference:?}");
    // Negative control: the faint stars by the bright ones' list, and the other way round.
    let mut swapped = plan.clone();
    let (first, last) = (swapped.stars[0].list, swapped.stars[swapped.stars.len() - 1].list);
    assert_ne!(first, last, "each class has its list");
    for star in &mut swapped.stars {
        star.list = if star.list == first { last } else { first };
    }
    let wrong = Difference::between(&truth, &draw_gpu(&mut gpu, &swapped, scene.size));
    assert!(!wrong.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{wrong:?}");
}

#[test]
fn airy_static_and_by_samples() {
    let Some(device) = device() else { return };
    compare_on(&device, &Scene::new(PsfModel::airy(1.9, 0.0), Motion::Still, "static"), 60);
    compare_on(&device, &Scene::new(PsfModel::airy(1.9, 0.2), Motion::Jitter(5, 1.7), "samples:5"), 30);
}

#[test]
fn airy_by_effective_psf() {
    compare(&Scene::new(PsfModel::airy(1.9, 0.0), Motion::Jitter(16, 1.7), "effective-psf:16"), 60);
}

#[test]
fn stars_across_all_edges_and_corners() {
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Jitter(8, 2.0), "samples:8");
    let Some(device) = device() else { return };
    let [width, height] = scene.size;
    let mut gpu = Gpu::new(device, width, height).expect("a backend");
    let mut planner = scene.planner();
    let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
    let mut stars = Vec::new();
    for (i, off) in [-6.3, -2.2, -0.5, 0.0, 0.49, 1.7].into_iter().enumerate() {
        let id = 10 * i as u32;
        let along = 30.0 + 25.0 * i as f64;
        let places = [[off, along], [right - off, along], [along, off], [along, bottom - off], [off, bottom - off]];
        stars.extend((0..).zip(places).map(|(k, px)| star(id + k, 1e4, px)));
    }
    let plan = planner.plan(&stars);
    let truth = draw_cpu(plan, scene.size);
    let difference = Difference::between(&truth, &draw_gpu(&mut gpu, plan, scene.size));
    assert!(difference.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{difference:?}");
    let edge = |x: usize, y: usize| truth.get(x, y).expect("on the image") > 1.0;
    assert!((0..height).any(|y| edge(0, y)) && (0..height).any(|y| edge(width - 1, y)), "left and right are lit");
    assert!((0..width).any(|x| edge(x, 0)) && (0..width).any(|x| edge(x, height - 1)), "top and bottom are lit");
}

#[test]
fn an_empty_field_is_dark() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static");
    let mut gpu = Gpu::new(device, scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    draw_gpu(&mut gpu, planner.plan(&scene.stars(100)), scene.size);
    let dark = draw_gpu(&mut gpu, planner.plan(&[]), scene.size);
    assert!(dark.pixels().iter().all(|e| *e == 0.0), "nothing is left of the frame before");
}

#[test]
fn the_comparator_sees_one_wrong_pixel() {
    let mut a = Image::<f32>::new(40, 30);
    a.pixels_mut().fill(100.0);
    let mut b = a.clone();
    assert!(Difference::between(&a, &b).within(PEAK_SHARE, FLOOR_E, FLUX_REL), "equal images agree");
    b.pixels_mut()[777] += 0.01;
    assert!(!Difference::between(&a, &b).within(PEAK_SHARE, FLOOR_E, 1.0), "one pixel off by 1e-4 of the peak");
    let mut c = a.clone();
    c.pixels_mut().iter_mut().for_each(|e| *e *= 1.0 + 2e-5);
    assert!(!Difference::between(&a, &c).within(1.0, 0.0, FLUX_REL), "flux off by 2e-5");
}
