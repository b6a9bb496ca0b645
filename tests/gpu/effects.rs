//! Every pixel-local effect: GPU against CPU, in one pass and in passes apart, with a control that it does something.

use crate::scene::{DnDifference, EXPOSURE_S, Motion, Scene, detector, device, draw_cpu, draw_gpu, star};
use base::{bayer::BayerPattern, image::DnImage};
use plan::optics::PsfModel;
use starloop_image::detector::{
    DarkLaw, Detector, DetectorConditions, DetectorParams, LinePattern, Nonlinearity, Patterns, Rounding, RowNoise,
    SpatialParams,
};
use starloop_image::{detector::gpu::GpuDetector, detector::pattern::ColourFilter, render::gpu::Gpu};
use std::sync::Arc;

/// As in `detector.rs`: rounding of the ADC and of Poisson means, and one or two multiply-adds more.
const SHARE: f64 = 5e-4;
const SIZE: [usize; 2] = [301, 203];

/// Returns every effect on its own, added to the detector with full noise; then all of them.
fn effects(base: DetectorParams) -> Vec<(&'static str, DetectorParams)> {
    let knots = [[2000.0, 1980.0], [20_000.0, 19_500.0], [50_000.0, 48_000.0], [90_000.0, 80_000.0]];
    let nonlinearity = Nonlinearity::through(&knots).expect("rising");
    let row_noise = RowNoise { e_rms: 15.0, corner_cycles_per_row: 0.1 };
    let columns = LinePattern { column_e_rms: 12.0, column_gain_rms: 0.01, row_e_rms: 0.0 };
    let dark_law = DarkLaw { operating_c: 31.0, ..DarkLaw::AT_REFERENCE };
    let colour_filter = Some(ColourFilter { pattern: BayerPattern::Grbg, red: 0.35, green: 0.45, blue: 0.25 });
    let filtered = SpatialParams { colour_filter, ..base.spatial };
    let all = DetectorParams {
        spatial: filtered,
        dark_law,
        dark_nonuniformity: 0.4,
        amplifier_noise_e_rms: 20.0,
        nonlinearity,
        line_pattern: LinePattern { row_e_rms: 9.0, ..columns },
        row_noise,
        rounding: Rounding::Truncate,
        ..base
    };
    vec![
        ("colour filter", DetectorParams { spatial: filtered, ..base }),
        ("temperature", DetectorParams { dark_law, ..base }),
        ("dark non-uniformity", DetectorParams { dark_law, dark_nonuniformity: 0.4, ..base }),
        ("amplifier noise", DetectorParams { amplifier_noise_e_rms: 20.0, ..base }),
        ("nonlinearity", DetectorParams { nonlinearity, ..base }),
        ("columns", DetectorParams { line_pattern: columns, ..base }),
        ("rows", DetectorParams { line_pattern: LinePattern { row_e_rms: 9.0, ..LinePattern::OFF }, ..base }),
        ("row noise", DetectorParams { row_noise, ..base }),
        ("truncation", DetectorParams { rounding: Rounding::Truncate, gain_e_per_dn: 7.0, ..base }),
        ("all of them", all),
    ]
}

#[test]
fn every_effect_agrees_with_the_cpu_and_changes_the_image() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(SIZE);
    let mut stars = scene.stars(200);
    stars.push(star(9999, 3e6, [20.3, 11.2]));
    let mut planner = scene.planner();
    let plan = planner.plan(&stars);
    let mean = draw_cpu(plan, SIZE);
    let mut gpu = Gpu::new(device.clone(), SIZE[0], SIZE[1]).expect("a backend");
    draw_gpu(&mut gpu, plan, SIZE);
    let on_gpu = |detector: &Detector| {
        let mut dn = DnImage::new(SIZE[0], SIZE[1]);
        let mut readout = GpuDetector::new(device.clone(), detector, SIZE[0], SIZE[1]).expect("a detector");
        // Two frames through the same buffers: the second is looked at.
        for frame in [2, 3] {
            readout
                .collect(gpu.device_electrons(), frame, &DetectorConditions::dark(EXPOSURE_S), &mut dn)
                .expect("reads out");
        }
        dn
    };
    let base = detector(SIZE, 2.0, 11);
    let without = on_gpu(&base);
    let maps =
        Patterns { prnu: Some((0..SIZE[0] * SIZE[1]).map(|i| (i % 7) as f32 * 0.01).collect()), ..Patterns::default() };
    let mut cases: Vec<(&str, Detector)> = effects(*base.params())
        .into_iter()
        .map(|(name, params)| (name, Detector::new(params, SIZE[0], SIZE[1], 11)))
        .collect();
    cases.push(("a given map", detector(SIZE, 2.0, 11).with_patterns(&maps).expect("fits")));
    for (name, mut detector) in cases {
        for passes in ["one pass", "passes apart"] {
            let mut on_cpu = DnImage::new(SIZE[0], SIZE[1]);
            detector.collect(&mean, 3, &DetectorConditions::dark(EXPOSURE_S), &mut on_cpu);
            let on_device = on_gpu(&detector);
            let difference = DnDifference::between(&on_cpu, &on_device);
            println!("{name}, {passes}: {difference:?}");
            assert!(difference.within(SHARE), "{name}, {passes}: {difference:?}");
            let effect = DnDifference::between(&without, &on_device);
            // A bent response shows in bright pixels only.
            assert!(effect.share > 0.02, "{name}, {passes}: it does something: {effect:?}");
            detector.keep_charge();
        }
    }
}

#[test]
fn a_temperature_step_is_the_same_on_both_sides() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.8), Motion::Still, "static").of_size(SIZE);
    let mut planner = scene.planner();
    let plan = planner.plan(&scene.stars(50));
    let mut gpu = Gpu::new(device.clone(), SIZE[0], SIZE[1]).expect("a backend");
    draw_gpu(&mut gpu, plan, SIZE);
    let mut detector = detector(SIZE, 1.0, 3);
    let mut readout = GpuDetector::new(Arc::clone(&device), &detector, SIZE[0], SIZE[1]).expect("a detector");
    let mut dn = [DnImage::new(SIZE[0], SIZE[1]), DnImage::new(SIZE[0], SIZE[1])];
    let mean = draw_cpu(plan, SIZE);
    let mut totals = Vec::new();
    for warmer_k in [0.0, 28.0] {
        let conditions = DetectorConditions { warmer_k, ..DetectorConditions::dark(EXPOSURE_S) };
        detector.collect(&mean, 1, &conditions, &mut dn[0]);
        readout.collect(gpu.device_electrons(), 1, &conditions, &mut dn[1]).expect("reads out");
        let difference = DnDifference::between(&dn[0], &dn[1]);
        assert!(difference.within(SHARE), "{warmer_k} K: {difference:?}");
        totals.push(dn[1].pixels().iter().map(|dn| f64::from(*dn)).sum::<f64>());
    }
    // Four doublings of 30 e-/s: 15 times 3 e- more in every pixel.
    let more = (totals[1] - totals[0]) / (SIZE[0] * SIZE[1]) as f64;
    assert!((more - 45.0).abs() < 1.0, "{more} e- a pixel");
}
