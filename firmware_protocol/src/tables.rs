//! Parameter tables of jitter: cells of [`TableCell`] -> rows that hold, once APPLY has found them whole and legal.
//!
//! Angles are rotations of the body away from the smooth attitude, about body x, y and z.
//!
//! * [`LineRow`]: `amplitude sin(2 pi frequency SCET + phase)`;
//! * [`PsdRow`]: Gaussian noise of this one-sided density, straight in log-log between breakpoints, nothing outside the
//!   first and the last, nothing between two when one of them is zero; the seed of APPLY names the noise;
//! * [`HarmonicRow`]: `amplitude (|speed| / 1000 rpm)^exponent sin(harmonic angle + phase)`, where the angle of the wheel
//!   is the integral of the speeds in WHEELS.
//!
//! Limits: [`LINES_MAX`], [`PSD_MAX`], [`HARMONICS_MAX`] rows; frequencies to [`FREQUENCY_MAX_HZ`], amplitudes to
//! [`AMPLITUDE_MAX_ARCSEC`], harmonics to [`HARMONIC_MAX`], exponents to [`EXPONENT_MAX`], phases to one turn either way.
//! No allocation: a store has a fixed size, about 9 KiB. `tests/tables.rs` holds the rules.

use crate::crc::Crc16;
use crate::message::{Refusal, Table, TableCell};

/// Lines at most.
pub const LINES_MAX: usize = 32;
/// Breakpoints of the density at most.
pub const PSD_MAX: usize = 32;
/// Wheel harmonics at most.
pub const HARMONICS_MAX: usize = 64;
/// Highest frequency, Hz.
pub const FREQUENCY_MAX_HZ: f32 = 10_000.0;
/// Largest magnitude of an amplitude, arcsec: one degree.
pub const AMPLITUDE_MAX_ARCSEC: f32 = 3600.0;
/// Highest multiple of a wheel's speed.
pub const HARMONIC_MAX: f32 = 1000.0;
/// Highest exponent of a wheel's speed.
pub const EXPONENT_MAX: f32 = 4.0;
/// Largest magnitude of a phase, rad.
pub const PHASE_MAX_RAD: f32 = core::f32::consts::TAU;
/// Wheels in a WHEELS message.
const WHEELS: u8 = 4;

/// A sine of fixed frequency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineRow {
    /// Frequency, above zero.
    pub frequency_hz: f32,
    /// Amplitude about body x, y, z.
    pub amplitude_xyz_arcsec: [f32; 3],
    /// Phase at SCET 0.
    pub phase_rad: f32,
}

/// A breakpoint of the power spectral density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PsdRow {
    /// Frequency; rises from row to row, above zero.
    pub frequency_hz: f32,
    /// One-sided density about body x, y, z, arcsec^2/Hz, not negative.
    pub density_xyz_arcsec2_hz: [f32; 3],
}

/// A disturbance whose frequency is a multiple of a wheel's speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HarmonicRow {
    /// Wheel, 0 to 3.
    pub wheel: u8,
    /// Multiple of the wheel's speed, above zero.
    pub harmonic: f32,
    /// Amplitude about body x, y, z at 1000 rpm.
    pub amplitude_xyz_arcsec: [f32; 3],
    /// Exponent of `|speed| / 1000 rpm` in the amplitude, 0 to 4.
    pub exponent: f32,
    /// Phase at wheel angle 0.
    pub phase_rad: f32,
}

/// A typed row, and the columns of its values.
pub trait Row: Sized {
    /// The table of such rows.
    const TABLE: Table;
    /// Its values, one per column.
    type Cells: AsRef<[f32]>;

    /// Returns the values in the order of the columns.
    fn cells(&self) -> Self::Cells;
}

impl Row for LineRow {
    const TABLE: Table = Table::Lines;
    type Cells = [f32; 5];

    fn cells(&self) -> Self::Cells {
        let [x, y, z] = self.amplitude_xyz_arcsec;
        [self.frequency_hz, x, y, z, self.phase_rad]
    }
}

impl Row for PsdRow {
    const TABLE: Table = Table::Psd;
    type Cells = [f32; 4];

    fn cells(&self) -> Self::Cells {
        let [x, y, z] = self.density_xyz_arcsec2_hz;
        [self.frequency_hz, x, y, z]
    }
}

