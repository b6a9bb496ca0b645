//! PSFs that come from tables: a Moffat profile, and a grid that is elongated and lopsided, so that an axis taken for
//! the other or turned round is seen. The CPU backend is held to the reference, which takes every pixel in f64; the
//! grid itself is held to the shape it was made of, integrated by hand.

use crate::measure::{around, measure, peak_error};
use crate::scene::{EXPOSURE_S, FOCAL_PX, centroid_error_px, draw_cpu, draw_reference, los, planner, star};
use base::accuracy::AccuracyBudget;
use glam::DVec3;
use plan::exposure::sampling::{TABLE_ERROR, oversampling, sampling_error, table_error};
use plan::exposure::{Instrument, PixelPath, PixelPoint, Planner, PsfSampling, Source};
use plan::optics::{PsfGrid, PsfModel};
use plan::{attitude::LosPath, exposure::cost::CostModel, exposure::plan::Verdict};

/// Side of the detector, px.
const SIZE: usize = 64;
/// Electrons of a star.
const ELECTRONS: f64 = 2e4;
/// Pixel error against the reference, share of the peak: a table's promise of 3e-5, and what the footprint drops (5 %
/// of the flux budget spread over its rim).
const TABLE_PIXEL: f64 = 5e-5;
/// The same for light that has left the footprint for good: wings that fall by a power.
const WINGS_PIXEL: f64 = 6e-5;
/// Single precision of one pixel, share of the peak.
const F32_PEAK: f64 = 2e-6;
/// Single precision of a centroid, px.
const F32_PX: f64 = 5e-6;

/// Returns the share of a Gaussian's light in the pixel `x` from its middle.
fn cell(x: f64, sigma: f64) -> f64 {
    let edge = |x: f64| 0.5 * libm::erf(x / (sigma * 2.0_f64.sqrt()));
    edge(x + 0.5) - edge(x - 0.5)
}

/// Returns a core that is wider along x than along y, with a flare to the right and up.
fn lopsided(x: f64, y: f64) -> f64 {
    0.8 * cell(x - 0.1, 0.95) * cell(y, 0.65) + 0.2 * cell(x - 1.4, 0.8) * cell(y + 0.9, 1.1)
}

fn grid(oversampling: usize, shape: impl Fn(f64, f64) -> f64) -> PsfModel {
    PsfModel::grid(PsfGrid::sampled(oversampling, 8, shape).unwrap())
}

fn sources(places: &[[f64; 2]]) -> Vec<Source> {
    (0..).zip(places).map(|(id, px)| star(id, ELECTRONS, *px)).collect()
}

fn drifting(length_px: f64) -> LosPath {
    LosPath { rate_rad_s: DVec3::new(0.4 * length_px, -length_px, 0.0) / (FOCAL_PX * EXPOSURE_S), ..los() }
}

fn rolling(angle_rad: f64) -> LosPath {
    LosPath { rate_rad_s: DVec3::new(0.0, 0.0, angle_rad / EXPOSURE_S), ..los() }
}

fn wander() -> Option<PixelPath> {
    let points = [[0.0, 0.0], [0.31, -0.7], [1.2, 0.4], [-0.8, 0.9], [0.5, 0.5]];
    let at = |p: &[f64; 2]| PixelPoint { t_s: 0.0, dx_px: p[0], dy_px: p[1], roll_rad: 0.0 };
    Some(PixelPath::samples(points.iter().map(at).collect()).unwrap())
}

/// Places of the stars, so far apart that none is in another's footprint.
const PLACES: [[f64; 2]; 4] = [[15.3, 16.6], [47.5, 14.21], [16.06, 48.44], [48.0, 47.0]];

