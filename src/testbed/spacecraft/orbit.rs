//! A circular two-body orbit: seconds since its epoch -> place and velocity, ICRF.
//!
//! No precession of the node, no drag: a day's run moves the true node by a few degrees, which changes no answer that
//! this simulator is asked. The Earth's pole is taken as ICRF's (0.14 degrees off in 2026).
//!
//! The Sun: an instant -> its direction from the Earth, ICRF; and a coarse sun sensor.
//!
//! Low-precision formula of the Astronomical Almanac (section C, "Low precision formulas for the Sun"): apparent
//! longitude of date within 0.01 degrees from 1950 to 2050. `Differs:` precession is taken out of the longitude (Lieske
//! et al. 1977, Astron. Astrophys. 58, 1: 5029.0966 arcsec per Julian century) to reach the axes of J2000.0; the
//! ecliptic's own motion of 47 arcsec per century is left in. Annual aberration (20 arcsec) is contained.

use crate::{noise::Gaussian, spacecraft::params::CircularOrbitParams};
use base::axes::{Body, Icrf, Rotation};
use base::{time::Tai, units::DEG};
use glam::DVec3;

/// `GM` of the Earth, m^3/s^2 (IERS Conventions 2010, table 1.1, TT-compatible value).
pub(super) const EARTH_GM_M3_S2: f64 = 3.986_004_415e14;
/// Equatorial radius of the Earth, m (IERS Conventions 2010, table 1.1).
pub(super) const EARTH_RADIUS_M: f64 = 6_378_136.6;

/// A circular orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircularOrbit {
    epoch: Tai,
    radius_m: f64,
    rate_rad_s: f64,
    argument_rad: f64,
    /// Towards the ascending node.
    node: DVec3,
    /// A quarter of an orbit later.
    quarter: DVec3,
}

impl CircularOrbit {
    /// Returns the orbit of `params`.
    pub fn new(params: &CircularOrbitParams) -> Self {
        let radius_m = EARTH_RADIUS_M + params.altitude_m;
        let (sin_node, cos_node) = params.raan_rad.sin_cos();
        let (sin_i, cos_i) = params.inclination_rad.sin_cos();
        Self {
            epoch: params.epoch,
            radius_m,
            rate_rad_s: (EARTH_GM_M3_S2 / radius_m.powi(3)).sqrt(),
            argument_rad: params.argument_of_latitude_rad,
            node: DVec3::new(cos_node, sin_node, 0.0),
            quarter: DVec3::new(-sin_node * cos_i, cos_node * cos_i, sin_i),
        }
    }

    /// Returns the place with respect to the Earth's centre, ICRF, m.
    pub fn position_m(&self, at: Tai) -> DVec3 {
        self.radial((at - self.epoch).s()) * self.radius_m
    }

    /// Returns the velocity with respect to the Earth's centre, ICRF, m/s: the small part of aberration.
    pub fn velocity_m_s(&self, at: Tai) -> DVec3 {
        let (sin, cos) = self.argument((at - self.epoch).s()).sin_cos();
        (self.quarter * cos - self.node * sin) * (self.radius_m * self.rate_rad_s)
    }

    /// Returns the angular rate of the orbit, rad/s.
    pub fn rate_rad_s(&self) -> f64 {
        self.rate_rad_s
    }

    /// Returns false inside the Earth's shadow, taken as a cylinder away from the Sun (unit vector, ICRF). The penumbra
    /// of a low orbit lasts some ten seconds.
    pub fn is_sunlit(&self, at: Tai, sun_icrf: DVec3) -> bool {
        let position_m = self.position_m(at);
        let along_m = position_m.dot(sun_icrf);
        along_m > 0.0 || (position_m - sun_icrf * along_m).length() > EARTH_RADIUS_M
    }

    /// Returns the unit vector away from the Earth's centre, `t_s` after the epoch.
    pub(super) fn radial(&self, t_s: f64) -> DVec3 {
        let (sin, cos) = self.argument(t_s).sin_cos();
        self.node * cos + self.quarter * sin
    }

