//! Random streaks as the planner draws them, against an integral made here: own projection, own lens, own pixel
//! integral, every row at its own time, many thousand instants, f64. Nothing of the planner's bounds is in it.
//!
//! A streak is inside the budget, or the plan says that it is over it and names an error within a factor of ten of the
//! true one; and it is a streak, never a row of dots.

use crate::measure::tally_of;
use crate::scene::{
    Dice, FULL_WELL_E, Picture, READ_NOISE_E, centroid_error_px, draw_cpu, everything, instrument, los, planner_of,
    star,
};
use base::accuracy::AccuracyBudget;
use glam::{DVec2, DVec3};
use plan::exposure::{Degradation, ExposurePlan, Instrument, Planner, Shutter, Source};
use plan::{
    attitude::LosPath,
    exposure::cost::CostModel,
    exposure::plan::{Assessment, Verdict},
    optics::PsfModel,
};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Streaks, half of them with a lens that distorts, half with a rolling shutter.
const STREAKS: u32 = 384;
/// Detector, px.
const SIZE: usize = 64;
/// Steps of the integral, share of the PSF's sigma.
const STEP_SIGMA: f64 = 0.02;
/// Steps at least.
const LEAST_STEPS: f64 = 4000.0;
/// No light is added further than this from a star, sigma.
const REACH_SIGMA: f64 = 7.0;
/// Beyond this tangent no lens images anything here.
const WIDEST_TANGENT: f64 = 1.3;
/// Factor between the error that is named and the true one.
const NAMED_WITHIN: f64 = 10.0;
/// Share of an image's light that may be in the wrong pixels: a row of dots has more than half of it.
const NOT_DOTS: f64 = 0.3;
/// Largest share of streaks that the planner may report over the budget though they are not.
const FALSE_ALARMS: f64 = 0.15;

/// One exposure.
struct Streak {
    instrument: Instrument,
    rate_rad_s: DVec3,
    exposure_s: f64,
    sigma_px: f64,
    stars: Vec<Source>,
    places_px: Vec<[f64; 2]>,
}

/// Errors of an image.
#[derive(Debug, Clone, Copy)]
struct Found {
    centroid_px: f64,
    pixel_sigma: f64,
    flux_rel: f64,
    /// Light in wrong pixels, share of all.
    misplaced: f64,
}

