//! The instrument as the planner sees it.

use crate::exposure::{motion::Shutter, sampling::PsfSampling};
use crate::optics::{Illumination, PsfModel};
use sky::astrometry::CameraGeometry;

/// The instrument as the planner sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Instrument {
    /// Projection and distortion.
    pub camera: CameraGeometry,
    /// How its rows are exposed.
    pub shutter: Shutter,
    /// PSF.
    pub psf: PsfModel,
    /// Method to compute pixel values from the PSF.
    pub sampling: PsfSampling,
    /// Relative illumination of the image plane: sources are multiplied by its value at their mid-exposure position.
    pub illumination: Illumination,
    /// Electrons at which a pixel saturates: errors above it are invisible.
    pub full_well_e: f64,
    /// Noise floor of a pixel, e-.
    pub read_noise_e_rms: f64,
}
