//! Bytes of the ephemeris table -> positions and velocities by Chebyshev polynomials.
//!
//! All numbers little-endian:
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
//! Source of the numbers: `hil_scripts/make_ephemeris_table.py`. Tests: `sky::ephemeris`.

use crate::state::BarycentricState;
use base::units::DAY_S;

const MAGIC: &[u8; 8] = b"STAREPH1";
const VERSION: u32 = 1;
const HEAD_BYTES: usize = 40;
const ROW_BYTES: usize = 40;
/// Offset of the checksum, bytes.
const CRC_AT: usize = 12;

/// Why a table was refused.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum TableError {
    /// It does not begin as it should.
    #[error(
        "ephemeris table: wanted the magic \"STAREPH1\", got other bytes; create it again with make_ephemeris_table.py"
    )]
    Magic,
    /// It is of another version.
    #[error("ephemeris table: wanted format version 1, got {got}; create it again with make_ephemeris_table.py")]
    Version {
        /// Version found.
        got: u32,
    },
    /// Its bytes have changed.
    #[error("ephemeris table: wanted CRC-32 {wanted:08x}, got {got:08x}: bytes were lost or changed")]
    Crc {
        /// Checksum in the file.
        wanted: u32,
        /// Checksum of the file.
        got: u32,
    },
    /// It ends too early, or its rows contradict it.
    #[error("ephemeris table: {what} wanted {wanted} bytes, got {got}")]
    Short {
        /// The part that does not fit.
        what: &'static str,
        /// Bytes it takes.
        wanted: usize,
        /// Bytes there are.
        got: usize,
    },
}

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
    pub(super) fn read(bytes: &'static [u8]) -> Result<Self, TableError> {
        let short = |what, wanted| TableError::Short { what, wanted, got: bytes.len() };
        let head = bytes.get(..HEAD_BYTES).ok_or_else(|| short("the head", HEAD_BYTES))?;
        if !head.starts_with(MAGIC) {
            return Err(TableError::Magic);
        }
        match u32_at(head, 8) {
            VERSION => {}
            got => return Err(TableError::Version { got }),
        }
        let mut crc = crc32fast::Hasher::new();
        for part in [&bytes[..CRC_AT], &[0; 4], &bytes[CRC_AT + 4..]] {
            crc.update(part);
        }
        let (wanted, got) = (u32_at(head, CRC_AT), crc.finalize());
        if got != wanted {
            return Err(TableError::Crc { wanted, got });
        }
        let count = u32_at(head, 32) as usize;
        let rows = bytes.get(HEAD_BYTES..HEAD_BYTES + ROW_BYTES * count);
        let rows = rows.ok_or_else(|| short("the rows", HEAD_BYTES + ROW_BYTES * count))?;
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
    fn read(row: &[u8], bytes: &'static [u8]) -> Result<Self, TableError> {
        let field = |at: usize| u32_at(row, at) as usize;
        let (begin, granules, wide, narrow) = (field(4), field(24), field(28), field(32));
        let end = begin + granules * granule_bytes(wide, narrow);
        let what = "the granules of a body";
        let data = bytes.get(begin..end).ok_or(TableError::Short { what, wanted: end, got: bytes.len() })?;
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
