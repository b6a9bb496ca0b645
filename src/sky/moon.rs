//! Time -> geocentric position and velocity of the Moon, km and km/s, ICRF axes.
//!
//! * From 1989-12-28 to 2052-01-08 by the table of [`crate::ephemeris`], fitted to DE421: 0.15 km, 0.08 arcsec.
//! * At other times by a series: ELP-2000/82 as truncated in Meeus, Astronomical Algorithms, 2nd ed. (1998), chapter 47,
//!   here without the terms below 0.002 deg in longitude and 0.001 deg in latitude; mean equinox and ecliptic of date,
//!   turned to ICRF by the mean obliquity and the precession of [`crate::orbit`]. Against DE421 (1900-2053) within
//!   0.015 deg and 60 km: enough for the glare of the Moon.
//!
//! [`method`] says which. Tests: `agrees_with_a_numerical_ephemeris`, `both_sides_of_the_table`.

use crate::ephemeris::{self, Method};
use crate::{orbit::icrf_from_mean_of_date, state::BarycentricState};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG, JULIAN_YEAR_D};
use glam::DVec3;

/// Mean radius, km (IAU Working Group on Cartographic Coordinates 2015).
pub const RADIUS_KM: f64 = 1_737.4;
/// Constant of the distance series, km (Meeus, chapter 47).
pub const MEAN_DISTANCE_KM: f64 = 385_000.56;

/// Multiples of D, M, M', F; 1e-6 deg of sine in longitude; metres of cosine in distance (table 47.A).
#[rustfmt::skip]
const LONGITUDE_DISTANCE: [([i8; 4], f64, f64); 41] = [
    ([0, 0, 1, 0], 6_288_774.0, -20_905_355.0), ([2, 0, -1, 0], 1_274_027.0, -3_699_111.0),
    ([2, 0, 0, 0], 658_314.0, -2_955_968.0), ([0, 0, 2, 0], 213_618.0, -569_925.0),
    ([0, 1, 0, 0], -185_116.0, 48_888.0), ([0, 0, 0, 2], -114_332.0, -3_149.0),
    ([2, 0, -2, 0], 58_793.0, 246_158.0), ([2, -1, -1, 0], 57_066.0, -152_138.0),
    ([2, 0, 1, 0], 53_322.0, -170_733.0), ([2, -1, 0, 0], 45_758.0, -204_586.0),
    ([0, 1, -1, 0], -40_923.0, -129_620.0), ([1, 0, 0, 0], -34_720.0, 108_743.0),
    ([0, 1, 1, 0], -30_383.0, 104_755.0), ([2, 0, 0, -2], 15_327.0, 10_321.0),
    ([0, 0, 1, 2], -12_528.0, 0.0), ([0, 0, 1, -2], 10_980.0, 79_661.0),
    ([4, 0, -1, 0], 10_675.0, -34_782.0), ([0, 0, 3, 0], 10_034.0, -23_210.0),
    ([4, 0, -2, 0], 8_548.0, -21_636.0), ([2, 1, -1, 0], -7_888.0, 24_208.0),
    ([2, 1, 0, 0], -6_766.0, 30_824.0), ([1, 0, -1, 0], -5_163.0, -8_379.0),
    ([1, 1, 0, 0], 4_987.0, -16_675.0), ([2, -1, 1, 0], 4_036.0, -12_831.0),
    ([2, 0, 2, 0], 3_994.0, -10_445.0), ([4, 0, 0, 0], 3_861.0, -11_650.0),
    ([2, 0, -3, 0], 3_665.0, 14_403.0), ([0, 1, -2, 0], -2_689.0, -7_003.0),
    ([2, 0, -1, 2], -2_602.0, 0.0), ([2, -1, -2, 0], 2_390.0, 10_056.0),
    ([1, 0, 1, 0], -2_348.0, 6_322.0), ([2, -2, 0, 0], 2_236.0, -9_884.0),
    ([0, 1, 2, 0], -2_120.0, 5_751.0), ([0, 2, 0, 0], -2_069.0, 0.0),
    ([2, -2, -1, 0], 2_048.0, -4_950.0), ([2, 0, 1, -2], -1_773.0, 4_130.0),
    ([2, 0, 0, 2], -1_595.0, 0.0), ([4, -1, -1, 0], 1_215.0, -3_958.0),
    ([0, 0, 2, 2], -1_110.0, 0.0), ([0, 0, 2, -2], -381.0, -4_421.0),
    ([2, 0, -1, -2], 0.0, 8_752.0),
];

