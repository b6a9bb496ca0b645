//! A PSF that changes over the field: every method drawn by the CPU against the reference, which blends exact pixel
//! values by the star's mean place.

use crate::measure::{class_alone, measure, peak_error};
use crate::scene::{
    EXPOSURE_S, FOCAL_PX, camera, draw_cpu, draw_reference, instrument, los, planner, planner_of, star,
};
use glam::DVec3;
use plan::exposure::{Drawing, ExposurePlan, Instrument, PixelPath, PixelPoint, Shutter, Source};
use plan::optics::{PsfField, PsfGrid, PsfModel};
use plan::{attitude::LosPath, exposure::plan::Verdict};

/// Side of the detector, px.
const SIZE: usize = 64;
/// Electrons of a star.
const ELECTRONS: f64 = 2e4;
/// Pixel error against the reference, share of the peak: a table's promise of 3e-5, and what the footprint drops.
const TABLE_PIXEL: f64 = 6e-5;

/// Returns the share of a Gaussian's light in the pixel `x` from its middle.
fn cell(x: f64, sigma: f64) -> f64 {
    let edge = |x: f64| 0.5 * libm::erf(x / (sigma * 2.0_f64.sqrt()));
    edge(x + 0.5) - edge(x - 0.5)
}

/// Returns the round in one corner, longer and with a flare towards the others.
fn node(column: usize, row: usize) -> PsfModel {
    let (x0, y0) = (column as f64, row as f64);
    let shape = |x: f64, y: f64| {
        0.85 * cell(x - 0.1 * x0, 0.7 + 0.2 * x0) * cell(y, 0.7 + 0.15 * y0)
            + 0.15 * cell(x - 0.8 * x0, 0.9) * cell(y + 0.7 * y0, 0.9)
    };
    PsfModel::grid(PsfGrid::sampled(8, 8, shape).unwrap())
}

