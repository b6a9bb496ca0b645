//! Fixed patterns of columns and rows: electrons -> electrons.
//!
//! Column `c` is read as `e (1 + g_c) + o_c` (its amplifier's gain and offset), then row `r` adds `q_r`; `g`, `o`, `q`
//! normal with the parameters' rms, drawn once from the seed, the same in every frame. EMVA 1288 (release 4, section on
//! row and column non-uniformity) separates these variances from the pixels' own. Gains act after saturation and
//! nonlinearity, offsets do not depend on exposure.
//!
//! Tests: below, and `tests/physics/line_noise.rs`.

use crate::detector::{block::BLOCK, pattern::normal_map};
use base::{fused::mul_add, random::Stage};

/// Spread of columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinePattern {
    /// Offset of a column, e- rms.
    pub column_e_rms: f64,
    /// Gain of a column, rms share.
    pub column_gain_rms: f64,
    /// Offset of a row, e- rms.
    pub row_e_rms: f64,
}

impl LinePattern {
    /// All columns and rows alike.
    pub const OFF: Self = Self { column_e_rms: 0.0, column_gain_rms: 0.0, row_e_rms: 0.0 };

    /// Returns whether columns differ.
    pub fn has_columns(&self) -> bool {
        self.column_e_rms > 0.0 || self.column_gain_rms > 0.0
    }
}

/// The patterns of a detector, line by line; empty where off.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Lines {
    /// `1 + g` of every column.
    pub column_gain: Vec<f32>,
    /// Offset of every column, e-.
    pub column_e: Vec<f32>,
    /// Offset of every row, e-.
    pub row_e: Vec<f32>,
}

impl Lines {
    /// Draws the pattern from the seed.
    pub fn draw(pattern: &LinePattern, [width, height]: [usize; 2], seed: u64) -> Self {
        let mut made = Self::default();
        if pattern.has_columns() {
            let of_columns = |rms, stage| normal_map(width, rms, seed, stage).unwrap_or_else(|| vec![0.0; width]);
            made.column_gain = of_columns(pattern.column_gain_rms, Stage::ColumnGain);
            made.column_gain.iter_mut().for_each(|gain| *gain += 1.0);
            made.column_e = of_columns(pattern.column_e_rms, Stage::ColumnOffset);
        }
        made.row_e = normal_map(height, pattern.row_e_rms, seed, Stage::RowOffset).unwrap_or_default();
        made
    }

    /// Applies the columns' gains and offsets to a block that begins at pixel `first` of rows of `width`.
    #[inline(always)]
    pub fn apply_columns<const FUSED: bool>(&self, electrons: &mut [f32; BLOCK], first: usize, width: usize) {
        for_each_run(electrons, first, width, |run, _, column| {
            let lines = self.column_gain[column..].iter().zip(&self.column_e[column..]);
            run.iter_mut().zip(lines).for_each(|(e, (gain, offset))| *e = mul_add::<FUSED>(*e, *gain, *offset));
        });
    }
}

/// Adds a number to every row: `rows` e- by row, to a block that begins at pixel `first` of rows of `width`.
#[inline(always)]
pub fn add_rows(electrons: &mut [f32; BLOCK], rows: &[f32], first: usize, width: usize) {
    for_each_run(electrons, first, width, |run, row, _| {
        // The last block of an image reaches past its end.
        let offset = rows.get(row).copied().unwrap_or_default();
        run.iter_mut().for_each(|e| *e += offset);
    });
}

/// Calls `each` with every part of the block that lies in one row, its row and its first column.
#[inline(always)]
fn for_each_run(
    electrons: &mut [f32; BLOCK],
    first: usize,
    width: usize,
    mut each: impl FnMut(&mut [f32], usize, usize),
) {
    let (mut row, mut column, mut from) = (first / width, first % width, 0);
    while from < BLOCK {
        let to = BLOCK.min(from + width - column);
        each(&mut electrons[from..to], row, column);
        (row, column, from) = (row + 1, 0, to);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_gets_its_columns_and_its_rows_number() {
        let pattern = LinePattern { column_e_rms: 5.0, column_gain_rms: 0.01, row_e_rms: 3.0 };
        for [width, height] in [[301, 20], [7, 90], [1, 600], [256, 3], [1000, 1]] {
            let lines = Lines::draw(&pattern, [width, height], 3);
            assert_eq!([lines.column_gain.len(), lines.column_e.len(), lines.row_e.len()], [width, width, height]);
            for first in (0..width * height).step_by(BLOCK) {
                let mut block = core::array::from_fn(|i| 100.0 + i as f32);
                lines.apply_columns::<false>(&mut block, first, width);
                add_rows(&mut block, &lines.row_e, first, width);
                for i in (0..BLOCK).take_while(|i| first + i < width * height) {
                    let (x, y) = ((first + i) % width, (first + i) / width);
                    let wanted = (100.0 + i as f32) * lines.column_gain[x] + lines.column_e[x] + lines.row_e[y];
                    assert_eq!(block[i].to_bits(), wanted.to_bits(), "{width} x {height}, pixel {}", first + i);
                }
            }
        }
    }

    #[test]
    fn off_is_empty_and_parts_are_on_alone() {
        assert_eq!(Lines::draw(&LinePattern::OFF, [30, 20], 1), Lines::default());
        let offsets = Lines::draw(&LinePattern { column_e_rms: 2.0, ..LinePattern::OFF }, [30, 20], 1);
        assert!(offsets.column_gain.iter().all(|gain| *gain == 1.0) && offsets.row_e.is_empty());
        assert!(offsets.column_e.iter().any(|e| *e != 0.0));
    }
}
