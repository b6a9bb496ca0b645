//! The last step: the image of the ADC -> the output image, binned digitally and cut to the window.
//!
//! On the host for both backends. When output and ADC's image are the same, nothing is copied.

use crate::detector::SpatialParams;
use crate::detector::binning::{Binning, BinningKind, bin_digital};
use crate::detector::window::{OutputGeometry, cut};
use base::{image::DnImage, region::Regions};

/// Geometry of the output image.
#[derive(Debug, Clone)]
pub struct Output {
    geometry: OutputGeometry,
    adc_px: [usize; 2],
    /// First pixel of the window in the ADC's image.
    first_px: [usize; 2],
    digital: Option<Binning>,
    /// The ADC's image where it is not the output itself.
    adc: Option<DnImage>,
}

impl Output {
    /// Returns the geometry for a sensor of this size.
    pub fn new(spatial: &SpatialParams, sensor_px: [usize; 2]) -> Self {
        let geometry = spatial.output(sensor_px);
        let adc_px = Binning::adc_size_px(spatial.binning, sensor_px);
        let digital = spatial.binning.filter(|binning| !matches!(binning.kind, BinningKind::Charge { .. }));
        let by = if digital.is_some() { 1 } else { geometry.binning.max(1) };
        let first_px = geometry.first_px.map(|first| (first / by) as usize);
        let same = digital.is_none() && geometry.size_px == adc_px;
        let adc = (!same).then(|| DnImage::new(adc_px[0], adc_px[1]));
        Self { geometry, adc_px, first_px, digital, adc }
    }

    /// Returns where the output's pixels are on the sensor.
    pub fn geometry(&self) -> OutputGeometry {
        self.geometry
    }

    /// Returns columns and rows of the ADC's image.
    pub fn adc_px(&self) -> [usize; 2] {
        self.adc_px
    }

    /// Returns regions of the output in pixels of the ADC's image.
    #[allow(clippy::cast_possible_truncation, reason = "sides of images")]
    pub fn adc_regions(&self, regions: &Regions) -> Regions {
        regions.enlarged(self.digital.map_or(1, |binning| binning.factor), self.first_px.map(|first| first as u32))
    }

    /// Returns the image that the ADC's numbers go to.
    pub fn adc_image<'a>(&'a mut self, out: &'a mut DnImage) -> &'a mut DnImage {
        self.adc.as_mut().unwrap_or(out)
    }

    /// Makes the output of the ADC's image.
    pub fn finish(&self, out: &mut DnImage) {
        let Some(adc) = &self.adc else { return };
        match self.digital {
            Some(Binning { factor, kind }) => {
                bin_digital(adc, factor, kind == BinningKind::DigitalMean, self.first_px, out);
            }
            None => cut(adc, self.first_px, out),
        }
    }
}
