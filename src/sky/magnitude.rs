//! Distances and phase angle -> apparent magnitude V of the Moon and of a planet.
//!
//! * Planets: Mallama and Hilton 2018, Astronomy and Computing 25, 10 (the Astronomical Almanac's), without the turning
//!   of Mars (0.06 mag), the seasons of Mars (0.06 mag) and the latitudes of Uranus (0.07 mag). Saturn with its rings.
//! * Moon: -12.74 at full and mean distance (Allen's Astrophysical Quantities, 4th ed.), fainter by `0.026 |a| + 4e-9 a^4`
//!   at phase angle `a`, deg (Krisciunas and Schaefer 1991, PASP 103, 1033, eq. 9). No eclipses, no Earthshine.
//!
//! Beyond the phase angles that were measured the polynomials are held at their last one ([`most_phase_deg`]). Colours:
//! all are lit by the Sun and taken to have its colour ([`SUN_BP_RP`]): G is V - 0.15. The red of Mars (B-V 1.43 for
//! the Sun's 0.65) is worth -0.3 mag in G. Tests: `tests/physics/bodies.rs`, against skyfield's values and published
//! ones.

use crate::{almanac::Almanac, planets::Planet};
use base::time::Tai;
use base::units::{AU_KM, DAY_S, DEG, SPEED_OF_LIGHT_KM_S};
use glam::DVec3;

/// Gaia BP - RP of the Sun (Casagrande and VandenBerg 2018, MNRAS 479, L102).
pub const SUN_BP_RP: f64 = 0.82;
/// G - V of that colour (Gaia DR3 documentation, section 5.5.1).
pub const SUN_G_LESS_V: f64 = -0.1525;
/// Full Moon at its mean distance, V.
const FULL_MOON_V: f64 = -12.74;
/// The distance that goes with it, km.
const MOON_DISTANCE_KM: f64 = 384_400.0;
/// Saturn's north pole, ICRF (IAU WGCCRE 2015): right ascension and declination at J2000, deg.
const SATURN_POLE_DEG: [f64; 2] = [40.589, 83.537];

/// Place of a body with respect to Sun and observer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// From the Sun to it, km.
    pub from_sun_km: DVec3,
    /// From the observer to it, km.
    pub from_observer_km: DVec3,
}

impl Lighting {
    /// Returns the angle at the body between Sun and observer, rad.
    pub fn phase_rad(&self) -> f64 {
        self.from_sun_km.angle_between(self.from_observer_km)
    }

    /// Returns the share of its disc that is lit.
    pub fn lit_share(&self) -> f64 {
        0.5 * (1.0 + self.phase_rad().cos())
    }
}

/// Returns the v of the Moon.
pub fn moon_v(lighting: &Lighting) -> f64 {
    let phase_deg = lighting.phase_rad() / DEG;
    let (sun_km, observer_km) = (lighting.from_sun_km.length(), lighting.from_observer_km.length());
    FULL_MOON_V
        + 0.026 * phase_deg
        + 4e-9 * phase_deg.powi(4)
        + 5.0 * ((sun_km / AU_KM) * (observer_km / MOON_DISTANCE_KM)).log10()
}

/// Returns the v of a planet; `year` is the Julian year.
pub fn planet_v(planet: Planet, lighting: &Lighting, year: f64) -> f64 {
    let [sun_au, observer_au] = [lighting.from_sun_km, lighting.from_observer_km].map(|km| km.length() / AU_KM);
    let phase_deg = (lighting.phase_rad() / DEG).min(most_phase_deg(planet));
    5.0 * (sun_au * observer_au).log10() + at_one_au(planet, phase_deg, lighting, year)
}

/// Returns the largest phase angle that a planet's magnitudes were measured at, deg.
pub const fn most_phase_deg(planet: Planet) -> f64 {
    match planet {
        Planet::Mercury => 169.5,
        Planet::Venus => 179.0,
        Planet::Mars => 120.0,
        Planet::Jupiter => 130.0,
        Planet::Saturn => 6.5,
        Planet::Uranus => 3.1,
        Planet::Neptune => 1.9,
    }
}

fn polynomial(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Returns the magnitude at 1 au from Sun and observer.
fn at_one_au(planet: Planet, a: f64, lighting: &Lighting, year: f64) -> f64 {
    match planet {
        Planet::Mercury => {
            polynomial(&[-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12], a)
        }
        Planet::Venus if a <= 163.7 => polynomial(&[-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9], a),
        Planet::Venus => polynomial(&[236.058_28, -2.819_14, 8.390_34e-3], a),
        Planet::Mars if a <= 50.0 => polynomial(&[-1.601, 0.022_67, -0.000_130_2], a),
        Planet::Mars => polynomial(&[-0.367, -0.025_73, 0.000_344_5], a),
        Planet::Jupiter if a <= 12.0 => polynomial(&[-9.395, -3.7e-4, 6.16e-4], a),
        Planet::Jupiter => -9.428 - 2.5 * polynomial(&[1.0, -1.507, -0.363, -0.062, 2.809, -1.876], a / 180.0).log10(),
        Planet::Saturn => {
            let sine = ring_sine(lighting);
            -8.914 - 1.825 * sine + 0.026 * a - 0.378 * sine * (-2.25 * a).exp()
        }
        Planet::Uranus => polynomial(&[-7.110, 6.587e-3, 1.045e-4], a),
        // It grew brighter from 1980 to 2000.
        Planet::Neptune => -6.89 - 0.0055 * (year - 1980.0).clamp(0.0, 20.0),
    }
}

/// Returns the sine of the angle by which Saturn's rings are open: the geometric mean for Sun and observer, 0 when they
/// look on different sides.
fn ring_sine(lighting: &Lighting) -> f64 {
    let [ra, dec] = SATURN_POLE_DEG.map(|deg| deg * DEG);
    let pole = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
    // To first order the mean of the angles is the mean of the sines: they differ by Earth's 6 deg at most.
    let [sun, observer] = [lighting.from_sun_km, lighting.from_observer_km].map(|km| pole.dot(km.normalize()));
    (sun * observer).max(0.0).sqrt()
}

/// Steps to the light time: each leaves v/c of the one before, 3e-4 of 4 hours at first.
const LIGHT_STEPS: usize = 3;

impl Planet {
    /// Returns where it was when the light left that an observer at `observer_km` from the Sun gets at `at`: from the
    /// Sun, km.
    pub fn light_left_km(self, at: Tai, observer_km: DVec3, almanac: &Almanac) -> DVec3 {
        let days = at.days_tdb_since_j2000();
        let mut from_sun_km = almanac.planet_km(self, days);
        for _ in 0..LIGHT_STEPS {
            let light_s = from_sun_km.distance(observer_km) / SPEED_OF_LIGHT_KM_S;
            from_sun_km = almanac.planet_km(self, days - light_s / DAY_S);
        }
        from_sun_km
    }
}
