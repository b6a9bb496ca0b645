//! The part of the image that leaves the detector, and the size of its pixels.
//!
//! Three coordinates, all with the first pixel's centre at (0, 0): **sensor** pixels, in which light is drawn; pixels
//! of the **ADC's image**, smaller by charge binning; **output** pixels, smaller by digital binning and cut to the
//! window. A star at `s` on the sensor is in the output at `(s - first - (b - 1) / 2) / b`, where `b` is both binnings'
//! factor together and `first` the first sensor pixel of the window. The window is given in sensor pixels; it begins
//! and ends on whole output pixels. `tests/physics/detector_spatial.rs` compares the centroid of a star with this.

use base::{image::DnImage, region::Regions};

/// A part of the sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column, sensor pixels.
    pub left_px: u32,
    /// First row.
    pub top_px: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

/// From sensor pixels to output pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputGeometry {
    /// Sensor pixels of one output pixel, along each side.
    pub binning: u32,
    /// First sensor pixel, column and row.
    pub first_px: [u32; 2],
    /// Columns and rows of the output.
    pub size_px: [usize; 2],
    /// Whether a window was cut: light may lie outside it.
    pub is_cut: bool,
}

impl OutputGeometry {
    /// Returns the whole sensor, pixel by pixel.
    pub fn whole(size_px: [usize; 2]) -> Self {
        Self { binning: 1, first_px: [0; 2], size_px, is_cut: false }
    }

    /// Returns a window of a sensor whose pixels are summed by `binning` in all; a rest that does not fill a pixel is
    /// left out.
    pub fn new(sensor_px: [usize; 2], binning: u32, window: Option<Window>) -> Self {
        let by = binning.max(1) as usize;
        let Some(w) = window else {
            return Self { binning, ..Self::whole(sensor_px.map(|side| side / by)) };
        };
        let size_px = [w.width_px, w.height_px].map(|side| side as usize / by);
        Self { binning, first_px: [w.left_px, w.top_px], size_px, is_cut: true }
    }

    /// Returns a place on the sensor in output pixels.
    pub fn output_from_sensor(&self, sensor_px: [f64; 2]) -> [f64; 2] {
        let by = f64::from(self.binning);
        [0, 1].map(|axis| (sensor_px[axis] - f64::from(self.first_px[axis]) - 0.5 * (by - 1.0)) / by)
    }

    /// Returns the place on the sensor of a place in output pixels.
    pub fn sensor_from_output(&self, output_px: [f64; 2]) -> [f64; 2] {
        let by = f64::from(self.binning);
        [0, 1].map(|axis| output_px[axis] * by + f64::from(self.first_px[axis]) + 0.5 * (by - 1.0))
    }

    /// Returns regions of the output in sensor pixels.
    pub fn sensor_regions(&self, regions: &Regions) -> Regions {
        regions.enlarged(self.binning, self.first_px)
    }

    /// Returns true if the output is the sensor's image itself.
    pub fn is_whole(&self, sensor_px: [usize; 2]) -> bool {
        self.binning == 1 && self.first_px == [0; 2] && self.size_px == sensor_px
    }
}

/// Cuts `from` to the size of `to`, beginning at `first_px`.
pub fn cut(from: &DnImage, first_px: [usize; 2], to: &mut DnImage) {
    let (stride, width) = (from.width(), to.width());
    let [left, top] = first_px;
    for (y, row) in to.pixels_mut().chunks_exact_mut(width.max(1)).enumerate() {
        let start = (top + y) * stride + left;
        row.copy_from_slice(&from.pixels()[start..start + width]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_follow_the_pixels() {
        let window = Window { left_px: 100, top_px: 40, width_px: 64, height_px: 32 };
        let output = OutputGeometry::new([256, 256], 4, Some(window));
        assert_eq!(output.size_px, [16, 8]);
        // The first output pixel is sensor pixels 100..=103: its centre is 101.5.
        assert_eq!(output.output_from_sensor([101.5, 41.5]), [0.0, 0.0]);
        assert_eq!(output.sensor_from_output([1.0, 2.0]), [105.5, 41.5 + 8.0]);
        assert_eq!(output.output_from_sensor([105.5, 41.5 + 8.0]), [1.0, 2.0]);
        assert_eq!(OutputGeometry::whole([256, 256]).output_from_sensor([3.25, 7.5]), [3.25, 7.5]);
        assert!(OutputGeometry::new([256, 256], 1, None).is_whole([256, 256]));
        assert!(!output.is_whole([256, 256]));
        assert_eq!(OutputGeometry::new([256, 128], 2, None).size_px, [128, 64]);
    }

    #[test]
    fn windows_hold_their_part() {
        let mut from = DnImage::new(10, 8);
        (0_u16..).zip(from.pixels_mut()).for_each(|(i, dn)| *dn = i);
        let mut to = DnImage::new(3, 2);
        cut(&from, [4, 5], &mut to);
        assert_eq!(to.pixels(), [54, 55, 56, 64, 65, 66]);
        let mut all = DnImage::new(10, 8);
        cut(&from, [0, 0], &mut all);
        assert_eq!(all, from);
    }
}
