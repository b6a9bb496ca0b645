//! Light of one wavelength, as a share of the detector's electrons: the effect of a band and a star's colour on the
//! PSF.

/// One wavelength of a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralWeight {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Share of the electrons that light near this wavelength makes; the shares of a band sum to 1.
    pub weight: f64,
}