#[test]
fn methods_draw_what_the_reference_draws() {
    let still = || (los(), None);
    let moved = || (los(), wander());
    let drift = || (drifting(2.0), None);
    let roll = || (rolling(0.03), None);
    let cases = [
        ("static", still()),
        ("gauss-legendre", drift()),
        ("samples", moved()),
        ("effective-psf", moved()),
        ("effective-psf", drift()),
        ("zonal-psf", roll()),
    ];
    for (name, psf, bound) in [
        ("grid 8", grid(8, lopsided), TABLE_PIXEL),
        ("grid 6", grid(6, lopsided), TABLE_PIXEL),
        ("grid 16", grid(16, lopsided), TABLE_PIXEL),
        ("Moffat", PsfModel::moffat(2.0, 6.0), WINGS_PIXEL),
        ("halo", PsfModel::halo(0.8, 2.0, 0.2), WINGS_PIXEL),
    ] {
        for (method, (los, path)) in cases.clone() {
            // The reference integrates a Moffat profile pixel by pixel: one star is enough.
            let places = if matches!(psf, PsfModel::Moffat(_)) { &PLACES[..1] } else { &PLACES[..] };
            let plan = planner(SIZE, &psf, method, los, path).plan(&sources(places)).clone();
            let (image, truth) = (draw_cpu(&plan), draw_reference(&plan));
            // The error of a zone's kernels is covered by the planner's bound.
            let bound = if method == "zonal-psf" { bound + plan.chosen.pixel_sigma / 10.0 } else { bound };
            let worst = peak_error(&image, &truth);
            println!("{name:8} {method:15} half {} px: largest pixel error / peak {worst:.1e}", plan.half_px);
            assert!(worst <= bound, "{name}, {method}: {worst:e}, wanted at most {bound:e}");
        }
    }
}

#[test]
fn a_grid_turned_round_or_transposed_is_another() {
    let psf = grid(8, lopsided);
    let truth = draw_reference(planner(SIZE, &psf, "static", los(), None).plan(&sources(&PLACES)));
    for (how, wrong) in [
        ("transposed", grid(8, |x, y| lopsided(y, x))),
        ("left for right", grid(8, |x, y| lopsided(-x, y))),
        ("upside down", grid(8, |x, y| lopsided(x, -y))),
    ] {
        let image = draw_cpu(planner(SIZE, &wrong, "static", los(), None).plan(&sources(&PLACES)));
        let worst = peak_error(&image, &truth);
        assert!(worst > 0.05, "{how}: {worst:e}");
    }
    // And the right way round it is the shape it was made of, star by star.
    let image = draw_cpu(planner(SIZE, &psf, "static", los(), None).plan(&sources(&PLACES)));
    for place in PLACES {
        for (x, y) in [(0_i32, 0_i32), (2, 0), (0, 2), (-2, 1), (1, -2), (3, -2)] {
            let (x, y) = (place[0].round() + f64::from(x), place[1].round() + f64::from(y));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "well inside the detector")]
            let got = image.at(x as usize, y as usize) / ELECTRONS;
            let wanted = lopsided(x - place[0], y - place[1]);
            assert!((got - wanted).abs() < 3e-5 * lopsided(0.0, 0.0), "({x}, {y}): {got}, wanted {wanted}");
        }
    }
}

#[test]
fn tables_err_by_no_more_than_their_bounds() {
    let fine = grid(8, lopsided);
    let narrow = grid(16, |x, y| cell(x, 0.35) * cell(y, 0.5));
    for (name, psf) in [("grid 8", &fine), ("narrow grid 16", &narrow), ("Moffat", &PsfModel::moffat(0.9, 6.0))] {
        let tables = [4, 8, 16, 32].map(|oversampling| PsfSampling::Table { oversampling });
        for sampling in [PsfSampling::Auto].into_iter().chain(tables) {
            let reported = sampling_error(psf, sampling);
            let mut got = [0.0_f64; 2];
            for (method, path) in [("static", None), ("effective-psf", wander())] {
                let instrument = Instrument { sampling, ..crate::scene::instrument(crate::scene::camera(SIZE), psf) };
                // The footprint is so wide that nothing to speak of lies beyond it.
                let budget = AccuracyBudget { flux_rel: 1e-6, ..AccuracyBudget::default() };
                let mut planner = Planner::new(instrument, budget, CostModel::CPU, method.parse().unwrap(), los());
                planner.motion_mut().image_path = path;
                let places = if matches!(psf, PsfModel::Moffat(_)) { &PLACES[..1] } else { &PLACES[..] };
                let plan = planner.plan(&sources(places)).clone();
                let (image, truth) = (draw_cpu(&plan), draw_reference(&plan));
                let rim = psf.pixel(plan.half_px as f64 + 0.5, 0.0) / psf.peak();
                let scale = ELECTRONS * psf.peak();
                let pixels = image.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a - b).abs() / scale);
                got[1] = got[1].max(pixels.fold(0.0, f64::max) - rim);
                for star in &plan.stars {
                    let window = truth.tracker_window(&around(&plan, star.mean_px));
                    got[0] = got[0].max(centroid_error_px(&image, &truth, &window));
                }
            }
            println!(
                "{name:15} {sampling:9} promised {:.1e} px {:.1e}, got {:.1e} px {:.1e}",
                reported.centroid_px, reported.peak, got[0], got[1]
            );
            assert!(
                got[1] <= reported.peak + F32_PEAK,
                "{name}, {sampling}: peak {:e}, promised {:e}",
                got[1],
                reported.peak
            );
            assert!(
                got[0] <= reported.centroid_px + F32_PX,
                "{name}, {sampling}: {:e} px, promised {:e}",
                got[0],
                reported.centroid_px
            );
            if reported.peak > 1e-4 {
                assert!(got[1] > 0.02 * reported.peak, "{name}, {sampling}: the bound is idle");
            }
        }
    }
}

