//! One attitude as the flight computer sent it.

use crate::base::axes::{Body, Icrf, Rotation};
use crate::base::time::Tai;
use glam::DVec3;

/// Attitude, rate and angular acceleration of the body at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeSample {
    /// Epoch of the attitude.
    pub at: Tai,
    /// Sequence number of the message that carried it.
    pub seq: u8,
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Angular rate of the body with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Angular acceleration, body axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
}
