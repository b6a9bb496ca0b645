//! Tests exposures of analytic motion that is sampled into a history.

use super::*;
use crate::attitude::los::{JitterPoint, PathOrigin};
use crate::attitude::{estimate::StalePolicy, history::AttitudeSample, ring::HistoryLimits};
use base::axes::Icrf;
use base::units::{ARCSEC, DEG};
use core::f64::consts::TAU;

/// Rounding of quaternion differences (1e-16) over half an exposure of 25 ms, squared for the acceleration.
const RATE_ROUNDING_RAD_S: f64 = 1e-12;
const ACCELERATION_ROUNDING_RAD_S2: f64 = 1e-10;
const ATTITUDE_ROUNDING_RAD: f64 = 1e-14;

type Motion = fn(f64) -> (Rotation<Body, Icrf>, DVec3, DVec3);

fn ms(t_ms: i64) -> Tai {
    Tai::from_ns(t_ms * 1_000_000)
}

/// Returns a motion of constant acceleration about one body axis.
fn accelerating(t_s: f64) -> (Rotation<Body, Icrf>, DVec3, DVec3) {
    let (axis, rate, acceleration) = (DVec3::new(0.6, 0.0, 0.8), 2.0 * DEG, 1.0 * DEG);
    let turned = axis * (rate * t_s + 0.5 * acceleration * t_s * t_s);
    (start().rotated_by(turned), axis * (rate + acceleration * t_s), axis * acceleration)
}

/// Returns a limit cycle of the attitude control: 2 Hz, 20 arcsec.
fn limit_cycle(t_s: f64) -> (Rotation<Body, Icrf>, DVec3, DVec3) {
    let (axis, w) = (DVec3::X, TAU * 2.0);
    let amplitude = axis * (20.0 * ARCSEC);
    let (sin, cos) = (w * t_s).sin_cos();
    (start().rotated_by(amplitude * sin), amplitude * (w * cos), amplitude * (-w * w * sin))
}

fn start() -> Rotation<Body, Icrf> {
    Rotation::from_rotation_vector(DVec3::new(-1.0, 0.4, 2.0))
}

/// Returns the motion sampled at 100 Hz until `until_ms`.
fn history(motion: Motion, until_ms: i64) -> AttitudeHistory {
    let mut history = AttitudeHistory::new(HistoryLimits::default());
    for (seq, t_ms) in (0..=255_u8).cycle().zip((0..=until_ms).step_by(10)) {
        let (body_from_icrf, rate_rad_s, acceleration_rad_s2) = motion(t_ms as f64 / 1e3);
        let sample = AttitudeSample { at: ms(t_ms), seq, body_from_icrf, rate_rad_s, acceleration_rad_s2 };
        history.insert(sample, ms(t_ms)).expect("in order");
    }
    history
}

fn no_jitter() -> JitterHistory {
    JitterHistory::new(HistoryLimits::default(), Span::from_ms(100))
}

/// Returns a quarter turn about z, and a tilt.
fn mounting() -> Rotation<Sensor, Body> {
    Rotation::from_rotation_vector(DVec3::new(0.3, 0.0, 1.5))
}

fn blank_path() -> LosPath {
    LosPath { jitter: no_jitter().new_track(), ..LosPath::commanded(Rotation::IDENTITY, ms(0), 0.0) }
}

fn composed(history: &AttitudeHistory, from_ms: i64, exposure_s: f64, policy: StalePolicy) -> (PathOutcome, LosPath) {
    let mut path = blank_path();
    let limits = EstimateLimits { policy, ..Default::default() };
    let outcome = compose(history, &no_jitter(), mounting(), ms(from_ms), exposure_s, &limits, &mut path);
    (outcome.expect("a history"), path)
}

/// Returns the largest angle between the path and the motion over the exposure.
fn path_error_rad(path: &LosPath, motion: Motion) -> f64 {
    (-50..=50).fold(0.0, |worst, i| {
        let t_s = path.exposure_s * 0.01 * f64::from(i);
        let turned = path.smooth_rotation_rad(t_s) + path.jitter_rotation_rad(t_s);
        let at = path.mid_exposure() + Span::from_s(t_s);
        let truth = mounting() * motion(at.ns() as f64 / 1e9).0;
        path.mid_sensor_from_icrf.rotated_by(turned).rotation_vector_to(&truth).length().max(worst)
    })
}