fn field([columns, rows]: [usize; 2]) -> PsfModel {
    let nodes = (0..columns * rows).map(|i| node(i % columns, i / columns)).collect();
    PsfModel::field(PsfField::new([columns, rows], [SIZE; 2], nodes).unwrap())
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

/// In every part of the field, in its cells and at their corners, on an edge.
const PLACES: [[f64; 2]; 6] = [[12.3, 11.6], [47.5, 14.21], [13.06, 46.44], [50.0, 47.0], [31.4, 30.9], [31.5, -0.2]];

fn drawn(psf: &PsfModel, method: &str, los: LosPath, path: Option<PixelPath>) -> ExposurePlan {
    planner(SIZE, psf, method, los, path).plan(&sources(&PLACES)).clone()
}

#[test]
fn every_method_draws_what_the_reference_draws() {
    for nodes in [[2, 2], [3, 2]] {
        let psf = field(nodes);
        for (method, los, path) in [
            ("static", los(), None),
            ("gauss-legendre", drifting(2.0), None),
            ("samples", los(), wander()),
            ("effective-psf", los(), wander()),
            ("zonal-psf", los(), wander()),
            ("auto", drifting(2.0), None),
        ] {
            let plan = drawn(&psf, method, los, path);
            assert!(plan.lists.iter().any(|list| matches!(list.drawing, Drawing::Blend(_))), "{method}");
            let worst = peak_error(&draw_cpu(&plan), &draw_reference(&plan));
            println!("{nodes:?} {method:15} {}: largest pixel error / peak {worst:.1e}", plan.chosen.method);
            assert!(worst <= TABLE_PIXEL, "{nodes:?}, {method}: {worst:e}");
        }
    }
}

#[test]
fn nodes_in_another_order_are_another_field() {
    let psf = field([3, 2]);
    let truth = draw_reference(&drawn(&psf, "static", los(), None));
    let mirrored = (0..6).map(|i| node(2 - i % 3, i / 3)).collect();
    let upside_down = (0..6).map(|i| node(i % 3, 1 - i / 3)).collect();
    let one = vec![node(1, 0); 6];
    for (how, nodes) in [("mirrored", mirrored), ("upside down", upside_down), ("all alike", one)] {
        let wrong = PsfModel::field(PsfField::new([3, 2], [SIZE; 2], nodes).unwrap());
        let worst = peak_error(&draw_cpu(&drawn(&wrong, "static", los(), None)), &truth);
        assert!(worst > 0.02, "{how}: {worst:e}");
    }
}

#[test]
fn a_field_of_one_psf_is_that_psf() {
    let (one, same) = (node(1, 1), PsfModel::field(PsfField::new([3, 2], [SIZE; 2], vec![node(1, 1); 6]).unwrap()));
    for (method, los, path) in
        [("static", los(), None), ("effective-psf", los(), wander()), ("samples", los(), wander())]
    {
        let image = draw_cpu(&drawn(&same, method, los.clone(), path.clone()));
        let alone = draw_cpu(&drawn(&one, method, los, path));
        let worst = peak_error(&image, &alone);
        assert!(worst < 5e-7, "{method}: {worst:e}");
    }
}

#[test]
fn bounds_hold_where_path_and_psf_both_change_over_the_field() {
    let psf = field([3, 3]);
    for (words, los, shutter) in [
        ("slow roll", rolling(0.01), Shutter::Global),
        ("roll", rolling(0.06), Shutter::Global),
        ("drift", drifting(3.0), Shutter::Global),
        ("roll, rolling shutter", rolling(0.02), Shutter::Rolling { line_s: 2e-5 }),
        ("drift, rolling shutter", drifting(1.0), Shutter::Rolling { line_s: 2e-5 }),
    ] {
        for method in ["auto", "effective-psf", "zonal-psf", "samples"] {
            let instrument = Instrument { shutter, ..instrument(camera(SIZE), &psf) };
            let plan = planner_of(instrument, method, los.clone(), None).plan(&sources(&PLACES)).clone();
            for (i, class) in plan.classes.iter().enumerate() {
                let (reported, got) = (class.chosen, measure(&class_alone(&plan, i)));
                println!(
                    "{words:23} {method:13} {}: promised {:.1e} px {:.1e} sigma, got {:.1e} px {:.1e} sigma, {:?}",
                    reported.method,
                    reported.centroid_px,
                    reported.pixel_sigma,
                    got.centroid_px,
                    got.pixel_sigma,
                    reported.verdict
                );
                assert!(got.is_within(&reported), "{words}, {method}: promised {reported:?}, got {got:?}");
                assert!(method != "auto" || reported.verdict == Verdict::Fits, "{words}: {reported:?}");
            }
        }
    }
}

#[test]
fn a_zone_is_never_coarser_than_a_cell_of_the_field() {
    let instrument = instrument(camera(SIZE), &field([4, 3]));
    let plan = planner_of(instrument, "zonal-psf", rolling(1e-5), None).plan(&sources(&PLACES)).clone();
    let words = plan.chosen.method.to_string();
    assert!(words.contains("3 x 2"), "as fine as the field, and no finer where nothing asks for it: {words}");
}

#[test]
fn electrons_on_the_detector_are_all_accounted_for() {
    /// Share of a star: its footprint's light by place on the pixel, corners, and f32.
    const SUM: f64 = 2e-4;
    let psf = field([3, 2]);
    for place in [[-0.3, 20.4], [40.2, -1.1], [63.9, 50.0], [20.0, 64.0], [31.0, 31.2]] {
        let plan = planner(SIZE, &psf, "static", los(), None).plan(&sources(&[place])).clone();
        let (reported, drawn) = (plan.electrons_on_detector(), draw_reference(&plan).sum());
        assert!((drawn - reported).abs() < SUM * ELECTRONS, "{place:?}: {drawn} drawn, {reported} promised");
    }
}
