//! The background's shape and the illumination map: GPU against CPU, in one pass and in two.

use crate::scene::{DnDifference, EXPOSURE_S, Motion, Scene, detector, device, draw_cpu, draw_gpu};
use base::image::DnImage;
use plan::optics::PsfModel;
use starloop_image::detector::{Background, DetectorConditions};
use starloop_image::{detector::gpu::GpuDetector, render::gpu::Gpu};

/// As for the detector's other stages.
const SHARE: f64 = 3e-4;

#[test]
fn shaped_backgrounds_agree() {
    let Some(device) = device() else { return };
    let shaped = Background { uniform_e: 180.0, gradient_e: [-70.0, 40.0], quadratic_e: 30.0, sky_e: 25.0 };
    let cases = [
        Background::uniform(40.0),
        shaped,
        Background { quadratic_e: 0.0, ..shaped },
        Background { sky_e: 0.0, ..shaped },
        Background { sky_e: 60.0, ..Background::DARK },
    ];
    for size in [[320, 256], [37, 23]] {
        let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(size);
        let mut planner = scene.planner();
        let plan = planner.plan(&scene.stars(60)).clone();
        let mut gpu = Gpu::new(device.clone(), size[0], size[1]).expect("a backend");
        draw_gpu(&mut gpu, &plan, size);
        let mean = draw_cpu(&plan, size);
        let map: Vec<f32> = (0..size[0] * size[1]).map(|i| 1.0 - 0.4 * (i % size[0]) as f32 / size[0] as f32).collect();
        let share = SHARE.max(1.5 / (size[0] * size[1]) as f64);
        for (has_map, is_apart) in [(false, false), (true, false), (true, true)] {
            let mut detector = detector(size, 2.0, 5);
            if is_apart {
                detector.keep_charge();
            }
            detector.set_illumination_map(has_map.then(|| map.clone()));
            let mut readout = GpuDetector::new(device.clone(), &detector, size[0], size[1]).expect("a detector");
            for (frame, background) in (0..).zip(cases) {
                let [mut on_cpu, mut on_gpu] = [DnImage::new(size[0], size[1]), DnImage::new(size[0], size[1])];
                let conditions = DetectorConditions::lit(EXPOSURE_S, background.and_uniform(3.0));
                detector.collect(&mean, frame, &conditions, &mut on_cpu);
                readout.collect(gpu.device_electrons(), frame, &conditions, &mut on_gpu).expect("reads out");
                let difference = DnDifference::between(&on_cpu, &on_gpu);
                println!("{size:?}, map {has_map}, apart {is_apart}, case {frame}: {difference:?}");
                assert!(difference.within(share), "{background:?}: {difference:?}");
                // Negative control: the same frame under another light.
                let turned = Background { gradient_e: [40.0, -70.0], ..conditions.background };
                let conditions = DetectorConditions::lit(EXPOSURE_S, turned);
                readout.collect(gpu.device_electrons(), frame, &conditions, &mut on_gpu).expect("reads out");
                assert!(!DnDifference::between(&on_cpu, &on_gpu).within(share), "a turned gradient shows");
            }
        }
    }
}

#[test]
fn a_map_given_later_is_the_map_given_at_once() {
    let Some(device) = device() else { return };
    let size = [64, 48];
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(size);
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(5)).clone();
    let mut gpu = Gpu::new(device.clone(), size[0], size[1]).expect("a backend");
    draw_gpu(&mut gpu, &plan, size);
    let map: Vec<f32> = (0..size[0] * size[1]).map(|i| (i % 7) as f32 / 7.0).collect();
    let read = |readout: &mut GpuDetector| {
        let mut dn = DnImage::new(size[0], size[1]);
        let conditions = DetectorConditions::lit(EXPOSURE_S, Background { sky_e: 400.0, ..Background::DARK });
        readout.collect(gpu.device_electrons(), 1, &conditions, &mut dn).expect("reads out");
        dn
    };
    let mut detector = detector(size, 1.0, 5);
    let mut later = GpuDetector::new(device.clone(), &detector, size[0], size[1]).expect("a detector");
    let even = read(&mut later);
    later.set_illumination_map(Some(&map)).expect("space");
    detector.set_illumination_map(Some(map));
    let mut at_once = GpuDetector::new(device.clone(), &detector, size[0], size[1]).expect("a detector");
    let with_map = read(&mut later);
    assert_eq!(with_map, read(&mut at_once));
    assert_ne!(with_map, even, "control: the map shows");
    later.set_illumination_map(None).expect("space");
    assert_eq!(read(&mut later), even, "and goes");
}
