//! Targets against an integral of their own: the pixel-integrated Gaussian along the way, Simpson's rule in time, with
//! paths, projection and turns written afresh.

use crate::scene::{
    EXPOSURE_S, FOCAL_PX, Picture, camera, draw_cpu, draw_reference, instrument, los, planner, planner_of, star,
};
use base::axes::{Icrf, Rotation, Sensor, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use core::f64::consts::{FRAC_1_SQRT_2, PI};
use frames::sink::TruthKind;
use glam::DVec3;
use image::detector::window::OutputGeometry;
use plan::attitude::{JitterLine, JitterPoint};
use plan::exposure::{
    ExposurePlan, LightCurve, PixelPath, PixelPoint, PlannedStar, Shutter, SkyPath, Target, TargetCurve, TargetPath,
    TargetWay,
};
use plan::exposure::{cost::CostModel, planner::Planner, target::FIRST_TARGET_ID, target_plan::MOST_NODES};
use plan::optics::PsfModel;
use scene::truth::fill_truth;

const SIZE: usize = 96;
const SIGMA_PX: f64 = 0.8;
const LIGHT_E: f64 = 1e5;
/// Steps of Simpson's rule: 0.016 px each on the longest way here, error below 1e-10 of the light.
const STEPS: usize = 4000;
/// Single precision and `1.5 L / sigma + 2` nodes: of the brightest pixel of a point of the same light.
const DRAWN: f64 = 6e-6;
/// The reference: of the light per pixel.
const EXACT: f64 = 1e-9;

fn target(path: TargetPath) -> Target {
    let e_per_s = LIGHT_E / EXPOSURE_S;
    let (begin, end) = (Tai::from_ns(0) - Span::from_s(1.0), Tai::from_ns(0) + Span::from_s(1.0));
    Target { id: FIRST_TARGET_ID, mag: f32::NAN, e_per_s, begin, end, way: TargetWay::Script(path), light: None }
}

/// Returns a path that is at `px` with this velocity at mid-exposure, `1 + EXPOSURE_S / 2` after it begins.
fn through(px: [f64; 2], velocity_px_s: [f64; 2]) -> TargetPath {
    let since_s = 1.0 + 0.5 * EXPOSURE_S;
    let position_px = [px[0] - velocity_px_s[0] * since_s, px[1] - velocity_px_s[1] * since_s];
    TargetPath { position_px, velocity_px_s, curve: TargetCurve::Straight }
}

fn cell(d: f64) -> f64 {
    let scale = FRAC_1_SQRT_2 / SIGMA_PX;
    0.5 * (libm::erf((d + 0.5) * scale) - libm::erf((d - 0.5) * scale))
}

/// Returns the mean electrons of light that is at `px(t)`, t in s after mid-exposure, from `from_s` to `to_s`; rows
/// at `y` see it `late_s(y)` later.
fn integral(px: impl Fn(f64) -> [f64; 2], seen_s: [f64; 2], late_s: impl Fn(usize) -> f64) -> Picture {
    integral_of(px, |_| 1.0, seen_s, late_s)
}

/// Returns the same of light that changes: shares of it at an instant.
fn integral_of(
    px: impl Fn(f64) -> [f64; 2],
    share: impl Fn(f64) -> f64,
    [from_s, to_s]: [f64; 2],
    late_s: impl Fn(usize) -> f64,
) -> Picture {
    let mut pixels = vec![0.0; SIZE * SIZE];
    let h = (to_s - from_s) / STEPS as f64;
    for (y, row) in pixels.chunks_mut(SIZE).enumerate() {
        for step in 0..=STEPS {
            let t_s = from_s + step as f64 * h + late_s(y);
            let [cx, cy] = px(t_s);
            if (cy - y as f64).abs() > 8.0 {
                continue;
            }
            let simpson = if step == 0 || step == STEPS { 1.0 } else { 2.0 + 2.0 * (step % 2) as f64 };
            let down = share(t_s) * LIGHT_E / EXPOSURE_S * simpson * h / 3.0 * cell(y as f64 - cy);
            for (x, pixel) in row.iter_mut().enumerate().filter(|(x, _)| (cx - *x as f64).abs() <= 8.0) {
                *pixel += down * cell(x as f64 - cx);
            }
        }
    }
    Picture { width: SIZE, pixels }
}

fn at_once(px: impl Fn(f64) -> [f64; 2]) -> Picture {
    integral(px, [-0.5 * EXPOSURE_S, 0.5 * EXPOSURE_S], |_| 0.0)
}

fn worst(a: &Picture, b: &Picture) -> f64 {
    a.pixels.iter().zip(&b.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn still(targets: Vec<Target>) -> Planner {
    let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los(), None);
    planner.set_targets(targets);
    planner
}

fn assert_drawn(what: &str, plan: &ExposurePlan, truth: &Picture) {
    let peak = LIGHT_E * cell(0.0) * cell(0.0);
    let drawn = worst(&draw_cpu(plan), truth) / peak;
    assert!(drawn < DRAWN, "{what}: drawn {drawn:e} of the peak");
    let exact = worst(&draw_reference(plan), truth) / LIGHT_E;
    assert!(exact < EXACT, "{what}: the reference is off by {exact:e} of the light");
    println!("{what}: drawn {drawn:.1e} of the peak, reference {exact:.1e} of the light");
}

#[test]
fn straight_accelerating_and_turning_targets_are_their_integrals() {
    for speed_px_s in [0.0, 5.0, 20.0, 80.0, 400.0] {
        let velocity = [0.8 * speed_px_s, -0.6 * speed_px_s];
        let path = through([47.3, 48.8], velocity);
        let mut planner = still(vec![target(path)]);
        let truth = at_once(|t| [47.3 + velocity[0] * t, 48.8 + velocity[1] * t]);
        assert_drawn(&format!("straight at {speed_px_s} px/s"), planner.plan(&[]), &truth);
        // The control: half of the velocity is another picture.
        let half = at_once(|t| [47.3 + 0.5 * velocity[0] * t, 48.8 + 0.5 * velocity[1] * t]);
        let off = worst(&draw_cpu(planner.plan(&[])), &half) / LIGHT_E;
        assert!(off > 10.0 * DRAWN || speed_px_s < 1.0, "half the velocity goes unseen: {off:e} at {speed_px_s}");
    }
    // A circle about (48, 48): the target is at its rightmost point 1.05 s before the middle of the exposure.
    let (radius, turn) = (20.0, -PI * 10.0);
    let curve = TargetCurve::Arc(turn);
    let path = TargetPath { position_px: [48.0 + radius, 48.0], velocity_px_s: [0.0, radius * turn], curve };
    let since_s = 1.0 + 0.5 * EXPOSURE_S;
    let truth = at_once(|t| {
        let (sin, cos) = (turn * (t + since_s)).sin_cos();
        [48.0 + radius * cos, 48.0 + radius * sin]
    });
    assert_drawn("half a circle", still(vec![target(path)]).plan(&[]), &truth);
    let curve = TargetCurve::Accelerating([300.0, -60.0]);
    let path = TargetPath { position_px: [50.0 - 218.0, 40.0 - 30.0], velocity_px_s: [50.0, 60.0], curve };
    let truth = at_once(|t| {
        let t = t + since_s;
        [50.0 - 218.0 + 50.0 * t + 150.0 * t * t, 10.0 + 60.0 * t - 30.0 * t * t]
    });
    let mut planner = still(vec![target(path)]);
    let plan = planner.plan(&[]);
    assert!(truth.sum() > 0.9 * LIGHT_E, "on the detector: {}", truth.sum());
    assert_drawn("accelerating", plan, &truth);
}

/// Returns `v` turned by `-angle` about each axis of `rotation`, by Rodrigues' formula: how a fixed direction is seen
/// after the camera has turned by `rotation`.
fn seen_after(rotation: DVec3, v: DVec3) -> DVec3 {
    let angle = rotation.length();
    if angle == 0.0 {
        return v;
    }
    let (axis, (sin, cos)) = (rotation / angle, (-angle).sin_cos());
    v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos))
}

