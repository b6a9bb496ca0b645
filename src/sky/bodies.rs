//! Time -> where the Sun, the Moon and the Earth are, seen by the star sensor, km, ICRF axes.
//!
//! * [`Bodies`], for stray light and the zodiacal light: geometric positions, no light time (the Sun's 8 minutes are 20
//!   arcsec), no aberration.
//! * [`Standpoint`], for what is drawn: the states from which apparent places follow, to 0.1 arcsec of DE421.
//!
//! Both are of an [`ObserverTrack`]. Limits: an observer at the barycentre has no such sky and is refused; for one at
//! the geocentre the Earth is left out. Tests: below; `tests/physics/bodies.rs`; the Moon in [`crate::moon`].

use crate::{ephemeris, moon, orbit};
use crate::{observer::ObserverTrack, planets::Planet, spheroid::Spheroid, state::BarycentricState};
use base::{refused::Refused, time::Tai};
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

/// Equatorial radius of the Earth, km, and its flattening (WGS 84).
pub const EARTH_RADIUS_KM: f64 = 6_378.137;
const EARTH_FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Radius of the Sun, km (IAU 2015 Resolution B3).
pub const SUN_RADIUS_KM: f64 = 695_700.0;

/// Place of the observer among the bodies, at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standpoint {
    /// When.
    pub at: Tai,
    /// The observer from the barycentre: its velocity makes the aberration of stars, planets and the Sun.
    pub observer: BarycentricState,
    /// The observer from the Sun's centre, km.
    pub from_sun_km: DVec3,
    /// The observer from the geocentre.
    pub from_earth: BarycentricState,
    /// The observer from the Moon's centre.
    pub from_moon: BarycentricState,
    /// The Earth's axis: mean of date, ICRF.
    pub earth_axis: DVec3,
    /// Planets from the Sun where their light left, in the order of [`Planet::ALL`], km.
    pub planets_from_sun_km: [DVec3; Planet::ALL.len()],
}

impl Standpoint {
    /// Returns the Earth's surface (WGS 84 ellipsoid); `None` for an observer below it.
    pub fn earth(&self) -> Option<Spheroid> {
        let is_outside = self.from_earth.position_km.length() > EARTH_RADIUS_KM;
        is_outside.then(|| Spheroid::seen_from(&self.from_earth, self.earth_axis, EARTH_RADIUS_KM, EARTH_FLATTENING))
    }

    /// Returns the Moon's surface (a sphere); `None` for an observer below it.
    pub fn moon(&self) -> Option<Spheroid> {
        let is_outside = self.from_moon.position_km.length() > moon::RADIUS_KM;
        is_outside.then(|| Spheroid::seen_from(&self.from_moon, DVec3::Z, moon::RADIUS_KM, 0.0))
    }

    /// Returns a planet where its light left: from the Sun and from the observer, km. The aberration of stars is still
    /// to come.
    pub fn planet_km(&self, planet: Planet) -> [DVec3; 2] {
        let from_sun_km = self.planets_from_sun_km[planet as usize];
        [from_sun_km, from_sun_km - self.from_sun_km]
    }
}

impl ObserverTrack {
    /// Returns where the bodies are at `at`; depends on the time only. Does not allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`, or the observer is at the barycentre.
    pub fn bodies(&self, at: Tai) -> Result<Bodies, Refused> {
        let observer_km = self
            .geocentric_state(at)?
            .ok_or_else(|| {
                Refused(
                    "Sun, Moon and Earth: wanted an observer near the Earth, got one at rest at the barycentre"
                        .to_owned(),
                )
            })?
            .position_km;
        let from_barycentre_km = self.barycentric_state(at)?.position_km;
        let is_there = self.is_geocentre();
        Ok(Bodies {
            sun_km: self.sun_state(at).position_km - from_barycentre_km,
            moon_km: moon::geocentric_km(at) - observer_km,
            earth_km: (!is_there).then_some(-observer_km),
        })
    }

