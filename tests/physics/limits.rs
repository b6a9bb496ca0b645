//! Where the planner cannot keep the budget: wings that are cut, stars below the cut-off. What it says
//! is compared with light that is worked out here. Pixels beside overexposed stars: `whole`.

use crate::scene::{Dice, Picture, camera, draw_cpu, draw_reference, instrument, los, planner, planner_of, star};
use glam::DVec3;
use plan::exposure::{ExposurePlan, Instrument, Shutter, Source};
use plan::{attitude::LosPath, exposure::plan::Verdict, optics::PsfModel};

/// Detector, px.
const SIZE: usize = 193;
/// Electrons of a star.
const ELECTRONS: f64 = 1e5;
/// Share of a star's light by which image and truth table may differ.
const TABLE_REL: f64 = 1e-4;

fn middle() -> Vec<Source> {
    vec![star(0, ELECTRONS, [96.2, 95.7])]
}

/// Returns the share of a Gaussian's light in a pixel along one axis.
fn cell(from_star_px: f64, sigma_px: f64) -> f64 {
    let scale = core::f64::consts::FRAC_1_SQRT_2 / sigma_px;
    let (low, high) = ((from_star_px.abs() - 0.5) * scale, (from_star_px.abs() + 0.5) * scale);
    0.5 * (libm::erfc(low) - libm::erfc(high))
}

fn gaussian(px: [f64; 2], sigma_px: f64, electrons: f64, size: usize) -> Picture {
    let pixel = |i: usize| {
        let at = [(i % size) as f64 - px[0], (i / size) as f64 - px[1]];
        electrons * cell(at[0], sigma_px) * cell(at[1], sigma_px)
    };
    Picture { width: size, pixels: (0..size * size).map(pixel).collect() }
}

#[test]
fn wings_that_are_cut_are_over_the_budget_and_missing_in_the_truth_table() {
    // Light of a Moffat profile beyond a circle of r: (1 + (r / alpha)^2)^(1 - beta).
    let moffat = |alpha: f64, beta: f64| (1.0 + (48.5_f64 / alpha).powi(2)).powf(1.0 - beta);
    let beyond = |sigma_px: f64| 1.0 - libm::erf(48.5 / sigma_px * core::f64::consts::FRAC_1_SQRT_2).powi(2);
    for (psf, lost) in [
        (PsfModel::gaussian(20.0), beyond(20.0)),
        (PsfModel::gaussian(15.0), beyond(15.0)),
        (PsfModel::moffat(3.0, 1.5), moffat(3.0, 1.5)),
        (PsfModel::moffat(10.0, 2.5), moffat(10.0, 2.5)),
    ] {
        let plan = planner(SIZE, &psf, "auto", los(), None).plan(&middle()).clone();
        let reported = plan.chosen;
        // The rim of a wide footprint may be over the pixel budget too.
        let verdicts = [Verdict::FluxOverBudget, Verdict::PixelOverBudget];
        assert!(
            verdicts.contains(&reported.verdict),
            "light that is missing is over the budget, {psf:?}: {reported:?}"
        );
        assert!(
            reported.flux_rel < 2.0 * lost && reported.flux_rel > 0.5 * lost,
            "{psf:?}: {lost:e} lost, {reported:?}"
        );
        let (drawn_e, table_e) = (draw_cpu(&plan).sum(), plan.electrons_on_detector());
        assert!((drawn_e / table_e - 1.0).abs() < TABLE_REL, "{psf:?}: {drawn_e} drawn, {table_e} in the truth table");
        assert!(1.0 - drawn_e / ELECTRONS > 0.5 * lost, "control: {drawn_e} e- drawn, {lost:e} lost");
    }
    let narrow = planner(SIZE, &PsfModel::gaussian(5.0), "auto", los(), None).plan(&middle()).chosen;
    assert!(narrow.verdict.is_met(), "control: nothing is cut off a narrow one, {narrow:?}");
}

#[test]
fn the_reference_holds_all_of_a_wide_gaussian() {
    let psf = PsfModel::gaussian(20.0);
    let plan = planner(SIZE, &psf, "auto", los(), None).exact().plan(&middle()).clone();
    assert_eq!(plan.chosen.verdict, Verdict::Fits, "{:?}", plan.chosen);
    let (image, wanted) = (draw_reference(&plan), gaussian([96.2, 95.7], 20.0, ELECTRONS, SIZE));
    let worst = image.pixels.iter().zip(&wanted.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9 * ELECTRONS, "{worst:e} e-");
    let (drawn_e, table_e) = (image.sum(), plan.electrons_on_detector());
    assert!((drawn_e / table_e - 1.0).abs() < 1e-6, "{drawn_e} drawn, {table_e} in the truth table");
}

fn rolling(line_s: f64) -> Instrument {
    Instrument { shutter: Shutter::Rolling { line_s }, ..instrument(camera(64), &PsfModel::gaussian(0.9)) }
}

#[test]
fn moving_stars_under_a_rolling_shutter_have_the_light_of_their_rows() {
    for (deg_per_s, line_s) in [(1.0_f64, 50e-6), (5.0, 50e-6), (-5.0, 50e-6), (10.0, 60e-6)] {
        let rate_rad_s = DVec3::new(deg_per_s.to_radians(), 0.0, 0.0);
        let los = LosPath { rate_rad_s, exposure_s: 0.002, ..los() };
        let plan: ExposurePlan =
            planner_of(rolling(line_s), "auto", los, None).plan(&[star(0, 400.0, [31.4, 31.8])]).clone();
        // A turn about x moves stars along y by the focal length; rows go down.
        let per_row = 2900.0 * deg_per_s.to_radians() * line_s;
        let drawn = draw_cpu(&plan).sum() / 400.0;
        let gains = [1.0 / (1.0 - per_row), 1.0 / (1.0 + per_row)];
        let truth = draw_reference(&plan).sum() / 400.0;
        let nearest = gains.map(|gain| (truth - gain).abs()).into_iter().fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-4, "{deg_per_s} deg/s: the reference has {truth}, wanted one of {gains:?}");
        assert!((drawn - truth).abs() < 2e-4, "{deg_per_s} deg/s, {line_s} s: {drawn} drawn, {truth} due");
        let table = plan.electrons_on_detector() / 400.0;
        assert!((table - truth).abs() < 2e-4, "truth table: {table}, {truth} due");
        assert!((truth - 1.0).abs() > 1e-3, "control: the shutter does something");
    }
}

#[test]
fn the_reference_draws_every_star_however_faint() {
    let mut dice = Dice::new(5);
    let place = |dice: &mut Dice| [dice.between(10.0, 180.0), dice.between(10.0, 180.0)];
    // A few that are far below the noise: crowds of such stars are drawn.
    let electrons = |id: u32| if id.is_multiple_of(7) { 0.4 } else { 5.0 };
    let stars: Vec<Source> = (0..40).map(|id| star(id, electrons(id), place(&mut dice))).collect();
    let wanted_e: f64 = stars.iter().map(|star| star.electrons).sum();
    let psf = PsfModel::gaussian(0.8);
    let exact = planner(SIZE, &psf, "auto", los(), None).exact().plan(&stars).clone();
    assert_eq!((exact.stars.len(), exact.cut_off.stars), (40, 0));
    let drawn_e = draw_reference(&exact).sum();
    assert!((drawn_e / wanted_e - 1.0).abs() < 1e-9, "{drawn_e} of {wanted_e} e-");
    let usual = planner(SIZE, &psf, "auto", los(), None).plan(&stars).clone();
    assert!(usual.cut_off.stars > 0, "control: other backends leave them out, {:?}", usual.cut_off);
}
