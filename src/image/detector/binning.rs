//! Binning: squares of pixels become one, on the chip before the amplifier, or as digital numbers after the ADC.
//!
//! | kind | what is summed | noise |
//! |---|---|---|
//! | `charge` | charge, clipped at the full well of the summing node | read noise once per sum |
//! | `digital-sum` | digital numbers, clipped at 65535; the black level adds up too | read noise of every pixel |
//! | `digital-mean` | their mean, rounded, halves up | the same, divided |
//!
//! Source: Janesick 2001, section 5.2.4 (summing wells); EMVA 1288 R4.0, section 2 (noise of sums). The factor is the
//! same along rows and columns and divides both sides of the image. Tests: below and
//! `tests/physics/detector_spatial.rs`.

use crate::detector::Effect;
use crate::detector::effect_order::{FrameAt, NeighbourStage};
use base::image::{DnImage, Image};
use rayon::prelude::*;
use std::sync::Arc;

/// Largest factor.
pub const MOST: u32 = 8;

/// Stage at which pixels become one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BinningKind {
    /// The charge is summed on the chip.
    Charge {
        /// Charge that the summing node holds, e-.
        full_well_e: f64,
    },
    /// Digital numbers are summed.
    DigitalSum,
    /// Digital numbers are averaged.
    DigitalMean,
}

/// Binning of pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Binning {
    /// Pixels along each side, 2 to 8.
    pub factor: u32,
    /// Stage at which they are summed.
    pub kind: BinningKind,
}

impl Binning {
    /// Returns the size of the ADC's image of a sensor, pixels.
    pub fn adc_size_px(binning: Option<Self>, sensor_px: [usize; 2]) -> [usize; 2] {
        match binning {
            Some(Self { factor, kind: BinningKind::Charge { .. } }) => sensor_px.map(|side| side / factor as usize),
            _ => sensor_px,
        }
    }
}

/// Charge binning with the image it makes.
#[derive(Debug)]
pub struct ChargeBinningStage {
    factor: usize,
    full_well_e: f32,
    sums: Image<f32>,
}

impl ChargeBinningStage {
    /// Returns the binning of sensor images of this size; remaining rows and columns that fill no square are not read.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn new(factor: u32, full_well_e: f64, sensor_px: [usize; 2]) -> Self {
        let factor = factor.max(1) as usize;
        let [width, height] = sensor_px.map(|side| side / factor);
        Self { factor, full_well_e: full_well_e as f32, sums: Image::new(width, height) }
    }
}

impl NeighbourStage for ChargeBinningStage {
    fn effect(&self) -> Effect {
        Effect::Binning
    }

    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, _: &FrameAt) -> &'a mut Image<f32> {
        let (factor, full_well_e, stride) = (self.factor, self.full_well_e, charge.width());
        let width = self.sums.width().max(1);
        let rows = charge.pixels().par_chunks(stride.max(1) * factor);
        self.sums.pixels_mut().par_chunks_mut(width).zip(rows).for_each(|(sums, rows)| {
            sums.fill(0.0);
            // The order of `binning.wgsl`: row by row, pixel by pixel.
            for row in rows.chunks_exact(stride) {
                for (sum, pixels) in sums.iter_mut().zip(row.chunks_exact(factor)) {
                    *sum = pixels.iter().fold(*sum, |sum, e| sum + e);
                }
            }
            sums.iter_mut().for_each(|sum| *sum = sum.min(full_well_e));
        });
        &mut self.sums
    }
}

/// Returns a map of offsets for binned pixels, summed as the charge is.
pub fn sums_of_squares(map: &[f32], [width, height]: [usize; 2], factor: u32) -> Arc<[f32]> {
    let by = factor.max(1) as usize;
    let rows = |x: usize, y: usize| (0..by).map(move |dy| (y * by + dy) * width + x * by);
    let sum = |x: usize, y: usize| rows(x, y).flat_map(|at| &map[at..at + by]).sum();
    (0..height / by).flat_map(|y| (0..width / by).map(move |x| sum(x, y))).collect()
}

/// Bins digital numbers by `factor`, beginning at pixel `first_px` of `from`, into all of `to`.
pub fn bin_digital(from: &DnImage, factor: u32, is_mean: bool, first_px: [usize; 2], to: &mut DnImage) {
    let (by, stride, width) = (factor.max(1) as usize, from.width(), to.width().max(1));
    let count = (by * by) as u32;
    let [left, top] = first_px;
    to.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            let rows = (0..by).map(|dy| (top + y * by + dy) * stride + left + x * by);
            let sum: u32 = rows.map(|at| from.pixels()[at..at + by].iter().map(|dn| u32::from(*dn)).sum::<u32>()).sum();
            let value = if is_mean { (2 * sum + count) / (2 * count) } else { sum };
            *out = u16::try_from(value).unwrap_or(u16::MAX);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: FrameAt = FrameAt { frame: 0, exposure_s: 1.0, key: [0; 2] };

    fn ramp() -> Image<f32> {
        let mut image = Image::new(12, 8);
        (0_u16..).zip(image.pixels_mut()).for_each(|(i, e)| *e = f32::from(i));
        image
    }

    #[test]
    fn charge_sums_up_to_the_full_well() {
        for factor in [2_u32, 4] {
            let mut stage = ChargeBinningStage::new(factor, 1e6, [12, 8]);
            let mut image = ramp();
            let out = stage.apply(&mut image, &AT).clone();
            assert_eq!([out.width(), out.height()], [12 / factor as usize, 8 / factor as usize]);
            assert_eq!(out.pixels().iter().sum::<f32>(), 95.0 * 96.0 / 2.0, "all charge is there");
        }
        let mut stage = ChargeBinningStage::new(2, 100.0, [12, 8]);
        let mut image = ramp();
        let out = stage.apply(&mut image, &AT);
        assert_eq!(out.get(0, 0), Some(26.0), "0 + 1 + 12 + 13");
        assert_eq!(out.get(5, 0), Some(66.0), "10 + 11 + 22 + 23");
        assert_eq!(out.get(0, 3), Some(100.0), "clipped");
    }

    #[test]
    fn maps_sum_as_charge_does() {
        let map: Vec<f32> = ramp().pixels().to_vec();
        let mut stage = ChargeBinningStage::new(4, 1e6, [12, 8]);
        assert_eq!(*sums_of_squares(&map, [12, 8], 4), *stage.apply(&mut ramp(), &AT).pixels());
    }

    #[test]
    fn numbers_sum_and_average() {
        let mut from = DnImage::new(12, 8);
        (0_u16..).zip(from.pixels_mut()).for_each(|(i, dn)| *dn = i);
        let mut sums = DnImage::new(6, 4);
        bin_digital(&from, 2, false, [0, 0], &mut sums);
        assert_eq!(sums.get(5, 0), Some(66));
        bin_digital(&from, 2, true, [0, 0], &mut sums);
        assert_eq!(sums.get(0, 0), Some(7), "6.5 is rounded up");
        let mut cut = DnImage::new(2, 1);
        bin_digital(&from, 4, false, [4, 4], &mut cut);
        let by_hand: u16 = (4..8_u16).flat_map(|y| (4..8_u16).map(move |x| 12 * y + x)).sum();
        assert_eq!(cut.get(0, 0), Some(by_hand));
        from.pixels_mut().fill(60_000);
        bin_digital(&from, 2, false, [0, 0], &mut sums);
        assert_eq!(sums.get(0, 0), Some(u16::MAX), "clipped");
        bin_digital(&from, 2, true, [0, 0], &mut sums);
        assert_eq!(sums.get(0, 0), Some(60_000));
    }
}
