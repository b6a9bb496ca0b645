//! Axes of date -> ICRF, for SGP4's output.
//!
//! Equation and constants: equatorial precession angles of IAU 2006 (Capitaine, Wallace and Chapront 2003, A&A 412,
//! 567, eq. 40; also Urban and Seidelmann, Explanatory Supplement, 3rd ed., sec. 6.6.2.1).
//!
//! Limit: TEME is taken as the mean equator and equinox of date. The neglected nutation turns a vector by up to
//! 17.2 arcsec x sin(obliquity) about the equinox and 9.2 arcsec in obliquity: at most 9.4e-5 rad, which for 7.8 km/s
//! is 0.73 m/s or 0.5 mas of aberration. Frame bias (17 mas) is neglected too.
//! Test: `published_teme_state` against another library.

use crate::base::time::Tai;
use crate::base::units::{ARCSEC, JULIAN_YEAR_D};
use glam::{DMat3, DVec3};

/// Rotation from mean axes of date to ICRF axes.
pub(in crate::sky) fn icrf_from_mean_of_date(at: Tai) -> DMat3 {
    let t = at.days_tdb_since_j2000() / (100.0 * JULIAN_YEAR_D);
    let zeta = (2.650_545 + t * (2_306.083_227 + t * (0.298_849_9 + t * 0.018_018_28))) * ARCSEC;
    let z = (-2.650_545 + t * (2_306.077_181 + t * (1.092_734_8 + t * 0.018_268_37))) * ARCSEC;
    let theta = t * (2_004.191_903 - t * (0.429_493_4 + t * 0.041_822_64)) * ARCSEC;
    turn_axes_about_z(zeta) * turn_axes_about_y(-theta) * turn_axes_about_z(z)
}

/// Passive rotation: the axes turn by `angle_rad` about +Z.
fn turn_axes_about_z(angle_rad: f64) -> DMat3 {
    let (s, c) = angle_rad.sin_cos();
    DMat3::from_cols(DVec3::new(c, -s, 0.0), DVec3::new(s, c, 0.0), DVec3::Z)
}

/// Passive rotation: the axes turn by `angle_rad` about +Y.
fn turn_axes_about_y(angle_rad: f64) -> DMat3 {
    let (s, c) = angle_rad.sin_cos();
    DMat3::from_cols(DVec3::new(c, 0.0, s), DVec3::Y, DVec3::new(-s, 0.0, c))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest angle between TEME and mean axes of date, rad (module doc).
    const NEGLECTED_NUTATION_RAD: f64 = 9.4e-5;

    #[test]
    fn published_teme_state() {
        // TEME position of object 5 on 2000-06-28 18:50:19.734 UTC (Vallado et al., "Revisiting Spacetrack Report #3",
        // AIAA 2006-6753, appendix C), km, and the same in GCRS axes by astropy 8.0.2 (nutation and bias included).
        let at = Tai::from_rfc3339("2000-06-28T18:50:19.733571Z").expect("a valid instant");
        let teme_km = DVec3::new(-9_060.473_735_69, 4_658.709_525_02, 813.686_731_53);
        let gcrs_km = DVec3::new(-9_059.948_132_19, 4_659.686_190_51, 813.946_741_98);
        let got_km = icrf_from_mean_of_date(at) * teme_km;
        let angle_rad = (got_km - gcrs_km).length() / gcrs_km.length();
        assert!(angle_rad < NEGLECTED_NUTATION_RAD, "{angle_rad:.2e} rad: {got_km} for {gcrs_km}");
        let unturned_rad = (teme_km - gcrs_km).length() / gcrs_km.length();
        assert!(unturned_rad > NEGLECTED_NUTATION_RAD, "control: six months of precession are {unturned_rad:.2e} rad");
    }

    #[test]
    fn fifty_arcsec_a_year() {
        let at = Tai::from_rfc3339("2026-01-01T00:00:00Z").expect("a valid instant");
        let equinox = icrf_from_mean_of_date(at) * DVec3::X;
        // General precession 50.29 arcsec/yr (IAU 2006), all of it seen on the equinox, over 26.0 years.
        let moved_arcsec = equinox.angle_between(DVec3::X) / ARCSEC;
        assert!((moved_arcsec - 50.29 * 26.0).abs() < 1.0, "{moved_arcsec}");
        assert!(equinox.y < 0.0, "the equinox of date lies west of ICRF's: {equinox}");
    }
}
