//! The attitude at one instant by a selected method, and which method is good enough.
//!
//! Input: a history and an instant; or a [`MotionScale`], the [`Reach`] of the samples and a budget. Output: a state;
//! or each method's error bound and verdict.
//!
//! | method | domain | needs | bound (leading term) |
//! |---|---|---|---|
//! | `hold` | any | a sample | `w T` |
//! | `constant-rate` | any | its rate | `a T^2 / 2` |
//! | `constant-acceleration` | any | its acceleration | `j T^3 / 6` |
//! | `interpolation` | < 1 rad between samples, sinusoids below half the sample rate | the next sample | `A (w H)^4 / 384` |
//!
//! `T` is the time since the sample, `H` the time between samples. The complete bounds are in `method_bound.rs`. They
//! do not contain errors of the samples themselves (noise, wire format, time tags): see
//! [`PredictionErrors`](super::PredictionErrors). *Validation.* `tests/physics/attitude_methods.rs`.

use crate::attitude::history::{AttitudeHistory, AttitudeSample};
use crate::attitude::method_bound::{self, MotionScale};
use crate::attitude::predict::{AttitudeState, held_state, predict};
use crate::attitude::{error::AttitudeError, interpolate::interpolate};
use base::time::{Span, Tai};
use core::fmt;

base::words! {
    /// Method to compute the attitude at an instant from samples, in the order of the data they need.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum AttitudeMethod {
        /// The last sample's attitude.
        Hold = "hold",
        /// The last sample's attitude, turned at its rate.
        ConstantRate = "constant-rate",
        /// The last sample's attitude, turned at a rate that changes by its acceleration.
        ConstantAcceleration = "constant-acceleration",
        /// The cubic through the samples on both sides.
        Interpolation = "interpolation",
    }
}

/// Distances of the samples from the instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Longest time from the last sample at or before the instant to the instant, s.
    pub horizon_s: f64,
    /// Longest time between the samples on both sides, s; `None` when the later one comes too late.
    pub spacing_s: Option<f64>,
}

/// Result of the assessment of one method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AttitudeVerdict {
    /// The bound is within the budget.
    Fits,
    /// The bound is this many times the budget.
    OverBudget {
        /// Bound over budget.
        times: f64,
    },
    /// Interpolation needs a sample after the instant, which is missing.
    NeedsLaterSample,
    /// A sinusoid is faster than half the sample rate, so that the samples do not resolve it.
    FasterThanSamples {
        /// Its frequency, Hz.
        frequency_hz: f64,
    },
    /// The body turns by more than a radian between samples.
    TurnsTooFar,
}

/// One method, its bound and its verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeAssessment {
    /// The method.
    pub method: AttitudeMethod,
    /// Largest error, rad; half a turn outside the method's domain.
    pub bound_rad: f64,
    /// Whether it may be used.
    pub verdict: AttitudeVerdict,
}

/// Largest turn between samples for which the bound of the interpolation is valid, rad.
pub(super) const INTERPOLATION_TURN_MAX_RAD: f64 = 1.0;

impl AttitudeMethod {
    /// Returns the largest error, rad, for any motion within `motion`'s magnitudes, in any phase and direction, from
    /// perfect samples.
    ///
    /// `span_s` is the time since the sample; for `Interpolation`, the time between the samples. Never above half a
    /// turn, and half a turn outside the method's domain.
    pub fn bound_rad(self, motion: &MotionScale, span_s: f64) -> f64 {
        let span_s = span_s.abs();
        let bound_rad = match self {
            Self::Hold => method_bound::hold_rad(motion, span_s),
            Self::ConstantRate => method_bound::constant_rate_rad(motion, span_s),
            Self::ConstantAcceleration => method_bound::constant_acceleration_rad(motion, span_s),
            Self::Interpolation if interpolation_refusal(motion, span_s).is_some() => core::f64::consts::PI,
            Self::Interpolation => method_bound::interpolation_rad(motion, span_s),
        };
        bound_rad.min(core::f64::consts::PI)
    }

