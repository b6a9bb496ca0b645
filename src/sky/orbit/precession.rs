//! Axes of date -> ICRF: mean equator and equinox, and TEME, the axes of SGP4's output.
//!
//! Equation and constants: angles of Fukushima and Williams, IAU 2006, frame bias included (Hilton et al. 2006, Celest.
//! Mech. 94, 351; IERS Conventions 2010, eq. 5.40), with [`super::nutation`].
//!
//! TEME has the true equator of date; its x axis is the origin of the sidereal time of 1982, which Earth-fixed
//! positions are made with (Vallado et al., "Revisiting Spacetrack Report #3", AIAA 2006-6753, appendix C): west of the
//! true equinox by the equation of the equinoxes, and by what that sidereal time has run away from IAU 2006 since.
//!
//! Limit: nutation's 11 mas, and 3 mas of small terms in the equation of the equinoxes: 14 mas, 0.5 m at 7,000 km. Mean
//! axes of date are not TEME: nutation turns them by up to 9.4e-5 rad. Tests: `teme_agrees_with_a_published_library`,
//! `published_teme_state`.

use super::nutation::nutation_rad;
use base::time::Tai;
use base::units::{ARCSEC, JULIAN_YEAR_D};
use glam::{DMat3, DVec3};

/// Returns the rotation from mean axes of date to ICRF axes.
pub(crate) fn icrf_from_mean_of_date(at: Tai) -> DMat3 {
    date_from_icrf(centuries_tdb(at), [0.0; 2]).transpose()
}

/// Returns the rotation from SGP4's axes to ICRF axes. Two microseconds; does not allocate.
pub(crate) fn icrf_from_teme(at: Tai) -> DMat3 {
    let t = centuries_tdb(at);
    let [longitude, obliquity] = nutation_rad(t);
    let equation_of_equinoxes = longitude * (mean_obliquity_rad(t) + obliquity).cos();
    // Sidereal time of IAU 2006 less that of 1982, to 1 mas 1991-2050.
    let sidereal_since_1982 = (0.014_6 - 0.277 * t) * ARCSEC;
    (turn_axes_about_z(equation_of_equinoxes + sidereal_since_1982) * date_from_icrf(t, [longitude, obliquity]))
        .transpose()
}

fn centuries_tdb(at: Tai) -> f64 {
    at.days_tdb_since_j2000() / (100.0 * JULIAN_YEAR_D)
}

/// Returns the true axes of date from ICRF; mean ones when nutation (in longitude and obliquity, rad) is zero.
fn date_from_icrf(t: f64, nutation_rad: [f64; 2]) -> DMat3 {
    let gamma = (-0.052_928 + t * (10.556_378 + t * (0.493_204_4 - t * 0.000_312_38))) * ARCSEC;
    let phi = (84_381.412_819 + t * (-46.811_016 + t * (0.051_126_8 + t * 0.000_532_89))) * ARCSEC;
    let psi = (-0.041_775 + t * (5_038.481_484 + t * (1.558_417_5 - t * 0.000_185_22))) * ARCSEC;
    turn_axes_about_x(-(mean_obliquity_rad(t) + nutation_rad[1]))
        * turn_axes_about_z(-(psi + nutation_rad[0]))
        * turn_axes_about_x(phi)
        * turn_axes_about_z(gamma)
}

fn mean_obliquity_rad(t: f64) -> f64 {
    (84_381.406 + t * (-46.836_769 + t * (-0.000_183_1 + t * 0.002_003_4))) * ARCSEC
}

/// Returns the passive rotation: the axes turn by `angle_rad` about +Z.
fn turn_axes_about_z(angle_rad: f64) -> DMat3 {
    let (s, c) = angle_rad.sin_cos();
    DMat3::from_cols(DVec3::new(c, -s, 0.0), DVec3::new(s, c, 0.0), DVec3::Z)
}