fn projected(px: [f64; 2], rotation: DVec3) -> [f64; 2] {
    let middle = 0.5 * (SIZE as f64 - 1.0);
    let v = seen_after(rotation, DVec3::new((px[0] - middle) / FOCAL_PX, (px[1] - middle) / FOCAL_PX, 1.0));
    [middle + FOCAL_PX * v.x / v.z, middle + FOCAL_PX * v.y / v.z]
}

#[test]
fn the_camera_moves_at_the_same_instants() {
    let velocity = [60.0, 40.0];
    let path = through([40.0, 44.0], velocity);
    let own = |t: f64| [40.0 + velocity[0] * t, 44.0 + velocity[1] * t];
    // A slew, and with it a line of jitter that turns around within the exposure.
    let rate = DVec3::new(0.004, 0.015, 0.3);
    let amplitude = DVec3::new(2e-4, -3e-4, 1e-3);
    for (what, hz) in [("slew", 0.0), ("slew and jitter", 23.0)] {
        let mut los = los();
        los.rate_rad_s = rate;
        if hz > 0.0 {
            los.jitter.lines.push(JitterLine { frequency_hz: hz, amplitude_rad: amplitude, phase_rad: 0.4 });
            los.jitter.lines_epoch = los.mid_exposure();
        }
        let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los, None);
        planner.set_targets(vec![target(path)]);
        let jitter = |t: f64| if hz > 0.0 { amplitude * (2.0 * PI * hz * t + 0.4).sin() } else { DVec3::ZERO };
        let truth = at_once(|t| {
            let middle = 0.5 * (SIZE as f64 - 1.0);
            let [x, y] = own(t);
            let v = DVec3::new((x - middle) / FOCAL_PX, (y - middle) / FOCAL_PX, 1.0);
            let v = seen_after(jitter(t), seen_after(rate * t, v));
            [middle + FOCAL_PX * v.x / v.z, middle + FOCAL_PX * v.y / v.z]
        });
        assert_drawn(what, planner.plan(&[]), &truth);
    }
    // A camera that follows the target sees a point; smeared twice, once for each, it would be a streak.
    let mut los = los();
    los.rate_rad_s = DVec3::new(-velocity[1] / FOCAL_PX, velocity[0] / FOCAL_PX, 0.0);
    let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los.clone(), None);
    planner.set_targets(vec![target(through([47.5, 47.5], velocity))]);
    let followed = draw_cpu(planner.plan(&[]));
    let brightest = followed.pixels.iter().copied().fold(0.0, f64::max);
    let still = at_once(|_| [47.5, 47.5]);
    let wanted = still.pixels.iter().copied().fold(0.0, f64::max);
    assert!((brightest / wanted - 1.0).abs() < 1e-3, "{brightest} of {wanted}");
    let truth = at_once(|t| projected([47.5 + velocity[0] * t, 47.5 + velocity[1] * t], los.rate_rad_s * t));
    assert_drawn("followed", planner.plan(&[]), &truth);
}

