//! One attitude as sent by the flight computer.

use base::axes::{Body, Icrf, Rotation};
use base::{time::Tai, units::DEG};
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

/// Fastest turn that is accepted as a spacecraft's attitude, rad/s: 1000 deg/s, beyond what a star sensor follows.
pub const MOST_RATE_RAD_S: f64 = 1000.0 * DEG;
/// Largest angular acceleration that is accepted, rad/s^2: 10,000 deg/s^2. Actuators stay far below it; a vibration of
/// 80 arcsec at 50 Hz has 2,200.
pub const MOST_ACCELERATION_RAD_S2: f64 = 10_000.0 * DEG;
/// Tolerance for noise of attitudes and of their time tags, rad: 3.4 arcmin.
const TURN_NOISE_RAD: f64 = 1e-3;

impl AttitudeSample {
    /// Returns true when every rate and acceleration is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.rate_rad_s.is_finite() && self.acceleration_rad_s2.is_finite()
    }

    /// Returns true when the rate or the acceleration is above its limit.
    pub(super) fn is_too_fast(&self) -> bool {
        self.rate_rad_s.length() > MOST_RATE_RAD_S || self.acceleration_rad_s2.length() > MOST_ACCELERATION_RAD_S2
    }

    /// Returns true when the turn from this sample to `other`, of another epoch, needs more than the largest rate.
    pub(super) fn is_too_far_from(&self, other: &Self) -> bool {
        let turned_rad = self.body_from_icrf.rotation_vector_to(&other.body_from_icrf).length();
        turned_rad > TURN_NOISE_RAD + MOST_RATE_RAD_S * (other.at - self.at).s().abs()
    }
}
