//! Time and the observer's place -> where a planet's light comes from, km, ICRF axes.
//!
//! Heliocentric positions by the table of [`crate::ephemeris`], outside its span by VSOP87E (Bretagnon and Francou
//! 1988, A&A 202, 309), both through [`crate::almanac`]. Light time: the planet is taken where it was when the light
//! left ([`crate::magnitude`]). The places are then geometric in the observer's axes of rest with the barycentre,
//! so that the aberration of stars applies. The Sun's own motion meanwhile (0.013 km/s) is left out: 200 km, or 0.01
//! arcsec, at Neptune. Mars to Neptune are the centres of mass of their systems (Jupiter's is 200 km from the planet's
//! middle: 0.1 arcsec).
//!
//! Against DE421 1990-2051: 0.05 arcsec by the table; by VSOP87E 0.4 arcsec for Mercury to Saturn, 1.7 for Uranus, 2.4
//! for Neptune. Tests: below; `tests/physics/bodies.rs` for apparent places.

use crate::earth::{self, HALF_STEP_D, state_by_difference};
use crate::{ephemeris::Method, state::BarycentricState};
use base::time::Tai;
use glam::DVec3;

base::words! {
    /// A planet other than the Earth.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    #[allow(missing_docs, reason = "the names say it all")]
    pub enum Planet {
        Mercury = "Mercury",
        Venus = "Venus",
        Mars = "Mars",
        Jupiter = "Jupiter",
        Saturn = "Saturn",
        Uranus = "Uranus",
        Neptune = "Neptune",
    }
}

impl Planet {
    /// Returns the number in order from the Sun, the Earth being 3.
    pub const fn number(self) -> u32 {
        match self {
            Self::Mercury => 1,
            Self::Venus => 2,
            Self::Mars => 4,
            Self::Jupiter => 5,
            Self::Saturn => 6,
            Self::Uranus => 7,
            Self::Neptune => 8,
        }
    }

    /// Radius of the sphere of its volume, km (IAU WGCCRE 2015).
    pub const fn radius_km(self) -> f64 {
        match self {
            Self::Mercury => 2_439.4,
            Self::Venus => 6_051.8,
            Self::Mars => 3_389.5,
            Self::Jupiter => 69_911.0,
            Self::Saturn => 58_232.0,
            Self::Uranus => 25_362.0,
            Self::Neptune => 24_622.0,
        }
    }

    /// Returns the position from the Sun on a day, TDB since J2000, by VSOP87E: milliseconds.
    #[cfg(test)]
    pub(super) fn by_series_km(self, days: f64) -> DVec3 {
        barycentric_km(self, days) - earth::sun_position_km(days)
    }

    /// Returns the method that computes its place at `at`.
    pub fn method(at: Tai) -> Method {
        Method::on_day(at.days_tdb_since_j2000())
    }
}

/// Returns the barycentric position of a planet, ICRF axes, by VSOP87E.
fn barycentric_km(planet: Planet, days_tdb_since_j2000: f64) -> DVec3 {
    use vsop87::vsop87e;
    let series = match planet {
        Planet::Mercury => vsop87e::mercury,
        Planet::Venus => vsop87e::venus,
        Planet::Mars => vsop87e::mars,
        Planet::Jupiter => vsop87e::jupiter,
        Planet::Saturn => vsop87e::saturn,
        Planet::Uranus => vsop87e::uranus,
        Planet::Neptune => vsop87e::neptune,
    };
    let p = series(earth::J2000_JD + days_tdb_since_j2000);
    earth::equatorial_km(DVec3::new(p.x, p.y, p.z))
}

/// States of all planets from the Sun on a day, TDB since J2000, by VSOP87E.
pub(super) fn states_by_series(days: f64) -> [BarycentricState; Planet::ALL.len()] {
    let sun = state_by_difference(earth::sun_position_km, days, HALF_STEP_D);
    Planet::ALL.map(|planet| state_by_difference(|days| barycentric_km(planet, days), days, HALF_STEP_D) - sun)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::{self, FIRST_DAY, LAST_DAY};
    use base::units::ARCSEC;

    /// Error of VSOP87E on either side of the table, arcsec: the outermost planets most (module doc), and a margin.
    const SERIES_ARCSEC: f64 = 3.0;

    #[test]
    fn table_and_series_agree_at_the_edges_of_the_table() {
        for planet in Planet::ALL {
            for inside in [FIRST_DAY, LAST_DAY - 1e-3] {
                let by_table = ephemeris::state(planet.number(), inside).expect("a day of the table").position_km;
                let off = by_table.angle_between(planet.by_series_km(inside)) / ARCSEC;
                assert!(off < SERIES_ARCSEC && off > 0.0, "{}: {off}", planet.name());
            }
        }
    }
}