    /// Returns `mu / r^3`, 1/s^2.
    pub(super) fn rate_squared(&self) -> f64 {
        self.rate_rad_s * self.rate_rad_s
    }

    fn argument(&self, t_s: f64) -> f64 {
        self.argument_rad + self.rate_rad_s * t_s
    }
}

/// General precession in longitude, degrees per day.
const PRECESSION_DEG_D: f64 = 5029.0966 / 3600.0 / 36_525.0;
/// Mean obliquity of the ecliptic at J2000.0, degrees (the formula's own).
const OBLIQUITY_J2000_DEG: f64 = 23.439;

/// Returns the unit vector from the Earth to the Sun, ICRF; error below 0.02 degrees from 1950 to 2050.
pub fn sun_direction_icrf(at: Tai) -> DVec3 {
    let n = at.days_tdb_since_j2000();
    let longitude = (apparent_longitude_deg(n) - PRECESSION_DEG_D * n) * DEG;
    let (sin, cos) = longitude.sin_cos();
    let (sin_obliquity, cos_obliquity) = (OBLIQUITY_J2000_DEG * DEG).sin_cos();
    DVec3::new(cos, cos_obliquity * sin, sin_obliquity * sin)
}

/// Returns the apparent ecliptic longitude of date, degrees, `n` days after J2000.0.
fn apparent_longitude_deg(n: f64) -> f64 {
    let mean_longitude = 280.460 + 0.985_647_4 * n;
    let anomaly = (357.528 + 0.985_600_3 * n) * DEG;
    mean_longitude + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin()
}

/// Reading of a sun sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunReading {
    /// Unit vector to the Sun, body axes.
    pub direction_body: DVec3,
    /// The Sun was seen.
    pub valid: bool,
}

/// A coarse sun sensor that sees all directions.
#[derive(Debug)]
pub struct SunSensor {
    noise_rad: f64,
    noise: Gaussian,
}

impl SunSensor {
    /// Returns the noise `noise_rad` is 1 sigma per axis.
    pub fn new(noise_rad: f64, seed: u64) -> Self {
        Self { noise_rad, noise: Gaussian::new(seed) }
    }

