//! Time -> barycentric position and velocity of the Sun's centre.
//!
//! Source and axes as for [`crate::earth`] (VSOP87E). The Sun moves by up to 16 m/s about the barycentre: 11 mas of
//! aberration for an observer in orbit about it. Velocity is the central difference over a day: truncation below 1e-10
//! km/s. Test: `agrees_with_a_numerical_ephemeris`.

use crate::earth::{state_by_difference, sun_position_km};
use crate::state::BarycentricState;
use base::time::Tai;

/// Half of the interval over which positions are differenced, days.
const HALF_STEP_D: f64 = 0.5;

/// Returns the barycentric state of the Sun's centre, ICRF axes: three evaluations of the series, about 1 ms. Frames
/// use [`crate::almanac`].
pub fn barycentric_state(at: Tai) -> BarycentricState {
    state_on_day(at.days_tdb_since_j2000())
}

pub(super) fn state_on_day(days: f64) -> BarycentricState {
    state_by_difference(sun_position_km, days, HALF_STEP_D)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// The theory's older planet masses place the barycentre so (as for the Earth): 2e-5 au.
    const POSITION_KM: f64 = 3_000.0;
    /// Three times the difference measured; 0.014 mas of aberration.
    const VELOCITY_KM_S: f64 = 2e-5;

    /// Barycentric Sun by JPL's DE421 (skyfield 1.55), ICRF axes, km and km/s.
    #[rustfmt::skip]
    const DE421: [(&str, [f64; 3], [f64; 3]); 4] = [
        ("1991-03-01T12:00:00Z", [208_875.2, 144_103.0, 52_060.0], [0.006825642, 0.005755568, 0.002357978]),
        ("2008-06-15T00:00:00Z", [-136_278.6, 678_426.8, 285_622.0], [-0.010967071, -0.001723187, -0.000534089]),
        ("2026-03-01T12:00:00Z", [-395_471.7, -763_035.7, -310_697.5], [0.012193126, 0.001291381, 0.000295423]),
        ("2050-11-30T06:00:00Z", [341_104.8, -300_878.8, -132_386.1], [0.005978583, 0.007272102, 0.003037269]),
    ];

    #[test]
    fn agrees_with_a_numerical_ephemeris() {
        for (text, position_km, velocity_km_s) in DE421 {
            let got = barycentric_state(Tai::from_rfc3339(text).expect("a valid instant"));
            let far_km = got.position_km.distance(DVec3::from_array(position_km));
            let slip_km_s = got.velocity_km_s.distance(DVec3::from_array(velocity_km_s));
            println!("{text}: {far_km:.1} km, {slip_km_s:.2e} km/s");
            assert!(far_km < POSITION_KM && slip_km_s < VELOCITY_KM_S, "{text}: {far_km} km, {slip_km_s} km/s");
            assert!(got.velocity_km_s.length() > 100.0 * VELOCITY_KM_S, "control: the Sun moves");
        }
    }
}