impl Streak {
    fn new(number: u32) -> Self {
        let mut dice = Dice::new(40_000 + number);
        let dice = &mut dice;
        let decades = |dice: &mut Dice, low: f64, high: f64| 10_f64.powf(dice.between(low.log10(), high.log10()));
        let focal_px = [2900.0, 2900.0, 900.0, 300.0][(number / 4 % 4) as usize];
        let mut distortion = BrownConrady::default();
        let mut off_px = 0.0;
        if number % 2 == 1 {
            let (k1, k2) = (dice.between(-0.12, 0.1), dice.between(-0.02, 0.02));
            distortion = BrownConrady { k1, k2, p1: dice.between(-1e-3, 1e-3), ..distortion };
            off_px = 0.25 * focal_px;
        }
        let middle = 0.5 * (SIZE as f64 - 1.0);
        let camera = CameraGeometry::new(CameraParameters {
            width_px: SIZE,
            height_px: SIZE,
            focal_px: [focal_px; 2],
            principal_point_px: [middle + off_px * dice.between(-1.0, 1.0), middle + off_px * dice.between(-1.0, 1.0)],
            distortion,
        })
        .unwrap();
        let rolling = Shutter::Rolling { line_s: decades(dice, 1e-6, 1e-4) };
        let shutter = if number / 2 % 2 == 1 { rolling } else { Shutter::Global };
        let sigma_px = dice.between(0.5, 1.5);
        let direction = DVec3::new(dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), dice.between(-1.0, 1.0));
        let rate_rad_s = direction.normalize() * decades(dice, 0.1, 20.0).to_radians();
        let exposure_s = decades(dice, 1e-3, 2.0);
        let places_px: Vec<[f64; 2]> =
            (0..2).map(|_| core::array::from_fn(|_| dice.between(12.0, SIZE as f64 - 13.0))).collect();
        let stars = (0..).zip(&places_px).map(|(id, px)| star(id, decades(dice, 3e3, 3e5), *px)).collect();
        let instrument = Instrument { shutter, ..instrument(camera, &PsfModel::gaussian(sigma_px)) };
        Self { instrument, rate_rad_s, exposure_s, sigma_px, stars, places_px }
    }

    fn planner(&self, method: &str) -> Planner {
        let los = LosPath { rate_rad_s: self.rate_rad_s, exposure_s: self.exposure_s, ..los() };
        planner_of(self.instrument.clone(), method, los, None)
    }

    fn plan(&self, method: &str) -> ExposurePlan {
        self.planner(method).plan(&self.stars).clone()
    }

    /// Returns the light of each star by the integral.
    fn truth(&self) -> Vec<Picture> {
        (0..self.stars.len()).map(|i| self.star(self.places_px[i], self.stars[i].electrons)).collect()
    }

    /// Returns where a fixed star is seen `t_s` after mid-exposure, px.
    fn place_px(&self, tangent: DVec2, t_s: f64) -> Option<[f64; 2]> {
        // Rodrigues: a fixed direction turns backwards in axes that turn.
        let angle = -self.rate_rad_s.length() * t_s;
        let (axis, v) = (self.rate_rad_s.normalize(), tangent.extend(1.0));
        let (sin, cos) = angle.sin_cos();
        let v = v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
        let seen = DVec2::new(v.x / v.z, v.y / v.z);
        (v.z > 0.0 && seen.length() < WIDEST_TANGENT).then(|| self.lens_px(seen))
    }

    fn lens_px(&self, DVec2 { x, y }: DVec2) -> [f64; 2] {
        let p = self.instrument.camera.parameters();
        let BrownConrady { k1, k2, k3, p1, p2 } = p.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let dx = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let dy = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        [p.principal_point_px[0] + p.focal_px[0] * dx, p.principal_point_px[1] + p.focal_px[1] * dy]
    }

    /// Tangents whose pixel is `px`, by repeated correction.
    fn tangent(&self, px: [f64; 2]) -> DVec2 {
        let focal_px = self.instrument.camera.parameters().focal_px;
        let mut tangent = DVec2::ZERO;
        for _ in 0..200 {
            let [x, y] = self.lens_px(tangent);
            tangent += DVec2::new((px[0] - x) / focal_px[0], (px[1] - y) / focal_px[1]);
        }
        tangent
    }

    fn star(&self, px: [f64; 2], electrons: f64) -> Picture {
        let tangent = self.tangent(px);
        let line_s = self.instrument.shutter.line_s();
        let late_s = 0.5 * line_s * (SIZE as f64 - 1.0);
        let span_s = self.exposure_s + 2.0 * late_s;
        let focal_px = self.instrument.camera.parameters().focal_px[0];
        let length_px = 1.5 * self.rate_rad_s.length() * span_s * focal_px;
        let steps = (length_px / (STEP_SIGMA * self.sigma_px)).max(LEAST_STEPS).ceil();
        let step_s = span_s / steps;
        let reach_px = REACH_SIGMA * self.sigma_px;
        let mut pixels = vec![0.0; SIZE * SIZE];
        for i in 0..steps as u64 {
            let t_s = (i as f64 + 0.5) * step_s - 0.5 * span_s;
            let Some([x, y]) = self.place_px(tangent, t_s) else { continue };
            let is_near = |v: f64| v > -reach_px - 1.0 && v < SIZE as f64 + reach_px;
            if !is_near(x) || !is_near(y) {
                continue;
            }
            let (columns, rows) = (near(x, reach_px), near(y, reach_px));
            let across: Vec<f64> = columns.clone().map(|column| self.cell(column as f64 - x)).collect();
            for row in rows {
                // The part of this step in which the row is exposed.
                let middle_s = line_s * (row as f64 - 0.5 * (SIZE as f64 - 1.0));
                let from_s = (t_s - 0.5 * step_s).max(middle_s - 0.5 * self.exposure_s);
                let to_s = (t_s + 0.5 * step_s).min(middle_s + 0.5 * self.exposure_s);
                if to_s > from_s {
                    let light = electrons * (to_s - from_s) / self.exposure_s * self.cell(row as f64 - y);
                    let line = &mut pixels[row * SIZE..(row + 1) * SIZE];
                    for (pixel, share) in line[columns.clone()].iter_mut().zip(&across) {
                        *pixel += light * share;
                    }
                }
            }
        }
        Picture { width: SIZE, pixels }
    }

    /// Returns the share of the light in a pixel along one axis.
    fn cell(&self, from_star_px: f64) -> f64 {
        let scale = core::f64::consts::FRAC_1_SQRT_2 / self.sigma_px;
        0.5 * (libm::erfc((from_star_px - 0.5) * scale) - libm::erfc((from_star_px + 0.5) * scale))
    }

    /// Returns errors of `image` where `truth` is due, star by star.
    fn errors(&self, image: &Picture, truth: &[Picture]) -> Found {
        let mut sum = Picture { width: SIZE, pixels: vec![0.0; SIZE * SIZE] };
        for (pixel, light) in truth.iter().flat_map(|star| star.pixels.iter().enumerate()) {
            sum.pixels[pixel] += light;
        }
        let mut found = Found { centroid_px: 0.0, pixel_sigma: 0.0, flux_rel: 0.0, misplaced: 0.0 };
        for (a, b) in image.pixels.iter().zip(&sum.pixels) {
            found.misplaced += (a - b).abs() / sum.sum();
            let seen_e = b.clamp(0.0, FULL_WELL_E);
            let error = (a.min(FULL_WELL_E) - seen_e).abs() / seen_e.sqrt().hypot(READ_NOISE_E);
            found.pixel_sigma = found.pixel_sigma.max(error);
        }
        for star in truth {
            let window = star.tracker_window(&everything(SIZE));
            found.centroid_px = found.centroid_px.max(centroid_error_px(image, &sum, &window));
        }
        // The part cut off by an edge depends on the place.
        let rim = (0..SIZE).flat_map(|i| [sum.at(i, 0), sum.at(i, SIZE - 1), sum.at(0, i), sum.at(SIZE - 1, i)]);
        if rim.fold(0.0, f64::max) < 1e-6 * sum.sum() {
            found.flux_rel = (image.sum() / sum.sum() - 1.0).abs();
        }
        found
    }

    fn words(&self) -> String {
        let p = self.instrument.camera.parameters();
        let rate = self.rate_rad_s.to_array().map(|v| (v.to_degrees() * 100.0).round() / 100.0);
        format!(
            "{rate:?} deg/s, {:.4} s, focal {} px, k1 {:.3}, sigma {:.2}, {:?}, {:?} e-",
            self.exposure_s,
            p.focal_px[0],
            p.distortion.k1,
            self.sigma_px,
            self.instrument.shutter,
            self.stars.iter().map(|star| star.electrons.round()).collect::<Vec<_>>()
        )
    }
}

