//! One camera: all parameters from the light to the digital numbers.

use base::{refused::Refused, region::Regions};
use frames::sink::CameraFacts;
use image::detector::binning::{Binning, BinningKind};
use image::detector::{self, Detector, DetectorParams, Patterns, Seeds};
use image::detector::{pattern::PatternSizeError, readout::Levels, window::OutputGeometry};
use plan::exposure::cost::CostModel;
use plan::exposure::{Instrument, PsfSampling, Shutter};
use plan::optics::{BackgroundLight, Illumination, PsfModel, StarLight};
use sky::astrometry::CameraGeometry;
use std::sync::Arc;

/// One camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraParams {
    /// Name, for files and tables.
    pub name: Arc<str>,
    /// Projection and distortion.
    pub geometry: CameraGeometry,
    /// Exposure of the detector's rows.
    pub shutter: Shutter,
    /// PSF.
    pub psf: PsfModel,
    /// Method to compute pixel values from the PSF.
    pub sampling: PsfSampling,
    /// Relative illumination of the image plane.
    pub illumination: Illumination,
    /// Light on the detector besides the stars.
    pub background: BackgroundLight,
    /// Magnitude to electrons.
    pub radiometry: StarLight,
    /// Detector.
    pub detector: DetectorParams,
    /// Fixed patterns that were measured; the others are drawn from the run's seed.
    pub patterns: Patterns,
    /// Pitch of the pixels, um.
    pub pixel_pitch_um: f64,
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Faintest Gaia G magnitude that is drawn.
    pub limiting_mag: f32,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Readout time, s: a frame is due this long after its exposure ends.
    pub readout_s: f64,
}

impl CameraParams {
    /// Returns the number of bits of an image's values: the converter's, or more where values are summed.
    pub fn output_bits(&self) -> u32 {
        let summed = match self.detector.spatial.binning {
            Some(Binning { factor, kind: BinningKind::DigitalSum }) => factor * factor,
            _ => 1,
        };
        let largest = u32::from(self.detector.largest_dn()) * summed;
        u32::BITS - largest.leading_zeros()
    }

    /// Returns the detector with its patterns: the measured ones, and the others drawn from the sensor seed.
    ///
    /// # Errors
    /// When a measured pattern has another size than the detector.
    pub fn make_detector(&self, seeds: impl Into<Seeds>) -> Result<Detector, PatternSizeError> {
        let [width, height] = self.sensor_px();
        let made = Detector::new(self.detector, width, height, seeds);
        made.with_patterns(&self.patterns)
    }

    /// Returns facts that readers of its images need.
    pub fn facts(&self) -> CameraFacts {
        self.facts_of(&Levels::of_output(&self.detector))
    }

    /// Returns the same facts for an image with these levels.
    pub fn facts_of(&self, levels: &Levels) -> CameraFacts {
        let full_dn = levels.black_level_dn + levels.full_well_e / levels.gain_e_per_dn;
        CameraFacts {
            pixel_pitch_um: self.pixel_pitch_um,
            focal_length_mm: self.focal_length_mm,
            saturation_dn: full_dn.min(levels.largest_dn),
            read_noise_e_rms: levels.read_noise_e_rms,
            temperature_c: levels.temperature_c,
            drawn_to_mag_g: (f64::from(self.limiting_mag) * 100.0).round() / 100.0,
            colours: self.detector.spatial.output_colours(),
        }
    }

    /// Returns the camera in the form used by the planner.
    pub fn instrument(&self) -> Instrument {
        Instrument {
            camera: self.geometry,
            shutter: self.shutter,
            psf: self.psf.clone(),
            sampling: self.sampling,
            illumination: self.illumination,
            full_well_e: self.detector.full_well_e,
            read_noise_e_rms: self.detector.readout_noise_e_rms(),
        }
    }
}

impl CameraParams {
    /// Returns the columns and rows of the sensor, on which light is drawn.
    pub fn sensor_px(&self) -> [usize; 2] {
        [self.geometry.width_px(), self.geometry.height_px()]
    }

    /// Returns the positions on the sensor of the pixels of the output image, and its size.
    pub fn output(&self) -> OutputGeometry {
        self.detector.spatial.output(self.sensor_px())
    }

    /// Returns where the pixels of an image before the detector are on the sensor.
    pub fn whole_sensor(&self) -> OutputGeometry {
        OutputGeometry::whole(self.sensor_px())
    }

    /// Returns the predicted time of the detector, ms.
    pub fn predicted_readout_ms(&self, cost: &CostModel) -> f64 {
        let [width, height] = [self.geometry.width_px(), self.geometry.height_px()];
        cost.readout_ms(width * height) * detector::cost::factor(&self.detector, &self.patterns, width)
    }

    /// Returns the share of that time that these regions of the image take on a CPU.
    pub fn readout_share(&self, regions: &Regions) -> f64 {
        detector::cost::share_of(&self.detector, &self.output().sensor_regions(regions), self.sensor_px())
    }
}

/// A layer of stars could not be read.
pub(crate) fn stars(why: Refused) -> Refused {
    Refused(format!("stars: {why}"))
}

/// The observer's orbit could not be computed.
pub(crate) fn observer(why: Refused) -> Refused {
    Refused(format!("observer: {why}"))
}