#[test]
fn constant_acceleration_comes_out_in_sensor_axes() {
    let (outcome, path) = composed(&history(accelerating, 500), 200, 0.05, StalePolicy::Hold);
    let (attitude, rate, acceleration) = accelerating(0.225);
    let PathOutcome::Show(report) = outcome else { panic!("{outcome:?}") };
    assert_eq!((path.origin, report.gap), (PathOrigin::Interpolated, Span::from_ms(10)));
    assert_eq!((report.horizon, report.end_horizon), (Span::from_ms(-5), Span::ZERO));
    let turned = path.mid_sensor_from_icrf.rotation_vector_to(&(mounting() * attitude));
    assert!(turned.length() < ATTITUDE_ROUNDING_RAD, "{turned}");
    assert!((path.rate_rad_s - mounting().apply(rate)).length() < RATE_ROUNDING_RAD_S, "{}", path.rate_rad_s);
    let acceleration_error = (path.acceleration_rad_s2 - mounting().apply(acceleration)).length();
    assert!(acceleration_error < ACCELERATION_ROUNDING_RAD_S2, "{acceleration_error}");
    assert!(path.jitter.is_still(), "no residual: {} rad", report.residual_rad);
}

#[test]
fn rates_that_stay_in_body_axes_would_be_seen() {
    let (_, path) = composed(&history(accelerating, 500), 200, 0.05, StalePolicy::Hold);
    let (_, body_rate, _) = accelerating(0.225);
    assert!((path.rate_rad_s - body_rate).length() > 1e6 * RATE_ROUNDING_RAD_S, "the mounting must matter");
}

#[test]
fn prediction_past_the_last_sample_follows_the_motion() {
    let (outcome, path) = composed(&history(accelerating, 200), 200, 0.1, StalePolicy::Stop);
    let PathOutcome::Show(report) = outcome else { panic!("{outcome:?}") };
    assert_eq!((path.origin, path.horizon), (PathOrigin::Predicted, Span::from_ms(50)));
    assert_eq!(report.end_horizon, Span::from_ms(100));
    assert!(path_error_rad(&path, accelerating) < 10.0 * ATTITUDE_ROUNDING_RAD, "acceleration was sent");
}

#[test]
fn long_exposures_follow_a_limit_cycle() {
    let (outcome, mut path) = composed(&history(limit_cycle, 2000), 500, 1.0, StalePolicy::Hold);
    let PathOutcome::Show(report) = outcome else { panic!("{outcome:?}") };
    assert!(report.residual_rad > 10.0 * ARCSEC, "a quadratic cannot follow: {} arcsec", report.residual_rad / ARCSEC);
    let with_knots = path_error_rad(&path, limit_cycle);
    // Two periods: 0.013 tolerances per the lobe rule, capped at 128 knots: 20 arcsec (2 pi 2 / 128)^2 / 8 = 0.024.
    assert!(with_knots < 0.03 * ARCSEC, "{} arcsec", with_knots / ARCSEC);
    path.jitter.points.clear();
    assert!(path_error_rad(&path, limit_cycle) > 10.0 * ARCSEC, "without the knots the error must show");
}

#[test]
fn received_jitter_and_residual_add_up() {
    let mut jitter = no_jitter();
    for t_ms in (490..=1510).step_by(2) {
        let rotation_rad = DVec3::Y * (ARCSEC * t_ms as f64);
        jitter.insert(JitterPoint { at: ms(t_ms), rotation_rad }, ms(t_ms)).expect("in order");
    }
    let history = history(limit_cycle, 2000);
    let (_, alone) = composed(&history, 500, 1.0, StalePolicy::Hold);
    let mut both = blank_path();
    compose(&history, &jitter, mounting(), ms(500), 1.0, &EstimateLimits::default(), &mut both).expect("a history");
    assert!(both.jitter.points.windows(2).all(|pair| pair[0].at < pair[1].at), "strictly ascending");
    for t_s in [-0.5, -0.1234, 0.0, 0.3, 0.5] {
        let extra = both.jitter_rotation_rad(t_s) - alone.jitter_rotation_rad(t_s);
        let wanted = DVec3::Y * (ARCSEC * 1000.0 * (1.0 + t_s));
        // Denser knots follow the residual's curvature better: the difference is the knots' own tolerance.
        assert!((extra - wanted).length() < 0.03 * ARCSEC, "{t_s} s: {}", (extra - wanted).length() / ARCSEC);
    }
}

