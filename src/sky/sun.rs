//! Time -> barycentric position and velocity of the Sun's centre.
//!
//! Source and axes as for [`crate::earth`] (VSOP87E). The Sun moves by up to 16 m/s about the barycentre: 11 mas of
//! aberration for an observer in orbit about it. Velocity is the central difference over a day: truncation below 1e-10 km/s.
//! Test: `agrees_with_a_numerical_ephemeris`.

use crate::earth::{state_by_difference, sun_position_km};
use crate::observer::BarycentricState;
use base::time::Tai;
use base::units::DAY_S;

/// Half of the interval over which positions are differenced, days.
const HALF_STEP_D: f64 = 0.5;

/// Barycentric state of the Sun's centre, ICRF axes: three evaluations of the series, about 1 ms.
#[must_use]
pub fn barycentric_state(at: Tai) -> BarycentricState {
    state_on_day(at.days_tdb_since_j2000())
}

fn state_on_day(days: f64) -> BarycentricState {
    state_by_difference(sun_position_km, days, HALF_STEP_D)
}

/// The Sun's state for every frame: straight on from the noon (TDB) of the day.
///
/// The result depends on the time only. Error: its acceleration, below 2.5e-10 km/s^2, over half a day: 0.25 km and 1.1e-5
/// km/s, or 8 microarcsec of aberration. Does not allocate. Test: `the_track_follows_the_series`.
#[derive(Debug, Clone)]
pub struct SunTrack {
    day: f64,
    noon: BarycentricState,
}

impl SunTrack {
    /// A track that is ready for the day of `at`.
    #[must_use]
    pub fn new(at: Tai) -> Self {
        Self::for_day(at.days_tdb_since_j2000().floor())
    }

    /// Barycentric state of the Sun's centre, ICRF axes.
    pub fn barycentric_state(&mut self, at: Tai) -> BarycentricState {
        let days = at.days_tdb_since_j2000();
        if days.floor() != self.day {
            *self = Self::for_day(days.floor());
        }
        let since_noon_s = (days - self.day - 0.5) * DAY_S;
        BarycentricState { position_km: self.noon.position_km + self.noon.velocity_km_s * since_noon_s, ..self.noon }
    }

    fn for_day(day: f64) -> Self {
        Self { day, noon: state_on_day(day + 0.5) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;
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

    #[test]
    fn the_track_follows_the_series() {
        let start = Tai::from_rfc3339("2026-01-01T00:00:00Z").expect("a valid instant");
        let mut track = SunTrack::new(start);
        for hour in (0..9_000).step_by(167) {
            let at = start + Span::from_s(3_600.0 * f64::from(hour));
            let (got, wanted) = (track.barycentric_state(at), barycentric_state(at));
            assert!(got.position_km.distance(wanted.position_km) < 0.25, "{hour} h");
            assert!(got.velocity_km_s.distance(wanted.velocity_km_s) < 1.1e-5, "{hour} h");
            assert_eq!(got, SunTrack::new(at).barycentric_state(at), "only the time matters");
        }
    }
}