#[test]
fn a_psf_too_narrow_for_the_finest_table_is_over_the_budget() {
    let measured = |psf: &PsfModel, electrons: f64| {
        let stars = [star(0, electrons, [31.37, 31.81])];
        let plan = planner(SIZE, psf, "effective-psf:5", los(), wander()).plan(&stars).clone();
        (plan.chosen, measure(&plan), plan)
    };
    // Both sides of the edge: wide enough, and a needle of a quarter of a pixel.
    let (reported, got, _) = measured(&grid(8, |x, y| cell(x, 0.7) * cell(y, 0.7)), ELECTRONS);
    assert!(reported.verdict == Verdict::Fits && got.is_within(&reported), "{reported:?} {got:?}");
    let needle = PsfModel::moffat(0.12, 3.0);
    assert!(
        table_error(&needle, oversampling(&needle)) > 5.0 * TABLE_ERROR,
        "{:e}",
        table_error(&needle, oversampling(&needle))
    );
    let (reported, got, _) = measured(&needle, 1e5);
    assert!(!reported.verdict.is_met(), "{reported:?}");
    assert!(got.pixel_sigma <= reported.pixel_sigma, "{reported:?} {got:?}");
}

#[test]
fn electrons_on_the_detector_are_all_accounted_for() {
    /// Share of a star: its footprint's light by place on the pixel, corners, and f32.
    const SUM: f64 = 2e-4;
    /// The same for wings that the footprint cuts.
    const WINGS_SUM: f64 = 1e-3;
    let end = SIZE as f64 - 0.5;
    let across = [-0.5, 0.2, -1.7, end, end - 0.8, end + 1.3];
    let cases = [
        (grid(8, lopsided), los(), "static", SUM),
        (grid(8, lopsided), drifting(3.0), "auto", SUM),
        (PsfModel::moffat(1.5, 5.0), los(), "static", WINGS_SUM),
    ];
    for (psf, los, method, tolerance) in cases {
        for along_x in [true, false] {
            for v in across {
                let place = if along_x { [v, 20.4] } else { [33.3, v] };
                let plan = planner(SIZE, &psf, method, los.clone(), None).plan(&sources(&[place])).clone();
                let reported = plan.electrons_on_detector();
                let drawn = draw_reference(&plan).sum();
                assert!(
                    (drawn - reported).abs() < tolerance * ELECTRONS,
                    "{method} at {place:?}: {drawn} drawn, {reported} promised"
                );
            }
        }
    }
    // Negative control: a star whose grid lies the other way round at an edge.
    let reported = planner(SIZE, &grid(8, |x, y| lopsided(-x, y)), "static", los(), None)
        .plan(&sources(&[[0.2, 20.4]]))
        .electrons_on_detector();
    let drawn =
        draw_reference(planner(SIZE, &grid(8, lopsided), "static", los(), None).plan(&sources(&[[0.2, 20.4]]))).sum();
    assert!((drawn - reported).abs() > 10.0 * SUM * ELECTRONS, "{drawn} {reported}");
}
