//! Recent gyro samples and attitudes in order of time, each with the estimate right after it.
//!
//! A late attitude splits the gyro sample it falls into; everything after it is then worked through again. One queue
//! with its capacity taken at the start: nothing allocates later. Tests: `tests.rs` (late and unordered attitudes).

use super::covariance6::{Covariance6, Turn};
use super::params::MekfParams;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use glam::{DMat3, DVec3};
use std::collections::VecDeque;

/// Attitude, bias and their covariance at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    pub(super) attitude: Rotation<Body, Icrf>,
    pub(super) bias_rad_s: DVec3,
    pub(super) covariance: Covariance6,
}

/// An attitude to be worked in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fix {
    pub(super) attitude: Rotation<Body, Icrf>,
    pub(super) covariance_rad2: DMat3,
}

/// One step: the motion up to `at`, then perhaps an attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step {
    pub(super) at: Tai,
    /// Mean rate since the step before as the gyro gave it (its last one while it is silent), rad/s.
    pub(super) rate_measured_rad_s: DVec3,
    /// Silence of the gyro before this step; `None`: it was not silent.
    pub(super) silent_for: Option<Span>,
    pub(super) fix: Option<Fix>,
    /// Estimate after all of this.
    pub(super) after: Estimate,
}

/// Steps in order of time.
#[derive(Debug, Clone)]
pub(super) struct History {
    steps: VecDeque<Step>,
    reach: Span,
    space: usize,
}

impl History {
    pub(super) fn new(first: Step, reach: Span, space: usize) -> Self {
        let mut steps = VecDeque::with_capacity(space + 1);
        steps.push_back(first);
        Self { steps, reach, space }
    }

    /// Returns the latest step. A history is never empty; the first step is its floor.
    pub(super) fn last(&self) -> &Step {
        &self.steps[self.steps.len() - 1]
    }

    pub(super) fn get(&self, index: usize) -> &Step {
        &self.steps[index]
    }

    pub(super) fn get_mut(&mut self, index: usize) -> &mut Step {
        &mut self.steps[index]
    }

    pub(super) fn len(&self) -> usize {
        self.steps.len()
    }

    /// Returns the index of the last step at or before `at`; `None` when all are later.
    pub(super) fn at_or_before(&self, at: Tai) -> Option<usize> {
        self.steps.partition_point(|step| step.at <= at).checked_sub(1)
    }

    pub(super) fn push(&mut self, step: Step) {
        self.steps.push_back(step);
        self.forget();
    }

    /// Puts `step` after the step `index`, shortening what comes next; returns the new step's index.
    pub(super) fn split_after(&mut self, index: usize, step: Step) -> usize {
        let began_at = self.steps[index].at;
        if let Some(next) = self.steps.get_mut(index + 1) {
            next.silent_for = next.silent_for.map(|silent| silent + (step.at - began_at));
        }
        self.steps.insert(index + 1, step);
        index + 1
    }

    /// Forgets all before the step `index`.
    pub(super) fn forget_before(&mut self, index: usize) {
        self.steps.drain(..index);
    }

    /// Drops steps out of reach, keeping one step at or before the reach, and the oldest beyond the capacity.
    pub(super) fn forget(&mut self) {
        let oldest = self.last().at - self.reach;
        let unreachable = self.steps.partition_point(|step| step.at <= oldest).saturating_sub(1);
        let gone = unreachable.max(self.steps.len().saturating_sub(self.space));
        self.steps.drain(..gone);
    }
}

