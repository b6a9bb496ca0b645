//! True attitude of a simulated spacecraft at one instant, for scripted and dynamic ones alike.

use base::axes::{Body, Icrf, Rotation};
use glam::DVec3;

/// Attitude, rate and acceleration at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeTruth {
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: DVec3,
    /// Derivative of the rate.
    pub acceleration_rad_s2: DVec3,
}
