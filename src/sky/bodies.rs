//! Time -> where the Sun, the Moon and the Earth stand, seen by the star sensor, km, ICRF axes.
//!
//! For stray light and the zodiacal light: geometric positions, no light time (the Sun's 8 minutes are 20 arcsec), no
//! aberration. The Sun's barycentric position is VSOP87E's, evaluated once a day and followed by the Earth's track.
//! Limits: an observer at the barycentre has no such sky and is refused; for one at the geocentre there is no Earth.
//! Tests: below; the Moon in [`crate::sky::moon`].

use crate::base::time::Tai;
use crate::sky::ObserverError;
use crate::sky::earth::{self, EarthTrack};
use crate::sky::moon;
use crate::sky::observer::Observer;
use glam::DVec3;

/// Positions from the observer, ICRF axes, km.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bodies {
    /// The Sun's centre.
    pub sun_km: DVec3,
    /// The Moon's centre.
    pub moon_km: DVec3,
    /// The Earth's centre; `None` when the observer is there.
    pub earth_km: Option<DVec3>,
}

/// The bodies followed from frame to frame. After start it allocates nothing; a new day evaluates the Sun's and the
/// Earth's series (about 5 ms).
#[derive(Debug, Clone)]
pub struct BodiesTrack {
    observer: Observer,
    earth: EarthTrack,
    sun: Option<(f64, DVec3)>,
}

impl BodiesTrack {
    /// Follows what `observer` sees, ready for the day of `at`.
    #[must_use]
    pub fn new(observer: Observer, at: Tai) -> Self {
        let mut track = Self { observer, earth: EarthTrack::new(at), sun: None };
        track.sun_km(at);
        track
    }

    /// Where the bodies stand at `at`; depends on the time only.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`, or the observer is at the barycentre.
    pub fn at(&mut self, at: Tai) -> Result<Bodies, ObserverError> {
        let observer_km = self.observer.geocentric_state(at)?.ok_or(ObserverError::NoBodies)?.position_km;
        let earth_km = self.earth.barycentric_state(at).position_km;
        let is_there = matches!(self.observer, Observer::Geocentre);
        Ok(Bodies {
            sun_km: self.sun_km(at) - earth_km - observer_km,
            moon_km: moon::geocentric_km(at) - observer_km,
            earth_km: (!is_there).then_some(-observer_km),
        })
    }

    /// Barycentric position of the Sun's centre at noon of the day (it moves by 1100 km a day: 1.5 arcsec).
    fn sun_km(&mut self, at: Tai) -> DVec3 {
        let day = at.days_tdb_since_j2000().floor();
        match self.sun {
            Some((of, sun_km)) if of == day => sun_km,
            _ => {
                let sun_km = earth::sun_position_km(day + 0.5);
                self.sun = Some((day, sun_km));
                sun_km
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::{AU_KM, DEG};
    use crate::sky::orbit::CircularOrbit;

    fn at(text: &str) -> Tai {
        Tai::from_rfc3339(text).expect("a valid instant")
    }

    #[test]
    fn the_sun_stands_where_the_almanac_says() {
        // March equinox 2026-03-20 14:46 UTC (apparent longitude 0: aberration 20.5 arcsec ahead of the geometric one),
        // perihelion 2026-01-03 17:16 UTC at 0.983 30 au (Astronomical Almanac 2026).
        let equinox = at("2026-03-20T14:46:00Z");
        let sun = BodiesTrack::new(Observer::Geocentre, equinox).at(equinox).expect("a sky").sun_km;
        // Precession since 2000 has moved the equinox by 0.365 deg.
        assert!((sun.y.atan2(sun.x) / DEG + 0.335).abs() < 0.02, "{}", sun.y.atan2(sun.x) / DEG);
        let perihelion = at("2026-01-03T17:16:00Z");
        let sun = BodiesTrack::new(Observer::Geocentre, perihelion).at(perihelion).expect("a sky").sun_km;
        assert!((sun.length() / AU_KM - 0.983_30).abs() < 2e-5, "{}", sun.length() / AU_KM);
    }

    #[test]
    fn an_eclipse_lines_up_sun_and_moon() {
        // Greatest eclipse 2026-08-12 17:46 UTC, gamma 0.898 (NASA eclipse catalogue): the axis of the shadow passes the
        // geocentre at 0.898 Earth radii, so the angle seen from there is near 0.9 x 0.95 deg.
        let eclipse = at("2026-08-12T17:46:00Z");
        let bodies = BodiesTrack::new(Observer::Geocentre, eclipse).at(eclipse).expect("a sky");
        let moon = bodies.moon_km;
        let axis = (moon - bodies.sun_km).normalize();
        let gamma = moon.cross(axis).length() / 6_378.137;
        assert!((gamma - 0.898).abs() < 0.02, "{gamma}");
        assert_eq!(bodies.earth_km, None, "an observer inside the Earth sees none");
    }

    #[test]
    fn the_earth_is_below_an_orbit_and_nobody_is_at_the_barycentre() {
        let now = at("2026-03-01T12:00:00Z");
        let orbit = CircularOrbit::new(500.0, 97.4, 30.0, 10.0, now).expect("a valid orbit");
        let bodies = BodiesTrack::new(Observer::Circular(orbit), now).at(now).expect("a sky");
        let earth_km = bodies.earth_km.expect("below");
        assert!((earth_km.length() - 6_878.137).abs() < 0.5, "{}", earth_km.length());
        assert!(earth_km.distance(-orbit.geocentric_state(now).position_km) < 0.5, "nadir");
        assert!(BodiesTrack::new(Observer::Barycentre, now).at(now).is_err());
    }
}
