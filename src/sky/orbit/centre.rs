//! The bodies that something may be in orbit about, and a circular orbit, for benches without real elements.
//!
//! Axes of the orbit: equator and equinox J2000, taken as ICRF (25 mas). Limits: no oblateness, so the node does not
//! regress (up to 8 degrees per day in low orbit) and no drag: a stand-in for an orbit's geometry, not for a given
//! spacecraft.

use crate::{moon, state::BarycentricState};
use base::{refused::Refused, time::Tai, units::DEG};
use core::{f64::consts::TAU, fmt};
use glam::DVec3;

/// Geocentric gravitational constant, km^3/s^2 (IERS Conventions 2010, table 1.1).
pub const EARTH_GM_KM3_S2: f64 = 398_600.441_8;
/// Gravitational constant of the Moon, km^3/s^2 (DE440; Park et al. 2021, AJ 161, 105, table 2).
pub const MOON_GM_KM3_S2: f64 = 4_902.800_118;
/// Heliocentric gravitational constant, km^3/s^2 (DE440, ibid.).
pub const SUN_GM_KM3_S2: f64 = 132_712_440_041.279_42;

/// Central body of an orbit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CentralBody {
    /// The Earth's centre.
    Earth,
    /// The Moon's centre.
    Moon,
    /// The Sun's centre.
    Sun,
}

impl CentralBody {
    /// Returns the gravitational parameter, km^3/s^2.
    pub fn gm_km3_s2(self) -> f64 {
        match self {
            Self::Earth => EARTH_GM_KM3_S2,
            Self::Moon => MOON_GM_KM3_S2,
            Self::Sun => SUN_GM_KM3_S2,
        }
    }

    /// Returns the distance from the centre below which nothing can orbit, km: the Earth's polar radius (WGS 84), the
    /// Moon's mean radius, the Sun's nominal radius (IAU 2015 Resolution B3).
    pub fn surface_km(self) -> f64 {
        match self {
            Self::Earth => 6_356.752,
            Self::Moon => moon::RADIUS_KM,
            Self::Sun => 695_700.0,
        }
    }
}

impl CentralBody {
    /// Returns a speed above that of all that passes the body, km/s: of the Earth and the Moon that of the fastest bodies
    /// of the solar system, 72 km/s, and more; of the Sun the escape from its surface, 618 km/s, and more.
    pub fn fastest_km_s(self) -> f64 {
        match self {
            Self::Earth | Self::Moon => 100.0,
            Self::Sun => 1_000.0,
        }
    }
}

impl fmt::Display for CentralBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Earth => "the Earth",
            Self::Moon => "the Moon",
            Self::Sun => "the Sun",
        })
    }
}

/// Equatorial radius of the Earth, km (WGS 84).
const EARTH_RADIUS_KM: f64 = 6_378.137;
/// Highest orbit accepted, km: beyond it the Moon rules.
const HIGHEST_ALTITUDE_KM: f64 = 400_000.0;

/// A circular orbit about the Earth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircularOrbit {
    radius_km: f64,
    rate_rad_s: f64,
    latitude_argument_rad: f64,
    epoch: Tai,
    towards_node: DVec3,
    a_quarter_later: DVec3,
}

impl CircularOrbit {
    /// Returns an orbit at `altitude_km` above the equatorial radius that is `latitude_argument_deg` past its ascending
    /// node at `epoch`.
    ///
    /// # Errors
    /// When the altitude is outside 100..400000 km or an angle is not a finite number in -360..360 (inclination
    /// 0..180).
    pub fn new(
        altitude_km: f64,
        inclination_deg: f64,
        raan_deg: f64,
        latitude_argument_deg: f64,
        epoch: Tai,
    ) -> Result<Self, Refused> {
        check("altitude_km", "100..400000", altitude_km, 100.0, HIGHEST_ALTITUDE_KM)?;
        check("inclination_deg", "0..180", inclination_deg, 0.0, 180.0)?;
        check("raan_deg", "-360..360", raan_deg, -360.0, 360.0)?;
        check("latitude_argument_deg", "-360..360", latitude_argument_deg, -360.0, 360.0)?;
        let radius_km = EARTH_RADIUS_KM + altitude_km;
        let (sin_node, cos_node) = (raan_deg * DEG).sin_cos();
        let (sin_i, cos_i) = (inclination_deg * DEG).sin_cos();
        Ok(Self {
            radius_km,
            rate_rad_s: (EARTH_GM_KM3_S2 / radius_km.powi(3)).sqrt(),
            latitude_argument_rad: latitude_argument_deg * DEG,
            epoch,
            towards_node: DVec3::new(cos_node, sin_node, 0.0),
            a_quarter_later: DVec3::new(-sin_node * cos_i, cos_node * cos_i, sin_i),
        })
    }