    /// Returns the place and motion of the observer at `at`, likewise.
    ///
    /// # Errors
    /// As for [`Self::bodies`], and when the ephemeris table is damaged.
    pub fn standpoint(&self, at: Tai) -> Result<Standpoint, Refused> {
        ephemeris::check().map_err(Refused::of)?;
        let from_earth = self.geocentric_state(at)?.ok_or_else(|| {
            Refused(
                "Sun, Moon and Earth: wanted an observer near the Earth, got one at rest at the barycentre".to_owned(),
            )
        })?;
        let observer = self.barycentric_state(at)?;
        let from_sun_km = observer.position_km - self.sun_state(at).position_km;
        Ok(Standpoint {
            at,
            observer,
            from_sun_km,
            from_earth,
            from_moon: from_earth - moon::geocentric_state(at),
            earth_axis: orbit::icrf_from_mean_of_date(at) * DVec3::Z,
            planets_from_sun_km: Planet::ALL.map(|planet| planet.light_left_km(at, from_sun_km, &self.almanac)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{observer::Observer, orbit::CircularOrbit};
    use base::units::{AU_KM, DEG};

    fn at(text: &str) -> Tai {
        Tai::from_rfc3339(text).expect("a valid instant")
    }

    #[test]
    fn the_sun_lies_where_the_almanac_says() {
        // March equinox 2026-03-20 14:46 UTC (apparent longitude 0: aberration 20.5 arcsec ahead of the geometric one),
        // perihelion 2026-01-03 17:16 UTC at 0.983 30 au (Astronomical Almanac 2026).
        let equinox = at("2026-03-20T14:46:00Z");
        let sun = ObserverTrack::new(Observer::Geocentre, equinox).bodies(equinox).expect("a sky").sun_km;
        // Precession since 2000 has moved the equinox by 0.365 deg.
        assert!((sun.y.atan2(sun.x) / DEG + 0.335).abs() < 0.02, "{}", sun.y.atan2(sun.x) / DEG);
        let perihelion = at("2026-01-03T17:16:00Z");
        let sun = ObserverTrack::new(Observer::Geocentre, perihelion).bodies(perihelion).expect("a sky").sun_km;
        assert!((sun.length() / AU_KM - 0.983_30).abs() < 2e-5, "{}", sun.length() / AU_KM);
    }

    #[test]
    fn an_eclipse_lines_up_sun_and_moon() {
        // Greatest eclipse 2026-08-12 17:46 UTC, gamma 0.898 (NASA eclipse catalogue): the axis of the shadow passes
        // the geocentre at 0.898 Earth radii, so the angle seen from there is near 0.9 x 0.95 deg.
        let eclipse = at("2026-08-12T17:46:00Z");
        let bodies = ObserverTrack::new(Observer::Geocentre, eclipse).bodies(eclipse).expect("a sky");
        let moon = bodies.moon_km;
        let axis = (moon - bodies.sun_km).normalize();
        let gamma = moon.cross(axis).length() / 6_378.137;
        assert!((gamma - 0.898).abs() < 0.02, "{gamma}");
        assert_eq!(bodies.earth_km, None, "an observer inside the Earth sees none");
    }

    #[test]
    fn the_earth_is_below_an_orbit_and_no_one_is_at_the_barycentre() {
        let now = at("2026-03-01T12:00:00Z");
        let orbit = CircularOrbit::new(500.0, 97.4, 30.0, 10.0, now).expect("a valid orbit");
        let bodies = ObserverTrack::new(Observer::Circular(orbit), now).bodies(now).expect("a sky");
        let earth_km = bodies.earth_km.expect("below");
        assert!((earth_km.length() - 6_878.137).abs() < 0.5, "{}", earth_km.length());
        assert!(earth_km.distance(-orbit.geocentric_state(now).position_km) < 0.5, "nadir");
        assert!(ObserverTrack::new(Observer::Barycentre, now).bodies(now).is_err());
    }
}
