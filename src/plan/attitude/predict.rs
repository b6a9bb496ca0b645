//! Attitude beyond the last sample, from its rate and acceleration, and the error of that prediction.
//!
//! *Algorithm.* In the project's passive convention `q(t + T) = exp(-(w T + a T^2 / 2) / 2) * q(t)`: the rotation
//! vector is the integral of a rate that changes linearly in body axes (first term of the Magnus series). The neglected
//! effects have the bounds of [`PredictionErrors`]; `errors_stay_within_their_bounds_on_both_sides` compares each with
//! analytic motion.

use crate::attitude::history::AttitudeSample;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use glam::DVec3;

/// Attitude of the body at one instant, computed from samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeState {
    /// The instant.
    pub at: Tai,
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Acceleration, body axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
}

impl From<&AttitudeSample> for AttitudeState {
    fn from(sample: &AttitudeSample) -> Self {
        Self {
            at: sample.at,
            body_from_icrf: sample.body_from_icrf,
            rate_rad_s: sample.rate_rad_s,
            acceleration_rad_s2: sample.acceleration_rad_s2,
        }
    }
}

/// Returns the state at `at`, using the acceleration for `acceleration_horizon` and only the rate after that.
///
/// For a time before the state's own the same equations run backwards (without limit on the acceleration).
pub fn predict(from: &AttitudeState, at: Tai, acceleration_horizon: Span) -> AttitudeState {
    let trusted_until = from.at + acceleration_horizon;
    if at <= trusted_until {
        return accelerated(from, at);
    }
    let coasting = accelerated(from, trusted_until);
    accelerated(&AttitudeState { acceleration_rad_s2: DVec3::ZERO, ..coasting }, at)
}

fn accelerated(from: &AttitudeState, at: Tai) -> AttitudeState {
    let t_s = (at - from.at).s();
    let turned_rad = from.rate_rad_s * t_s + from.acceleration_rad_s2 * (0.5 * t_s * t_s);
    AttitudeState {
        at,
        body_from_icrf: from.body_from_icrf.rotated_by(turned_rad),
        rate_rad_s: from.rate_rad_s + from.acceleration_rad_s2 * t_s,
        acceleration_rad_s2: from.acceleration_rad_s2,
    }
}

/// Returns the state at `at` when the stream stopped at `from`: the rate decays as `exp(-t / rate_decay)`, so the
/// attitude comes to rest after a further turn of `w * rate_decay`. A decay of zero stops it at once.
pub fn held_state(from: &AttitudeState, at: Tai, rate_decay: Span) -> AttitudeState {
    let (t_s, decay_s) = ((at - from.at).s().max(0.0), rate_decay.s());
    let (share, travel_s) =
        if decay_s > 0.0 { ((-t_s / decay_s).exp(), -decay_s * (-t_s / decay_s).exp_m1()) } else { (0.0, 0.0) };
    let rate_rad_s = from.rate_rad_s * share;
    let acceleration_rad_s2 = if decay_s > 0.0 { -rate_rad_s / decay_s } else { DVec3::ZERO };
    AttitudeState {
        at,
        body_from_icrf: from.body_from_icrf.rotated_by(from.rate_rad_s * travel_s),
        rate_rad_s,
        acceleration_rad_s2,
    }
}

/// Errors of a prediction over a horizon. Each term bounds one neglected effect; their sum bounds all.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PredictionErrors {
    /// Acceleration that is not used (constant-rate prediction), rad/s^2: `a T^2 / 2`.
    pub unused_acceleration_rad_s2: f64,
    /// Largest jerk of the true motion, rad/s^3: `j T^3 / 6`.
    pub jerk_rad_s3: f64,
    /// Error of the reported rate, rad/s: `sigma T`.
    pub rate_error_rad_s: f64,
    /// Error of the time tag, s: `w dt`.
    pub clock_error_s: f64,
}