#[test]
fn a_commanded_path_moves_targets_too() {
    let path = through([40.0, 44.0], [50.0, 0.0]);
    let point = |t_s: f64, dx_px: f64, dy_px: f64| PixelPoint { t_s, dx_px, dy_px, roll_rad: 0.0 };
    let line = PixelPath::line(vec![point(0.0, 0.0, 0.0), point(0.04, 6.0, 1.0), point(0.1, -2.0, 3.0)], EXPOSURE_S);
    let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los(), Some(line.unwrap()));
    planner.set_targets(vec![target(path)]);
    let truth = at_once(|t| {
        let s = t + 0.5 * EXPOSURE_S;
        let between = |a: f64, b: f64, share: f64| a + (b - a) * share;
        let [dx, dy] = if s < 0.04 {
            [between(0.0, 6.0, s / 0.04), between(0.0, 1.0, s / 0.04)]
        } else {
            [between(6.0, -2.0, (s - 0.04) / 0.06), between(1.0, 3.0, (s - 0.04) / 0.06)]
        };
        [40.0 + 50.0 * t + dx, 44.0 + dy]
    });
    let plan = planner.plan(&[]);
    let peak = LIGHT_E * cell(0.0) * cell(0.0);
    // Simpson's steps do not end at the corner.
    const CORNER: f64 = 2e-5;
    for (what, picture) in [("drawn", draw_cpu(plan)), ("reference", draw_reference(plan))] {
        let off = worst(&picture, &truth) / peak;
        assert!(off < CORNER, "{what}: {off:e}");
    }
}

