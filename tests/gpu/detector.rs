//! Digital numbers: GPU against CPU with every effect on.

use crate::scene::{DnDifference, EXPOSURE_S, Motion, Scene, detector, device, draw_cpu, draw_gpu, star};
use base::image::{DnImage, Image};
use plan::{exposure::Source, optics::PsfModel};
use starloop_image::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};
use starloop_image::gpu::{DeviceElectrons, GpuDevice, GpuError};
use starloop_image::{detector::gpu::GpuDetector, render::gpu::Gpu};
use std::sync::Arc;

/// Share of pixels that may differ by 1 DN: the ADC rounds apart where a value lies within the rounding error of the
/// noise (1e-6 of 40 DN in 1 DN, both sides: 1e-4), Poisson counts where a mean differs by 1e-5 e- (1e-5 of them).
const SHARE: f64 = 3e-4;

/// Draws and reads out on both sides: (CPU, GPU).
fn both(device: &Arc<GpuDevice>, scene: &Scene, stars: &[Source], detector: &mut Detector, frame: u32) -> [DnImage; 2] {
    let [width, height] = scene.size;
    let mut gpu = Gpu::new(device.clone(), width, height).expect("a backend");
    let mut readout = GpuDetector::new(device.clone(), detector, width, height).expect("a detector");
    let mut planner = scene.planner();
    let plan = planner.plan(stars);
    let [mut on_cpu, mut on_gpu] = [DnImage::new(width, height), DnImage::new(width, height)];
    detector.collect(&draw_cpu(plan, scene.size), frame, &DetectorConditions::dark(EXPOSURE_S), &mut on_cpu);
    draw_gpu(&mut gpu, plan, scene.size);
    readout
        .collect(gpu.device_electrons(), frame, &DetectorConditions::dark(EXPOSURE_S), &mut on_gpu)
        .expect("reads out");
    [on_cpu, on_gpu]
}

#[test]
fn full_noise_agrees_to_one_dn() {
    let Some(device) = device() else { return };
    for (gain, method) in [(1.0, "samples:16"), (2.0, "effective-psf:16"), (7.3, "static")] {
        let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Jitter(16, 1.2), method).of_size([512, 512]);
        let mut stars = scene.stars(2000);
        stars.push(star(9999, 3e6, [250.3, 250.2])); // saturates
        let mut detector = detector(scene.size, gain, 11);
        let [cpu, gpu] = both(&device, &scene, &stars, &mut detector, 3);
        let difference = DnDifference::between(&cpu, &gpu);
        println!("gain {gain}, {method}: {difference:?}");
        assert!(difference.within(SHARE), "{method}: {difference:?}");
        assert!(cpu.pixels().iter().max() > Some(&5000), "a bright pixel is there");
    }
}

#[test]
fn a_bright_background_goes_through_the_other_branch() {
    // Dark signal above the inversion limit everywhere: Cornish-Fisher.
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static");
    let params = DetectorParams { dark_e_per_s: 1000.0, bits: 12, ..*detector(scene.size, 1.5, 2).params() };
    let mut detector = Detector::new(params, scene.size[0], scene.size[1], 2);
    let [cpu, gpu] = both(&device, &scene, &scene.stars(300), &mut detector, 1);
    let difference = DnDifference::between(&cpu, &gpu);
    println!("dark 100 e-: {difference:?}");
    assert!(difference.within(SHARE), "{difference:?}");
    assert_eq!(gpu.pixels().iter().max(), cpu.pixels().iter().max(), "the same clipping");
}

#[test]
fn effects_that_are_off_keep_the_agreement() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static");
    let params = DetectorParams {
        read_noise_e_rms: 0.0,
        prnu: 0.0,
        dsnu_e_rms: 0.0,
        dark_e_per_s: 0.0,
        ..*detector(scene.size, 1.0, 2).params()
    };
    let mut detector = Detector::new(params, scene.size[0], scene.size[1], 2);
    let [cpu, gpu] = both(&device, &scene, &scene.stars(300), &mut detector, 1);
    let difference = DnDifference::between(&cpu, &gpu);
    println!("shot noise alone: {difference:?}");
    assert!(difference.within(SHARE), "{difference:?}");
}

#[test]
fn images_of_odd_size_and_of_more_than_one_row_of_workgroups() {
    let Some(device) = device() else { return };
    for size in [[37, 23], [1, 1], [4096, 2100]] {
        let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(size);
        let [cpu, gpu] = both(&device, &scene, &scene.stars(50), &mut detector(size, 2.0, 4), 8);
        let difference = DnDifference::between(&cpu, &gpu);
        println!("{size:?}: {difference:?}");
        // One pixel of a small image is already a large share.
        assert!(difference.within(SHARE.max(1.5 / (size[0] * size[1]) as f64)), "{size:?}: {difference:?}");
    }
}

#[test]
fn the_comparator_sees_another_seed_another_frame_and_one_pixel() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static");
    let stars = scene.stars(300);
    let [cpu, gpu] = both(&device, &scene, &stars, &mut detector(scene.size, 2.0, 11), 3);
    assert!(DnDifference::between(&cpu, &gpu).within(SHARE), "they agree to begin with");
    let [_, seed] = both(&device, &scene, &stars, &mut detector(scene.size, 2.0, 12), 3);
    assert!(!DnDifference::between(&cpu, &seed).within(SHARE), "another seed");
    let [_, frame] = both(&device, &scene, &stars, &mut detector(scene.size, 2.0, 11), 4);
    assert!(!DnDifference::between(&cpu, &frame).within(SHARE), "another frame");
    let mut pixel = gpu.clone();
    pixel.pixels_mut()[4321] ^= 2;
    assert!(!DnDifference::between(&gpu, &pixel).within(SHARE), "one pixel off by 2 DN");
}

#[test]
fn images_of_another_size_are_refused() {
    let Some(device) = device() else { return };
    let mut readout = GpuDetector::new(device.clone(), &detector([64, 32], 1.0, 1), 64, 32).expect("a detector");
    let electrons = DeviceElectrons::new(&device, 64, 31).expect("an image");
    let refused = readout.collect(&electrons, 0, &DetectorConditions::dark(EXPOSURE_S), &mut DnImage::new(64, 32));
    assert!(matches!(refused, Err(GpuError::Size { got: [64, 31], wanted: [64, 32], .. })), "{refused:?}");
    let mut gpu = Gpu::new(device, 64, 32).expect("a backend");
    assert!(gpu.read_electrons(&mut Image::new(32, 64)).is_err(), "rows and columns swapped");
}

#[test]
fn a_poisson_method_of_the_cpu_alone_is_refused() {
    let Some(device) = device() else { return };
    for poisson in PoissonMethod::ALL {
        let params = DetectorParams { poisson, ..*detector([64, 32], 1.0, 1).params() };
        let made = GpuDetector::new(device.clone(), &Detector::new(params, 64, 32, 1), 64, 32);
        match made.err() {
            None => assert_eq!(poisson, PoissonMethod::Auto, "drawn as auto without a word"),
            Some(error) => {
                assert!(matches!(&error, GpuError::CpuOnly { got, .. } if got == poisson.name()), "{error}");
                assert!(error.to_string().contains("wanted \"auto\", or the CPU backend"), "{error}");
                assert_ne!(poisson, PoissonMethod::Auto);
            }
        }
    }
}
