//! Pixels beside overexposed stars: the light that the backend draws against the reference, in sigma of their noise.

use crate::scene::{
    FULL_WELL_E, Picture, READ_NOISE_E, camera, draw_cpu, draw_reference, instrument, los, planner_of, star,
};
use glam::DVec3;
use plan::attitude::LosPath;
use plan::exposure::{Drawing, ExposurePlan, Instrument, PixelPath, PixelPoint, Planner, Shutter, Source};
use plan::optics::{PsfField, PsfGrid, PsfModel};

const SIZE: usize = 96;
/// Rows with the bright star; the faint ones are below them.
const ROWS: usize = 58;
/// Largest error, sigma of a pixel's noise: the budget.
const MOST_SIGMA: f64 = 0.1;

/// Returns the largest error of an unsaturated pixel in the rows of the bright star, sigma of its noise.
fn unsaturated_sigma(image: &Picture, truth: &Picture) -> f64 {
    let pixels = image.pixels.iter().zip(&truth.pixels).take(ROWS * SIZE);
    let errors = pixels.filter(|(_, truth)| **truth < FULL_WELL_E);
    errors.map(|(a, b)| (a - b).abs() / b.max(0.0).sqrt().hypot(READ_NOISE_E)).fold(0.0, f64::max)
}

/// Returns a star of `electrons`, and faint ones for which the plan has ordinary lists.
fn stars(electrons: f64) -> Vec<Source> {
    let faint = |id: u32| star(id, 3e3, [20.0 * f64::from(id) - 5.0, 70.3]);
    core::iter::once(star(0, electrons, [41.3, 38.8])).chain((1..5).map(faint)).collect()
}

/// Returns the plan with every star drawn as ordinary ones are.
fn ordinary(plan: &ExposurePlan) -> ExposurePlan {
    let mut plan = plan.clone();
    let list =
        plan.stars.iter().map(|star| star.list).find(|list| plan.lists[*list as usize].drawing != Drawing::Whole);
    let list = list.expect("faint stars have a list");
    plan.stars.iter_mut().for_each(|star| star.list = list);
    plan
}

/// Returns the errors of the bright star drawn whole, and drawn as ordinary stars are.
fn errors(mut planner: Planner, electrons: f64) -> [f64; 2] {
    let plan = planner.plan(&stars(electrons)).clone();
    let drawing = plan.list_of(&plan.stars[0]).drawing;
    assert_eq!(drawing, Drawing::Whole, "{electrons:e} e-");
    let truth = draw_reference(&plan);
    [unsaturated_sigma(&draw_cpu(&plan), &truth), unsaturated_sigma(&draw_cpu(&ordinary(&plan)), &truth)]
}

fn instrument_of(psf: &PsfModel) -> Instrument {
    instrument(camera(SIZE), psf)
}

#[test]
fn gaussians_at_rest_of_any_light_are_inside_the_budget() {
    for sigma_px in [0.6, 0.75, 0.9, 1.3] {
        for electrons in [3e7, 3e8, 3e9, 1e12] {
            let planner = planner_of(instrument_of(&PsfModel::gaussian(sigma_px)), "auto", los(), None);
            let [whole, ordinary] = errors(planner, electrons);
            println!("sigma {sigma_px}, {electrons:.0e} e-: {whole:.1e} sigma, as an ordinary star {ordinary:.1e}");
            assert!(whole <= 0.1 * MOST_SIGMA, "sigma {sigma_px}, {electrons:e} e-: {whole}");
            assert!(electrons < 1e9 || ordinary > 10.0 * MOST_SIGMA, "control: {ordinary}");
        }
    }
}

#[test]
fn below_the_limit_stars_are_ordinary_and_inside_the_budget() {
    for sigma_px in [0.6, 0.75, 0.9, 1.3] {
        let mut planner = planner_of(instrument_of(&PsfModel::gaussian(sigma_px)), "auto", los(), None);
        let limit_e = planner.plan(&stars(1e12)).whole.from_e;
        let [below, above] = [0.999, 1.0].map(|share| planner.plan(&stars(share * limit_e)).clone());
        assert!(below.lists.iter().all(|list| list.drawing != Drawing::Whole), "{limit_e:e} e-");
        assert_eq!(above.list_of(&above.stars[0]).drawing, Drawing::Whole);
        let found = unsaturated_sigma(&draw_cpu(&below), &draw_reference(&below));
        assert!(below.chosen.verdict.is_met() && found <= MOST_SIGMA, "{found} sigma, {:?}", below.chosen);
    }
}

/// Returns a path of `count` random places within `px`.
fn jitter(count: u32, px: f64) -> PixelPath {
    let place = |i: u32, step: u32| px * (f64::from(i * step % 101) / 50.0 - 1.0);
    let point = |i: u32| PixelPoint { t_s: 0.0, dx_px: place(i, 37), dy_px: place(i, 53), roll_rad: 0.0 };
    PixelPath::samples((0..count).map(point).collect()).expect("a path")
}