    /// Returns the state from the geocentre at `at`.
    pub fn geocentric_state(&self, at: Tai) -> BarycentricState {
        let turned_rad = (self.rate_rad_s * (at - self.epoch).s()).rem_euclid(TAU);
        let (sin_u, cos_u) = (self.latitude_argument_rad + turned_rad).sin_cos();
        let outward = self.towards_node * cos_u + self.a_quarter_later * sin_u;
        let forward = self.a_quarter_later * cos_u - self.towards_node * sin_u;
        BarycentricState {
            position_km: outward * self.radius_km,
            velocity_km_s: forward * (self.radius_km * self.rate_rad_s),
        }
    }

    /// Returns the time for one revolution, s.
    pub fn period_s(&self) -> f64 {
        TAU / self.rate_rad_s
    }
}

fn check(parameter: &'static str, wanted: &'static str, got: f64, low: f64, high: f64) -> Result<(), Refused> {
    if (low..=high).contains(&got) {
        Ok(())
    } else {
        Err(Refused(format!("circular orbit: {parameter} wanted {wanted}, got {got}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;

    fn low_orbit() -> CircularOrbit {
        let epoch = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant");
        CircularOrbit::new(500.0, 97.4, 30.0, 10.0, epoch).expect("a valid orbit")
    }

    #[test]
    fn speed_and_period_are_those_of_the_textbook() {
        // v = sqrt(GM / a) = 7.6127 km/s and 94.6 min at 500 km (Vallado, Fundamentals of Astrodynamics, ch. 1).
        let orbit = low_orbit();
        let state = orbit.geocentric_state(orbit.epoch);
        assert!((state.velocity_km_s.length() - 7.6127).abs() < 1e-4, "{} km/s", state.velocity_km_s.length());
        assert!((orbit.period_s() / 60.0 - 94.6).abs() < 0.05, "{} min", orbit.period_s() / 60.0);
    }

    #[test]
    fn velocity_is_the_rate_of_position_and_the_plane_is_inclined() {
        let orbit = low_orbit();
        let at = orbit.epoch + Span::from_s(1000.0);
        let half = Span::from_ms(500);
        let [a, b] = [orbit.geocentric_state(at - half), orbit.geocentric_state(at + half)];
        let state = orbit.geocentric_state(at);
        // Central difference over 1 s: (n h)^2 / 6 of 7.6 km/s with n = 1.1e-3 rad/s is 4e-7 km/s.
        assert!((b.position_km - a.position_km - state.velocity_km_s).length() < 1e-6);
        let normal = state.position_km.cross(state.velocity_km_s).normalize();
        assert!((normal.z.acos() / DEG - 97.4).abs() < 1e-9, "{}", normal.z.acos() / DEG);
    }

    #[test]
    fn bad_parameters_are_named() {
        let epoch = Tai::from_ns(0);
        let low = CircularOrbit::new(10.0, 0.0, 0.0, 0.0, epoch).expect_err("inside the air").to_string();
        assert!(low.contains("altitude_km") && low.contains("100..400000") && low.contains("10"), "{low}");
        assert!(CircularOrbit::new(500.0, f64::NAN, 0.0, 0.0, epoch).is_err(), "NaN is not an angle");
    }
}
