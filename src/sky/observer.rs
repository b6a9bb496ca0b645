//! Time -> barycentric position and velocity of the star sensor: the Earth's centre plus the spacecraft's orbit.
//!
//! Proven by the tests of [`crate::sky::earth`] and [`crate::sky::orbit`] and by `tests/physics/apparent_places`.

use crate::base::time::Tai;
use crate::sky::ObserverError;
use crate::sky::earth::{self, EarthTrack};
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
    /// State at `at`, by direct evaluation of the Earth's series (0.3 to 0.8 ms); frames use [`ObserverTrack`]. Does not
    /// allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`.
    pub fn barycentric_state(&self, at: Tai) -> Result<BarycentricState, ObserverError> {
        self.with_earth(at, || earth::barycentric_state(at))
    }

    fn with_earth(&self, at: Tai, earth: impl FnOnce() -> BarycentricState) -> Result<BarycentricState, ObserverError> {
        Ok(self.geocentric_state(at)?.map_or_else(BarycentricState::default, |geocentric| earth() + geocentric))
    }

    /// State from the Earth's centre at `at`; `None` at the barycentre. Does not allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`.
    pub fn geocentric_state(&self, at: Tai) -> Result<Option<BarycentricState>, ObserverError> {
        Ok(Some(match self {
            Self::Barycentre => return Ok(None),
            Self::Geocentre => BarycentricState::default(),
            Self::Tle(orbit) => orbit.geocentric_state(at)?,
            Self::Circular(orbit) => orbit.geocentric_state(at),
        }))
    }
}

/// An observer followed from frame to frame: the orbit at each time, the Earth by [`EarthTrack`].
#[derive(Debug, Clone)]
pub struct ObserverTrack {
    observer: Observer,
    earth: EarthTrack,
}

impl ObserverTrack {
    /// Follows `observer`, ready for the day of `at`.
    #[must_use]
    pub fn new(observer: Observer, at: Tai) -> Self {
        Self { observer, earth: EarthTrack::new(at) }
    }

    /// Where the star sensor flies.
    #[must_use]
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// State at `at`; depends on the time only. Does not allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`.
    pub fn barycentric_state(&mut self, at: Tai) -> Result<BarycentricState, ObserverError> {
        let Self { observer, earth } = self;
        observer.with_earth(at, || earth.barycentric_state(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orbit_and_earth_add_up_and_the_barycentre_rests() {
        let at = Tai::from_rfc3339("2026-03-01T12:34:56Z").expect("a valid instant");
        let orbit = CircularOrbit::new(500.0, 97.4, 30.0, 10.0, at).expect("a valid orbit");
        let state = |observer: Observer| observer.barycentric_state(at).expect("no elements, no error");
        let [flying, earth] = [Observer::Circular(orbit), Observer::Geocentre].map(state);
        let speed_km_s = (flying.velocity_km_s - earth.velocity_km_s).length();
        assert!((speed_km_s - 7.6127).abs() < 1e-4, "{speed_km_s}");
        assert_eq!(state(Observer::Barycentre), BarycentricState::default());
        let followed = ObserverTrack::new(Observer::Circular(orbit), at).barycentric_state(at).expect("no error");
        assert!(followed.velocity_km_s.distance(flying.velocity_km_s) < 2e-5, "three times EarthTrack's");
    }
}