impl Row for HarmonicRow {
    const TABLE: Table = Table::WheelHarmonics;
    type Cells = [f32; 7];

    fn cells(&self) -> Self::Cells {
        let [x, y, z] = self.amplitude_xyz_arcsec;
        [f32::from(self.wheel), self.harmonic, x, y, z, self.exponent, self.phase_rad]
    }
}

/// Returns the messages that upload `rows`, row by row.
pub fn cells<R: Row>(rows: &[R]) -> impl Iterator<Item = TableCell> + '_ {
    let values_of = |row: &R, number: u8| {
        let values = row.cells();
        (0..R::TABLE.columns()).filter_map(move |column| {
            let value = values.as_ref().get(usize::from(column)).copied();
            value.map(|value| TableCell { table: R::TABLE, row: number, column, value })
        })
    };
    (0..R::TABLE.rows_max()).zip(rows).flat_map(move |(number, row)| values_of(row, number))
}

/// Returns the CRC-16 that APPLY carries: over all values, row by row, each as f32, little-endian.
pub fn crc<R: Row>(rows: &[R]) -> u16 {
    rows.iter().fold(Crc16::new(), |crc, row| over_values(crc, row.cells().as_ref())).value()
}

fn over_values(crc: Crc16, values: &[f32]) -> Crc16 {
    values.iter().fold(crc, |crc, value| crc.over(&value.to_le_bytes()))
}

/// Change made by APPLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Applied {
    /// The table.
    pub table: Table,
    /// Its rows; 0 after clearing.
    pub rows: u8,
}

/// Cells of one table as they come in, and the rows in effect.
#[derive(Debug, Clone, Copy)]
struct Sheet<const COLUMNS: usize, const ROWS: usize> {
    uploaded: [[Option<f32>; COLUMNS]; ROWS],
    effective: [[f32; COLUMNS]; ROWS],
    rows: usize,
}

impl<const COLUMNS: usize, const ROWS: usize> Sheet<COLUMNS, ROWS> {
    const EMPTY: Self = Self { uploaded: [[None; COLUMNS]; ROWS], effective: [[0.0; COLUMNS]; ROWS], rows: 0 };

    fn put(&mut self, cell: &TableCell) {
        let row = self.uploaded.get_mut(usize::from(cell.row));
        if let Some(slot) = row.and_then(|row| row.get_mut(usize::from(cell.column))) {
            *slot = Some(cell.value);
        }
    }

    fn in_effect(&self) -> &[[f32; COLUMNS]] {
        self.effective.get(..self.rows).unwrap_or(&[])
    }

    /// Makes the first `rows` rows effective, if all their cells are there, match the CRC, and are `legal`.
    fn apply(&mut self, rows: u8, crc: u16, legal: fn(&[[f32; COLUMNS]]) -> bool) -> Result<(), Refusal> {
        if rows == 0 {
            *self = Self::EMPTY;
            return Ok(());
        }
        let rows = usize::from(rows);
        let mut wanted = [[0.0; COLUMNS]; ROWS];
        let (to, from) = (wanted.get_mut(..rows), self.uploaded.get(..rows));
        let (to, from) = to.zip(from).ok_or(Refusal::TableValue)?;
        for (to, from) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
            *to = from.ok_or(Refusal::TableIncomplete)?;
        }
        if over_values(Crc16::new(), to.as_flattened()).value() != crc {
            return Err(Refusal::TableCrc);
        }
        if !legal(to) {
            return Err(Refusal::TableValue);
        }
        (self.effective, self.rows) = (wanted, rows);
        Ok(())
    }
}

/// The three tables: cells received, rows in effect.
#[derive(Debug, Clone, Copy)]
pub struct TableStore {
    lines: Sheet<5, LINES_MAX>,
    psd: Sheet<4, PSD_MAX>,
    harmonics: Sheet<7, HARMONICS_MAX>,
    psd_seed: u16,
}

impl Default for TableStore {
    fn default() -> Self {
        Self::new()
    }
}

impl TableStore {
    /// Returns the empty tables.
    pub const fn new() -> Self {
        Self { lines: Sheet::EMPTY, psd: Sheet::EMPTY, harmonics: Sheet::EMPTY, psd_seed: 0 }
    }

