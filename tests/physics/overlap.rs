//! Where targets cover stars: photons add, or each pixel shows the brighter of the two.

use crate::scene::{EXPOSURE_S, draw_cpu, draw_reference, los, planner, star};
use base::time::{Span, Tai};
use image::render::{cpu::Cpu, overlap::Apart, reference::Reference};
use image::{gpu::Electrons, render::Backend};
use plan::exposure::{ExposurePlan, Target, TargetCurve, TargetPath, TargetWay};
use plan::{exposure::planner::Planner, exposure::target::FIRST_TARGET_ID, optics::PsfModel};

const SIZE: usize = 64;

fn crossing() -> Planner {
    let mut planner = planner(SIZE, &PsfModel::gaussian(0.8), "auto", los(), None);
    let path = TargetPath { position_px: [25.0, 30.0], velocity_px_s: [100.0, 0.0], curve: TargetCurve::Straight };
    let (begin, end) = (Tai::from_ns(0), Tai::from_ns(0) + Span::from_s(1.0));
    planner.set_targets(vec![Target {
        id: FIRST_TARGET_ID,
        mag: f32::NAN,
        e_per_s: 5e4 / EXPOSURE_S,
        begin,
        end,
        way: TargetWay::Script(path),
        light: None,
    }]);
    planner
}

fn pixels(electrons: Electrons<'_>) -> Vec<f64> {
    match electrons {
        Electrons::Host(image) => image.pixels().iter().map(|e| f64::from(*e)).collect(),
        Electrons::Precise(image) => image.pixels().to_vec(),
        Electrons::Device(_) => panic!("in memory"),
    }
}

fn apart(backend: &mut dyn Backend, plan: &ExposurePlan) -> (Vec<f64>, f64) {
    let mut apart = Apart::new();
    apart.render(backend, plan).unwrap();
    (pixels(apart.electrons()), apart.lost_e)
}

#[test]
fn each_pixel_shows_the_brighter_and_the_rest_is_reported() {
    // A star on the target's way, and one far from it.
    let stars = [star(1, 3e4, [30.2, 30.4]), star(2, 2e4, [12.0, 50.0])];
    let mut with = crossing();
    let plan = with.plan(&stars).clone();
    let stars_alone = {
        let mut planner = planner(SIZE, &PsfModel::gaussian(0.8), "auto", los(), None);
        draw_cpu(planner.plan(&stars))
    };
    let target_alone = draw_cpu(crossing().plan(&[]));
    let together = draw_cpu(&plan);
    let (kept, lost_e) = apart(&mut Cpu::new(SIZE, SIZE), &plan);
    let brightest = together.pixels.iter().copied().fold(0.0, f64::max);
    let mut wanted_lost = 0.0;
    for (i, kept) in kept.iter().enumerate() {
        let (a, b) = (stars_alone.pixels[i], target_alone.pixels[i]);
        assert!((kept - a.max(b)).abs() < 1e-6 * brightest, "pixel {i}: {kept}, {a} and {b}");
        assert!((together.pixels[i] - (a + b)).abs() < 1e-6 * brightest, "photons add: pixel {i}");
        wanted_lost += a.min(b);
    }
    assert!(wanted_lost > 1000.0 && (lost_e / wanted_lost - 1.0).abs() < 1e-4, "{lost_e} of {wanted_lost}");
    let sum: f64 = kept.iter().sum();
    assert!((sum + lost_e - together.sum()).abs() < 1e-4 * together.sum(), "what is lost is what is missing");
    let (precise, precise_lost_e) = apart(&mut Reference::new(SIZE, SIZE), &plan);
    let worst = kept.iter().zip(&precise).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-5 * brightest, "CPU and reference: {worst:e} e-");
    assert!((precise_lost_e / lost_e - 1.0).abs() < 1e-4);
    // The control: the sum is not the brighter.
    let off = kept.iter().zip(&draw_reference(&plan).pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off > 0.05 * brightest, "{off}");
}

#[test]
fn without_a_star_behind_it_a_target_loses_nothing() {
    let plan = crossing().plan(&[star(2, 2e4, [12.0, 50.0])]).clone();
    let (kept, lost_e) = apart(&mut Cpu::new(SIZE, SIZE), &plan);
    let together = draw_cpu(&plan);
    let worst = kept.iter().zip(&together.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-2 && lost_e.abs() < 1e-2, "{worst} e-, {lost_e} e- lost");
}
