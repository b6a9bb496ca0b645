//! One pointing loop at work: proportional to angle and rate, integral, structural filter.
//!
//! Input: error, rate error, limits. Output: torque, N m, body axes. The integral neither winds up at the torque limit
//! nor holds more than its share. Tests: `tests.rs`.

use super::filter::{Biquad, BiquadState};
use super::laws::{LoopGains, shortened};
use super::slew::SlewLimits;
use glam::DVec3;

/// Part of the acceleration allowed that a feedback turn may need to stop; the rest is left for damping and coupling.
const DECELERATION_SHARE: f64 = 0.5;

/// A pointing loop with its integral and filter.
#[derive(Debug, Clone, Copy)]
pub(super) struct FeedbackLoop {
    gains: LoopGains,
    filter: BiquadState,
    integral_rad_s: DVec3,
    saturated: bool,
    fresh: bool,
}

impl FeedbackLoop {
    /// Returns a loop that begins with the first step.
    pub(super) fn new(gains: LoopGains, filter: Biquad) -> Self {
        Self { gains, filter: filter.at_rest(), integral_rad_s: DVec3::ZERO, saturated: false, fresh: true }
    }

    /// Forgets integral and filter: the next step starts from zero.
    pub(super) fn start_again(&mut self) {
        *self = Self { integral_rad_s: DVec3::ZERO, saturated: false, fresh: true, ..*self };
    }

    /// Records whether the torque of this step was cut.
    pub(super) fn note_saturation(&mut self, saturated: bool) {
        self.saturated = saturated;
    }

    /// Returns `F (kp e - kd w + ki int e)`. The integral is frozen while the torque is at its limit (no wind-up) and
    /// where it would pass its own limit.
    pub(super) fn torque(
        &mut self,
        error_rad: DVec3,
        rate_error_rad_s: DVec3,
        dt_s: f64,
        limits: &SlewLimits,
        integral_limit_n_m: DVec3,
    ) -> DVec3 {
        let (rate, deceleration) = (limits.largest_rate_rad_s, limits.largest_acceleration_rad_s2);
        let error = shortened(error_rad, &self.gains, rate, deceleration * DECELERATION_SHARE);
        let longer = self.integral_rad_s + error * dt_s;
        let possible = (self.gains.integral * longer).abs().cmple(integral_limit_n_m).all();
        if !self.saturated && error == error_rad && possible {
            self.integral_rad_s = longer;
        }
        let held = self.gains.integral * self.integral_rad_s;
        let raw = self.gains.angle * error - self.gains.rate * rate_error_rad_s + held;
        if core::mem::take(&mut self.fresh) {
            self.filter.settle(raw);
        }
        self.filter.step(raw)
    }
}
