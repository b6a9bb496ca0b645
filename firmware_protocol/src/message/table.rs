//! Parameter tables of jitter, one cell per message. [`crate::tables`] collects them. Since protocol 1.1.

use crate::Reject;
use crate::bytes::{Reader, Writer};

/// A table of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Table {
    /// Sines of fixed frequency: [`crate::tables::LineRow`].
    Lines = 1,
    /// Breakpoints of a power spectral density: [`crate::tables::PsdRow`].
    Psd = 2,
    /// Harmonics of the reaction wheels' speeds: [`crate::tables::HarmonicRow`].
    WheelHarmonics = 3,
}

impl Table {
    /// Every table, in the order of the numbers.
    pub const ALL: [Self; 3] = [Self::Lines, Self::Psd, Self::WheelHarmonics];

    /// Returns the table of a number.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|table| table.number() == number)
    }

    /// Returns the number on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }

    /// Returns rows at most.
    pub const fn rows_max(self) -> u8 {
        match self {
            Self::Lines | Self::Psd => 32,
            Self::WheelHarmonics => 64,
        }
    }

    /// Columns.
    pub const fn columns(self) -> u8 {
        match self {
            Self::Lines => 5,
            Self::Psd => 4,
            Self::WheelHarmonics => 7,
        }
    }
}

/// `0x48n`, 8 bytes: one cell. Nothing changes until APPLY names the table.
///
/// | byte | field |
/// |---|---|
/// | 0 | table: 1 lines, 2 PSD, 3 wheel harmonics |
/// | 1 | row, from 0; below 32, 32, 64 |
/// | 2 | column, from 0; below 5, 4, 7 |
/// | 3 | reserved |
/// | 4..8 | value, f32, in the unit of the column |
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TableCell {
    /// Which table.
    pub table: Table,
    /// Row, from 0.
    pub row: u8,
    /// Column, from 0.
    pub column: u8,
    /// Value, in the unit of the column.
    pub value: f32,
}

impl TableCell {
    /// Returns whether the table has such a row and column.
    pub const fn exists(&self) -> bool {
        self.row < self.table.rows_max() && self.column < self.table.columns()
    }

    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.table.number()).u8(self.row).u8(self.column).u8(0).f32s(&[self.value]);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let [number, row, column, _] = from.take()?;
        let table = Table::from_number(number).ok_or(Reject::UnknownValue)?;
        let place = Self { table, row, column, value: 0.0 };
        if !place.exists() {
            return Err(Reject::UnknownValue);
        }
        let [value] = from.f32s()?;
        Ok(Self { value, ..place })
    }
}
