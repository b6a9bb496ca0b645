//! The Sun: an instant -> its direction from the Earth, ICRF; and a coarse sun sensor.
//!
//! Low-precision formula of the Astronomical Almanac (section C, "Low precision formulas for the Sun"): apparent
//! longitude of date within 0.01 degrees from 1950 to 2050. `Differs:` precession is taken out of the longitude (Lieske
//! et al. 1977, Astron. Astrophys. 58, 1: 5029.0966 arcsec per Julian century) to reach the axes of J2000.0; the
//! ecliptic's own motion of 47 arcsec per century is left in. Annual aberration (20 arcsec) is contained.

use crate::noise::Gaussian;
use base::axes::{Body, Icrf, Rotation};
use base::{time::Tai, units::DEG};
use glam::DVec3;

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
