//! Time -> the Moon from the Earth, planets from the Sun: position and velocity, km and km/s, ICRF axes.
//!
//! Two methods, each with its domain:
//!
//! | method | domain | error against DE421 |
//! |---|---|---|
//! | [`Method::Table`]: Chebyshev polynomials fitted to JPL's DE421 | [`FIRST_DAY`] to [`LAST_DAY`]: 1989-12-28 to 2052-01-08 | 0.1 arcsec |
//! | [`Method::Series`]: [`crate::moon`]'s short series, VSOP87E | any time | 0.015 deg for the Moon, 2.5 arcsec for planets |
//!
//! The table is part of the program (0.5 MB) and made by `hil_scripts/generate/make_ephemeris_table.py`. A state costs below a
//! microsecond by the table and some milliseconds by VSOP87E, which [`crate::almanac`] evaluates; neither allocates.
//! Tests: below, `sky::moon`, `sky::planets`.
//!
//! The table, all numbers little-endian:
//!
//! | bytes | content |
//! |---|---|
//! | 0..8 | magic `STAREPH1` |
//! | 8..12 | u32 format version, 1 |
//! | 12..16 | u32 CRC-32 of the whole file, this field taken as zero |
//! | 16..32 | f64 x 2: first day, and day after the last, TDB since J2000 |
//! | 32..40 | u32 number of bodies; zero |
//! | then per body | u32 number, u32 place of its data, f64 days of a granule, f64 km of a step, u32 granules, u32 wide, u32 narrow, zero |
//! | data | per granule, and x, y, z: `wide` i32 and then `narrow` i16 coefficients of T0, T1, ..., in steps |
//!
//! A granule covers its days from -1 to 1. Everything that reading relies on is checked when the table is opened.
//!

use crate::state::BarycentricState;
use base::{refused::Refused, units::DAY_S};
use std::sync::OnceLock;

/// First day of the table, TDB since J2000.
pub const FIRST_DAY: f64 = -3_656.0;
/// Last day of the table, exclusive.
pub const LAST_DAY: f64 = 19_000.0;

static BYTES: &[u8] = include_bytes!("de421_1990_2052.table");
static TABLE: OnceLock<Result<Table, Refused>> = OnceLock::new();

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
pub fn check() -> Result<(), &'static Refused> {
    table().map(|_| ())
}

/// Returns the state of a body of the table by its number: 10 for the Moon (geocentric), 1 to 8 for planets
/// (heliocentric); `None` outside the table.
pub(super) fn state(number: u32, days: f64) -> Option<BarycentricState> {
    table().ok()?.state(number, days)
}

fn table() -> Result<&'static Table, &'static Refused> {
    TABLE.get_or_init(|| Table::read(BYTES)).as_ref()
}

fn short(bytes: &[u8], what: &str, wanted: usize) -> Refused {
    Refused(format!("ephemeris table: {what} wanted {wanted} bytes, got {got}", got = bytes.len()))
}

const MAGIC: &[u8; 8] = b"STAREPH1";
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 40;
const ROW_BYTES: usize = 40;
/// Offset of the checksum, bytes.
const CRC_AT: usize = 12;

/// A table whose bytes are sound.
#[derive(Debug)]
pub(super) struct Table {
    first_day: f64,
    last_day: f64,
    bodies: Vec<Row>,
}

/// One body.
#[derive(Debug)]
struct Row {
    number: u32,
    granule_d: f64,
    step_km: f64,
    wide: usize,
    narrow: usize,
    /// Its granules and nothing else.
    data: &'static [u8],
}

