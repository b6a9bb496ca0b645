//! Electrons of PSFs that come from tables alone: GPU against CPU for a lopsided grid, a Moffat profile and a field.

use crate::scene::{Difference, Motion, Scene, device, draw_cpu, draw_gpu};
use plan::exposure::{Drawing, Shutter};
use plan::optics::{PsfField, PsfGrid, PsfModel};
use starloop_image::{gpu::GpuDevice, render::gpu::Gpu};
use std::sync::Arc;

/// Both sides draw in f32 from the same tables: 1e-6 of rounding per star and part; overlapping stars add up.
const PEAK_SHARE: f64 = 3e-6;
/// Half a unit of fixed point (3e-5 e-) for each of the few stars over a pixel, four parts and several slices each.
const FLOOR_E: f64 = 1e-3;
/// Rounding to units is unbiased except for wings below half a unit, which vanish.
const FLUX_REL: f64 = 2e-5;

/// Returns the share of a Gaussian's light in the pixel `x` from its middle.
fn cell(x: f64, sigma: f64) -> f64 {
    let edge = |x: f64| 0.5 * libm::erf(x / (sigma * 2.0_f64.sqrt()));
    edge(x + 0.5) - edge(x - 0.5)
}

/// Returns a PSF that is wider along x than along y, with a flare to the right and up.
fn lopsided(wider: f64) -> PsfModel {
    let shape = |x: f64, y: f64| {
        0.8 * cell(x - 0.1, 0.95 + wider) * cell(y, 0.65) + 0.2 * cell(x - 1.4, 0.8) * cell(y + 0.9, 1.1)
    };
    PsfModel::grid(PsfGrid::sampled(8, 8, shape).expect("a PSF"))
}

fn field(size: [usize; 2]) -> PsfModel {
    let nodes = (0..6).map(|i| lopsided(0.1 * f64::from(i))).collect();
    PsfModel::field(PsfField::new([3, 2], size, nodes).expect("a field"))
}

fn compare(device: &Arc<GpuDevice>, scene: &Scene, count: u32) {
    let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(count));
    let truth = draw_cpu(plan, scene.size);
    let difference = Difference::between(&truth, &draw_gpu(&mut gpu, plan, scene.size));
    println!("{}, half {} px: {difference:?}", plan.chosen.method, plan.half_px);
    assert!(difference.peak_e > 30.0, "something was drawn: {difference:?}");
    assert!(difference.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{}: {difference:?}", plan.chosen.method);
}

#[test]
fn a_grid_and_a_moffat_profile() {
    let Some(device) = device() else { return };
    for psf in [lopsided(0.0), PsfModel::moffat(1.6, 4.0)] {
        compare(&device, &Scene::new(psf.clone(), Motion::Still, "static"), 150);
        compare(&device, &Scene::new(psf.clone(), Motion::Jitter(5, 1.7), "samples:5"), 60);
        compare(&device, &Scene::new(psf.clone(), Motion::Jitter(16, 1.7), "effective-psf:16"), 150);
        compare(&device, &Scene::new(psf, Motion::Roll(0.02), "zonal-psf:16"), 100);
    }
}

#[test]
fn a_field_of_psfs() {
    let Some(device) = device() else { return };
    let scene = |motion, method| {
        let scene = Scene::new(lopsided(0.0), motion, method);
        Scene { psf: field(scene.size), ..scene }
    };
    compare(&device, &scene(Motion::Still, "static"), 150);
    compare(&device, &scene(Motion::Jitter(5, 1.7), "samples:5"), 60);
    compare(&device, &scene(Motion::Slew([0.008, -0.006, 0.02]), "gauss-legendre"), 60);
    compare(&device, &scene(Motion::Jitter(16, 1.7), "effective-psf:16"), 150);
    compare(&device, &scene(Motion::Roll(0.02), "zonal-psf:16"), 100);
    let rolling = Shutter::Rolling { line_s: 1e-4 };
    compare(&device, &scene(Motion::Slew([0.008, -0.006, 0.02]), "samples:8").with_shutter(rolling), 60);
}

#[test]
fn psfs_of_a_field_that_change_places_are_seen() {
    let Some(device) = device() else { return };
    let scene = Scene::new(lopsided(0.0), Motion::Still, "static");
    let scene = Scene { psf: field(scene.size), ..scene };
    let mut gpu = Gpu::new(device, scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(150));
    let truth = draw_cpu(plan, scene.size);
    // Negative control: the nodes' tables in another order.
    let mut swapped = plan.clone();
    for list in &mut swapped.lists {
        if matches!(list.drawing, Drawing::Once) {
            list.psf_px[0] = scene.size[0] as f64 - 1.0 - list.psf_px[0];
        }
    }
    let wrong = Difference::between(&truth, &draw_gpu(&mut gpu, &swapped, scene.size));
    assert!(!wrong.within(PEAK_SHARE, FLOOR_E, FLUX_REL), "{wrong:?}");
}