/// Returns pixels within `reach_px` of a place.
fn near(v: f64, reach_px: f64) -> core::ops::Range<usize> {
    let clamp = |v: f64| v.clamp(0.0, SIZE as f64) as usize;
    clamp((v - reach_px).ceil())..clamp((v + reach_px).floor() + 1.0)
}

/// Counted results of some streaks.
#[derive(Debug, Default)]
struct Tally {
    inside: usize,
    named: usize,
    false_alarms: usize,
    dots: usize,
    broken: Vec<String>,
}

impl Tally {
    fn take(&mut self, number: u32, method: &str) {
        let streak = Streak::new(number);
        let plan = streak.plan(method);
        let found = streak.errors(&draw_cpu(&plan), &streak.truth());
        let (budget, reported) = (AccuracyBudget::default(), &plan.chosen);
        let pairs = [
            (found.centroid_px, reported.centroid_px, budget.centroid_px),
            (found.pixel_sigma, reported.pixel_sigma, budget.pixel_sigma),
            (found.flux_rel, reported.flux_rel, budget.flux_rel),
        ];
        let is_inside = pairs.iter().all(|(found, _, budget)| found <= budget);
        let is_named = pairs.iter().all(|(found, reported, budget)| {
            found <= budget || (*reported <= NAMED_WITHIN * found && *reported >= found / NAMED_WITHIN)
        });
        self.inside += usize::from(is_inside);
        self.named += usize::from(!is_inside && !reported.verdict.is_met() && is_named);
        self.false_alarms += usize::from(is_inside && !reported.verdict.is_met());
        self.dots += usize::from(found.misplaced > NOT_DOTS);
        if found.misplaced > NOT_DOTS || !(is_inside || (!reported.verdict.is_met() && is_named)) {
            self.broken.push(format!("{number} {}: {reported:?}, {found:?}", streak.words()));
        }
    }

