//! One pass over all stages and two passes with a charge image between them give the same numbers.

use crate::scene::{DnDifference, EXPOSURE_S, Motion, Scene, detector, device, draw_cpu, draw_gpu, star};
use base::image::DnImage;
use plan::optics::PsfModel;
use starloop_image::{detector::DetectorConditions, detector::gpu::GpuDetector, render::gpu::Gpu};

/// A driver may fuse a multiply-add where the other form stores to memory: as CPU against GPU.
const SHARE: f64 = 3e-4;

#[test]
fn passes_apart_agree_with_one_pass_and_with_the_cpu() {
    let Some(device) = device() else { return };
    for size in [[320, 256], [37, 23]] {
        let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(size);
        let mut stars = scene.stars(60);
        stars.push(star(9999, 3e6, [20.3, 11.2])); // saturates: the full well is a pass of its own
        let mut planner = scene.planner();
        let plan = planner.plan(&stars);
        let mut gpu = Gpu::new(device.clone(), size[0], size[1]).expect("a backend");
        draw_gpu(&mut gpu, plan, size);
        let mut detector = detector(size, 2.0, 5);
        let read_out = |detector: &_, frame| {
            let mut dn = DnImage::new(size[0], size[1]);
            let mut readout = GpuDetector::new(device.clone(), detector, size[0], size[1]).expect("a detector");
            readout
                .collect(gpu.device_electrons(), frame, &DetectorConditions::dark(EXPOSURE_S), &mut dn)
                .expect("reads out");
            dn
        };
        let one = read_out(&detector, 3);
        detector.keep_charge();
        let apart = read_out(&detector, 3);
        let mut on_cpu = DnImage::new(size[0], size[1]);
        detector.collect(&draw_cpu(plan, size), 3, &DetectorConditions::dark(EXPOSURE_S), &mut on_cpu);
        // Under the brightest star a mean is known to a hundredth of an electron: some of its 49 counts round the other
        // way.
        let share = SHARE.max(5.0 / (size[0] * size[1]) as f64);
        let [to_one, to_cpu] = [&one, &on_cpu].map(|other| DnDifference::between(&apart, other));
        println!("{size:?}: against one pass {to_one:?}, against the CPU {to_cpu:?}");
        assert!(to_one.within(share), "{to_one:?}");
        assert!(to_cpu.within(share), "{to_cpu:?}");
        assert!(one.pixels().iter().max() > Some(&40_000), "a pixel is full");
        let other = DnDifference::between(&apart, &read_out(&detector, 4));
        assert!(!other.within(share), "another frame is another draw: {other:?}");
    }
}