/// Multiples of D, M, M', F; 1e-6 deg of sine in latitude (table 47.B).
#[rustfmt::skip]
const LATITUDE: [([i8; 4], f64); 29] = [
    ([0, 0, 0, 1], 5_128_122.0), ([0, 0, 1, 1], 280_602.0), ([0, 0, 1, -1], 277_693.0), ([2, 0, 0, -1], 173_237.0),
    ([2, 0, -1, 1], 55_413.0), ([2, 0, -1, -1], 46_271.0), ([2, 0, 0, 1], 32_573.0), ([0, 0, 2, 1], 17_198.0),
    ([2, 0, 1, -1], 9_266.0), ([0, 0, 2, -1], 8_822.0), ([2, -1, 0, -1], 8_216.0), ([2, 0, -2, -1], 4_324.0),
    ([2, 0, 1, 1], 4_200.0), ([2, 1, 0, -1], -3_359.0), ([2, -1, -1, 1], 2_463.0), ([2, -1, 0, 1], 2_211.0),
    ([2, -1, -1, -1], 2_065.0), ([0, 1, -1, -1], -1_870.0), ([4, 0, -1, -1], 1_828.0), ([0, 1, 0, 1], -1_794.0),
    ([0, 0, 0, 3], -1_749.0), ([0, 1, -1, 1], -1_565.0), ([1, 0, 0, 1], -1_491.0), ([0, 1, 1, 1], -1_475.0),
    ([0, 1, 1, -1], -1_410.0), ([0, 1, 0, -1], -1_344.0), ([1, 0, 0, -1], -1_335.0), ([0, 0, 3, 1], 1_107.0),
    ([4, 0, 0, -1], 1_021.0),
];

/// The Moon's number in the table.
const NUMBER: u32 = 10;
/// Half of the interval over which the series is differenced, s: the error of its velocity is 1e-5 km/s.
const HALF_STEP_S: f64 = 600.0;

/// Returns the method that computes positions at `at`.
pub fn method(at: Tai) -> Method {
    Method::on_day(at.days_tdb_since_j2000())
}

/// Returns the position from the Earth's centre, ICRF axes, km. Does not allocate; below a microsecond by the table, a
/// few by the series.
pub fn geocentric_km(at: Tai) -> DVec3 {
    let by_table = ephemeris::state(NUMBER, at.days_tdb_since_j2000());
    by_table.map_or_else(|| by_series_km(at), |state| state.position_km)
}

/// Returns the position and velocity from the Earth's centre, ICRF axes.
pub fn geocentric_state(at: Tai) -> BarycentricState {
    ephemeris::state(NUMBER, at.days_tdb_since_j2000()).unwrap_or_else(|| {
        let half = Span::from_s(HALF_STEP_S);
        let [before_km, after_km] = [at - half, at + half].map(by_series_km);
        let velocity_km_s = (after_km - before_km) / (2.0 * HALF_STEP_S);
        BarycentricState { position_km: by_series_km(at), velocity_km_s }
    })
}