#[test]
fn stopped_stream_is_held_blanked_dropped_or_stopped() {
    let history = history(accelerating, 100);
    let (held, path) = composed(&history, 1000, 0.1, StalePolicy::Hold);
    assert!(matches!(held, PathOutcome::Show(_)), "{held:?}");
    assert_eq!((path.origin, path.horizon), (PathOrigin::Held, Span::from_ms(950)));
    let age = Span::from_ms(950);
    assert_eq!(composed(&history, 1000, 0.1, StalePolicy::Blank).0, PathOutcome::Blank { age });
    assert_eq!(composed(&history, 1000, 0.1, StalePolicy::Drop).0, PathOutcome::Drop { age });
    assert_eq!(composed(&history, 1000, 0.1, StalePolicy::Stop).0, PathOutcome::Stop { age });
}

/// Tests exposures of 200 ms with samples every 10 ms: one missing sample at an end is normal, two are reported.
#[test]
fn exposure_is_partly_extrapolated_when_two_samples_are_missing_at_an_end() {
    for (from_ms, until_ms, outside_ms, wanted) in
        [(100, 300, 0, false), (100, 290, 10, false), (100, 280, 20, false), (100, 270, 30, true), (-30, 300, 30, true)]
    {
        let (outcome, path) = composed(&history(accelerating, until_ms), from_ms, 0.2, StalePolicy::Hold);
        let PathOutcome::Show(report) = outcome else { panic!("{outcome:?}") };
        assert_eq!(path.origin, PathOrigin::Interpolated);
        assert_eq!((report.outside, report.interval), (Span::from_ms(outside_ms), Span::from_ms(10)));
        assert_eq!(report.is_partly_extrapolated(), wanted, "{from_ms} to {} of {until_ms} ms", from_ms + 200);
    }
}

#[test]
fn invalid_times_and_empty_histories_are_errors() {
    let limits = EstimateLimits::default();
    let filled = history(accelerating, 100);
    for exposure_s in [f64::NAN, f64::INFINITY, -0.1] {
        let mut path = blank_path();
        let outcome = compose(&filled, &no_jitter(), mounting(), ms(50), exposure_s, &limits, &mut path);
        assert!(matches!(outcome, Err(AttitudeError::ExposureTime { .. })), "{exposure_s}: {outcome:?}");
        assert_eq!(path, blank_path(), "untouched");
    }
    let empty = AttitudeHistory::new(HistoryLimits::default());
    let outcome = compose(&empty, &no_jitter(), mounting(), ms(50), 0.1, &limits, &mut blank_path());
    assert_eq!(outcome, Err(AttitudeError::NoSamples { at: ms(100) }));
}

#[test]
fn exposures_that_begin_before_the_first_sample_use_the_motion_at_their_middle() {
    let (_, path) = composed(&history(accelerating, 500), -20, 0.1, StalePolicy::Hold);
    // Backwards from mid-exposure with an interpolated acceleration: no jerk, so only rounding of the cubic.
    assert!(path_error_rad(&path, accelerating) < 1e-10, "{} rad", path_error_rad(&path, accelerating));
}

#[test]
fn instants_and_reused_buffers_are_fine() {
    let history = history(limit_cycle, 2000);
    let mut path = blank_path();
    let space = path.jitter.points.capacity();
    for i in 0..50 {
        let limits = EstimateLimits::default();
        compose(&history, &no_jitter(), mounting(), ms(10 * i), 1.0, &limits, &mut path).expect("a history");
    }
    assert_eq!(path.jitter.points.capacity(), space, "no growth");
    let (_, instant) = composed(&history, 333, 0.0, StalePolicy::Hold);
    assert!((instant.rate_rad_s - mounting().apply(limit_cycle(0.333).1)).length() < 0.05 * ARCSEC, "its own rate");
}
