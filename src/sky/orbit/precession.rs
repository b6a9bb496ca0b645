//! Axes of date -> ICRF: mean equator and equinox, and TEME, the axes of SGP4's output.
//!
//! Equation and constants: angles of Fukushima and Williams, IAU 2006, frame bias included (Hilton et al. 2006, Celest.
//! Mech. 94, 351; IERS Conventions 2010, eq. 5.40), with the nutation below.
//!
//! TEME has the true equator of date; its x axis is the origin of the sidereal time of 1982, which Earth-fixed
//! positions are made with (Vallado et al., "Revisiting Spacetrack Report #3", AIAA 2006-6753, appendix C): west of the
//! true equinox by the equation of the equinoxes, and by what that sidereal time has run away from IAU 2006 since.
//!
//! Limit: nutation's 11 mas, and 3 mas of small terms in the equation of the equinoxes: 14 mas, 0.5 m at 7,000 km. Mean
//! axes of date are not TEME: nutation turns them by up to 9.4e-5 rad. Tests: `teme_agrees_with_a_published_library`,
//! `published_teme_state`.
//!
//! *Nutation.* Time -> nutation in longitude and in obliquity, rad. Source: the 21 largest luni-solar terms of IAU
//! 2000B (McCarthy and Luzum 2003, Celest. Mech. 85, 37, table 1), their sine in longitude and cosine in obliquity at
//! J2000; arguments of Delaunay, linear (Simon et al. 1994, A&A 282, 663). Limit: against IAU 2006/2000A, 1991-2050,
//! the pole is within 11 mas (28 in longitude, 10 in obliquity). Test: `agrees_with_the_whole_series`.

use base::time::Tai;
use base::units::{ARCSEC, JULIAN_YEAR_D, MAS};
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

/// Largest error of the pole against the whole series, 1991-2050, mas.
#[cfg(test)]
pub(super) const POLE_MAS: f64 = 12.0;

/// Arguments at J2000 and their rates per Julian century, arcsec: l, l', F, D, Omega.
const DELAUNAY: [[f64; 2]; 5] = [
    [485_868.249_036, 1_717_915_923.217_8],
    [1_287_104.793_05, 129_596_581.048_1],
    [335_779.526_232, 1_739_527_262.847_8],
    [1_072_260.703_69, 1_602_961_601.209_0],
    [450_160.398_036, -6_962_890.543_1],
];

/// Multiples of the arguments; sine in longitude, cosine in obliquity, 0.1 microarcsec.
#[rustfmt::skip]
const TERMS: [([i8; 5], f64, f64); 21] = [
    ([0, 0, 0, 0, 1], -172_064_161.0, 92_052_331.0), ([0, 0, 2, -2, 2], -13_170_906.0, 5_730_336.0),
    ([0, 0, 2, 0, 2], -2_276_413.0, 978_459.0), ([0, 0, 0, 0, 2], 2_074_554.0, -897_492.0),
    ([0, 1, 0, 0, 0], 1_475_877.0, 73_871.0), ([0, 1, 2, -2, 2], -516_821.0, 224_386.0),
    ([1, 0, 0, 0, 0], 711_159.0, -6_750.0), ([0, 0, 2, 0, 1], -387_298.0, 200_728.0),
    ([1, 0, 2, 0, 2], -301_461.0, 129_025.0), ([0, -1, 2, -2, 2], 215_829.0, -95_929.0),
    ([0, 0, 2, -2, 1], 128_227.0, -68_982.0), ([-1, 0, 2, 0, 2], 123_457.0, -53_311.0),
    ([-1, 0, 0, 2, 0], 156_994.0, -1_235.0), ([1, 0, 0, 0, 1], 63_110.0, -33_228.0),
    ([-1, 0, 0, 0, 1], -57_976.0, 31_429.0), ([-1, 0, 2, 2, 2], -59_641.0, 25_543.0),
    ([1, 0, 2, 0, 1], -51_613.0, 26_366.0), ([-2, 0, 2, 0, 1], 45_893.0, -24_236.0),
    ([0, 0, 0, 2, 0], 63_384.0, -1_220.0), ([0, 0, 2, 2, 2], -38_571.0, 16_452.0),
    ([-2, 0, 0, 2, 0], -47_722.0, 477.0),
];

/// Returns the nutation in longitude and in obliquity, rad, `t` Julian centuries (TDB) after J2000.
pub(super) fn nutation_rad(t: f64) -> [f64; 2] {
    let arguments = DELAUNAY.map(|[at_j2000, rate]| (at_j2000 + t * rate) * ARCSEC);
    let mut sums = [0.0; 2];
    for (multiples, sine, cosine) in TERMS {
        let phase: f64 = multiples.iter().zip(arguments).map(|(n, argument)| f64::from(*n) * argument).sum();
        let (sin, cos) = phase.sin_cos();
        sums[0] += sine * sin;
        sums[1] += cosine * cos;
    }
    sums.map(|sum| sum * 1e-4 * MAS)
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

#[cfg(test)]
mod nutation_tests {
    use super::*;

    /// Julian centuries after J2000; nutation in longitude and obliquity, mas, by erfa.nut06a (pyerfa 2.0.1.5).
    const NUT06A: [[f64; 3]; 6] = [
        [-0.09, 15534.396, 3895.587],
        [0.0, -13932.003, -5769.398],
        [0.091, 14604.496, 5749.839],
        [0.263, 5627.896, 8542.470],
        [0.3555, -5553.095, -8911.968],
        [0.5099, 11451.270, -7831.794],
    ];

    #[test]
    fn agrees_with_the_whole_series() {
        for [t, longitude_mas, obliquity_mas] in NUT06A {
            let [longitude, obliquity] = nutation_rad(t).map(|angle_rad| angle_rad / MAS);
            let off_mas = ((longitude - longitude_mas) * 0.3978).hypot(obliquity - obliquity_mas);
            println!("{t}: {off_mas:.1} mas");
            assert!(off_mas < POLE_MAS, "{t}: {longitude} {obliquity}");
            let later = nutation_rad(t + 0.002).map(|angle_rad| angle_rad / MAS);
            let moved_mas = ((later[0] - longitude) * 0.3978).hypot(later[1] - obliquity);
            assert!(moved_mas > 3.0 * POLE_MAS, "control: 73 days move the pole by {moved_mas} mas");
        }
    }
}