    fn assess(self, budget_rad: f64, motion: &MotionScale, reach: Reach) -> AttitudeAssessment {
        let span_s = if self == Self::Interpolation { reach.spacing_s } else { Some(reach.horizon_s) };
        let Some(span_s) = span_s else {
            let verdict = AttitudeVerdict::NeedsLaterSample;
            return AttitudeAssessment { method: self, bound_rad: core::f64::consts::PI, verdict };
        };
        let bound_rad = self.bound_rad(motion, span_s);
        let refusal = if self == Self::Interpolation { interpolation_refusal(motion, span_s) } else { None };
        let verdict = refusal.unwrap_or(if bound_rad <= budget_rad {
            AttitudeVerdict::Fits
        } else {
            AttitudeVerdict::OverBudget { times: bound_rad / budget_rad }
        });
        AttitudeAssessment { method: self, bound_rad, verdict }
    }
}

impl fmt::Display for AttitudeMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Returns the reason why the bound of the interpolation is not valid for `motion`.
fn interpolation_refusal(motion: &MotionScale, spacing_s: f64) -> Option<AttitudeVerdict> {
    let frequency_hz = motion.highest_frequency_hz();
    if frequency_hz * spacing_s > 0.5 {
        return Some(AttitudeVerdict::FasterThanSamples { frequency_hz });
    }
    let turn_rad = motion.body_extremes().rate * spacing_s;
    (turn_rad > INTERPOLATION_TURN_MAX_RAD).then_some(AttitudeVerdict::TurnsTooFar)
}

/// Compares every method with `budget_rad`; returns the results in the order of [`AttitudeMethod::ALL`].
pub fn assess_methods(budget_rad: f64, motion: &MotionScale, reach: Reach) -> [AttitudeAssessment; 4] {
    AttitudeMethod::ALL.map(|method| method.assess(budget_rad, motion, reach))
}

/// Returns the least demanding method that fits; `None` when none does.
pub fn cheapest(assessed: &[AttitudeAssessment]) -> Option<AttitudeMethod> {
    assessed.iter().filter(|a| a.verdict == AttitudeVerdict::Fits).map(|a| a.method).min()
}

/// Returns the state at `at` by `method`, from the last sample at or before `at` and, for `Interpolation`, the first
/// after it. A sample at exactly that instant is returned unchanged.
///
/// # Errors
/// When the history is empty, has no sample at or before `at`, or none after it for a method that needs one.
pub fn state_by(method: AttitudeMethod, history: &AttitudeHistory, at: Tai) -> Result<AttitudeState, AttitudeError> {
    let (earlier, later) = history.around(at);
    let earlier = match (earlier, history.oldest()) {
        (Some(earlier), _) => earlier,
        (None, Some(oldest)) => return Err(AttitudeError::BeforeHistory { at, oldest: oldest.at }),
        (None, None) => return Err(AttitudeError::NoSamples { at }),
    };
    if method != AttitudeMethod::Interpolation || earlier.at == at {
        return Ok(continued(method, earlier, at));
    }
    match later {
        Some(later) => Ok(interpolate(earlier, later, at)),
        None => Err(AttitudeError::AfterHistory { at, newest: earlier.at }),
    }
}

/// Returns `sample` continued to `at` by one of the methods that need no later sample.
fn continued(method: AttitudeMethod, sample: &AttitudeSample, at: Tai) -> AttitudeState {
    let from = AttitudeState::from(sample);
    match method {
        AttitudeMethod::Hold => held_state(&from, at, Span::ZERO),
        AttitudeMethod::ConstantRate => predict(&from, at, Span::ZERO),
        AttitudeMethod::ConstantAcceleration | AttitudeMethod::Interpolation => predict(&from, at, at - from.at),
    }
}

#[cfg(test)]
#[path = "method_tests.rs"]
mod tests;
