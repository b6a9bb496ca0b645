//! The instrument as the planner sees it.

use crate::exposure::motion::Shutter;
use crate::exposure::sampling::PsfSampling;
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
    /// How pixel values are had from it.
    pub sampling: PsfSampling,
    /// How the image plane is lit: sources are multiplied by its value where they stand at mid-exposure.
    pub illumination: Illumination,
    /// Electrons at which a pixel saturates: errors above it cannot be seen.
    pub full_well_e: f64,
    /// Noise floor of a pixel, e-.
    pub read_noise_e_rms: f64,
}