impl PredictionErrors {
    /// Returns the largest error, rad, of a prediction by `horizon_s` at this rate and acceleration. Commutation adds
    /// `|w x a| T^3 / 12` (second term of the Magnus series).
    pub fn bound_rad(&self, rate_rad_s: DVec3, acceleration_rad_s2: DVec3, horizon_s: f64) -> f64 {
        let t = horizon_s.abs();
        self.unused_acceleration_rad_s2 * t * t / 2.0
            + self.jerk_rad_s3 * t.powi(3) / 6.0
            + self.rate_error_rad_s * t
            + self.clock_error_s.abs() * (rate_rad_s + acceleration_rad_s2 * t).length()
            + rate_rad_s.cross(acceleration_rad_s2).length() * t.powi(3) / 12.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, DEG};

    /// Factor for the next terms of the series whose leading terms are the bounds: `rate * T` smaller (< 1 % here).
    const NEXT_TERM: f64 = 1.01;
    /// Share of its bound that an error must reach: below it the bound is too loose or the motion is not the worst
    /// case.
    const WORST_CASE_SHARE: f64 = 0.95;
    /// f64 rounding of a quaternion (2^-53) seen as an angle, with a few operations.
    const ROUNDING_RAD: f64 = 2e-15;

    fn at_s(t_s: f64) -> Tai {
        Tai::from_ns(1_000_000_000) + Span::from_s(t_s)
    }

    fn state(rate_rad_s: DVec3, acceleration_rad_s2: DVec3) -> AttitudeState {
        AttitudeState {
            at: at_s(0.0),
            body_from_icrf: Rotation::from_rotation_vector(DVec3::new(0.3, -0.8, 1.1)),
            rate_rad_s,
            acceleration_rad_s2,
        }
    }

    /// Returns the truth: integrates `w(t) = w0 + a t + j t^2 / 2` (body axes) in small exact steps.
    fn integrated(from: &AttitudeState, jerk_rad_s3: DVec3, t_s: f64) -> Rotation<Body, Icrf> {
        let steps = 4000;
        let h = t_s / f64::from(steps);
        (0..steps).fold(from.body_from_icrf, |q, i| {
            let t = (f64::from(i) + 0.5) * h;
            q.rotated_by((from.rate_rad_s + from.acceleration_rad_s2 * t + jerk_rad_s3 * (0.5 * t * t)) * h)
        })
    }

    fn error_rad(from: &AttitudeState, jerk_rad_s3: DVec3, t_s: f64) -> f64 {
        let predicted = predict(from, at_s(t_s), Span::from_ms(10_000)).body_from_icrf;
        integrated(from, jerk_rad_s3, t_s).rotation_vector_to(&predicted).length()
    }

    fn assert_worst_case(error: f64, bound: f64, what: &str) {
        assert!(error <= bound * NEXT_TERM, "{what}: {} arcsec over {}", error / ARCSEC, bound / ARCSEC);
        assert!(error >= bound * WORST_CASE_SHARE, "{what}: {} arcsec idle under {}", error / ARCSEC, bound / ARCSEC);
    }

    #[test]
    fn errors_stay_within_their_bounds_on_both_sides() {
        for t_s in [0.02, 0.1, -0.02, -0.1] {
            let still = state(DVec3::X * 3.0 * DEG, DVec3::ZERO);
            let jerk = PredictionErrors { jerk_rad_s3: 1.0 * DEG, ..Default::default() };
            let bound = jerk.bound_rad(still.rate_rad_s, DVec3::ZERO, t_s);
            assert_worst_case(error_rad(&still, DVec3::X * DEG, t_s), bound, "jerk of 1 deg/s^3");

            let turning = state(DVec3::X * 3.0 * DEG, DVec3::Y * DEG);
            let commutation = PredictionErrors::default();
            let bound = commutation.bound_rad(turning.rate_rad_s, turning.acceleration_rad_s2, t_s);
            assert_worst_case(error_rad(&turning, DVec3::ZERO, t_s), bound, "commutation");
        }
    }

