use super::*;
use crate::attitude::{method_bound::Sinusoid, ring::HistoryLimits};
use base::axes::Rotation;
use base::units::{ARCSEC, DEG};
use core::f64::consts::PI;
use glam::DVec3;

fn ms(t_ms: i64) -> Tai {
    Tai::from_ns(t_ms * 1_000_000)
}

fn slewing() -> MotionScale {
    MotionScale { rate_rad_s: DEG, acceleration_rad_s2: 0.4 * DEG, jerk_rad_s3: 0.3 * DEG, sinusoids: Vec::new() }
}

fn wobbling(frequency_hz: f64) -> MotionScale {
    let sinusoids = vec![Sinusoid { frequency_hz, amplitude_rad: 5.0 * ARCSEC }];
    MotionScale { sinusoids, ..MotionScale::default() }
}

/// Returns samples at 0 and 10 ms of a constant spin.
fn history(rate_rad_s: DVec3) -> AttitudeHistory {
    let mut history = AttitudeHistory::new(HistoryLimits::default());
    for seq in 0..2_u8 {
        let (at, t_s) = (ms(10 * i64::from(seq)), 0.01 * f64::from(seq));
        let body_from_icrf = Rotation::IDENTITY.rotated_by(rate_rad_s * t_s);
        let sample = AttitudeSample { at, seq, body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO };
        history.insert(sample, at).unwrap();
    }
    history
}

#[test]
fn each_method_asks_for_more_and_errs_less() {
    let bounds = AttitudeMethod::ALL.map(|method| method.bound_rad(&slewing(), 0.01));
    assert!(bounds.windows(2).all(|pair| pair[1] < 0.1 * pair[0]), "{bounds:?}");
    assert!((bounds[0] - 0.01 * DEG).abs() < 1e-15, "w T");
    assert!((bounds[1] - 0.4 * DEG * 5e-5).abs() < 1e-15, "a T^2 / 2");
}

#[test]
fn the_cheapest_that_fits_is_chosen_and_nothing_when_none_does() {
    let reach = Reach { horizon_s: 0.01, spacing_s: Some(0.01) };
    let choice = |budget_arcsec: f64| cheapest(&assess_methods(budget_arcsec * ARCSEC, &slewing(), reach));
    assert_eq!(choice(40.0), Some(AttitudeMethod::Hold));
    assert_eq!(choice(1.0), Some(AttitudeMethod::ConstantRate));
    assert_eq!(choice(0.01), Some(AttitudeMethod::ConstantAcceleration));
    assert_eq!(choice(1e-4), Some(AttitudeMethod::Interpolation));
    assert_eq!(choice(1e-9), None);
    assert_eq!(choice(f64::NAN), None, "a NaN budget allows nothing");
}

#[test]
fn verdicts_state_why_a_method_is_refused() {
    let verdict = |motion: &MotionScale, spacing_s| {
        assess_methods(0.1 * ARCSEC, motion, Reach { horizon_s: 0.1, spacing_s })[3].verdict
    };
    assert_eq!(verdict(&slewing(), None), AttitudeVerdict::NeedsLaterSample);
    assert_eq!(verdict(&slewing(), Some(0.01)), AttitudeVerdict::Fits);
    let fast = verdict(&wobbling(51.0), Some(0.01));
    assert_eq!(fast, AttitudeVerdict::FasterThanSamples { frequency_hz: 51.0 });
    assert!(matches!(verdict(&wobbling(49.0), Some(0.01)), AttitudeVerdict::OverBudget { times } if times > 5.0));
    let spinning = MotionScale { rate_rad_s: 101.0, ..MotionScale::default() };
    assert_eq!(verdict(&spinning, Some(0.01)), AttitudeVerdict::TurnsTooFar);
}

#[test]
fn no_bound_is_above_half_a_turn() {
    let wild = MotionScale { rate_rad_s: 1e6, acceleration_rad_s2: 1e9, jerk_rad_s3: 1e12, ..wobbling(1e5) };
    for method in AttitudeMethod::ALL {
        assert_eq!(method.bound_rad(&wild, 10.0), PI, "{method}");
        assert_eq!(method.bound_rad(&MotionScale::default(), 10.0), 0.0, "{method}: at rest nothing can be wrong");
    }
}

#[test]
fn states_come_from_the_sample_before_and_the_one_after() {
    let rate = DVec3::X * 0.02;
    let history = history(rate);
    let turned = |method, at| {
        let state = state_by(method, &history, at).unwrap();
        Rotation::IDENTITY.rotation_vector_to(&state.body_from_icrf).x
    };
    assert_eq!(turned(AttitudeMethod::Hold, ms(4)), 0.0);
    for method in &AttitudeMethod::ALL[1..] {
        assert!((turned(*method, ms(4)) - 8e-5).abs() < 1e-15, "{method}");
    }
    assert!((turned(AttitudeMethod::Hold, ms(30)) - 2e-4).abs() < 1e-15, "the newest sample");
    assert!((turned(AttitudeMethod::Interpolation, ms(10)) - 2e-4).abs() < 1e-15, "the sample itself");
}

#[test]
fn missing_samples_are_reported() {
    let history = history(DVec3::ZERO);
    let by = |method, at| state_by(method, &history, at).map(|state| state.at);
    let after = Err(AttitudeError::AfterHistory { at: ms(11), newest: ms(10) });
    assert_eq!(by(AttitudeMethod::Interpolation, ms(11)), after);
    assert_eq!(by(AttitudeMethod::Hold, ms(11)), Ok(ms(11)));
    let before = Err(AttitudeError::BeforeHistory { at: ms(-1), oldest: ms(0) });
    assert_eq!(by(AttitudeMethod::Hold, ms(-1)), before);
    let empty = AttitudeHistory::new(HistoryLimits::default());
    let none = state_by(AttitudeMethod::Hold, &empty, ms(1));
    assert_eq!(none, Err(AttitudeError::NoSamples { at: ms(1) }));
}
