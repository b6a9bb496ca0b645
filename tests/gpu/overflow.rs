//! Bright stars: the fixed point gives way in resolution, never in range.

use crate::scene::{Difference, Motion, Scene, device, draw_cpu, draw_gpu, star};
use plan::optics::PsfModel;
use starloop_image::{gpu::GpuDevice, render::gpu::Gpu, render::gpu::scale::LARGEST_SCALE};
use std::sync::Arc;

/// f32 rounding of both sides; the floor is half a unit of the scale the frame got.
const PEAK_SHARE: f64 = 3e-6;
/// Most electrons of a whole star in a pixel on a device.
const MOST_PIXEL_E: f32 = 268_435_456.0;

fn draw(device: &Arc<GpuDevice>, electrons: f64, count: u32, psf: PsfModel, method: &str) {
    let scene = Scene::new(psf, Motion::Jitter(6, 0.4), method);
    let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let stars: Vec<_> = (0..count).map(|i| star(i, electrons, [100.2 + 0.1 * f64::from(i), 80.4])).collect();
    let plan = planner.plan(&stars);
    let mut truth = draw_cpu(plan, scene.size);
    truth.pixels_mut().iter_mut().for_each(|e| *e = e.min(MOST_PIXEL_E));
    let drawn = draw_gpu(&mut gpu, plan, scene.size);
    let difference = Difference::between(&truth, &drawn);
    let scale = f64::from(gpu.device_electrons().scale());
    println!("{count} stars of {electrons:e} e-: peak {:.3e} e-, scale {scale}", difference.peak_e);
    assert!(difference.peak_e * scale < f64::from(i32::MAX), "fits: {difference:?}, scale {scale}");
    assert!(difference.within(PEAK_SHARE, f64::from(count) / scale, 1e-5), "{difference:?}, scale {scale}");
    assert!(drawn.pixels().iter().all(|e| *e > -1e-4 * electrons as f32), "nothing has wrapped");
}

#[test]
fn one_star_of_thirty_million_electrons() {
    let Some(device) = device() else { return };
    for (electrons, method) in [(3e7, "samples:6"), (3e7, "effective-psf:6"), (1e12, "static")] {
        draw(&device, electrons, 1, PsfModel::gaussian(0.8), method);
    }
    draw(&device, 3e7, 1, PsfModel::airy(1.9, 0.0), "static");
}

#[test]
fn many_stars_in_one_pixel() {
    let Some(device) = device() else { return };
    draw(&device, 2e5, 40, PsfModel::gaussian(0.8), "samples:6");
}

#[test]
fn an_ordinary_field_keeps_full_resolution() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static");
    let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    draw_gpu(&mut gpu, planner.plan(&[star(0, 4e5, [50.0, 50.0])]), scene.size);
    assert_eq!(f64::from(gpu.device_electrons().scale()), LARGEST_SCALE, "a star at full well");
}