fn by_series_km(at: Tai) -> DVec3 {
    let t = at.days_tdb_since_j2000() / (100.0 * JULIAN_YEAR_D);
    let angle = |at_epoch: f64, rate: f64, square: f64| (at_epoch + t * (rate + t * square)).rem_euclid(360.0) * DEG;
    let moon_longitude = angle(218.316_447_7, 481_267.881_234_21, -0.001_578_6);
    let elongation = angle(297.850_192_1, 445_267.111_403_4, -0.001_881_9);
    let sun_anomaly = angle(357.529_109_2, 35_999.050_290_9, -0.000_153_6);
    let moon_anomaly = angle(134.963_396_4, 477_198.867_505_5, 0.008_741_4);
    let node_distance = angle(93.272_095_0, 483_202.017_523_3, -0.003_653_9);
    // Venus, Jupiter and the flattening of the Earth.
    let [a1, a3] = [angle(119.75, 131.849, 0.0), angle(313.45, 481_266.484, 0.0)];
    let eccentricity = 1.0 - t * (0.002_516 + t * 0.000_007_4);
    let arguments = [elongation, sun_anomaly, moon_anomaly, node_distance];
    let phase = |multiples: [i8; 4]| {
        let sum: f64 = multiples.iter().zip(arguments).map(|(n, argument)| f64::from(*n) * argument).sum();
        // The Earth's eccentricity shrinks: terms of the Sun's anomaly go with it.
        (sum, eccentricity.powi(i32::from(multiples[1].abs())))
    };
    let mut longitude_udeg = 3_958.0 * a1.sin() + 1_962.0 * (moon_longitude - node_distance).sin();
    let mut distance_m = 0.0;
    for (multiples, sine, cosine) in LONGITUDE_DISTANCE {
        let (phase, weight) = phase(multiples);
        longitude_udeg += weight * sine * phase.sin();
        distance_m += weight * cosine * phase.cos();
    }
    let mut latitude_udeg = -2_235.0 * moon_longitude.sin() + 382.0 * a3.sin();
    for (multiples, sine) in LATITUDE {
        let (phase, weight) = phase(multiples);
        latitude_udeg += weight * sine * phase.sin();
    }
    let longitude = moon_longitude + longitude_udeg * 1e-6 * DEG;
    let latitude = latitude_udeg * 1e-6 * DEG;
    let radius_km = MEAN_DISTANCE_KM + distance_m * 1e-3;
    let ((sin_l, cos_l), (sin_b, cos_b)) = (longitude.sin_cos(), latitude.sin_cos());
    let ecliptic_km = DVec3::new(cos_b * cos_l, cos_b * sin_l, sin_b) * radius_km;
    // Mean obliquity of date (IAU 1980, which the series goes with).
    let (sin_e, cos_e) = ((84_381.448 - 46.815 * t) * ARCSEC).sin_cos();
    let DVec3 { x, y, z } = ecliptic_km;
    icrf_from_mean_of_date(at) * DVec3::new(x, cos_e * y - sin_e * z, sin_e * y + cos_e * z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::{FIRST_DAY, LAST_DAY};
    use base::units::DAY_S;

    /// Sum of squares of what the series leaves out is 0.004 deg; three times that, and precession's neglected
    /// nutation.
    const SERIES_DEG: f64 = 0.015;
    const SERIES_KM: f64 = 60.0;
    /// Rounding and truncation of the table's coefficients (measured 0.13 km), and 1 ms of the clock.
    const TABLE_KM: f64 = 0.2;

    /// Geocentric Moon by JPL's DE421 (jplephem 2.22), equatorial ICRF axes, km; days of TDB since J2000.
    const DE421: [(f64, [f64; 3]); 5] = [
        (0.0, [-291_608.385, -266_716.833, -76_102.487]),
        (4_567.5, [95_551.027, -332_313.459, -120_488.573]),
        (9_556.0, [-268_622.293, 235_574.882, 116_888.769]),
        (11_579.75, [-357_122.422, 172_649.474, 37_583.583]),
        (14_955.25, [375_424.352, 8_638.890, -26_705.832]),
    ];

    /// Returns the instant at which so many days of TDB have passed since J2000 (its offset from TAI is constant to 2
    /// ms).
    fn at(days: f64) -> Tai {
        Tai::from_rfc3339("2000-01-01T11:58:55.816Z").expect("J2000.0") + Span::from_s(DAY_S * days)
    }

    #[test]
    fn agrees_with_a_numerical_ephemeris() {
        for (days, wanted) in DE421 {
            assert!((at(days).days_tdb_since_j2000() - days).abs() < 1e-6, "the clock of this test");
            let wanted = DVec3::from_array(wanted);
            let off_km = geocentric_km(at(days)).distance(wanted);
            assert!(off_km < TABLE_KM, "{days}: {off_km} km");
            assert!(geocentric_km(at(days + 1e-5)).distance(wanted) > TABLE_KM, "control: a second of motion is 1 km");
            let series = by_series_km(at(days));
            let (off_deg, far_km) = (series.angle_between(wanted) / DEG, (series.length() - wanted.length()).abs());
            assert!(off_deg < SERIES_DEG && far_km < SERIES_KM, "{days}: {off_deg} deg, {far_km} km");
            let later = by_series_km(at(days + 0.05));
            assert!(later.angle_between(wanted) / DEG > SERIES_DEG, "control: an hour of motion is half a degree");
        }
    }

    #[test]
    fn both_sides_of_the_table() {
        for (edge, inside) in [(FIRST_DAY, 1e-3), (LAST_DAY, -1e-3)] {
            let [inner, outer] = [at(edge + inside), at(edge - inside)];
            assert_eq!((method(inner), method(outer)), (Method::Table, Method::Series));
            for instant in [inner, outer] {
                let off = geocentric_km(instant).angle_between(by_series_km(instant)) / DEG;
                assert!(off < SERIES_DEG, "{off}");
                let state = geocentric_state(instant);
                assert_eq!(state.position_km, geocentric_km(instant));
                let half = Span::from_s(30.0);
                let moved_km = geocentric_km(instant + half) - geocentric_km(instant - half);
                assert!((moved_km / 60.0).distance(state.velocity_km_s) < 2e-5, "{}", state.velocity_km_s);
            }
            assert_eq!(geocentric_km(outer), by_series_km(outer));
            assert_ne!(geocentric_km(inner), by_series_km(inner));
        }
    }
}