#[test]
fn moving_stars_are_inside_the_budget_by_every_method() {
    let psf = PsfModel::gaussian(0.75);
    let slew = LosPath { rate_rad_s: DVec3::new(0.01, -0.02, 0.1), ..los() };
    for method in ["auto", "gauss-legendre", "effective-psf", "zonal-psf"] {
        let [whole, ordinary] = errors(planner_of(instrument_of(&psf), method, slew.clone(), None), 3e9);
        println!("slew, {method}: {whole:.1e} sigma, as an ordinary star {ordinary:.1e}");
        assert!(whole <= MOST_SIGMA && ordinary > MOST_SIGMA, "{method}: {whole}, control {ordinary}");
    }
    for method in ["auto", "samples", "effective-psf"] {
        let path = Some(jitter(48, 1.5));
        let [whole, ordinary] = errors(planner_of(instrument_of(&psf), method, los(), path), 3e9);
        println!("jitter, {method}: {whole:.1e} sigma, as an ordinary star {ordinary:.1e}");
        assert!(whole <= MOST_SIGMA && ordinary > MOST_SIGMA, "{method}: {whole}, control {ordinary}");
    }
}

/// Returns a PSF whose grid ends where its wings are 1e-12 of the peak.
fn grid(sigma_px: f64) -> PsfModel {
    let cell = |x: f64| plan::optics::gaussian::cell(x, sigma_px);
    PsfModel::grid(PsfGrid::sampled(8, 12, |x, y| cell(x) * cell(y + 0.2)).expect("a PSF"))
}

#[test]
fn other_psfs_are_inside_the_budget_as_far_as_they_go() {
    let field = PsfField::new([2, 2], [SIZE; 2], [1.2, 1.3, 1.4, 1.5].map(grid).to_vec()).expect("a field");
    for (psf, electrons) in [
        (PsfModel::halo(0.8, 3.0, 0.05), 3e8),
        (PsfModel::moffat(1.5, 4.765), 3e7),
        (grid(1.3), 3e8),
        (PsfModel::field(field), 3e8),
    ] {
        let [whole, ordinary] = errors(planner_of(instrument_of(&psf), "auto", los(), None), electrons);
        println!("{:?}: {whole:.1e} sigma, as an ordinary star {ordinary:.1e}", psf.core_sigma_px());
        assert!(whole <= MOST_SIGMA && ordinary > MOST_SIGMA, "{whole}, control {ordinary}");
    }
}

#[test]
fn wings_beyond_the_furthest_footprint_are_named() {
    let psf = PsfModel::moffat(1.5, 2.0);
    let plan = planner_of(instrument_of(&psf), "auto", los(), None).plan(&stars(1e9)).clone();
    assert!(!plan.chosen.verdict.is_met() && plan.chosen.pixel_sigma > MOST_SIGMA, "{:?}", plan.chosen);
}

#[test]
fn rolling_shutters_and_stars_beyond_the_edge_have_their_wings() {
    let psf = PsfModel::gaussian(0.9);
    let rolling = Instrument { shutter: Shutter::Rolling { line_s: 1e-6 }, ..instrument_of(&psf) };
    let slew = LosPath { rate_rad_s: DVec3::new(0.005, -0.002, 0.0), ..los() };
    let [whole, ordinary] = errors(planner_of(rolling, "auto", slew, None), 1e9);
    assert!(whole <= MOST_SIGMA && ordinary > MOST_SIGMA, "rolling: {whole}, control {ordinary}");
    // Outside the detector by more than an ordinary footprint.
    let mut planner = planner_of(instrument_of(&psf), "auto", los(), None);
    let plan = planner.plan(&[star(0, 1e12, [-5.6, 40.2]), star(1, 3e3, [-5.6, 60.2])]).clone();
    assert_eq!(plan.stars.len(), 1, "a faint star there leaves no light");
    let truth = draw_reference(&plan);
    assert!(truth.sum() > 100.0, "control: {} e- of its wings", truth.sum());
    let found = unsaturated_sigma(&draw_cpu(&plan), &truth);
    assert!(found <= MOST_SIGMA, "{found} sigma");
}

#[test]
fn a_disc_of_many_bright_cells_is_drawn_as_before() {
    let cells: Vec<Source> =
        (0..400).map(|i| star(i, 1e9, [40.0 + f64::from(i % 20) * 0.5, 40.0 + f64::from(i / 20) * 0.5])).collect();
    let mut planner = planner_of(instrument_of(&PsfModel::gaussian(0.75)), "auto", los(), None);
    let plan = planner.plan(&cells).clone();
    assert!(plan.lists.iter().all(|list| list.drawing != Drawing::Whole), "{:?}", plan.classes);
    assert!(!plan.chosen.verdict.is_met(), "and its error is named: {:?}", plan.chosen);
    let with_star: Vec<Source> = cells.into_iter().chain([star(400, 1e10, [80.2, 20.1])]).collect();
    let plan = planner.plan(&with_star).clone();
    assert_eq!(plan.whole.from_e, 8e9);
    let whole = plan.stars.iter().filter(|star| plan.list_of(star).drawing == Drawing::Whole).count();
    assert_eq!(whole, 1, "a brighter star beside it");
}