    /// Keeps a cell; it has no effect before APPLY. A cell outside its table (no decoder gives one) is left out.
    pub fn put(&mut self, cell: &TableCell) {
        match cell.table {
            Table::Lines => self.lines.put(cell),
            Table::Psd => self.psd.put(cell),
            Table::WheelHarmonics => self.harmonics.put(cell),
        }
    }

    /// Puts rows `0..rows` of a table into effect. Cells are kept, so that a change of a few needs only these and
    /// another APPLY. `rows` = 0 clears the table, received cells too, and looks at neither CRC nor seed.
    ///
    /// # Errors
    /// Why the rows in effect stay as they are: no such table or too many rows or an illegal value, a cell missing, or
    /// another CRC.
    pub fn apply(&mut self, table: u8, rows: u8, crc: u16, seed: u16) -> Result<Applied, Refusal> {
        let table = Table::from_number(table).ok_or(Refusal::TableValue)?;
        match table {
            Table::Lines => self.lines.apply(rows, crc, |rows| rows.iter().all(is_line))?,
            Table::Psd => {
                self.psd.apply(rows, crc, is_psd)?;
                self.psd_seed = if rows == 0 { 0 } else { seed };
            }
            Table::WheelHarmonics => self.harmonics.apply(rows, crc, |rows| rows.iter().all(is_harmonic))?,
        }
        Ok(Applied { table, rows })
    }

    /// Returns lines in effect.
    pub fn lines(&self) -> impl Iterator<Item = LineRow> + '_ {
        self.lines.in_effect().iter().map(|&[frequency_hz, x, y, z, phase_rad]| LineRow {
            frequency_hz,
            amplitude_xyz_arcsec: [x, y, z],
            phase_rad,
        })
    }

    /// Breakpoints of the density in effect, by rising frequency.
    pub fn psd(&self) -> impl Iterator<Item = PsdRow> + '_ {
        self.psd
            .in_effect()
            .iter()
            .map(|&[frequency_hz, x, y, z]| PsdRow { frequency_hz, density_xyz_arcsec2_hz: [x, y, z] })
    }

    /// Returns the seed of the noise of [`Self::psd`].
    pub const fn psd_seed(&self) -> u16 {
        self.psd_seed
    }

    /// Returns the wheel harmonics in effect.
    pub fn harmonics(&self) -> impl Iterator<Item = HarmonicRow> + '_ {
        self.harmonics.in_effect().iter().map(|&[wheel, harmonic, x, y, z, exponent, phase_rad]| HarmonicRow {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "0, 1, 2 or 3: checked by apply"
            )]
            wheel: wheel as u8,
            harmonic,
            amplitude_xyz_arcsec: [x, y, z],
            exponent,
            phase_rad,
        })
    }
}

fn is_frequency(frequency_hz: f32) -> bool {
    frequency_hz > 0.0 && frequency_hz <= FREQUENCY_MAX_HZ
}

fn are_within(values: &[f32], limit: f32) -> bool {
    values.iter().all(|value| value.abs() <= limit)
}

fn is_line(&[frequency_hz, x, y, z, phase_rad]: &[f32; 5]) -> bool {
    is_frequency(frequency_hz)
        && are_within(&[x, y, z], AMPLITUDE_MAX_ARCSEC)
        && are_within(&[phase_rad], PHASE_MAX_RAD)
}

/// Returns whether these are legal breakpoints: at least two, with rising frequencies.
fn is_psd(rows: &[[f32; 4]]) -> bool {
    let rises = rows.iter().zip(rows.iter().skip(1)).all(|([low, ..], [high, ..])| low < high);
    let is_point = |&[frequency_hz, x, y, z]: &[f32; 4]| {
        is_frequency(frequency_hz) && [x, y, z].iter().all(|density| *density >= 0.0 && density.is_finite())
    };
    rows.len() >= 2 && rises && rows.iter().all(is_point)
}

fn is_harmonic(&[wheel, harmonic, x, y, z, exponent, phase_rad]: &[f32; 7]) -> bool {
    let is_wheel = (0..WHEELS).any(|number| f32::from(number) == wheel);
    is_wheel
        && harmonic > 0.0
        && harmonic <= HARMONIC_MAX
        && (0.0..=EXPONENT_MAX).contains(&exponent)
        && are_within(&[x, y, z], AMPLITUDE_MAX_ARCSEC)
        && are_within(&[phase_rad], PHASE_MAX_RAD)
}
