//! Boxes and masks of targets: the pixels in which a target's own light is above the noise.
//!
//! In: the mean electrons of one target drawn alone, sensor pixel by sensor pixel, and the noise of a pixel without it. Out:
//! the output pixels in which its light is at least `mask_snr` times that noise, their bounding box and their run lengths in
//! the order of COCO (column by column). A target that is below that everywhere has the box of its brightest pixel and no
//! mask. Tests: below.

use image::detector::window::OutputGeometry;
use serde::Serialize;

/// Box and mask of one target.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outline {
    /// Identifier in the truth.
    pub id: u32,
    /// First column, first row, columns, rows.
    pub box_px: [usize; 4],
    /// Pixels of the mask.
    pub area_px: usize,
    /// Lengths of runs outside and inside the mask by turns, column by column.
    pub runs: Vec<usize>,
}

impl Outline {
    /// Returns the outline of a target that is drawn alone; `None` when no light of it is on the output.
    pub fn of(id: u32, mean_e: &Mean<'_>, output: &OutputGeometry, threshold_e: f64) -> Option<Self> {
        let [columns, rows] = output.size_px;
        let (mut runs, mut is_inside, mut run, mut area_px) = (Vec::new(), false, 0, 0);
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        let (mut brightest_e, mut brightest_px) = (0.0, [0; 2]);
        for x in 0..columns {
            for y in 0..rows {
                let electrons = mean_e.of_output(output, [x, y]);
                if electrons > brightest_e {
                    (brightest_e, brightest_px) = (electrons, [x, y]);
                }
                let is_target = electrons >= threshold_e;
                if is_target != is_inside {
                    runs.push(core::mem::take(&mut run));
                    is_inside = is_target;
                }
                run += 1;
                if is_target {
                    area_px += 1;
                    low = [low[0].min(x), low[1].min(y)];
                    high = [high[0].max(x), high[1].max(y)];
                }
            }
        }
        runs.push(run);
        if brightest_e <= 0.0 {
            return None;
        }
        if area_px == 0 {
            (low, high) = (brightest_px, brightest_px);
        }
        let box_px = [low[0], low[1], high[0] - low[0] + 1, high[1] - low[1] + 1];
        Some(Self { id, box_px, area_px, runs })
    }
}

/// Mean electrons of a sensor.
#[derive(Debug, Clone, Copy)]
pub struct Mean<'a> {
    /// Row by row from the top.
    pub electrons: &'a [f32],
    /// Columns of the sensor.
    pub width_px: usize,
}

impl Mean<'_> {
    /// Returns the electrons of one output pixel.
    fn of_output(&self, output: &OutputGeometry, [x, y]: [usize; 2]) -> f64 {
        let by = output.binning.max(1) as usize;
        let [first_x, first_y] = output.first_px.map(|first| first as usize);
        let rows = (0..by).map(|row| (first_y + y * by + row) * self.width_px + first_x + x * by);
        rows.map(|at| self.electrons[at..at + by].iter().map(|e| f64::from(*e)).sum::<f64>()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A light of 10 electrons in columns 2 to 3 and row 1 of 5 by 4 pixels.
    const LIGHT: [f32; 20] = {
        let mut light = [0.0; 20];
        light[7] = 10.0;
        light[8] = 10.0;
        light[9] = 0.5;
        light
    };

    fn outline(threshold_e: f64, output: &OutputGeometry) -> Option<Outline> {
        Outline::of(7, &Mean { electrons: &LIGHT, width_px: 5 }, output, threshold_e)
    }

    #[test]
    fn box_and_runs_are_those_of_the_light() {
        let whole = OutputGeometry::whole([5, 4]);
        let found = outline(1.0, &whole).unwrap();
        assert_eq!((found.box_px, found.area_px), ([2, 1, 2, 1], 2));
        assert_eq!(found.runs, [9, 1, 3, 1, 6], "columns of four");
        assert_eq!(outline(0.1, &whole).unwrap().box_px, [2, 1, 3, 1], "control: fainter light belongs to it");
    }

    #[test]
    fn faint_target_has_a_box_and_no_mask_and_one_outside_has_nothing() {
        let faint = outline(100.0, &OutputGeometry::whole([5, 4])).unwrap();
        assert_eq!((faint.box_px, faint.area_px, faint.runs), ([2, 1, 1, 1], 0, vec![20]));
        let window = OutputGeometry { first_px: [0, 2], size_px: [5, 2], ..OutputGeometry::whole([5, 4]) };
        assert_eq!(outline(1.0, &window), None);
    }

    #[test]
    fn binned_pixels_have_the_sum_of_their_light() {
        let binned = OutputGeometry { binning: 2, size_px: [2, 2], ..OutputGeometry::whole([5, 4]) };
        let found = outline(15.0, &binned).unwrap();
        assert_eq!((found.box_px, found.area_px), ([1, 0, 1, 1], 1), "20 electrons in one pixel");
    }
}
