//! Flat images through a detector, and the moments of what comes out.

use base::image::{DnImage, ElectronImage, Image};
use image::detector::{Detector, DetectorConditions, DetectorParams};

/// Seed of every detector.
pub(crate) const SEED: u64 = 20_240_601;

/// A detector and the exposures it makes of flat light.
pub(crate) struct Flats {
    pub(crate) detector: Detector,
    pub(crate) warmer_k: f64,
    size_px: [usize; 2],
}

impl Flats {
    pub(crate) fn new(params: DetectorParams, size_px: [usize; 2]) -> Self {
        Self { detector: Detector::new(params, size_px[0], size_px[1], SEED), warmer_k: 0.0, size_px }
    }

    /// Returns one frame of so many electrons in every pixel: electrons by the detector's own gain and black level.
    pub(crate) fn frame_e(&mut self, electrons: f64, frame: u32, exposure_s: f64) -> Vec<f64> {
        let [width, height] = self.size_px;
        let mut mean: ElectronImage = Image::new(width, height);
        #[allow(clippy::cast_possible_truncation, reason = "electron images are f32")]
        mean.pixels_mut().fill(electrons as f32);
        let mut dn = DnImage::new(width, height);
        let conditions = DetectorConditions { warmer_k: self.warmer_k, ..DetectorConditions::dark(exposure_s) };
        self.detector.collect(&mean, frame, &conditions, &mut dn);
        let DetectorParams { gain_e_per_dn, black_level_dn, .. } = *self.detector.params();
        dn.pixels().iter().map(|dn| (f64::from(*dn) - black_level_dn) * gain_e_per_dn).collect()
    }

    /// Returns the mean of `frames` frames, pixel by pixel.
    pub(crate) fn averaged_e(&mut self, electrons: f64, frames: u32, exposure_s: f64) -> Vec<f64> {
        let mut sum = vec![0.0; self.size_px[0] * self.size_px[1]];
        for frame in 0..frames {
            let values = self.frame_e(electrons, frame, exposure_s);
            sum.iter_mut().zip(values).for_each(|(sum, e)| *sum += e / f64::from(frames));
        }
        sum
    }
}

pub(crate) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

pub(crate) fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Means of the rows of an image.
pub(crate) fn row_means(values: &[f64], width: usize) -> Vec<f64> {
    values.chunks_exact(width).map(mean).collect()
}

/// Means of the columns of an image.
pub(crate) fn column_means(values: &[f64], width: usize) -> Vec<f64> {
    let rows = (values.len() / width) as f64;
    (0..width).map(|x| values.iter().skip(x).step_by(width).sum::<f64>() / rows).collect()
}

/// Returns how many standard errors a variance is from the wanted one, of so many independent normal values.
pub(crate) fn variance_error(found: f64, wanted: f64, count: usize) -> f64 {
    (found / wanted - 1.0) / (2.0 / count as f64).sqrt()
}
