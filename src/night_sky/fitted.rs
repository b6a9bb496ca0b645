//! All that is fitted to one frame.

use crate::geometry::{Freedom, Geometry};
use crate::light_fit::{FittedBackground, FittedLight};
use crate::{measure::PixelNoise, psf_fit::FittedPsf, response::Response};
use plan::optics::illumination::Vignetting;

/// All that was fitted to a frame.
pub(crate) struct Fitted {
    pub geometry: Geometry,
    /// The terms that were fitted.
    pub freedom: Freedom,
    pub focal_error_px: f64,
    pub second_radial_error: f64,
    pub axis_errors_px: [f64; 2],
    pub stretch_error: f64,
    /// Rms distance of the stars above the SNR of ties along an axis without the stretch, px.
    pub rms_without_air_px: f64,
    pub psf: Option<FittedPsf>,
    pub light: Option<FittedLight>,
    pub vignetting: Option<Vignetting>,
    /// The vignetting is that of the stars, not of the background.
    pub is_lit_by_stars: bool,
    pub response: Option<Response>,
    pub background: FittedBackground,
    pub noise: PixelNoise,
    pub transfer: Option<[f64; 2]>,
}