#[test]
fn rows_of_a_rolling_shutter_see_a_target_when_they_are_exposed() {
    let line_s = 2e-4;
    let mut instrument = instrument(camera(SIZE), &PsfModel::gaussian(SIGMA_PX));
    instrument.shutter = Shutter::Rolling { line_s };
    let mut planner = planner_of(instrument, "auto", los(), None);
    planner.set_targets(vec![target(through([40.0, 20.0], [90.0, 0.0]))]);
    let late = |y: usize| line_s * (y as f64 - 0.5 * (SIZE as f64 - 1.0));
    let window = [-0.5 * EXPOSURE_S, 0.5 * EXPOSURE_S];
    let truth = integral(|t| [40.0 + 90.0 * t, 20.0], window, late);
    let plan = planner.plan(&[]);
    let exact = worst(&draw_reference(plan), &truth) / LIGHT_E;
    assert!(exact < EXACT, "{exact:e}");
    // Changes within a footprint are neglected by the fast methods: the smear's ends, 0.018 px a row.
    let drawn = worst(&draw_cpu(plan), &truth) / (LIGHT_E * cell(0.0) * cell(0.0));
    assert!(drawn < 5e-3, "{drawn:e}");
    let unaware = at_once(|t| [40.0 + 90.0 * t, 20.0]);
    let off = worst(&unaware, &truth) / (LIGHT_E * cell(0.0) * cell(0.0));
    assert!(off > 10.0 * drawn, "the control: without the rows' delay {off:e}, with it {drawn:e}");
}

#[test]
fn a_target_seen_for_a_part_of_the_exposure_leaves_that_part_of_its_light() {
    let mid = los().mid_exposure();
    let path = TargetPath { position_px: [30.0, 40.0], velocity_px_s: [200.0, 100.0], curve: TargetCurve::Straight };
    let begin = mid - Span::from_s(0.01);
    let only = Target { begin, end: begin + Span::from_s(0.03), ..target(path) };
    let truth = integral(|t| [30.0 + 200.0 * (t + 0.01), 40.0 + 100.0 * (t + 0.01)], [-0.01, 0.02], |_| 0.0);
    let mut planner = still(vec![only]);
    assert_drawn("seen for 30 of 100 ms", planner.plan(&[]), &truth);
    let mut rows = Vec::new();
    let plan = planner.latest();
    fill_truth(plan, &whole(plan), None, &mut rows);
    let [row] = rows[..] else { panic!("one row: {rows:?}") };
    assert!((row.electrons / (0.3 * LIGHT_E) - 1.0).abs() < 1e-6, "{}", row.electrons);
    assert!((row.x_px - 33.0).abs() < 1e-9 && (row.y_px - 41.5).abs() < 1e-9, "{row:?}");
    assert!((row.smear_px - 0.03 * 200.0_f64.hypot(100.0)).abs() < 1e-9);
    assert!((row.smear_deg - 100.0_f64.atan2(200.0).to_degrees()).abs() < 1e-9);
}

