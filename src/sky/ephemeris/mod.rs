//! Time -> the Moon from the Earth, planets from the Sun: position and velocity, km and km/s, ICRF axes.
//!
//! Two methods, each with its domain:
//!
//! | method | domain | error against DE421 |
//! |---|---|---|
//! | [`Method::Table`]: Chebyshev polynomials fitted to JPL's DE421 (`table`) | [`FIRST_DAY`] to [`LAST_DAY`]: 1989-12-28 to 2052-01-08 | 0.1 arcsec |
//! | [`Method::Series`]: [`crate::moon`]'s short series, VSOP87E | any time | 0.015 deg for the Moon, 2.5 arcsec for planets |
//!
//! The table is part of the program (0.5 MB) and made by `hil_scripts/make_ephemeris_table.py`. A state costs below a
//! microsecond by the table and some milliseconds by VSOP87E, which [`crate::almanac`] evaluates; neither allocates.
//! Tests: below, `sky::moon`, `sky::planets`.

mod table;

use crate::state::BarycentricState;
use std::sync::OnceLock;
use table::Table;
pub use table::TableError;

/// First day of the table, TDB since J2000.
pub const FIRST_DAY: f64 = -3_656.0;
/// Last day of the table, exclusive.
pub const LAST_DAY: f64 = 19_000.0;

static BYTES: &[u8] = include_bytes!("de421_1990_2052.table");
static TABLE: OnceLock<Result<Table, TableError>> = OnceLock::new();

/// Method that computes a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Polynomials fitted to DE421.
    Table,
    /// Analytical series.
    Series,
}

impl Method {
    /// Returns the method that serves on a day, TDB since J2000.
    pub fn on_day(days: f64) -> Self {
        if (FIRST_DAY..LAST_DAY).contains(&days) && table().is_ok() { Self::Table } else { Self::Series }
    }
}

/// Checks the table: once for a program, a millisecond.
///
/// # Errors
/// When its bytes are not those that were made.
pub fn check() -> Result<(), &'static TableError> {
    table().map(|_| ())
}

/// Returns the state of a body of the table by its number: 10 for the Moon (geocentric), 1 to 8 for planets
/// (heliocentric); `None` outside the table.
pub(super) fn state(number: u32, days: f64) -> Option<BarycentricState> {
    table().ok()?.state(number, days)
}

fn table() -> Result<&'static Table, &'static TableError> {
    TABLE.get_or_init(|| Table::read(BYTES)).as_ref()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_whole_and_serves_its_span_only() {
        check().expect("a sound table");
        let edges = [(FIRST_DAY - 1e-6, false), (FIRST_DAY, true), (LAST_DAY - 1e-6, true), (LAST_DAY, false)];
        for (days, is_inside) in edges {
            assert_eq!(state(10, days).is_some(), is_inside, "{days}");
            assert_eq!(Method::on_day(days) == Method::Table, is_inside, "{days}");
        }
        assert!(state(3, 0.0).is_none() && state(9, 0.0).is_none() && state(10, f64::NAN).is_none());
    }

    #[test]
    fn granules_join_and_velocities_are_derivatives() {
        // Error of each side at a joint is that of the table: 0.2 km for the Moon, 300 km for the outermost planets.
        for (number, granule_d, joint_km) in [(10, 8.0, 0.4), (1, 16.0, 25.0), (4, 64.0, 50.0), (8, 512.0, 600.0)] {
            for granule in [1.0, 7.0, 20.0, 43.0] {
                let joint = FIRST_DAY + granule * granule_d;
                let [a, b] = [joint - 1e-7, joint + 1e-7].map(|days| state(number, days).expect("inside"));
                let moved_km = a.velocity_km_s * (2e-7 * base::units::DAY_S);
                assert!(b.position_km.distance(a.position_km + moved_km) < joint_km, "{number}");
            }
            let (day, half_d) = (FIRST_DAY + 0.37 * granule_d, 1e-4 * granule_d);
            let [a, m, b] = [-half_d, 0.0, half_d].map(|d| state(number, day + d).expect("inside"));
            let difference = (b.position_km - a.position_km) / (2.0 * half_d * base::units::DAY_S);
            assert!(difference.distance(m.velocity_km_s) < 1e-6 * m.velocity_km_s.length(), "{number}");
        }
    }

    #[test]
    fn a_damaged_table_is_refused() {
        for (at, what) in [(0, "magic"), (9, "version"), (200, "CRC"), (BYTES.len() - 1, "CRC")] {
            let mut bytes = BYTES.to_vec();
            bytes[at] ^= 0x10;
            let error = Table::read(bytes.leak()).expect_err("damaged").to_string();
            assert!(error.contains(what), "{at}: {error}");
        }
        for length in [0, 39, 40, 100, BYTES.len() - 1] {
            assert!(Table::read(&BYTES[..length]).is_err(), "{length}");
        }
    }
}