    fn add(&mut self, other: Self) {
        self.inside += other.inside;
        self.named += other.named;
        self.false_alarms += other.false_alarms;
        self.dots += other.dots;
        self.broken.extend(other.broken);
    }
}

/// Returns all streaks, by as many threads as there are.
fn tally(streaks: u32, method: &str) -> Tally {
    tally_of(streaks, |tally: &mut Tally, number| tally.take(number, method), Tally::add)
}

#[test]
fn random_streaks_are_inside_the_budget_or_their_error_is_named() {
    let Tally { inside, named, false_alarms, dots, broken } = tally(STREAKS, "auto");
    println!(
        "{inside} of {STREAKS} inside the budget ({false_alarms} of them said to be over), {named} named, {dots} dots"
    );
    assert!(broken.is_empty(), "{} of {STREAKS}:\n{}", broken.len(), broken.join("\n"));
    assert_eq!(inside + named, STREAKS as usize, "every streak is one or the other");
    assert!(false_alarms as f64 <= FALSE_ALARMS * f64::from(STREAKS), "{false_alarms} false alarms");
}

#[test]
fn four_nodes_are_dots_and_this_integral_sees_them() {
    let Tally { dots, inside, .. } = tally(STREAKS / 4, "gauss-legendre:4");
    println!("{dots} of {} are dots, {inside} inside the budget", STREAKS / 4);
    assert!(dots > 12, "only {dots} rows of dots seen");
    assert!(inside < STREAKS as usize / 4 * 3 / 4, "{inside} inside the budget with four nodes");
}

#[test]
fn a_streak_without_enough_time_has_as_many_nodes_as_fit() {
    let is_long = |streak: &Streak| {
        let plan = streak.plan("auto");
        let chosen = plan.chosen;
        // Where an eighth of the nodes is as good, it need not take as many as fit.
        let is_worse = |with: &Assessment| {
            8 * with.method.nodes() > chosen.method.nodes() || with.centroid_px > 1.01 * chosen.centroid_px
        };
        chosen.verdict == Verdict::CentroidOverBudget
            && chosen.method.nodes() > 64
            && plan.assessed.iter().all(is_worse)
    };
    let streak = (0..STREAKS).map(Streak::new).find(is_long).expect("a long streak over the budget");
    let whole = streak.plan("auto");
    let full = whole.chosen;
    let cost = CostModel::CPU;
    // A frame with a time budget tries methods on fewer stars.
    let hurried = streak.planner("auto").within_ms(1e9).plan(&streak.stars).path_steps;
    let [before_ms, hurried_ms] =
        [whole.path_steps, hurried].map(|steps| cost.empty_frame_ms(SIZE * SIZE) + cost.path_ms(steps));
    let limit_ms = hurried_ms + 0.4 * (full.cost_ms - before_ms);
    let plan = streak.planner("auto").within_ms(limit_ms).plan(&streak.stars).clone();
    let (fewer, all) = (plan.chosen.method.nodes(), full.method.nodes());
    println!("{}: {} in {limit_ms} ms, {} in {} ms", streak.words(), plan.chosen.method, full.method, full.cost_ms);
    assert_eq!(plan.degradation, Degradation::Full, "{:?}", plan.chosen);
    assert!(plan.chosen.cost_ms <= limit_ms, "{:?} in {limit_ms} ms", plan.chosen);
    assert!(fewer < all && fewer * 8 > all, "{fewer} nodes of {all}");
}
