//! One instant of an external plant, by the bench's clock, in double precision.
//!
//! Plain datagrams and the control socket bring them; attitudes go to the same history as those of the bus. Tests:
//! `receiver_tests`.

use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use glam::DVec3;
use sky::observer::BarycentricState;

/// State of an external plant at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantSample {
    /// The instant.
    pub at: Tai,
    /// Attitude and rates, where they are given.
    pub attitude: Option<PlantAttitude>,
    /// Rotation vector of the line of sight beside the attitude, body axes, rad.
    pub jitter_rad: Option<DVec3>,
    /// State of the observer from the centre of the body that it orbits, ICRF axes, km and km/s.
    pub observer: Option<BarycentricState>,
}

/// Attitude and motion of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantAttitude {
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Angular rate of the body with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Angular acceleration, body axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
}

impl PlantSample {
    /// Returns an empty sample for an instant.
    pub fn at(at: Tai) -> Self {
        Self { at, attitude: None, jitter_rad: None, observer: None }
    }
}