/// Returns the estimate after turning with `rate_measured_rad_s` for `span`.
pub(super) fn propagated(
    from: &Estimate,
    params: &MekfParams,
    rate_measured_rad_s: DVec3,
    silent_for: Option<Span>,
    span: Span,
) -> Estimate {
    if span == Span::ZERO {
        return *from;
    }
    let dt_s = span.s();
    let rate = rate_measured_rad_s - from.bias_rad_s;
    let mut noise = gyro_noise(params, dt_s);
    if let Some(silent) = silent_for {
        let (begin_s, end_s) = (silent.s(), silent.s() + dt_s);
        let variance = params.dropout_acceleration_rad_s2.powi(2) * (end_s.powi(4) - begin_s.powi(4)) / 4.0;
        noise.attitude += DMat3::IDENTITY * variance;
    }
    Estimate {
        attitude: from.attitude.rotated_by(rate * dt_s),
        bias_rad_s: from.bias_rad_s,
        covariance: from.covariance.propagated(&turn(rate, dt_s), &noise),
    }
}

/// Returns the transition of the errors over `dt_s` at a constant rate: Markley and Crassidis (2014), eq. 6.82:
/// attitude `exp(-[w x] dt)`, bias to attitude minus its integral over time.
fn turn(rate_rad_s: DVec3, dt_s: f64) -> Turn {
    let attitude = Rotation::<Body, Body>::from_rotation_vector(rate_rad_s * dt_s).matrix();
    let angle = rate_rad_s.length() * dt_s;
    // (1 - cos x) / x^2 and (x - sin x) / x^3, by series where the differences lose digits.
    let (first, second) = if angle < 1e-2 {
        let x2 = angle * angle;
        (0.5 - x2 / 24.0 + x2 * x2 / 720.0, 1.0 / 6.0 - x2 / 120.0 + x2 * x2 / 5040.0)
    } else {
        ((1.0 - angle.cos()) / angle.powi(2), (angle - angle.sin()) / angle.powi(3))
    };
    let cross = cross_product_matrix(rate_rad_s * dt_s);
    let integral = (DMat3::IDENTITY - cross * first + cross * cross * second) * dt_s;
    Turn { attitude, cross: -integral }
}

/// Returns the noise of one gyro step: Farrenkopf (1978); Markley and Crassidis (2014), eq. 6.93. Exact for slow turns;
/// the turning of the axes within one step is left out.
fn gyro_noise(params: &MekfParams, dt_s: f64) -> Covariance6 {
    let arw = params.gyro_arw_rad_sqrt_s * params.gyro_arw_rad_sqrt_s;
    let rrw = params.gyro_rrw_rad_s_sqrt_s * params.gyro_rrw_rad_s_sqrt_s;
    Covariance6 {
        attitude: DMat3::from_diagonal(arw * dt_s + rrw * (dt_s.powi(3) / 3.0)),
        cross: DMat3::from_diagonal(rrw * (-0.5 * dt_s * dt_s)),
        bias: DMat3::from_diagonal(rrw * dt_s),
    }
}

/// Returns `[v x]`, the matrix with `[v x] u = v x u`.
fn cross_product_matrix(v: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(at_ms: i64) -> Step {
        let covariance = Covariance6::independent(DMat3::IDENTITY, DMat3::IDENTITY);
        let after = Estimate { attitude: Rotation::IDENTITY, bias_rad_s: DVec3::ZERO, covariance };
        let at = Tai::from_ns(at_ms * 1_000_000);
        Step { at, rate_measured_rad_s: DVec3::ZERO, silent_for: None, fix: None, after }
    }

    #[test]
    fn memory_is_taken_once_and_time_stays_in_order() {
        for space in [16, 300] {
            let mut history = History::new(step(0), Span::from_ms(2000), space);
            let taken = history.steps.capacity();
            for k in 1..3000 {
                history.push(step(20 * k));
                let late = 20 * k - 210;
                if let Some(before) = history.at_or_before(Tai::from_ns(late * 1_000_000)) {
                    history.split_after(before, step(late));
                    history.forget();
                }
                assert!(history.len() <= space, "capacity {space}, held {}", history.len());
            }
            assert_eq!(history.steps.capacity(), taken, "nothing allocates later");
            assert!(history.steps.iter().is_sorted_by_key(|step| step.at), "in order");
            let reach = history.last().at - history.get(0).at;
            assert!(space < 200 || reach >= Span::from_ms(2000), "reach {} ms", reach.ms());
        }
    }
}