/// Returns the passive rotation: the axes turn by `angle_rad` about +X.
fn turn_axes_about_x(angle_rad: f64) -> DMat3 {
    let (s, c) = angle_rad.sin_cos();
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, c, -s), DVec3::new(0.0, s, c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::MAS;

    /// Largest turn between TEME of here and of the whole series, rad (module doc).
    const TEME_RAD: f64 = 14.0 * MAS;
    /// Largest angle between TEME and mean axes of date, rad (module doc).
    const NUTATION_RAD: f64 = 9.4e-5;

    /// ICRF axes from TEME, row by row: transposed `skyfield.sgp4lib.TEME.rotation_at` (skyfield 1.55, its built-in
    /// UT1).
    #[rustfmt::skip]
    const SKYFIELD: [(&str, [f64; 9]); 8] = [
        ("1991-01-02T00:00:00Z", [0.9999976195, -0.0020120113, -0.0008442333, 0.0020120274, 0.9999979757, 0.0000182221, 0.0008441949, -0.0000199207, 0.9999996435]),
        ("2000-06-28T18:00:00Z", [0.9999999938, 0.0001097320, 0.0000174849, -0.0001097316, 0.9999999937, -0.0000217712, -0.0000174873, 0.0000217693, 0.9999999996]),
        ("2009-09-09T09:00:00Z", [0.9999971817, 0.0021666584, 0.0009706715, -0.0021666810, 0.9999976525, 0.0000222322, -0.0009706211, -0.0000243352, 0.9999995287]),
        ("2018-03-03T06:00:00Z", [0.9999902283, 0.0040628595, 0.0017425298, -0.0040628107, 0.9999917463, -0.0000315470, -0.0017426436, 0.0000244671, 0.9999984813]),
        ("2026-03-01T12:00:00Z", [0.9999796167, 0.0058507931, 0.0025562540, -0.0058509043, 0.9999828827, 0.0000360014, -0.0025559996, -0.0000509571, 0.9999967321]),
        ("2026-11-22T00:00:00Z", [0.9999784651, 0.0060133841, 0.0026283957, -0.0060134768, 0.9999819185, 0.0000273838, -0.0026281835, -0.0000431890, 0.9999965454]),
        ("2035-07-01T03:00:00Z", [0.9999625881, 0.0079382424, 0.0034360885, -0.0079380897, 0.9999684912, -0.0000580572, -0.0034364411, 0.0000307791, 0.9999940949]),
        ("2050-12-30T23:00:00Z", [0.9999225740, 0.0114053495, 0.0049763430, -0.0114051613, 0.9999349568, -0.0000662045, -0.0049767744, 0.0000094434, 0.9999876157]),
    ];

    fn at(text: &str) -> Tai {
        Tai::from_rfc3339(text).expect("a valid instant")
    }

    /// Returns the largest displacement of a unit vector along an axis.
    fn turn_rad(a: DMat3, b: DMat3) -> f64 {
        [DVec3::X, DVec3::Y, DVec3::Z].into_iter().map(|axis| (a * axis).distance(b * axis)).fold(0.0, f64::max)
    }

    #[test]
    fn teme_agrees_with_a_published_library() {
        let mut worst = 0.0_f64;
        for (text, rows) in SKYFIELD {
            let wanted = DMat3::from_cols_array(&rows).transpose();
            let off_rad = turn_rad(icrf_from_teme(at(text)), wanted);
            println!("{text}: {:.1} mas", off_rad / MAS);
            worst = worst.max(off_rad);
            let day_later = at(text) + base::time::Span::from_s(86_400.0);
            assert!(turn_rad(icrf_from_teme(day_later), wanted) > TEME_RAD, "control: a day later");
        }
        assert!(worst < TEME_RAD, "{} mas", worst / MAS);
        let without = turn_rad(icrf_from_mean_of_date(at(SKYFIELD[6].0)), icrf_from_teme(at(SKYFIELD[6].0)));
        assert!(without > 100.0 * TEME_RAD && without < NUTATION_RAD, "control: nutation is {without:e} rad");
    }

    #[test]
    fn published_teme_state() {
        // TEME position of object 5 on 2000-06-28 18:50:19.734 UTC (Vallado et al., "Revisiting Spacetrack Report #3",
        // AIAA 2006-6753, appendix C), km, and the same in GCRS axes by astropy 8.0.2 (nutation and bias included).
        let at = at("2000-06-28T18:50:19.733571Z");
        let teme_km = DVec3::new(-9_060.473_735_69, 4_658.709_525_02, 813.686_731_53);
        let gcrs_km = DVec3::new(-9_059.948_132_19, 4_659.686_190_51, 813.946_741_98);
        let got_km = icrf_from_teme(at) * teme_km;
        let angle_rad = (got_km - gcrs_km).length() / gcrs_km.length();
        assert!(angle_rad < 2.0 * TEME_RAD, "{angle_rad:.2e} rad: {got_km} for {gcrs_km}");
        let by_mean_rad = (icrf_from_mean_of_date(at) * teme_km - gcrs_km).length() / gcrs_km.length();
        assert!(by_mean_rad > 2.0 * TEME_RAD && by_mean_rad < NUTATION_RAD, "control: {by_mean_rad:.2e} rad");
    }

    #[test]
    fn fifty_arcsec_a_year() {
        let equinox = icrf_from_mean_of_date(at("2026-01-01T00:00:00Z")) * DVec3::X;
        // General precession 50.29 arcsec/yr (IAU 2006), all of it seen on the equinox, over 26.0 years.
        let moved_arcsec = equinox.angle_between(DVec3::X) / ARCSEC;
        assert!((moved_arcsec - 50.29 * 26.0).abs() < 1.0, "{moved_arcsec}");
        assert!(equinox.y < 0.0, "the equinox of date lies west of ICRF's: {equinox}");
    }
}
