//! Light that is left out: stars below a share of the noise, and what footprints drop.

use crate::scene::{Dice, draw_cpu, draw_reference, instrument, star};
use crate::stability::{ELECTRONS, Scene};
use base::accuracy::AccuracyBudget;
use plan::exposure::{ExposurePlan, Instrument, Source};
use plan::optics::PsfModel;

/// Detector, px.
const SIDE: usize = 256;
/// Brightness of the faint stars, e-: a thirtieth of the read noise in their brightest pixel.
const FAINT_E: f64 = 0.4;
/// A bound this many times what is measured says little.
const SLACKEST: f64 = 20.0;
/// Single precision of a star's sum.
const F32_FLUX: f64 = 2e-6;

/// Returns a scene of bright stars, and a grid of faint ones, jittered.
fn scene(faint: &[[f64; 2]], read_noise_e_rms: f64) -> Scene {
    let mut stars: Vec<Source> =
        (0..).zip([[40.3, 50.6], [200.1, 99.4], [120.5, 210.2]]).map(|(id, px)| star(id, ELECTRONS, px)).collect();
    stars.extend((100..).zip(faint).map(|(id, px)| star(id, FAINT_E, *px)));
    let whole = instrument(crate::scene::camera(SIDE), &PsfModel::gaussian(0.8));
    Scene { instrument: Instrument { read_noise_e_rms, ..whole }, stars, ..Scene::shaken(0.8, 0.6, 2.3) }
}

fn scattered() -> Vec<[f64; 2]> {
    let mut dice = Dice::new(12);
    (0..64).map(|i| [i % 8, i / 8].map(|cell| 32.0 * f64::from(cell) + 16.0 + dice.between(-6.0, 6.0))).collect()
}

/// Returns the largest pixel of all sources' image less that of the stars kept, by the reference, e-.
fn lacking_e(all: &ExposurePlan, kept: &ExposurePlan) -> f64 {
    let (all, kept) = (draw_reference(all), draw_reference(kept));
    all.pixels.iter().zip(&kept.pixels).map(|(a, b)| a - b).fold(0.0, f64::max)
}

#[test]
fn stars_far_below_the_noise_are_left_out_and_no_pixel_lacks_more_than_reported() {
    let faint = scattered();
    let plan = scene(&faint, 10.0).plan("samples:64");
    let all = scene(&faint, 1e-9).plan("samples:64");
    assert_eq!(all.stars.len(), faint.len() + 3, "without noise every star counts");
    assert_eq!((plan.stars.len(), plan.cut_off.stars), (3, faint.len()), "with noise none of them does");
    assert!((plan.cut_off.electrons - FAINT_E * faint.len() as f64).abs() < 1e-9, "{:?}", plan.cut_off);
    let lacking = lacking_e(&all, &plan);
    println!(
        "{} stars left out: {lacking:.2e} e- lacking, promised {:.2e}",
        plan.cut_off.stars, plan.cut_off.most_in_pixel_e
    );
    assert!(lacking <= plan.cut_off.most_in_pixel_e, "{lacking} {:?}", plan.cut_off);
    assert!(plan.cut_off.most_in_pixel_e < SLACKEST * lacking, "{lacking} {:?}", plan.cut_off);
    assert!(plan.cut_off.most_in_pixel_e <= AccuracyBudget::default().pixel_sigma * 10.0, "{:?}", plan.cut_off);
}

#[test]
fn a_crowd_of_the_same_stars_is_kept() {
    let crowd: Vec<[f64; 2]> =
        (0..64).map(|i| [100.2 + 0.1 * f64::from(i % 8), 100.4 + 0.1 * f64::from(i / 8)]).collect();
    let plan = scene(&crowd, 10.0).plan("samples:64");
    assert_eq!((plan.stars.len(), plan.cut_off.stars), (67, 0), "{:?}", plan.cut_off);
    let without = {
        let mut plan = plan.clone();
        plan.stars.retain(|star| star.id < 100);
        plan
    };
    let lacking = lacking_e(&plan, &without);
    assert!(lacking > 0.1 * AccuracyBudget::default().pixel_sigma * 10.0, "together they are seen: {lacking} e-");
}

#[test]
fn footprints_drop_no_more_than_reported() {
    for sigma_px in [0.3, 0.8, 1.2] {
        for half_px in 2..=6 {
            let mut least = f64::INFINITY;
            for phase in [0.0, 0.2, 0.35, 0.5] {
                let mut scene = Scene::still(sigma_px);
                scene.stars = vec![star(0, ELECTRONS, [31.0 + phase, 31.0 - phase])];
                let mut plan = scene.plan("static");
                plan.half_px = half_px;
                least = least.min(draw_cpu(&plan).sum() / ELECTRONS);
            }
            let (lost, reported) = (1.0 - least, PsfModel::gaussian(sigma_px).lost_flux(half_px));
            println!("sigma {sigma_px}, half {half_px}: lost {lost:.1e}, promised {reported:.1e}");
            assert!(
                lost <= reported + F32_FLUX,
                "sigma {sigma_px}, half {half_px}: lost {lost:e}, promised {reported:e}"
            );
            let is_tight = reported < 10.0 * F32_FLUX || lost > reported / SLACKEST;
            assert!(is_tight, "sigma {sigma_px}, half {half_px}: lost {lost:e}, promised {reported:e}");
        }
    }
}
