//! Time -> barycentric position and velocity of the star sensor: the Earth's centre plus the spacecraft's orbit.
//!
//! Proven by the tests of [`crate::sky::earth`] and [`crate::sky::orbit`] and by `tests/physics/apparent_places`.

use crate::base::time::Tai;
use crate::sky::ObserverError;
use crate::sky::earth;
use crate::sky::orbit::{CircularOrbit, TleOrbit};
use core::ops::Add;
use glam::DVec3;

/// Position and velocity in ICRF axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BarycentricState {
    /// Position from the solar-system barycentre, km (from the geocentre where a function says so).
    pub position_km: DVec3,
    /// Velocity with respect to the same origin, km/s.
    pub velocity_km_s: DVec3,
}

impl Add for BarycentricState {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            position_km: self.position_km + other.position_km,
            velocity_km_s: self.velocity_km_s + other.velocity_km_s,
        }
    }
}

/// Where the star sensor flies.
#[derive(Debug, Clone)]
pub enum Observer {
    /// At rest at the solar-system barycentre: no parallax and no aberration.
    Barycentre,
    /// At the Earth's centre: annual parallax and aberration only.
    Geocentre,
    /// In an Earth orbit given by two-line elements.
    Tle(Box<TleOrbit>),
    /// In a circular Earth orbit.
    Circular(CircularOrbit),
}

impl Observer {
    /// State at `at`. Does not allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`.
    pub fn barycentric_state(&self, at: Tai) -> Result<BarycentricState, ObserverError> {
        let geocentric = match self {
            Self::Barycentre => return Ok(BarycentricState::default()),
            Self::Geocentre => BarycentricState::default(),
            Self::Tle(orbit) => orbit.geocentric_state(at)?,
            Self::Circular(orbit) => orbit.geocentric_state(at),
        };
        Ok(earth::barycentric_state(at) + geocentric)
    }
}
