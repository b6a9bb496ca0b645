//! Measures the errors of the attitude methods on a motion in closed form, beside their bounds: the data of a chart.
//!
//! Input: an [`AnalyticMotion`] and a list of horizons. Output: [`MeasuredError`]s, the worst of 96 starts over the
//! longest period and, for the interpolation, of seven places between the samples. Samples are perfect: the result is
//! the method's error alone. A worst phase between the starts is missed by at most `1 - cos(pi / 96)`, 0.06 %.

use crate::attitude::history::{AttitudeHistory, AttitudeSample};
use crate::attitude::method::{AttitudeMethod, state_by};
use crate::attitude::method_bound::{MotionScale, Sinusoid};
use crate::attitude::ring::HistoryLimits;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use core::f64::consts::TAU;
use glam::DVec3;

/// Number of starts over the longest period.
const STARTS: u32 = 96;
/// Number of parts into which the places between two samples divide their interval.
const PARTS: u32 = 8;
/// Time zero of every motion.
const EPOCH: Tai = Tai::from_ns(1_000_000_000_000);

/// A sinusoidal turn about an axis fixed in the body: `amplitude sin(2 pi f t + phase)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SinusoidTurn {
    /// Axis, body axes, of length 1.
    pub axis: DVec3,
    /// Frequency and amplitude.
    pub sinusoid: Sinusoid,
    /// Phase at time zero, rad.
    pub phase_rad: f64,
}

/// A slew about one axis, and sinusoids on top of it, one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct AnalyticMotion {
    /// Attitude at time zero, before the sinusoids.
    pub initial: Rotation<Body, Icrf>,
    /// Axis of the slew, body axes, of length 1.
    pub slew_axis: DVec3,
    /// Rate of the slew at time zero, rad/s.
    pub rate_rad_s: f64,
    /// Acceleration of the slew at time zero, rad/s^2.
    pub acceleration_rad_s2: f64,
    /// Jerk of the slew, rad/s^3.
    pub jerk_rad_s3: f64,
    /// Sinusoids.
    pub sinusoids: Vec<SinusoidTurn>,
}

/// One method over one horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredError {
    /// The method.
    pub method: AttitudeMethod,
    /// Time since the sample; for the interpolation, time between the samples, s.
    pub horizon_s: f64,
    /// Largest error found, rad.
    pub error_rad: f64,
    /// The bound, rad.
    pub bound_rad: f64,
}

impl AnalyticMotion {
    /// Returns attitude, rate and acceleration at `at`, exact.
    pub fn sample_at(&self, at: Tai) -> AttitudeSample {
        let t = (at - EPOCH).s();
        let [w, a, j] = [self.rate_rad_s, self.acceleration_rad_s2, self.jerk_rad_s3];
        let angle_rad = w * t + 0.5 * a * t * t + j * t * t * t / 6.0;
        let slew = AttitudeSample {
            at,
            seq: 0,
            body_from_icrf: self.initial.rotated_by(self.slew_axis * angle_rad),
            rate_rad_s: self.slew_axis * (w + a * t + 0.5 * j * t * t),
            acceleration_rad_s2: self.slew_axis * (a + j * t),
        };
        self.sinusoids.iter().fold(slew, |inner, turn| turn.applied(&inner, t))
    }

    /// Returns the motion's magnitudes from time zero to `until_s`.
    pub fn scale(&self, until_s: f64) -> MotionScale {
        let [w, a, j] = [self.rate_rad_s, self.acceleration_rad_s2, self.jerk_rad_s3].map(f64::abs);
        MotionScale {
            rate_rad_s: w + a * until_s + 0.5 * j * until_s * until_s,
            acceleration_rad_s2: a + j * until_s,
            jerk_rad_s3: j,
            sinusoids: self.sinusoids.iter().map(|turn| turn.sinusoid).collect(),
        }
    }

    /// Returns the time over which starts are spread: the longest period, or 1 s without sinusoids.
    fn longest_period_s(&self) -> f64 {
        let slowest_hz =
            self.sinusoids.iter().map(|turn| turn.sinusoid.frequency_hz.abs()).fold(f64::INFINITY, f64::min);
        if slowest_hz.is_finite() && slowest_hz > 0.0 { 1.0 / slowest_hz } else { 1.0 }
    }

    /// Returns the largest error of `method` for samples at `start` and `horizon` later.
    fn error_from_rad(&self, method: AttitudeMethod, start: Tai, horizon: Span) -> f64 {
        let mut history = AttitudeHistory::new(HistoryLimits::default());
        let sees_later = method == AttitudeMethod::Interpolation;
        for (seq, at) in (0..).zip([Some(start), sees_later.then_some(start + horizon)].into_iter().flatten()) {
            // A time that is not later than the sample's own is refused: the error there is zero as well.
            let _refused = history.insert(AttitudeSample { seq, ..self.sample_at(at) }, at);
        }
        let parts = if sees_later { 1..PARTS } else { PARTS..PARTS + 1 };
        let error_at = |part: u32| {
            let at = start + Span::from_s(horizon.s() * f64::from(part) / f64::from(PARTS));
            let truth = self.sample_at(at).body_from_icrf;
            state_by(method, &history, at).map_or(0.0, |state| state.body_from_icrf.rotation_vector_to(&truth).length())
        };
        parts.map(error_at).fold(0.0, f64::max)
    }
}