/// Returns the output of the whole sensor.
fn whole(plan: &ExposurePlan) -> OutputGeometry {
    OutputGeometry::whole([plan.camera.width_px(), plan.camera.height_px()])
}

#[test]
fn the_truth_has_a_row_for_each_target_and_every_star() {
    let other = Target { id: FIRST_TARGET_ID + 1, mag: 7.5, ..target(through([95.2, 50.0], [0.0, 30.0])) };
    let away = Target { id: FIRST_TARGET_ID + 2, ..target(through([400.0, 50.0], [0.0, 30.0])) };
    let mut planner = still(vec![target(through([20.0, 30.0], [-30.0, 40.0])), other, away]);
    let plan = planner.plan(&[star(7, 2e4, [60.0, 60.0]), star(8, 3e4, [70.0, 10.0])]).clone();
    let mut rows = Vec::new();
    fill_truth(&plan, &whole(&plan), None, &mut rows);
    let kinds: Vec<_> = rows.iter().map(|row| (row.id, row.kind)).collect();
    let wanted = [
        (7, TruthKind::Star),
        (8, TruthKind::Star),
        (FIRST_TARGET_ID, TruthKind::Target),
        (FIRST_TARGET_ID + 1, TruthKind::Target),
    ];
    assert_eq!(kinds, wanted, "the third target is far away");
    assert!((rows[2].x_px - 20.0).abs() < 1e-9 && (rows[2].y_px - 30.0).abs() < 1e-9);
    assert!((rows[2].smear_px - 5.0).abs() < 1e-9 && (rows[2].smear_deg - 126.869_897_645_844).abs() < 1e-9);
    assert!(rows[3].electrons < 0.7 * LIGHT_E, "cut by the edge");
    let sum: f64 = rows.iter().map(|row| row.electrons).sum();
    let drawn = draw_cpu(&plan).sum();
    assert!((drawn / sum - 1.0).abs() < 1e-4, "truth {sum}, image {drawn}");
}

#[test]
fn targets_are_in_the_predicted_cost_and_cost_nothing_when_there_are_none() {
    let stars: Vec<_> = (0..50).map(|i| star(i, 1e4, [10.0 + f64::from(i), 40.0])).collect();
    let without = still(Vec::new()).plan(&stars).clone();
    let mut planner = still(vec![target(through([47.3, 48.8], [600.0, 0.0]))]);
    let with = planner.plan(&stars).clone();
    let places = |stars: &[PlannedStar]| stars.iter().map(|star| (star.id, star.mean_px)).collect::<Vec<_>>();
    assert_eq!(places(&without.stars), places(with.sky_stars()));
    let nodes = (with.stars.len() - without.stars.len()) as f64;
    assert!(nodes >= 1.5 * 60.0 / SIGMA_PX, "{nodes}");
    let more_ms = with.chosen.cost_ms - without.chosen.cost_ms;
    let node_ms = 1e-6 * (CostModel::CPU.star_ns + CostModel::CPU.splat_ns);
    assert!((more_ms / (nodes * node_ms) - 1.0).abs() < 1e-9, "{more_ms} ms for {nodes} nodes");
    assert!(without.targets.is_empty());
}

/// A target 500 km away that passes at 11 km/s, as a camera sees it that looks at where it is at mid-exposure: km, x
/// right and y down, at mid-exposure and per second.
const PASS_KM: [[f64; 3]; 2] = [[0.4, -0.7, 500.0], [9.0, 3.0, 5.5]];
/// The observer's barycentric velocity, km/s, and its change, km/s^2: sensor axes.
const FLIGHT_KM_S: [[f64; 3]; 2] = [[21.0, -18.0, 9.0], [-0.006, 0.004, 0.003]];

