//! All that is fitted to one frame.

use crate::geometry::Geometry;
use crate::light_fit::{FittedBackground, FittedLight};
use crate::measure::PixelNoise;
use crate::psf_fit::FittedPsf;
use plan::optics::illumination::Vignetting;

/// All that was fitted to a frame.
pub(crate) struct Fitted {
    pub geometry: Geometry,
    pub focal_error_px: f64,
    pub stretch_error: f64,
    /// Rms distance of the stars above the SNR of ties along an axis without the stretch, px.
    pub rms_without_air_px: f64,
    pub psf: Option<FittedPsf>,
    pub light: Option<FittedLight>,
    pub vignetting: Option<Vignetting>,
    pub background: FittedBackground,
    pub noise: PixelNoise,
    pub transfer: Option<[f64; 2]>,
}