    /// Returns the Sun at `sun_icrf` (unit vector) from a body with this attitude. Draws the same numbers in shadow.
    pub fn measure(&mut self, body_from_icrf: &Rotation<Body, Icrf>, sun_icrf: DVec3, is_sunlit: bool) -> SunReading {
        let noisy = body_from_icrf.apply(sun_icrf) + self.noise.vector(self.noise_rad);
        let direction_body = if is_sunlit { noisy.normalize_or_zero() } else { DVec3::ZERO };
        SunReading { direction_body, valid: is_sunlit && direction_body != DVec3::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;
    use core::f64::consts::{FRAC_PI_2, PI};

    const EPOCH: Tai = Tai::from_ns(1_700_000_000_000_000_000);

    fn orbit(inclination_rad: f64, raan_rad: f64) -> CircularOrbit {
        CircularOrbit::new(&CircularOrbitParams {
            epoch: EPOCH,
            altitude_m: 600e3,
            inclination_rad,
            raan_rad,
            argument_of_latitude_rad: 0.0,
        })
    }

    #[test]
    fn speed_and_period_are_those_of_600_km() {
        let orbit = orbit(1.7, 0.4);
        // sqrt(398600.44 / 6978.14) km/s and 2 pi 6978.14 / 7.55787 s.
        assert!((orbit.velocity_m_s(EPOCH).length() - 7557.87).abs() < 0.1, "{}", orbit.velocity_m_s(EPOCH));
        assert!((2.0 * PI / orbit.rate_rad_s() - 5801.2).abs() < 0.5, "{} s", 2.0 * PI / orbit.rate_rad_s());
    }

    #[test]
    fn velocity_is_the_derivative_of_the_place_and_the_node_is_where_it_rises() {
        let orbit = orbit(1.0, 0.4);
        let (step, later) = (Span::from_ms(10), EPOCH + Span::from_s(1234.5));
        let slope = (orbit.position_m(later + step) - orbit.position_m(later - step)) / (2.0 * step.s());
        // Rounding of 7e6 m over 20 ms: 1e-7 m/s; curvature 8 m/s^2 rate^2 step^2 / 6: less.
        assert!((slope - orbit.velocity_m_s(later)).length() < 1e-6, "{slope}");
        assert!((orbit.position_m(EPOCH).normalize() - DVec3::new(0.4f64.cos(), 0.4f64.sin(), 0.0)).length() < 1e-15);
        assert!(orbit.velocity_m_s(EPOCH).z > 0.0, "ascending");
        let normal = orbit.position_m(later).cross(orbit.velocity_m_s(later)).normalize();
        assert!((normal.z - 1.0f64.cos()).abs() < 1e-12, "inclination");
    }

    #[test]
    fn shadow_is_behind_the_earth_only() {
        let orbit = orbit(0.0, 0.0);
        assert!(orbit.is_sunlit(EPOCH, DVec3::X), "noon");
        assert!(!orbit.is_sunlit(EPOCH, DVec3::NEG_X), "midnight");
        assert!(orbit.is_sunlit(EPOCH, DVec3::Z), "terminator");
        let quarter = EPOCH + Span::from_s(FRAC_PI_2 / orbit.rate_rad_s() + 60.0);
        assert!(orbit.is_sunlit(quarter, DVec3::X), "behind the terminator but beside the shadow");
    }
}

#[cfg(test)]
mod sun_tests {
    use super::*;

    /// 0.01 degrees of the formula, 0.0057 of aberration (the published place is geometric), 0.0034 of the ecliptic's
    /// motion over a quarter of a century.
    const FORMULA_RAD: f64 = 0.019 * DEG;

    #[test]
    fn meeus_example_26b() {
        // Meeus, Astronomical Algorithms (2nd ed. 1998), example 26.b: 1992 October 13.0 TD, axes of FK5 J2000.0.
        // TD - TAI = 32.184 s and TAI - UTC = 27 s.
        let at = Tai::from_rfc3339("1992-10-12T23:59:00.816Z").expect("a valid instant");
        let published = DVec3::new(-0.937_396_91, -0.313_167_93, -0.135_779_24).normalize();
        let angle = sun_direction_icrf(at).angle_between(published);
        assert!(angle < FORMULA_RAD, "{} deg", angle / DEG);
        let wrong = DVec3::new(-0.937_995_2, -0.311_654_4, -0.135_121_5).normalize();
        let angle = sun_direction_icrf(at).angle_between(wrong);
        assert!(angle > 4.0 * FORMULA_RAD, "negative control, the same of date (example 26.a): {} deg", angle / DEG);
    }

    #[test]
    fn the_equinox_of_march_2026() {
        // US Naval Observatory: 2026 March 20, 14:46 UT; the Sun moves 0.01 degrees in 15 minutes.
        let at = Tai::from_rfc3339("2026-03-20T14:46:00Z").expect("a valid instant");
        let longitude = (apparent_longitude_deg(at.days_tdb_since_j2000()) + 180.0).rem_euclid(360.0) - 180.0;
        assert!(longitude.abs() < 0.01, "{longitude} deg");
    }

    #[test]
    fn noise_is_as_asked_and_shadow_is_reported() {
        let (sigma, draws) = (0.01, 4000);
        let mut sensor = SunSensor::new(sigma, 5);
        let attitude = Rotation::IDENTITY.rotated_by(DVec3::new(0.3, -0.2, 0.9));
        let truth = attitude.apply(DVec3::X);
        let mut squares = 0.0;
        for _ in 0..draws {
            let reading = sensor.measure(&attitude, DVec3::X, true);
            assert!(reading.valid);
            squares += reading.direction_body.angle_between(truth).powi(2);
        }
        // Two axes: chi-square with 8000 degrees of freedom; 4 sigma, false alarm 6e-5, once for the fixed seed.
        let ratio = squares / (2.0 * sigma * sigma * f64::from(draws));
        assert!((ratio - 1.0).abs() < 4.0 * (2.0f64 / 8000.0).sqrt(), "{ratio}");
        assert!(!sensor.measure(&attitude, DVec3::X, false).valid);
    }
}
