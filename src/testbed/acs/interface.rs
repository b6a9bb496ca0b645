//! Inputs and outputs of the attitude control.

use super::mode_logic::{Mode, ModeEvent};
use base::axes::{Body, Icrf, Rotation};
use glam::DVec3;

/// Commands of people to the control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Hold this attitude; by a planned turn when it is far off. In safe mode and rate damping: later.
    Point(Rotation<Body, Icrf>),
    /// Turn to this attitude now.
    SlewTo(Rotation<Body, Icrf>),
    /// To safe mode.
    Safe,
    /// Out of safe mode, by way of rate damping.
    Resume,
}

/// Knowledge of the control at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcsInput {
    /// Estimated attitude.
    pub attitude: Option<Rotation<Body, Icrf>>,
    /// Estimated rate, rad/s, body axes.
    pub rate_rad_s: DVec3,
    /// Sigma of the attitude, rad, largest axis.
    pub attitude_sigma_rad: f64,
    /// Direction of the Sun, ICRF.
    pub sun_icrf: Option<DVec3>,
    /// Direction of the Sun as the coarse Sun sensor has it, body axes.
    pub sun_body: Option<DVec3>,
    /// Momentum of all wheels, N m s, body axes.
    pub wheel_momentum_n_m_s: DVec3,
}

/// Torques and reports of the control at one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcsOutput {
    /// Torque on the body, N m, body axes.
    pub torque_n_m: DVec3,
    /// Wheel momentum should be unloaded.
    pub unload: bool,
    /// Mode of this step.
    pub mode: Mode,
    /// Attitude followed now: the target, or the moving reference of a slew. `None` in safe mode, in rate damping and
    /// before the first target.
    pub target: Option<Rotation<Body, Icrf>>,
    /// Rotation vector from the attitude to what is followed (in safe mode: that turns the axis to the Sun), rad, body
    /// axes; zero when unknown.
    pub error_rad: DVec3,
    /// Change of mode at this step.
    pub event: Option<ModeEvent>,
}

impl AcsInput {
    /// Returns numbers that are not finite count as missing; a rate as none.
    pub(super) fn finite(&self) -> Self {
        let direction = |v: &DVec3| v.is_finite() && v.length_squared() > 0.0;
        let or_zero = |v: DVec3| if v.is_finite() { v } else { DVec3::ZERO };
        Self {
            attitude: self.attitude.filter(|attitude| attitude.quat().is_finite()),
            rate_rad_s: or_zero(self.rate_rad_s),
            attitude_sigma_rad: if self.attitude_sigma_rad.is_nan() { f64::INFINITY } else { self.attitude_sigma_rad },
            sun_icrf: self.sun_icrf.filter(direction),
            sun_body: self.sun_body.filter(direction),
            wheel_momentum_n_m_s: or_zero(self.wheel_momentum_n_m_s),
        }
    }
}
