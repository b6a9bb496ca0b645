//! Velocity of the observer -> apparent directions; time -> velocity of the Earth.
//!
//! Aberration: the relativistic addition of velocities (Urban & Seidelmann, *Explanatory Supplement to the
//! Astronomical Almanac*, 3rd ed. 2013, eq. 7.38), complete, so its own error is rounding. Earth: the low-precision Sun
//! of the *Astronomical Almanac*, section C ("low precision formulas for the Sun", 0.01 deg in 1950..2050), with the
//! longitude carried back from the equinox of date to J2000.0 and differentiated. Left out: the Sun about the
//! barycentre (13 m/s), the Earth about the Earth-Moon barycentre (12 m/s), together below 0.02 arcsec; light
//! deflection (4 mas at 90 degrees from the Sun). Test: `earth_velocity_gives_the_published_aberration`.

use base::time::Tai;
use base::units::{AU_KM, DAY_S, DEG, SPEED_OF_LIGHT_KM_S};
use glam::DVec3;

/// General precession in longitude, deg per day: 50.2880 arcsec per Julian year (IAU 2006, Capitaine et al. 2003).
const PRECESSION_DEG_D: f64 = 50.2880 / 3600.0 / 365.25;
/// Obliquity of the ecliptic at J2000.0, deg (IAU 2006: 84381.406 arcsec).
const OBLIQUITY_DEG: f64 = 84381.406 / 3600.0;

/// Returns the apparent unit direction (ICRF axes) of a unit direction, for an observer with the velocity `beta` = v/c
/// (ICRF axes, with respect to the barycentre).
pub fn apparent(direction: DVec3, beta: DVec3) -> DVec3 {
    let inverse_lorentz = (1.0 - beta.length_squared()).max(0.0).sqrt();
    let along = direction.dot(beta);
    let sum = direction * inverse_lorentz + beta * (1.0 + along / (1.0 + inverse_lorentz));
    (sum / (1.0 + along)).normalize()
}

/// Returns the error, about x and y of the sensor, of an attitude that knows nothing of aberration; `beta` in sensor axes.
/// Directions near the boresight move by `beta` across it, and the frame that holds them fixed turns the other way.
pub fn uncorrected_turn(beta: DVec3) -> DVec3 {
    DVec3::new(beta.y, -beta.x, 0.0)
}

/// Returns the velocity of the Earth's centre about the Sun over the speed of light, ICRF axes; error below 0.1 arcsec
/// (5e-7).
pub fn earth_beta(at: Tai) -> DVec3 {
    let days = at.days_tdb_since_j2000();
    let anomaly_rate = 0.985_600_3 * DEG;
    let anomaly = 357.528 * DEG + anomaly_rate * days;
    let mean_longitude = 280.460 + (0.985_647_4 - PRECESSION_DEG_D) * days;
    let (sin_g, cos_g) = anomaly.sin_cos();
    let (sin_2g, cos_2g) = (2.0 * anomaly).sin_cos();
    let longitude = (mean_longitude + 1.915 * sin_g + 0.020 * sin_2g) * DEG;
    let longitude_rate = (0.985_647_4 - PRECESSION_DEG_D) * DEG + (1.915 * cos_g + 0.040 * cos_2g) * DEG * anomaly_rate;
    let radius_au = 1.000_14 - 0.016_71 * cos_g - 0.000_14 * cos_2g;
    let radius_rate = (0.016_71 * sin_g + 0.000_28 * sin_2g) * anomaly_rate;
    // The Earth is opposite the Sun.
    let (sin_l, cos_l) = longitude.sin_cos();
    let velocity_au_d = -DVec3::new(
        radius_rate * cos_l - radius_au * longitude_rate * sin_l,
        radius_rate * sin_l + radius_au * longitude_rate * cos_l,
        0.0,
    );
    let (sin_e, cos_e) = (OBLIQUITY_DEG * DEG).sin_cos();
    let equatorial = DVec3::new(velocity_au_d.x, velocity_au_d.y * cos_e, velocity_au_d.y * sin_e);
    equatorial * (AU_KM / DAY_S / SPEED_OF_LIGHT_KM_S)
}