/// Returns the direction in which it is seen: aberration by components, along the velocity and across it.
fn seen_at(t: f64) -> DVec3 {
    let [u, b] = [PASS_KM, FLIGHT_KM_S].map(|[at, rate]| DVec3::from_array(at) + t * DVec3::from_array(rate));
    let (u, b) = (u.normalize(), b / 299_792.458);
    let along = b * (u.dot(b) / b.length_squared());
    ((along + b) + (u - along) * (1.0 - b.length_squared()).sqrt()) / (1.0 + u.dot(b))
}

fn px_of(v: DVec3) -> [f64; 2] {
    let middle = 0.5 * (SIZE as f64 - 1.0);
    [middle + FOCAL_PX * v.x / v.z, middle + FOCAL_PX * v.y / v.z]
}

/// Returns the pass as a target on the sky of a camera with this attitude.
fn passing(sensor_from_icrf: &Rotation<Sensor, Icrf>, light: Option<LightCurve>) -> Target {
    let half_s = 0.5 * EXPOSURE_S;
    let icrf = |v: DVec3| sensor_from_icrf.inverse().apply(v);
    let at = |[at, rate]: [[f64; 3]; 2], t: f64| icrf(DVec3::from_array(at) + t * DVec3::from_array(rate));
    let places = SkyPath::instants_s(half_s).map(|t| at(PASS_KM, t));
    let path = SkyPath::through(places, half_s, [-half_s, half_s].map(|t| at(FLIGHT_KM_S, t)));
    Target { way: TargetWay::Sky(path), light, ..target(through([0.0; 2], [0.0; 2])) }
}

#[test]
fn a_way_on_the_sky_is_its_integral_under_a_moving_camera() {
    let rate = DVec3::new(0.004, 0.015, 0.3);
    let amplitude = DVec3::new(2e-4, -3e-4, 1e-3);
    for (what, moves) in [("on the sky, camera at rest", false), ("on the sky, slew and jitter", true)] {
        let mut los = los();
        los.mid_sensor_from_icrf = sensor_from_ra_dec_roll(2.0, -0.6, 0.8);
        if moves {
            los.rate_rad_s = rate;
            los.jitter.lines.push(JitterLine { frequency_hz: 23.0, amplitude_rad: amplitude, phase_rad: 0.4 });
            los.jitter.lines_epoch = los.mid_exposure();
        }
        let target = passing(&los.mid_sensor_from_icrf, None);
        let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los, None);
        planner.reserve_targets_on_sky(1);
        planner.set_targets_on_sky(&[target]);
        let place = |t: f64| {
            let own = seen_at(t);
            let jitter = amplitude * (2.0 * PI * 23.0 * t + 0.4).sin();
            px_of(if moves { seen_after(jitter, seen_after(rate * t, own)) } else { own })
        };
        let plan = planner.plan(&[]);
        assert_drawn(what, plan, &at_once(place));
        let [own_from, own_to] = [-0.5, 0.5].map(|tau| px_of(seen_at(tau * EXPOSURE_S)));
        let smear = plan.targets[0].smear;
        let along = [own_to[0] - own_from[0], own_to[1] - own_from[1]];
        assert!((smear.length_px - along[0].hypot(along[1])).abs() < 1e-6, "{smear:?} {along:?}");
        assert!((smear.angle_rad - along[1].atan2(along[0])).abs() < 1e-8, "{smear:?} {along:?}");
        // The control: without aberration it is elsewhere.
        let still = |t: f64| px_of(DVec3::from_array(PASS_KM[0]) + t * DVec3::from_array(PASS_KM[1]));
        let off = worst(&draw_cpu(plan), &at_once(still)) / (LIGHT_E * cell(0.0) * cell(0.0));
        assert!(off > 100.0 * DRAWN, "aberration goes unseen: {off:e}");
    }
}

