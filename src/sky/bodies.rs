//! Time -> where the Sun, the Moon and the Earth are, seen by the star sensor, km, ICRF axes.
//!
//! * [`Bodies`], for stray light and the zodiacal light: geometric positions, no light time (the Sun's 8 minutes are 20
//!   arcsec), no aberration.
//! * [`Standpoint`], for what is drawn: the states from which apparent places follow, to 0.1 arcsec of DE421.
//!
//! Both are of an [`ObserverTrack`]. Limits: an observer at the barycentre has no such sky and is refused; for one at
//! the geocentre the Earth is left out. Tests: below; `tests/physics/bodies.rs`; the Moon in [`crate::moon`].
//!
//! *Spheroids.* A direction as the observer sees it -> does it meet a body, and where: limb, point of the surface, its
//! normal.
//!
//! A body is a spheroid about its axis. Stretched along the axis until it is a sphere, straight lines stay straight, so
//! limb and surface are those of a sphere: a line meets it when it passes nearer than the radius.
//!
//! Light is taken in the body's own axes of rest, where it needs no light time: a direction seen, `u`, comes from `u -
//! b` there, `b` the observer's velocity with respect to the body over that of light (aberration to first order; what
//! is left out, b^2 / 2, is 1 mas at 30 km/s). Limits: no atmosphere, so no refraction (at the Earth's limb up to 70
//! arcmin, a few seconds of an orbit) and no dimming; no mountains. Tests: below.

use crate::{ephemeris, moon, observer::ObserverTrack, orbit, planets::Planet, state::BarycentricState};
use base::{refused::Refused, time::Tai, units::SPEED_OF_LIGHT_KM_S};
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

/// A body from where the observer is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheroid {
    /// Its present centre, km.
    pub centre_km: DVec3,
    /// Its axis, unit.
    pub axis: DVec3,
    /// Equatorial radius, km.
    pub radius_km: f64,
    /// Equatorial over polar radius.
    pub stretch: f64,
    /// The observer's velocity with respect to it, over that of light.
    pub beta: DVec3,
}

/// A point of a body's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Outward normal, unit.
    pub normal: DVec3,
    /// Cosine of the angle between the normal and the way to the observer.
    pub towards_observer: f64,
    /// Distance from the observer, km.
    pub range_km: f64,
}

impl Spheroid {
    /// Returns a body with this state for the observer: position from the body's centre and velocity with respect to
    /// it.
    pub fn seen_from(state: &BarycentricState, axis: DVec3, radius_km: f64, flattening: f64) -> Self {
        let beta = state.velocity_km_s / SPEED_OF_LIGHT_KM_S;
        Self { centre_km: -state.position_km, axis, radius_km, stretch: 1.0 / (1.0 - flattening), beta }
    }

    /// Returns a small sphere in an apparent direction (unit) and at a distance: aberration has been taken care of.
    pub fn sphere(apparent: DVec3, distance_km: f64, radius_km: f64) -> Self {
        Self { centre_km: apparent * distance_km, axis: DVec3::Z, radius_km, stretch: 1.0, beta: DVec3::ZERO }
    }

    /// Returns the angular radius of the largest circle, rad; a right angle for an observer inside.
    pub fn angular_radius_rad(&self) -> f64 {
        (self.radius_km / self.centre_km.length()).min(1.0).asin()
    }

    /// Returns where its centre is seen, unit.
    pub fn apparent_centre(&self) -> DVec3 {
        (self.centre_km.normalize() + self.beta).normalize()
    }

    /// Returns how far inside the limb a direction is, in radii by which its line passes the limb: 0 on it, 1 in the
    /// middle, negative outside. Linear in the angle near the limb.
    pub fn depth(&self, apparent: DVec3) -> f64 {
        let (u, centre_km) = (self.stretched(apparent - self.beta), self.stretched(self.centre_km));
        if u.dot(centre_km) <= 0.0 {
            return -1.0;
        }
        1.0 - (centre_km.cross(u).length_squared() / u.length_squared()).sqrt() / self.radius_km
    }

    /// Returns whether it covers everything farther away in this direction.
    pub fn hides(&self, apparent: DVec3) -> bool {
        self.depth(apparent) > 0.0
    }

    /// Returns the point of the surface seen in a direction; `None` outside the limb.
    pub fn surface(&self, apparent: DVec3) -> Option<SurfacePoint> {
        let natural = (apparent - self.beta).normalize();
        let (u, centre_km) = (self.stretched(natural), self.stretched(self.centre_km));
        let length = u.length();
        let along_km = u.dot(centre_km) / length;
        let half_chord_km2 = self.radius_km * self.radius_km - (centre_km.length_squared() - along_km * along_km);
        if along_km <= 0.0 || half_chord_km2 < 0.0 {
            return None;
        }
        let near_km = along_km - half_chord_km2.sqrt();
        if near_km < 0.0 {
            return None;
        }
        // The gradient of the spheroid's equation: stretched twice.
        let normal = self.stretched(u * (near_km / length) - centre_km).normalize();
        Some(SurfacePoint { normal, towards_observer: -normal.dot(natural), range_km: near_km / length })
    }

