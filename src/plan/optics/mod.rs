//! Point-spread function and radiometry.
//!
//! In: magnitude and colour, a PSF model. Out: electrons, and the share of a star's light in each pixel (f64, exact).
//! Fast forms of the pixel integral live with the backends that use them and are measured against this module.

pub mod airy;
pub mod background;
pub mod baffle;
pub mod band;
pub mod chain_light;
pub mod chain_psf;
pub mod energy;
pub mod gaussian;
pub mod halo;
pub mod illumination;
pub mod measured;
pub mod moffat;
pub mod mtf;
pub mod psf;
pub mod psf_field;
pub mod psf_grid;
pub mod quadrature;
pub mod radiometry;
pub mod round_psf;
#[cfg(test)]
pub(crate) mod round_psf_checks;
pub mod sky_brightness;
pub mod snr;
pub mod spectrum;
pub mod star_light;
pub mod star_spectrum;

pub use background::BackgroundLight;
pub use band::{Band, BandRadiometry, spectral_weights};
pub use illumination::Illumination;
pub use psf::{PsfForm, PsfModel};
pub use psf_field::PsfField;
pub use psf_grid::PsfGrid;
pub use radiometry::Radiometry;
pub use round_psf::RoundPsf;
pub use spectrum::{SpectralWeight, Spectrum, SpectrumError};
pub use star_light::{GreyMap, GreyScale, StarLight};
pub use star_spectrum::{StarSpectra, StarSpectrum};