#[test]
fn light_that_fades_along_a_way_is_drawn_as_it_fades() {
    let half_s = 0.5 * EXPOSURE_S;
    // Straight down to nothing at a quarter of the exposure before its end.
    let share = |t: f64| (0.5 - t / EXPOSURE_S - 0.25).clamp(0.0, 0.75) / 0.75;
    let light = LightCurve { half_s, shares: LightCurve::instants_s(half_s).map(share) };
    let los = los();
    let target = passing(&los.mid_sensor_from_icrf, Some(light));
    let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los, None);
    planner.set_targets_on_sky(&[target]);
    let plan = planner.plan(&[]);
    let truth = integral_of(|t| px_of(seen_at(t)), share, [-half_s, half_s], |_| 0.0);
    let peak = LIGHT_E * cell(0.0) * cell(0.0);
    // The curve's corner lies within a piece of nodes.
    const CORNER: f64 = 2e-4;
    for (what, picture) in [("drawn", draw_cpu(plan)), ("reference", draw_reference(plan))] {
        let off = worst(&picture, &truth) / peak;
        println!("fading, {what}: {off:.1e} of the peak");
        assert!(off < CORNER, "{what}: {off:e}");
    }
    let steady = at_once(|t| px_of(seen_at(t)));
    assert!(worst(&draw_cpu(plan), &steady) / peak > 100.0 * CORNER, "control: steady light is another picture");
    assert!((plan.targets[0].electrons / (0.375 * LIGHT_E) - 1.0).abs() < 1e-3, "{}", plan.targets[0].electrons);
}

#[test]
fn targets_on_the_sky_go_with_each_exposure_and_scripts_stay() {
    let los = los();
    let on_sky = Target { id: FIRST_TARGET_ID + 1, ..passing(&los.mid_sensor_from_icrf, None) };
    let mut planner = still(vec![target(through([20.0, 30.0], [-30.0, 40.0]))]);
    let ids = |planner: &mut Planner| planner.plan(&[]).targets.iter().map(|t| t.target.id).collect::<Vec<_>>();
    assert_eq!(ids(&mut planner), [FIRST_TARGET_ID]);
    planner.set_targets_on_sky(&[on_sky]);
    assert_eq!(ids(&mut planner), [FIRST_TARGET_ID, FIRST_TARGET_ID + 1]);
    planner.set_targets_on_sky(&[]);
    assert_eq!(ids(&mut planner), [FIRST_TARGET_ID]);
}

#[test]
fn a_target_under_jitter_with_many_corners_has_few_nodes_and_says_that_it_is_coarse() {
    let amplitude_rad = 0.2 / FOCAL_PX;
    let plan_of = |points: i64| {
        let mut los = los();
        let mid = los.mid_exposure();
        // Samples as they come from a bus, over the whole exposure.
        los.jitter.points = (0..points)
            .map(|i| JitterPoint {
                at: mid + Span::from_s(EXPOSURE_S * (i as f64 / (points - 1) as f64 - 0.5)),
                rotation_rad: DVec3::new(0.0, amplitude_rad * (0.01 * i as f64).sin(), 0.0),
            })
            .collect();
        let mut planner = planner(SIZE, &PsfModel::gaussian(SIGMA_PX), "auto", los, None);
        planner.set_targets(vec![target(through([47.3, 48.8], [30.0, -20.0]))]);
        planner.plan(&[]).clone()
    };
    for (points, is_coarse) in [(100, false), (5000, true)] {
        let plan = plan_of(points);
        let [planned] = plan.targets.as_slice() else { panic!("one target") };
        assert!(planned.nodes.len() <= MOST_NODES, "{points} corners: {} nodes", planned.nodes.len());
        assert_eq!(planned.is_coarse, is_coarse, "{points} corners, {} nodes", planned.nodes.len());
        let light_e = draw_cpu(&plan).sum();
        assert!((light_e / LIGHT_E - 1.0).abs() < 1e-4, "{points} corners: {light_e} e-");
    }
}
