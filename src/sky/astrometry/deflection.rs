//! Direction -> direction after the bending of its light by the Sun.
//!
//! Equation: u' = u + (2 GM / c^2 r) / max(1 + u.e, limit) u x (e x u), for a star at infinity; e is the direction from
//! the Sun to the observer and r their distance (Urban and Seidelmann, Explanatory Supplement, 3rd ed., eq. 7.63; the
//! formula and the limit of SOFA's `iauLdsun`). Size at 1 au: 4.07 mas x cot(elongation / 2): 0.4 at 170 degrees, 4 at
//! 90, 10 at 45, 23 at 20, 47 at 10, 93 at 5, 1750 at the limb.
//!
//! Limit: within 0.08 deg of the Sun's centre (at 1 au, a third of its radius) it goes to zero: nothing is seen there.
//! Other bodies are left out: at its limb Jupiter bends by 16 mas (1 mas at 5 arcmin from it), Saturn by 6 (1 mas at 1
//! arcmin), the Earth by 0.6, the Moon by 0.03. Test: `agrees_with_erfa_ldsun`.

use base::units::AU_KM;
use glam::DVec3;

/// Twice the Sun's gravitational radius GM / c^2, in au (SOFA `SRS`).
const SCHWARZSCHILD_AU: f64 = 1.974_125_743_36e-8;
/// Least 1 + u.e at 1 au or nearer; farther away it shrinks with the square of the distance, as the Sun's disc does.
const LEAST_OPENING: f64 = 1e-6;
/// Most that light from beside the Sun's disc can be bent, rad: 1.75 arcsec at the limb, from any distance.
pub(super) const MOST_RAD: f64 = 1.8 * base::units::ARCSEC;

/// Effect of the Sun's gravity on light on its way to one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deflection {
    away_from_sun: DVec3,
    /// `2 GM / c^2 r`.
    strength: f64,
    least_opening: f64,
}

impl Deflection {
    /// Computes the deflection for an observer at `heliocentric_km` from the Sun's centre.
    pub fn at(heliocentric_km: DVec3) -> Self {
        let distance_au = heliocentric_km.length() / AU_KM;
        Self {
            away_from_sun: heliocentric_km / (distance_au * AU_KM),
            strength: SCHWARZSCHILD_AU / distance_au,
            least_opening: LEAST_OPENING / (distance_au * distance_au).max(1.0),
        }
    }

    /// Returns the direction of light that came from `direction_icrf` (unit vector). Its length is 1 to 1e-10.
    #[inline]
    pub fn deflected(&self, direction_icrf: DVec3) -> DVec3 {
        let away = direction_icrf.dot(self.away_from_sun);
        // u x (e x u) = e - u (u.e) for a unit vector.
        let across = self.away_from_sun - direction_icrf * away;
        direction_icrf + across * (self.strength / (1.0 + away).max(self.least_opening))
    }
}

/// Returns the direction of light that came from `direction_icrf` (unit vector) at `heliocentric_km` from the Sun's
/// centre.
pub fn deflected(direction_icrf: DVec3, heliocentric_km: DVec3) -> DVec3 {
    Deflection::at(heliocentric_km).deflected(direction_icrf)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, DEG, MAS};

    /// Returns the direction at `elongation_deg` from the Sun for an observer at +X of it.
    fn at(elongation_deg: f64) -> DVec3 {
        let (sin, cos) = (elongation_deg * DEG).sin_cos();
        DVec3::new(-cos, sin, 0.0)
    }

    fn bent_mas(elongation_deg: f64, distance_au: f64) -> f64 {
        deflected(at(elongation_deg), DVec3::X * (distance_au * AU_KM)).distance(at(elongation_deg)) / MAS
    }

    /// Elongation deg, distance au, deflection mas by erfa.ldsun (pyerfa 2.0.1.5).
    const LDSUN: [[f64; 3]; 10] = [
        [170.0, 1.0, 0.356247],
        [90.0, 1.0, 4.071927],
        [45.0, 1.0, 9.830501],
        [20.0, 1.0, 23.093044],
        [10.0, 1.0, 46.542334],
        [5.0, 1.0, 93.262453],
        [2.0, 1.0, 233.280521],
        [0.27, 1.0, 1728.176142],
        [30.0, 0.3, 50.655457],
        [10.0, 10.0, 4.654233],
    ];

    #[test]
    fn agrees_with_erfa_ldsun() {
        for [elongation_deg, distance_au, wanted_mas] in LDSUN {
            let got_mas = bent_mas(elongation_deg, distance_au);
            assert!(
                (got_mas - wanted_mas).abs() < 1e-5 * wanted_mas + 1e-6,
                "{elongation_deg}: {got_mas} {wanted_mas}"
            );
        }
        assert!((bent_mas(90.0, 1.0) - bent_mas(80.0, 1.0)).abs() > 0.5, "control: it depends on the elongation");
    }

    #[test]
    fn stars_are_pushed_away_from_the_sun() {
        let seen = deflected(at(10.0), DVec3::X * AU_KM);
        assert!(seen.angle_between(DVec3::NEG_X) > at(10.0).angle_between(DVec3::NEG_X));
        assert!((seen.length() - 1.0).abs() < 1e-10, "{}", seen.length());
    }

    #[test]
    fn the_limb_bends_most_and_the_limit_is_behind_the_disc() {
        for distance_au in [0.1, 1.0, 30.0] {
            let limb_deg = (695_700.0 / (distance_au * AU_KM)).asin() / DEG;
            let limb_arcsec = bent_mas(limb_deg, distance_au) * MAS / ARCSEC;
            assert!((limb_arcsec - 1.75).abs() < 0.01, "{limb_arcsec} at {distance_au} au");
            assert!(limb_arcsec * ARCSEC < MOST_RAD);
            // Beyond the limb the limit changes nothing; at the centre nothing is bent.
            let unlimited = 2.0 * SCHWARZSCHILD_AU / distance_au / (limb_deg * DEG) / MAS;
            assert!((bent_mas(limb_deg, distance_au) / unlimited - 1.0).abs() < 3e-3, "{distance_au} au");
            assert!(bent_mas(1e-4 * limb_deg, distance_au) < bent_mas(limb_deg, distance_au));
        }
        assert_eq!(deflected(DVec3::NEG_X, DVec3::X * AU_KM), DVec3::NEG_X, "through the centre");
    }
}
