//! PSF samplings: what an image drawn with each errs by, against its bound, and which of them the budget refuses.

use crate::measure::around;
use crate::scene::{centroid_error_px, draw_cpu, draw_reference, star};
use crate::stability::{ELECTRONS, Scene};
use base::accuracy::AccuracyBudget;
use plan::exposure::plan::Verdict;
use plan::exposure::sampling::{SamplingError, sampling_error};
use plan::exposure::{Instrument, PsfSampling};

/// Widths of the PSF, px.
const SIGMAS: [f64; 4] = [0.3, 0.5, 0.8, 1.2];
/// Places of a star within a pixel.
const PHASES: [[f64; 2]; 8] =
    [[0.0, 0.0], [0.25, 0.0], [0.13, -0.37], [0.37, 0.31], [-0.29, 0.44], [0.06, 0.19], [0.49, -0.21], [0.44, 0.44]];
/// Single precision: 25 pixels, and a table's coefficients (1e-7 each, filtered).
const F32_PX: f64 = 5e-6;
/// Single precision of one pixel, share of the peak.
const F32_PEAK: f64 = 2e-6;
/// A bound this many times what is measured says little.
const SLACKEST: f64 = 60.0;
/// Errors below this are not asked to be near their bounds.
const SMALL_PX: f64 = 1e-4;

/// Returns the methods that are compared.
fn samplings() -> Vec<PsfSampling> {
    let tables = [2, 4, 8, 16].map(|oversampling| PsfSampling::Table { oversampling });
    let points = [3, 5].map(|n| PsfSampling::Supersampled { n });
    let mut all = vec![PsfSampling::Auto, PsfSampling::Point, PsfSampling::Bicubic];
    all.extend(tables.into_iter().chain(points));
    all
}

fn scene(sigma_px: f64, sampling: PsfSampling, [dx, dy]: [f64; 2]) -> Scene {
    let still = Scene::still(sigma_px);
    Scene {
        instrument: Instrument { sampling, ..still.instrument },
        stars: vec![star(0, ELECTRONS, [31.0 + dx, 31.0 + dy])],
        ..still
    }
}

/// Returns the largest errors over all phases, and what the planner says.
fn worst(sigma_px: f64, sampling: PsfSampling) -> (SamplingError, Verdict) {
    let mut worst = SamplingError::default();
    let mut verdict = Verdict::Fits;
    for phase in PHASES {
        let plan = scene(sigma_px, sampling, phase).plan("static");
        verdict = plan.chosen.verdict;
        let (image, truth) = (draw_cpu(&plan), draw_reference(&plan));
        let around = around(&plan, plan.stars[0].mean_px);
        let window = truth.tracker_window(&around);
        let scale = ELECTRONS * plan.psf.peak();
        let rim = plan.psf.pixel(plan.half_px as f64 + 0.5, 0.0) / plan.psf.peak();
        let pixels = image.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a - b).abs() / scale);
        worst.centroid_px = worst.centroid_px.max(centroid_error_px(&image, &truth, &window));
        worst.peak = worst.peak.max(pixels.fold(0.0, f64::max) - rim);
    }
    (worst, verdict)
}

#[test]
fn errors_stay_within_the_bounds_of_each_sampling() {
    let mut broken = Vec::new();
    for sampling in samplings() {
        for sigma_px in SIGMAS {
            let (got, verdict) = worst(sigma_px, sampling);
            let psf = scene(sigma_px, sampling, [0.0; 2]).instrument.psf;
            let reported = sampling_error(&psf, sampling);
            let line = format!(
                "{sampling:15} sigma {sigma_px}: promised {:.1e} px {:.1e} peak, got {:.1e} px {:.1e} peak, {verdict:?}",
                reported.centroid_px, reported.peak, got.centroid_px, got.peak
            );
            println!("{line}");
            let slack = reported.centroid_px > SLACKEST * got.centroid_px && reported.centroid_px > SMALL_PX;
            let over = got.centroid_px > reported.centroid_px + F32_PX || got.peak > reported.peak + F32_PEAK;
            if over || slack {
                broken.push(line);
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn the_planner_refuses_samplings_that_miss_the_budget() {
    // Sampling, sigma, centroid error as published or measured elsewhere (px), whether it fits.
    let table = |oversampling| PsfSampling::Table { oversampling };
    let cases = [
        (PsfSampling::Auto, 0.3, 0.0, true),
        (PsfSampling::Auto, 0.8, 0.0, true),
        (PsfSampling::Point, 0.3, 2.0e-1, false),
        (PsfSampling::Point, 0.5, 2.9e-2, false),
        (PsfSampling::Point, 0.8, 8.4e-3, false),
        (PsfSampling::Supersampled { n: 3 }, 0.3, 1.6e-2, false),
        (PsfSampling::Bicubic, 0.3, 7.7e-2, false),
        (PsfSampling::Bicubic, 0.5, 2.3e-2, false),
        (PsfSampling::Bicubic, 0.8, 2.8e-2, false),
        (table(8), 0.5, 2.9e-5, true),
        (table(8), 0.8, 2.0e-5, true),
        (table(16), 0.5, 0.0, true),
    ];
    for (sampling, sigma_px, published_px, fits) in cases {
        let (got, verdict) = worst(sigma_px, sampling);
        assert_eq!(verdict == Verdict::Fits, fits, "{sampling}, sigma {sigma_px}: {verdict:?}, {got:?}");
        // Few phases here, a random sweep there.
        let most = 1.5 * published_px + SMALL_PX;
        assert!(got.centroid_px <= most, "{sampling}, sigma {sigma_px}: {got:?}, published {published_px}");
        if !fits {
            assert!(got.centroid_px > AccuracyBudget::default().centroid_px, "{sampling}, sigma {sigma_px}: {got:?}");
            assert!(got.centroid_px > 0.3 * published_px, "{sampling}, sigma {sigma_px}: {got:?}, {published_px}");
        }
    }
}
