//! Time -> barycentric position and velocity of the Earth's centre.
//!
//! Source: VSOP87 version E (Bretagnon and Francou 1988, A&A 202, 309): rectangular coordinates from the solar-system
//! barycentre, dynamical ecliptic and equinox J2000, au; argument Julian date TDB. The rotation to the equatorial axes
//! is the one printed with the theory (to FK5 J2000, which is within 25 mas of ICRF: 0.1 microarcsec of aberration).
//!
//! Velocity is the central difference over two half-steps of [`HALF_STEP_D`]; its truncation error, h^2/6 of the third
//! derivative, is below 4e-6 km/s for the year's motion and 3e-7 km/s for the month's: 3 microarcsec of aberration.
//! Measured against `erfa.epv00` at 2,001 times, 1900-2100: velocity within 1.1e-5 km/s (0.008 mas of aberration),
//! position within 1420 km (7 microarcsec of parallax at 1 arcsec; the theory's older planet masses place the
//! barycentre so).
//!
//! Test: `agrees_with_a_numerical_ephemeris` against literals from `erfa.epv00`.

use crate::state::BarycentricState;
use base::time::Tai;
use base::units::{AU_KM, DAY_S};
use glam::{DMat3, DVec3};

/// Half of the interval over which positions are differenced, days.
pub const HALF_STEP_D: f64 = 0.05;
/// Julian date of J2000.0.
pub(super) const J2000_JD: f64 = 2_451_545.0;

/// Rows of the rotation from the VSOP87 ecliptic to equatorial J2000 axes (note on VSOP87's coordinates, 1988).
const EQUATORIAL_FROM_VSOP87: [[f64; 3]; 3] = [
    [1.0, 0.000_000_440_360, -0.000_000_190_919],
    [-0.000_000_479_966, 0.917_482_137_087, -0.397_776_982_902],
    [0.0, 0.397_776_982_902, 0.917_482_137_087],
];

/// Returns the barycentric state of the Earth's centre, ICRF axes: three evaluations of the series, 0.3 to 0.8 ms.
/// Frames use [`crate::almanac`].
pub fn barycentric_state(at: Tai) -> BarycentricState {
    state_on_day(at.days_tdb_since_j2000())
}

pub(super) fn state_on_day(days: f64) -> BarycentricState {
    state_by_difference(position_km, days, HALF_STEP_D)
}

/// Returns the state of a body by its place on a day (TDB since J2000.0): the velocity is the central difference over
/// twice `half_step_d`.
pub(super) fn state_by_difference(position_km: impl Fn(f64) -> DVec3, days: f64, half_step_d: f64) -> BarycentricState {
    let [before_km, now_km, after_km] = [-half_step_d, 0.0, half_step_d].map(|step| position_km(days + step));
    BarycentricState { position_km: now_km, velocity_km_s: (after_km - before_km) / (2.0 * half_step_d * DAY_S) }
}

fn position_km(days_tdb_since_j2000: f64) -> DVec3 {
    let p = vsop87::vsop87e::earth(J2000_JD + days_tdb_since_j2000);
    equatorial_km(DVec3::new(p.x, p.y, p.z))
}

/// Returns the barycentric position of the Sun's centre, ICRF axes, by the same theory.
pub(super) fn sun_position_km(days_tdb_since_j2000: f64) -> DVec3 {
    let p = vsop87::vsop87e::sun(J2000_JD + days_tdb_since_j2000);
    equatorial_km(DVec3::new(p.x, p.y, p.z))
}

/// Returns the barycentric axes of the ICRF from those of the theory, in au.
pub(super) fn equatorial_km(ecliptic_au: DVec3) -> DVec3 {
    let rows = EQUATORIAL_FROM_VSOP87.map(DVec3::from_array);
    DMat3::from_cols(rows[0], rows[1], rows[2]).transpose() * ecliptic_au * AU_KM
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, MAS, SPEED_OF_LIGHT_KM_S};

    /// Twice the difference measured (module doc); 0.014 mas of aberration.
    const VELOCITY_KM_S: f64 = 2e-5;
    /// Twice the difference measured; 2e-5 au is 2e-5 of a star's parallax.
    const POSITION_KM: f64 = 3_000.0;

    /// Barycentric Earth by erfa.epv00 (pyerfa 2.0.1; 4.6 km and 1.4e-6 km/s rms against DE405), BCRS axes.
    #[rustfmt::skip]
    const EPV00: [(&str, [f64; 3], [f64; 3]); 7] = [
        ("1991-01-02T00:00:00Z", [-28_401_525.036, 132_503_942.622, 57_441_099.682], [-29.686741239, -5.402287531, -2.341202784]),
        ("2016-06-30T18:00:00Z", [24_693_661.265, -137_403_588.810, -59_591_923.770], [28.933799336, 4.239114649, 1.838112159]),
        ("2041-04-11T03:00:00Z", [-138_943_847.908, -49_121_067.594, -21_321_738.590], [10.209492966, -25.592924131, -11.092907732]),
        ("2050-12-30T12:00:00Z", [-20_775_924.650, 133_292_722.412, 57_769_393.867], [-29.948118644, -4.017442228, -1.740840778]),
        ("2000-01-01T12:00:00Z", [-27_568_540.666, 132_361_107.119, 57_418_504.658], [-29.784_877_458, -5.030_110_403, -2.180_798_787]),
        ("2026-03-01T12:00:00Z", [-140_159_701.835, 44_531_114.677, 19_324_160.225], [-10.384_115_158, -25.864_320_166, -11.210_753_435]),
        ("2031-09-15T06:00:00Z", [148_581_271.654, -19_570_381.951, -8_469_093.525], [3.770_231_878, 26.955_556_160, 11.684_202_303]),
    ];

    #[test]
    fn agrees_with_a_numerical_ephemeris() {
        for (text, position_km, velocity_km_s) in EPV00 {
            let got = barycentric_state(Tai::from_rfc3339(text).expect("a valid instant"));
            let far_km = got.position_km.distance(DVec3::from_array(position_km));
            let slip_km_s = got.velocity_km_s.distance(DVec3::from_array(velocity_km_s));
            println!("{text}: {far_km:.2} km, {slip_km_s:.2e} km/s, {:.4} mas", slip_km_s / SPEED_OF_LIGHT_KM_S / MAS);
            assert!(far_km < POSITION_KM && slip_km_s < VELOCITY_KM_S, "{text}: {far_km} km, {slip_km_s} km/s");
        }
    }

    #[test]
    fn a_year_of_aberration_has_the_published_size() {
        // kappa = 20.4955 arcsec is n a / (c sqrt(1 - e^2)); extremes of the speed are kappa (1 +- e), e = 0.0167.
        let day = |d: i64| {
            Tai::from_rfc3339("2026-01-01T00:00:00Z").expect("valid") + base::time::Span::from_s(86_400.0 * d as f64)
        };
        let speeds =
            (0..73).map(|i| barycentric_state(day(5 * i)).velocity_km_s.length() / SPEED_OF_LIGHT_KM_S / ARCSEC);
        let (low, high) = speeds.fold((f64::MAX, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
        // The Sun's own 12.5 m/s and the Moon's on the Earth, likewise, are 0.009 arcsec each.
        assert!((low - 20.4955 * (1.0 - 0.0167)).abs() < 0.03, "{low}");
        assert!((high - 20.4955 * (1.0 + 0.0167)).abs() < 0.03, "{high}");
    }
}