    fn stretched(&self, v: DVec3) -> DVec3 {
        v + self.axis * ((self.stretch - 1.0) * self.axis.dot(v))
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

#[cfg(test)]
mod spheroid_tests {
    use super::*;

    /// WGS 84.
    const RADIUS_KM: f64 = 6_378.137;
    const FLATTENING: f64 = 1.0 / 298.257_223_563;

    fn at(position_km: DVec3) -> Spheroid {
        let state = BarycentricState { position_km, velocity_km_s: DVec3::ZERO };
        Spheroid::seen_from(&state, DVec3::Z, RADIUS_KM, FLATTENING)
    }

    #[test]
    fn a_sphere_has_its_textbook_limb() {
        let sphere = Spheroid { stretch: 1.0, ..at(DVec3::X * 6_878.137) };
        let limb = (RADIUS_KM / 6_878.137_f64).asin();
        let off = |angle: f64| DVec3::new(-angle.cos(), angle.sin(), 0.0);
        assert!(sphere.hides(off(limb - 1e-9)) && !sphere.hides(off(limb + 1e-9)), "both sides of the limb");
        assert!((sphere.depth(off(0.0)) - 1.0).abs() < 1e-12 && sphere.depth(DVec3::X) == -1.0, "middle and behind");
        let below = sphere.surface(DVec3::NEG_X).expect("nadir");
        assert!((below.range_km - 500.0).abs() < 1e-9 && below.normal.distance(DVec3::X) < 1e-12);
        assert!((below.towards_observer - 1.0).abs() < 1e-12);
        assert_eq!(sphere.surface(off(limb + 1e-9)), None);
        assert!((sphere.angular_radius_rad() - limb).abs() < 1e-15);
    }

    #[test]
    fn points_are_on_the_spheroid_and_normals_are_geodetic() {
        // By the geodetic formulae: a point of latitude phi has N cos(phi), N (1 - e^2) sin(phi), normal phi.
        let e2 = FLATTENING * (2.0 - FLATTENING);
        for latitude_deg in [0.0_f64, 20.0, 45.0, 70.0, 89.0] {
            let (s, c) = latitude_deg.to_radians().sin_cos();
            let n_km = RADIUS_KM / (1.0 - e2 * s * s).sqrt();
            let point_km = DVec3::new(n_km * c, 0.0, n_km * (1.0 - e2) * s);
            let normal = DVec3::new(c, 0.0, s);
            let side = DVec3::new(-s, 0.0, c);
            let observer_km = point_km + normal * 700.0 + side * 300.0 + DVec3::Y * 200.0;
            let seen = at(observer_km).surface((point_km - observer_km).normalize()).expect("in sight");
            assert!(seen.normal.distance(normal) < 1e-11, "{latitude_deg}: {}", seen.normal);
            assert!((seen.range_km - (700_f64.powi(2) + 300_f64.powi(2) + 200_f64.powi(2)).sqrt()).abs() < 1e-8);
            let sphere = Spheroid { stretch: 1.0, ..at(observer_km) };
            let control = sphere.surface((point_km - observer_km).normalize());
            let off = control.map_or(1.0, |point| point.normal.distance(normal));
            assert!(latitude_deg == 0.0 || off > 1e-5, "control: a sphere's is another");
        }
    }

    #[test]
    fn the_pole_is_21_km_lower() {
        // Seen from far over the equator, the limb is at b / a of the distance above the pole.
        let far_km = 400_000.0;
        let spheroid = at(DVec3::X * far_km);
        let polar_km = RADIUS_KM * (1.0 - FLATTENING);
        let over_pole = |km: f64| (DVec3::new(-far_km, 0.0, km)).normalize();
        // The line touches a little before the pole: (b / d)^2 / 2 of the radius higher.
        let touch_km = polar_km / (1.0 - (RADIUS_KM / far_km).powi(2)).sqrt();
        assert!(spheroid.hides(over_pole(touch_km - 0.01)) && !spheroid.hides(over_pole(touch_km + 0.01)));
        assert!(Spheroid { stretch: 1.0, ..spheroid }.hides(over_pole(touch_km + 21.0)), "control: a sphere is higher");
    }

    #[test]
    fn a_moving_observer_sees_it_ahead() {
        let state = BarycentricState { position_km: DVec3::X * 7_000.0, velocity_km_s: DVec3::Y * 7.5 };
        let moving = Spheroid::seen_from(&state, DVec3::Z, RADIUS_KM, FLATTENING);
        let shift = moving.apparent_centre().angle_between(DVec3::NEG_X);
        assert!((shift - 7.5 / SPEED_OF_LIGHT_KM_S).abs() < 1e-9, "{shift}");
        assert!(moving.apparent_centre().y > 0.0, "towards the motion");
        let limb = (RADIUS_KM / 7_000.0_f64).asin();
        let ahead = |angle: f64| DVec3::new(-angle.cos(), angle.sin(), 0.0);
        // At the limb the shift is that of the light that comes from there: b cos(limb).
        let beta = 7.5 / SPEED_OF_LIGHT_KM_S;
        assert!(moving.hides(ahead(limb + beta * limb.cos() - 1e-8)), "aberration lifts the limb ahead");
        assert!(!moving.hides(ahead(limb + beta * limb.cos() + 1e-8)));
    }
}