    #[test]
    fn constant_rate_prediction_is_wrong_by_half_a_t_squared() {
        // The project's published numbers: arcsec after 20 and 100 ms.
        for (t_s, deg_s2, arcsec) in [(0.02, 0.1, 0.07), (0.02, 1.0, 0.72), (0.1, 0.1, 1.8), (0.1, 1.0, 18.0)] {
            let truth = state(DVec3::X * DEG, DVec3::X * deg_s2 * DEG);
            let blind = AttitudeState { acceleration_rad_s2: DVec3::ZERO, ..truth };
            let predicted = predict(&blind, at_s(t_s), Span::from_ms(1000)).body_from_icrf;
            let error = integrated(&truth, DVec3::ZERO, t_s).rotation_vector_to(&predicted).length();
            let errors = PredictionErrors { unused_acceleration_rad_s2: deg_s2 * DEG, ..Default::default() };
            assert_worst_case(error, errors.bound_rad(blind.rate_rad_s, DVec3::ZERO, t_s), "constant rate");
            assert!((error / ARCSEC - arcsec).abs() < 0.03 * arcsec + 0.005, "{} for {arcsec}", error / ARCSEC);
        }
    }

    #[test]
    fn a_millisecond_of_clock_error_at_3_deg_s_costs_11_arcsec() {
        let errors = PredictionErrors { clock_error_s: 1e-3, ..Default::default() };
        let bound = errors.bound_rad(DVec3::Z * 3.0 * DEG, DVec3::ZERO, 0.0);
        assert!((bound / ARCSEC - 10.8).abs() < 0.01, "{}", bound / ARCSEC);
    }

    #[test]
    fn a_wrong_sign_of_the_rate_would_be_seen() {
        let moving = state(DVec3::X * 3.0 * DEG, DVec3::ZERO);
        let backwards = AttitudeState { rate_rad_s: -moving.rate_rad_s, ..moving };
        let predicted = predict(&backwards, at_s(0.02), Span::from_ms(1000)).body_from_icrf;
        let error = integrated(&moving, DVec3::ZERO, 0.02).rotation_vector_to(&predicted).length();
        assert!(error > 100.0 * ARCSEC, "only {} arcsec", error / ARCSEC);
    }

    #[test]
    fn beyond_its_horizon_the_acceleration_is_not_used() {
        let start = state(DVec3::X * 0.01, DVec3::X * 0.1);
        let far = predict(&start, at_s(1.1), Span::from_ms(100));
        let turned = start.body_from_icrf.rotation_vector_to(&far.body_from_icrf);
        let wanted = 0.01 * 0.1 + 0.1 * 0.005 + (0.01 + 0.1 * 0.1) * 1.0;
        assert!((turned.x - wanted).abs() < ROUNDING_RAD, "{} for {wanted}", turned.x);
        assert_eq!(far.acceleration_rad_s2, DVec3::ZERO);
    }

    #[test]
    fn holding_is_continuous_and_comes_to_rest() {
        let start = state(DVec3::new(0.02, 0.0, -0.01), DVec3::ZERO);
        let decay = Span::from_ms(200);
        let at_once = held_state(&start, start.at, decay);
        assert_eq!(at_once.rate_rad_s, start.rate_rad_s);
        let late = held_state(&start, at_s(20.0), decay);
        let travel = start.body_from_icrf.rotation_vector_to(&late.body_from_icrf);
        assert!((travel - start.rate_rad_s * 0.2).length() < ROUNDING_RAD, "{travel}");
        assert!(late.rate_rad_s.length() < 1e-40, "{}", late.rate_rad_s);
        let frozen = held_state(&start, at_s(1.0), Span::ZERO);
        assert!(
            start.body_from_icrf.rotation_vector_to(&frozen.body_from_icrf).length() < ROUNDING_RAD,
            "decay of zero"
        );
    }
}