impl Table {
    /// Opens a table.
    pub(super) fn read(bytes: &'static [u8]) -> Result<Self, Refused> {
        let head = bytes.get(..HEAD_BYTES).ok_or_else(|| short(bytes, "the head", HEAD_BYTES))?;
        if !head.starts_with(MAGIC) {
            return Err(Refused(
                "ephemeris table: wanted the magic \"STAREPH1\", got other bytes; create it again with \
                 make_ephemeris_table.py"
                    .to_owned(),
            ));
        }
        match u32_at(head, 8) {
            VERSION => {}
            got => {
                return Err(Refused(format!(
                    "ephemeris table: wanted format version 1, got {got}; create it again with \
                     make_ephemeris_table.py"
                )));
            }
        }
        let mut crc = crc32fast::Hasher::new();
        for part in [&bytes[..CRC_AT], &[0; 4], &bytes[CRC_AT + 4..]] {
            crc.update(part);
        }
        let (wanted, got) = (u32_at(head, CRC_AT), crc.finalize());
        if got != wanted {
            return Err(Refused(format!(
                "ephemeris table: wanted CRC-32 {wanted:08x}, got {got:08x}: bytes were lost or changed"
            )));
        }
        let count = u32_at(head, 32) as usize;
        let rows = bytes.get(HEAD_BYTES..HEAD_BYTES + ROW_BYTES * count);
        let rows = rows.ok_or_else(|| short(bytes, "the rows", HEAD_BYTES + ROW_BYTES * count))?;
        let bodies = rows.chunks_exact(ROW_BYTES).map(|row| Row::read(row, bytes)).collect::<Result<_, _>>()?;
        Ok(Self { first_day: f64_at(head, 16), last_day: f64_at(head, 24), bodies })
    }

    /// Returns the state of a body; `None` for one that is not there, or outside the span.
    pub(super) fn state(&self, number: u32, days: f64) -> Option<BarycentricState> {
        if !(self.first_day..self.last_day).contains(&days) {
            return None;
        }
        let row = self.bodies.iter().find(|row| row.number == number)?;
        row.state(days - self.first_day)
    }
}

impl Row {
    fn read(row: &[u8], bytes: &'static [u8]) -> Result<Self, Refused> {
        let field = |at: usize| u32_at(row, at) as usize;
        let (begin, granules, wide, narrow) = (field(4), field(24), field(28), field(32));
        let end = begin + granules * granule_bytes(wide, narrow);
        let data = bytes.get(begin..end).ok_or_else(|| short(bytes, "the granules of a body", end))?;
        Ok(Self { number: u32_at(row, 0), granule_d: f64_at(row, 8), step_km: f64_at(row, 16), wide, narrow, data })
    }

    /// Returns the position and velocity so many days after the table's first.
    fn state(&self, days: f64) -> Option<BarycentricState> {
        let turn = days / self.granule_d;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "days of the span, not negative")]
        let granule = turn as usize;
        let x = 2.0 * (turn - granule as f64) - 1.0;
        let bytes = granule_bytes(self.wide, self.narrow);
        let data = self.data.get(granule * bytes..(granule + 1) * bytes)?;
        let mut state = BarycentricState::default();
        for (axis, data) in data.chunks_exact(bytes / 3).enumerate() {
            let (value, slope) = self.sum(data, x);
            state.position_km[axis] = value * self.step_km;
            state.velocity_km_s[axis] = slope * self.step_km * 2.0 / (self.granule_d * DAY_S);
        }
        Some(state)
    }

    /// Returns the sum of the polynomials and its derivative, in steps, by the recurrences of T and of T'.
    fn sum(&self, data: &[u8], x: f64) -> (f64, f64) {
        let (wide, narrow) = data.split_at(4 * self.wide);
        let wide = wide.chunks_exact(4).map(|b| f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let narrow = narrow.chunks_exact(2).map(|b| f64::from(i16::from_le_bytes([b[0], b[1]])));
        let (mut t, mut t_next) = (1.0, x);
        let (mut d, mut d_next) = (0.0, 1.0);
        let (mut value, mut slope) = (0.0, 0.0);
        for c in wide.chain(narrow) {
            value += c * t;
            slope += c * d;
            (t, t_next, d, d_next) = (t_next, 2.0 * x * t_next - t, d_next, 2.0 * t_next + 2.0 * x * d_next - d);
        }
        (value, slope)
    }
}

/// Returns bytes of a granule: three axes.
fn granule_bytes(wide: usize, narrow: usize) -> usize {
    3 * (4 * wide + 2 * narrow)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(core::array::from_fn(|i| bytes[at + i]))
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(core::array::from_fn(|i| bytes[at + i]))
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
                let moved_km = a.velocity_km_s * (2e-7 * DAY_S);
                assert!(b.position_km.distance(a.position_km + moved_km) < joint_km, "{number}");
            }
            let (day, half_d) = (FIRST_DAY + 0.37 * granule_d, 1e-4 * granule_d);
            let [a, m, b] = [-half_d, 0.0, half_d].map(|d| state(number, day + d).expect("inside"));
            let difference = (b.position_km - a.position_km) / (2.0 * half_d * DAY_S);
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
