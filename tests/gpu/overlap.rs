//! Targets, and the brighter of stars and targets: GPU against CPU.

use crate::scene::{EXPOSURE_S, Motion, Scene, device, draw_cpu, draw_gpu};
use base::image::Image;
use base::time::{Span, Tai};
use plan::exposure::{ExposurePlan, Target, TargetCurve, TargetPath, TargetWay};
use plan::{exposure::target::FIRST_TARGET_ID, optics::PsfModel};
use starloop_image::gpu::Electrons;
use starloop_image::render::{cpu::Cpu, gpu::Gpu, gpu::brighter::Brighter, overlap::Apart};

/// Of the brightest pixel: rounding of single precision on both sides.
const PEAK_SHARE: f64 = 5e-6;

fn plan_of(scene: &Scene) -> ExposurePlan {
    let mut planner = scene.planner();
    let target = |(id, x, y): (u32, f64, f64)| Target {
        id,
        mag: f32::NAN,
        e_per_s: 8e4 / EXPOSURE_S,
        begin: Tai::from_ns(0) - Span::from_s(1e6),
        end: Tai::from_ns(i64::MAX / 2),
        way: TargetWay::Script(TargetPath {
            position_px: [x, y],
            velocity_px_s: [150.0, -60.0],
            curve: TargetCurve::Straight,
        }),
        light: None,
    };
    let mid = planner.latest().motion.los.mid_exposure();
    let mut targets = [(FIRST_TARGET_ID, 90.3, 80.8), (FIRST_TARGET_ID + 1, 200.0, 150.5)].map(target);
    for target in &mut targets {
        target.begin = mid - Span::from_s(0.2);
        target.end = mid + Span::from_s(0.2);
    }
    planner.set_targets(targets.to_vec());
    planner.plan(&scene.stars(600)).clone()
}

fn worst(a: &[f32], b: &[f32]) -> (f64, f64) {
    let worst = a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    (worst, a.iter().copied().map(f64::from).fold(0.0, f64::max))
}

#[test]
fn targets_are_drawn_alike() {
    let Some(device) = device() else { return };
    for psf in [PsfModel::gaussian(0.8), PsfModel::airy(1.2, 0.2)] {
        let scene = Scene::new(psf, Motion::Slew([0.004, -0.01, 0.05]), "auto");
        let plan = plan_of(&scene);
        assert_eq!(plan.targets.len(), 2);
        let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
        let (cpu, drawn) = (draw_cpu(&plan, scene.size), draw_gpu(&mut gpu, &plan, scene.size));
        let (off, peak) = worst(cpu.pixels(), drawn.pixels());
        assert!(off < PEAK_SHARE * peak, "{off} of {peak}");
    }
}

#[test]
fn the_brighter_is_the_same_on_both() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Slew([0.004, -0.01, 0.05]), "auto");
    let plan = plan_of(&scene);
    let [width, height] = scene.size;
    let (mut apart, mut host) = (Apart::new(), Apart::new());
    host.render(&mut Cpu::new(width, height), &plan).expect("draws");
    let Electrons::Host(wanted) = host.electrons() else { panic!("in memory") };
    let mut gpu = Gpu::new(device.clone(), width, height).expect("a backend");
    let mut brighter = Brighter::new(&device, scene.size).expect("a pass");
    let mut got = Image::new(width, height);
    // Twice: the state of one image must not show in the next.
    for _ in 0..2 {
        brighter.render(&mut gpu, &plan, &mut apart).expect("draws");
        gpu.read_image(brighter.electrons(), &mut got).expect("reads");
        let (off, peak) = worst(wanted.pixels(), got.pixels());
        assert!(off < PEAK_SHARE * peak, "{off} of {peak}");
        assert!((apart.lost_e / host.lost_e - 1.0).abs() < 1e-3, "{} and {}", apart.lost_e, host.lost_e);
    }
    let together = draw_cpu(&plan, scene.size);
    assert!(worst(together.pixels(), got.pixels()).0 > 10.0, "the control: the sum is another image");
}