impl SinusoidTurn {
    /// Returns `inner` rotated by this sinusoid at `t` seconds.
    fn applied(&self, inner: &AttitudeSample, t: f64) -> AttitudeSample {
        let (w, amplitude_rad) = (TAU * self.sinusoid.frequency_hz, self.sinusoid.amplitude_rad);
        let (sin, cos) = (w * t + self.phase_rad).sin_cos();
        let turn_rad = self.axis * (amplitude_rad * sin);
        let turn_rate = self.axis * (amplitude_rad * w * cos);
        let turned = Rotation::<Body, Body>::from_rotation_vector(turn_rad);
        let [rate, acceleration] = [inner.rate_rad_s, inner.acceleration_rad_s2].map(|v| turned.apply(v));
        AttitudeSample {
            body_from_icrf: inner.body_from_icrf.rotated_by(turn_rad),
            rate_rad_s: turn_rate + rate,
            // A constant vector turns the other way when written in rotating axes.
            acceleration_rad_s2: acceleration - turn_rad * (w * w) - turn_rate.cross(rate),
            ..*inner
        }
    }
}

/// Returns the worst measured error and the bound of every method over every horizon, method by method.
pub fn measured_prediction_errors(motion: &AnalyticMotion, horizons_s: &[f64]) -> Vec<MeasuredError> {
    let spread_s = motion.longest_period_s();
    let starts = |k: u32| EPOCH + Span::from_s(spread_s * f64::from(k) / f64::from(STARTS));
    let point = |method: AttitudeMethod, horizon_s: f64| {
        let worst = |k: u32| motion.error_from_rad(method, starts(k), Span::from_s(horizon_s));
        let error_rad = (0..STARTS).map(worst).fold(0.0, f64::max);
        let bound_rad = method.bound_rad(&motion.scale(spread_s + horizon_s), horizon_s);
        MeasuredError { method, horizon_s, error_rad, bound_rad }
    };
    let over_horizons = |method| horizons_s.iter().map(move |horizon_s| (method, *horizon_s));
    AttitudeMethod::ALL
        .into_iter()
        .flat_map(over_horizons)
        .map(|(method, horizon_s)| point(method, horizon_s))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, DEG};

    /// Error of central differences over 0.2 ms: third derivatives here times 1e-8 / 6, and rounding of 1e-16 / 1e-4.
    const DIFFERENCE: f64 = 1e-8;
    /// f64 rounding of a quaternion seen as an angle.
    const ROUNDING_RAD: f64 = 2e-15;

    fn motion(jitter_hz: f64) -> AnalyticMotion {
        let sinusoid = Sinusoid { frequency_hz: jitter_hz, amplitude_rad: 5.0 * ARCSEC };
        AnalyticMotion {
            initial: Rotation::from_rotation_vector(DVec3::new(0.4, -1.0, 0.9)),
            slew_axis: DVec3::Y,
            rate_rad_s: 0.5 * DEG,
            acceleration_rad_s2: 0.1 * DEG,
            jerk_rad_s3: 0.1 * DEG,
            sinusoids: vec![SinusoidTurn { axis: DVec3::new(0.6, 0.0, 0.8), sinusoid, phase_rad: 0.3 }],
        }
    }

    #[test]
    fn rate_and_acceleration_are_the_derivatives() {
        let (motion, step) = (motion(5.0), Span::from_ns(100_000));
        let at = EPOCH + Span::from_ms(777);
        let [before, now, after] = [at - step, at, at + step].map(|t| motion.sample_at(t));
        let rate = before.body_from_icrf.rotation_vector_to(&after.body_from_icrf) / (2.0 * step.s());
        assert!((rate - now.rate_rad_s).length() < DIFFERENCE, "{}", (rate - now.rate_rad_s).length());
        let acceleration = (after.rate_rad_s - before.rate_rad_s) / (2.0 * step.s());
        let off = (acceleration - now.acceleration_rad_s2).length();
        assert!(off < 100.0 * DIFFERENCE, "{off}");
        assert!(now.rate_rad_s.cross(now.acceleration_rad_s2).length() > 1e-6, "the axis of rotation moves");
    }

    #[test]
    fn every_error_is_under_its_bound_and_not_far() {
        let horizons_s = [0.002, 0.01, 0.02, 0.05];
        let found = measured_prediction_errors(&motion(5.0), &horizons_s);
        assert_eq!(found.len(), 16);
        for point in &found {
            assert!(point.error_rad <= point.bound_rad, "{point:?}");
            assert!(point.error_rad >= 0.1 * point.bound_rad, "idle: {point:?}");
        }
        let at = |method, horizon_s| {
            found.iter().find(|p| p.method == method && p.horizon_s == horizon_s).map(|p| p.error_rad / ARCSEC)
        };
        let last = AttitudeMethod::ALL.map(|method| at(method, 0.01).unwrap());
        assert!(last.windows(2).all(|pair| pair[0] > pair[1]), "each method is better than the one before: {last:?}");
    }

    #[test]
    fn no_horizon_no_error() {
        let still = measured_prediction_errors(&motion(5.0), &[0.0]);
        assert!(still.iter().all(|p| p.error_rad < ROUNDING_RAD), "{still:?}");
        assert!(measured_prediction_errors(&motion(5.0), &[]).is_empty());
    }
}
