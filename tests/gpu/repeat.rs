//! The same plan and frame number give the same bits, whatever was drawn in between.

use crate::scene::{EXPOSURE_S, Motion, Scene, detector, device, draw_gpu};
use base::image::DnImage;
use plan::{exposure::ExposurePlan, optics::PsfModel};
use starloop_image::{detector::DetectorConditions, detector::gpu::GpuDetector, render::Backend, render::gpu::Gpu};

#[test]
fn frames_repeat_bit_for_bit() {
    let Some(device) = device() else { return };
    for method in ["samples:32", "effective-psf:32"] {
        let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Jitter(32, 1.7), method);
        let [width, height] = scene.size;
        let mut gpu = Gpu::new(device.clone(), width, height).expect("a backend");
        let mut readout = GpuDetector::new(device.clone(), &detector(scene.size, 2.0, 9), width, height).expect("one");
        let (mut planner, mut other) = (scene.planner(), scene.planner());
        let plan = planner.plan(&scene.stars(500)).clone();
        let mut shoot = |gpu: &mut Gpu, plan: &ExposurePlan, frame| {
            gpu.render(plan).expect("draws");
            let mut dn = DnImage::new(width, height);
            readout
                .collect(gpu.device_electrons(), frame, &DetectorConditions::dark(EXPOSURE_S), &mut dn)
                .expect("reads out");
            dn
        };
        let first = shoot(&mut gpu, &plan, 5);
        let electrons = draw_gpu(&mut gpu, &plan, scene.size);
        assert_eq!(first, shoot(&mut gpu, &plan, 5), "{method}: at once");
        // More stars than the buffers held so far, none, and another frame number in between.
        for count in [6000, 0, 30] {
            let between = shoot(&mut gpu, other.plan(&scene.stars(count)), 6);
            assert_ne!(first, between, "{method}: the frame between is another one");
        }
        assert_eq!(first, shoot(&mut gpu, &plan, 5), "{method}: after other frames");
        assert_eq!(electrons, draw_gpu(&mut gpu, &plan, scene.size), "{method}: electrons");
        assert_ne!(first, shoot(&mut gpu, &plan, 7), "{method}: another frame number is other noise");
    }
}

#[test]
fn a_field_in_blocks_is_the_field_at_once() {
    let Some(device) = device() else { return };
    // Analytic, from a table, and by kernels: both passes, blocks with a part of each, and with several of the chunks that
    // threads prepare.
    for (psf, method) in [
        (PsfModel::gaussian(0.8), "samples:8"),
        (PsfModel::airy(0.98, 0.3), "samples:8"),
        (PsfModel::gaussian(0.8), "effective-psf:32"),
    ] {
        let scene = Scene::new(psf, Motion::Jitter(32, 1.7), method);
        let [width, height] = scene.size;
        let mut gpu = Gpu::new(device.clone(), width, height).expect("a backend");
        let mut planner = scene.planner();
        let plan = planner.plan(&scene.stars(3000)).clone();
        let at_once = draw_gpu(&mut gpu, &plan, scene.size);
        for block in [2999, 640] {
            gpu.limit_block(block);
            assert_eq!(at_once, draw_gpu(&mut gpu, &plan, scene.size), "{method}, blocks of {block}");
        }
        let fewer = planner.plan(&scene.stars(2999)).clone();
        assert_ne!(at_once, draw_gpu(&mut gpu, &fewer, scene.size), "control: one star less is seen");
    }
}
