//! Effects that vary over the field: roll, and a rolling shutter's rows.

use crate::measure::{compare, measure};
use crate::scene::{FOCAL_PX, draw_cpu, draw_reference, instrument, star};
use crate::stability::motion::narrow_field;
use crate::stability::{ELECTRONS, Scene, assert_hopeless, assert_inside, assert_outside, assert_replaced};
use base::accuracy::AccuracyBudget;
use plan::exposure::{ExposurePlan, Instrument, Shutter};
use plan::{exposure::plan::Verdict, optics::PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// A tall detector: many rows, few pixels.
const TALL: [usize; 2] = [48, 512];
/// PSF, px.
const SIGMA_PX: f64 = 0.8;

/// Returns stars all the way down a tall detector whose rows are exposed `line_s` apart.
fn tall(shutter: Shutter, amplitude_px: f64, cycles: f64) -> Scene {
    let [width_px, height_px] = TALL;
    let parameters = CameraParameters {
        width_px,
        height_px,
        focal_px: [FOCAL_PX; 2],
        principal_point_px: [23.5, 255.5],
        distortion: BrownConrady::default(),
    };
    let camera = CameraGeometry::new(parameters).unwrap();
    let stars = (0..9).map(|i| star(i, ELECTRONS, [23.2, 16.3 + 60.0 * f64::from(i)])).collect();
    let instrument = Instrument { shutter, ..instrument(camera, &PsfModel::gaussian(SIGMA_PX)) };
    Scene { instrument, stars, ..Scene::shaken(SIGMA_PX, amplitude_px, cycles) }
}

#[test]
fn roll_at_the_edge_of_the_field_needs_zones_or_each_stars_own_path() {
    assert_replaced("roll", &Scene::rolled(SIGMA_PX, 0.04), "effective-psf");
    // Where the bound of one kernel is over the budget, those of eight by eight zones still fit.
    let scene = Scene::rolled(SIGMA_PX, 0.0025);
    let [one, zones] = ["effective-psf", "zonal-psf"].map(|method| scene.plan(method));
    assert_ne!(one.chosen.verdict, Verdict::Fits, "{:?}", one.chosen);
    assert_inside("roll", &scene, "zonal-psf");
    let [one, zones] = [one, zones].map(|plan| measure(&plan).centroid_px);
    println!("one kernel {one:.1e} px, zones {zones:.1e} px");
    assert!(zones < 0.5 * one, "zones {zones} px, one kernel {one} px");
    // Near the middle, where nothing moves, the one kernel of the middle is not wrong: it is the edge that refuses it.
    let mut middle = Scene::rolled(SIGMA_PX, 0.04).plan("effective-psf");
    middle.stars.retain(|star| star.id == 0);
    assert!(measure(&middle).centroid_px < AccuracyBudget::default().centroid_px);
}

#[test]
fn the_rows_of_a_rolling_shutter_see_windows_of_their_own() {
    let scene = |shutter| narrow_field(&Scene { los: Scene::drifting(SIGMA_PX, 4.5).los, ..tall(shutter, 0.0, 1.0) });
    let rolling = scene(Shutter::Rolling { line_s: 4e-6 });
    let mut plans: Vec<ExposurePlan> = Vec::new();
    for method in ["samples", "zonal-psf", "auto"] {
        plans.push(assert_inside("rows", &rolling, method));
    }
    assert!(plans[1].lists.len() > 1, "a kernel for every zone of rows");
    // Negative control: all rows at once.
    let global = scene(Shutter::Global);
    let (at_once, by_row) = (draw_cpu(&global.plan("samples")), draw_reference(&plans[0]));
    let wrong = compare(&plans[0], &at_once, &by_row);
    println!("a global shutter's image of it is off by {:.1e} px", wrong.centroid_px);
    assert!(wrong.centroid_px > 2.0 * AccuracyBudget::default().centroid_px, "{wrong:?}");
}

#[test]
fn rows_whose_paths_differ_in_shape_are_drawn_in_bands() {
    // A slow swing: the first rows see it go, the last ones see it turn.
    let rolling = tall(Shutter::Rolling { line_s: 2e-6 }, 1.2, 0.45);
    let plan = assert_inside("bands", &rolling, "samples");
    assert!(plan.lists.len() > 1, "bands: {:?}", plan.classes);
    assert_outside("one kernel", &rolling, "effective-psf");
    // The bands do it: the middle band's nodes for all rows are wrong.
    let mut one = plan.clone();
    let middle = one.lists.len() / 2;
    for star in &mut one.stars {
        star.list = u32::try_from(middle).unwrap();
    }
    let (before, after) = (measure(&plan), measure(&one));
    assert!(after.pixel_sigma > 3.0 * before.pixel_sigma.max(1e-3), "{before:?} {after:?}");
}

#[test]
fn a_slew_that_shears_a_star_between_its_own_rows_is_refused() {
    let mut scene = tall(Shutter::Rolling { line_s: 1e-4 }, 0.0, 1.0);
    // Four hundred px/s along the rows: 0.04 px from each row to the next.
    scene.los = Scene::drifting(SIGMA_PX, 40.0).los;
    assert_hopeless("shear", &scene);
}
