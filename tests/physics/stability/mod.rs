//! Tests where methods fail: for every method a scene inside its domain, where the measured error is under the
//! bound and the bound under the budget, and one outside, where the error is over the budget and the planner says so.

mod cut_off;
mod field;
mod levels;
mod motion;
mod numbers;
mod sampling;

use crate::measure::{Measured, measure};
use crate::scene::{EXPOSURE_S, FOCAL_PX, camera, instrument, los, planner_of, star};
use base::accuracy::AccuracyBudget;
use glam::DVec3;
use plan::attitude::{JitterLine, LosPath};
use plan::exposure::{ExposurePlan, Instrument, PixelPath, PixelPoint, Source};
use plan::{exposure::plan::Verdict, optics::PsfModel};

/// Detector of most scenes, px.
const SIZE: usize = 64;
/// A star's electrons.
const ELECTRONS: f64 = 2e4;

/// A scene to draw, whatever the method.
#[derive(Debug, Clone)]
struct Scene {
    instrument: Instrument,
    los: LosPath,
    path: Option<PixelPath>,
    stars: Vec<Source>,
}

impl Scene {
    /// Returns a star near the middle and one near a corner, at rest.
    fn still(sigma_px: f64) -> Self {
        let stars = vec![star(0, ELECTRONS, [31.3, 30.8]), star(1, ELECTRONS, [52.2, 51.9])];
        Self { instrument: instrument(camera(SIZE), &PsfModel::gaussian(sigma_px)), los: los(), path: None, stars }
    }

    /// Returns the line of sight that moves the image by `x_px` and 0.4 times as much down.
    fn drifting(sigma_px: f64, x_px: f64) -> Self {
        let rate_rad_s = DVec3::new(0.4 * x_px, -x_px, 0.0) / (FOCAL_PX * EXPOSURE_S);
        Self { los: LosPath { rate_rad_s, ..los() }, ..Self::still(sigma_px) }
    }

    /// Returns a sinusoid along the rows, and an eighth of it down.
    fn shaken(sigma_px: f64, amplitude_px: f64, cycles: f64) -> Self {
        let mut scene = Self::still(sigma_px);
        let amplitude_rad = DVec3::new(0.125, 1.0, 0.0) * (amplitude_px / scene.focal_px());
        scene.los.jitter.lines = vec![JitterLine { frequency_hz: cycles / EXPOSURE_S, amplitude_rad, phase_rad: 0.4 }];
        scene
    }

    /// Returns a commanded image path that turns by `roll_rad` about the middle of the detector.
    fn rolled(sigma_px: f64, roll_rad: f64) -> Self {
        let point = |i: u32| point(0.0, [0.0; 2], roll_rad * (f64::from(i) / 63.0 - 0.5));
        let path = PixelPath::samples((0..64).map(point).collect()).unwrap();
        Self { path: Some(path), ..Self::still(sigma_px) }
    }

    /// Returns a straight commanded path.
    fn straight(sigma_px: f64, x_px: f64) -> Self {
        let ends = [-0.5, 0.5].map(|side| point((side + 0.5) * EXPOSURE_S, [side * x_px, 0.3 * side * x_px], 0.0));
        Self { path: Some(PixelPath::line(ends.into(), EXPOSURE_S).unwrap()), ..Self::still(sigma_px) }
    }

    fn focal_px(&self) -> f64 {
        self.instrument.camera.parameters().focal_px[0]
    }

    fn plan(&self, method: &str) -> ExposurePlan {
        planner_of(self.instrument.clone(), method, self.los.clone(), self.path.clone()).plan(&self.stars).clone()
    }
}

fn point(t_s: f64, [dx_px, dy_px]: [f64; 2], roll_rad: f64) -> PixelPoint {
    PixelPoint { t_s, dx_px, dy_px, roll_rad }
}

/// Returns whether something is over the budget.
fn is_over_budget(measured: &Measured) -> bool {
    let budget = AccuracyBudget::default();
    measured.centroid_px > budget.centroid_px || measured.pixel_sigma > budget.pixel_sigma
}

fn announce(where_: &str, what: &str, method: &str, plan: &ExposurePlan, measured: &Measured) {
    println!(
        "{where_:7} {what}, {method}: {} promised {:.1e} px {:.1e} sigma, measured {:.1e} px {:.1e} sigma",
        plan.chosen.method,
        plan.chosen.centroid_px,
        plan.chosen.pixel_sigma,
        measured.centroid_px,
        measured.pixel_sigma
    );
}

/// Asserts, inside the domain: error <= bound <= budget.
fn assert_inside(what: &str, scene: &Scene, method: &str) -> ExposurePlan {
    let plan = scene.plan(method);
    let measured = measure(&plan);
    announce("inside", what, method, &plan, &measured);
    assert_eq!(plan.chosen.verdict, Verdict::Fits, "{what}, {method}: {:?}", plan.chosen);
    assert!(measured.is_within(&plan.chosen), "{what}, {method}: {measured:?}, promised {:?}", plan.chosen);
    assert!(!is_over_budget(&measured), "{what}, {method}: {measured:?}");
    plan
}

/// Asserts, outside the domain: the error is over the budget, the method is refused, and its bound, where it has one,
/// holds all the same.
fn assert_outside(what: &str, scene: &Scene, method: &str) -> ExposurePlan {
    let plan = scene.plan(method);
    let measured = measure(&plan);
    announce("outside", what, method, &plan, &measured);
    assert_ne!(plan.chosen.verdict, Verdict::Fits, "{what}, {method}: {:?}", plan.chosen);
    assert!(is_over_budget(&measured), "{what}, {method}: refused without need, {measured:?}");
    if plan.chosen.verdict.is_drawable() {
        assert!(measured.centroid_px <= plan.chosen.centroid_px, "{what}, {method}: {measured:?} {:?}", plan.chosen);
    }
    plan
}

/// Asserts that a scene is outside for `method`, and that the planner finds another that fits.
fn assert_replaced(what: &str, scene: &Scene, method: &str) {
    let refused = assert_outside(what, scene, method);
    let chosen = assert_inside(what, scene, "auto").chosen.method;
    assert_ne!(chosen, refused.chosen.method, "{what}: the method that was refused");
}

/// Asserts that a scene is outside for all methods: the planner says so, and by how much.
fn assert_hopeless(what: &str, scene: &Scene) {
    assert_outside(what, scene, "auto");
}
