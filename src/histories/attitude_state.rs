//! An attitude as one row of a file has it, and with its motion as it is interpolated.

use base::axes::{Body, Icrf, Rotation};
use glam::DVec3;

/// One row of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeState {
    /// Nanoseconds: of TAI since 1970, or since a zero of the file's own ([`Times`](crate::Times)).
    pub t_ns: i64,
    /// Attitude.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: Option<DVec3>,
}

/// Attitude, rate and acceleration at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeMotion {
    /// Attitude.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: DVec3,
    /// Derivative of the rate.
    pub acceleration_rad_s2: DVec3,
}
