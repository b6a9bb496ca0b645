//! Control laws: gains, rate damping, pointing, limits. Torques on the body, N m, body axes.
//!
//! Sources: quaternion feedback with eigen-axis gains and gyroscopic feed-forward: Wie, Weiss and Arapostathis,
//! JGCD 12 (1989); limits on rate and deceleration ("cascade saturation"): Wie, Bailey and Heiberg, JGCD 25 (2002).
//! Assumptions: `J` is known; the wheels' momentum is known; errors are exact rotation vectors. Pure functions.
//! Tests: `tests.rs`.
//!
//! One pointing loop at work: proportional to angle and rate, integral, structural filter.
//!
//! Input: error, rate error, limits. Output: torque, N m, body axes. The integral neither winds up at the torque limit
//! nor holds more than its share. Tests: `tests.rs`.

use crate::acs::filter::{Biquad, BiquadState};
use crate::acs::slew::SlewLimits;
use core::f64::consts::TAU;
use glam::{DMat3, DVec3};

/// Requested bandwidth, damping and integral time of a pointing loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Undamped natural frequency of the loop, Hz.
    pub bandwidth_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Time constant of the integral part, s; `None`: no integral.
    pub integral_s: Option<f64>,
}

/// Gain matrices of a pointing loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopGains {
    /// Angle to torque, N m/rad: `J wn^2`.
    pub angle: DMat3,
    /// Rate to torque, N m s/rad: `2 zeta wn J`.
    pub rate: DMat3,
    /// Integral of the angle to torque, N m/(rad s): `J wn^2 / Ti`.
    pub integral: DMat3,
    /// Error at which the angle's torque balances the rate's at 1 rad/s, rad: `2 zeta / wn`.
    pub error_per_rate_s: f64,
}

impl Gains {
    /// Returns the undamped natural frequency, rad/s.
    pub fn natural_rad_s(&self) -> f64 {
        TAU * self.bandwidth_hz
    }

    /// Returns `J wn^2`, `2 zeta wn J`, `J wn^2 / Ti`: with the full inertia all axes have the same loop, and a turn
    /// from rest stays on its eigen-axis.
    pub fn of(&self, inertia_kg_m2: &DMat3) -> LoopGains {
        let wn = self.natural_rad_s();
        let angle = *inertia_kg_m2 * (wn * wn);
        LoopGains {
            angle,
            rate: *inertia_kg_m2 * (2.0 * self.damping * wn),
            integral: self.integral_s.map_or(DMat3::ZERO, |ti| angle * (1.0 / ti)),
            error_per_rate_s: 2.0 * self.damping / wn,
        }
    }
}

/// Returns the torque that undoes the gyroscopic coupling of body and wheels: `w x (J w + h)`.
pub fn gyroscopic(inertia_kg_m2: &DMat3, rate_rad_s: DVec3, wheel_momentum_n_m_s: DVec3) -> DVec3 {
    rate_rad_s.cross(*inertia_kg_m2 * rate_rad_s + wheel_momentum_n_m_s)
}

/// Returns the error shortened so that the loop turns no faster than `largest_rate_rad_s` and can still stop with
/// `deceleration_rad_s2`: Wie, Bailey and Heiberg (2002), eq. 32, with `sqrt(a e)`, half the deceleration of theirs,
/// in reserve.
pub fn shortened(error_rad: DVec3, gains: &LoopGains, largest_rate_rad_s: f64, deceleration_rad_s2: f64) -> DVec3 {
    let rate = largest_rate_rad_s.min((deceleration_rad_s2 * error_rad.length()).sqrt());
    error_rad.clamp_length_max(rate * gains.error_per_rate_s)
}

/// Returns a torque scaled so that no axis exceeds `largest_n_m`; its direction is kept.
pub fn limited(torque_n_m: DVec3, largest_n_m: f64) -> DVec3 {
    let most = torque_n_m.abs().max_element();
    if most > largest_n_m { torque_n_m * (largest_n_m / most) } else { torque_n_m }
}

/// Returns the rotation vector (rad, body axes) that turns the body axis `axis_body` onto the measured direction
/// `sun_body`.
pub fn error_to_direction(axis_body: DVec3, sun_body: DVec3) -> DVec3 {
    let (axis, sun) = (axis_body.normalize_or_zero(), sun_body.normalize_or_zero());
    let across = axis.cross(sun);
    let angle = across.length().atan2(axis.dot(sun));
    // Opposite directions leave the axis of the turn free.
    let turn = across.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
    turn * angle
}

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
