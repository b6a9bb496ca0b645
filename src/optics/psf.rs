//! The PSF of a camera and its exact (f64) integral over a pixel.

use crate::optics::airy::Airy;
use crate::optics::gaussian;
use crate::optics::moffat::Moffat;
use crate::optics::psf_grid::PsfGrid;
use std::sync::Arc;

/// PSF model: optics only, unit flux over the infinite plane, 100 % fill factor.
#[derive(Debug, Clone, PartialEq)]
pub enum PsfModel {
    /// Circular Gaussian.
    Gaussian {
        /// Standard deviation, px.
        sigma_px: f64,
    },
    /// Diffraction at an annular pupil.
    Airy(Airy),
    /// A core with wings.
    Moffat(Moffat),
    /// Samples of the pixel integral, and the spline through them.
    Grid(Arc<PsfGrid>),
}

/// No footprint reaches further from its star than this, px: beyond it an Airy pattern's wings are given up and
/// reported as lost flux.
pub const LARGEST_HALF_PX: usize = 48;

impl PsfModel {
    /// A circular Gaussian.
    #[must_use]
    pub fn gaussian(sigma_px: f64) -> Self {
        Self::Gaussian { sigma_px }
    }

    /// An Airy pattern; see [`Airy::new`].
    #[must_use]
    pub fn airy(lambda_n_px: f64, obscuration: f64) -> Self {
        Self::Airy(Airy::new(lambda_n_px, obscuration))
    }

    /// A Moffat profile; see [`Moffat::new`].
    #[must_use]
    pub fn moffat(alpha_px: f64, beta: f64) -> Self {
        Self::Moffat(Moffat::new(alpha_px, beta))
    }

    /// Samples of the pixel integral.
    #[must_use]
    pub fn grid(grid: PsfGrid) -> Self {
        Self::Grid(Arc::new(grid))
    }

    /// Share of the light in the pixel whose centre lies (`x_px`, `y_px`) from the star.
    #[must_use]
    pub fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        match self {
            Self::Gaussian { sigma_px } => gaussian::cell(x_px, *sigma_px) * gaussian::cell(y_px, *sigma_px),
            Self::Airy(airy) => airy.pixel(x_px, y_px),
            Self::Moffat(moffat) => moffat.pixel(x_px, y_px),
            Self::Grid(grid) => grid.pixel(x_px, y_px),
        }
    }

    /// Largest share any pixel can receive (the star at its centre, where the PSF is symmetric).
    #[must_use]
    pub fn peak(&self) -> f64 {
        match self {
            Self::Grid(grid) => grid.peak(),
            _ => self.pixel(0.0, 0.0),
        }
    }

    /// Standard deviation of the Gaussian with the same core, px: the scale against which motion is short or long.
    /// Airy: 0.42 L / 1 matches the core to 3 % (Zhang et al. 2007); never used as an image of the PSF.
    #[must_use]
    pub fn core_sigma_px(&self) -> f64 {
        match self {
            Self::Gaussian { sigma_px } => *sigma_px,
            Self::Airy(airy) => 0.42 * airy.lambda_n_px(),
            Self::Moffat(moffat) => moffat.core_sigma_px(),
            Self::Grid(grid) => grid.core_sigma_px(),
        }
    }

    /// Share of the light outside a square footprint of half-width `half_px + 1/2` px (upper bound).
    #[must_use]
    pub fn lost_flux(&self, half_px: usize) -> f64 {
        match self {
            Self::Gaussian { sigma_px } => gaussian::lost_flux(half_px, *sigma_px),
            Self::Airy(airy) => airy.lost_flux((half_px as f64).max(0.5)).min(1.0),
            // The circle that the footprint holds wherever the star stands on its pixel.
            Self::Moffat(moffat) => moffat.lost_flux(half_px as f64),
            Self::Grid(grid) => grid.lost_flux(half_px),
        }
    }

    /// Smallest footprint half-width that loses no more than `flux_rel`, at most [`LARGEST_HALF_PX`] and a grid's own.
    #[must_use]
    pub fn half_px(&self, flux_rel: f64) -> usize {
        let most = match self {
            Self::Grid(grid) => grid.half_px(),
            _ => LARGEST_HALF_PX,
        };
        (1..most).find(|&half| self.lost_flux(half) <= flux_rel).unwrap_or(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_footprint_follows_the_flux_asked_for() {
        let psf = PsfModel::gaussian(0.8);
        let half = psf.half_px(1e-4);
        assert!(psf.lost_flux(half) <= 1e-4 && psf.lost_flux(half - 1) > 1e-4, "half {half}");
        assert_eq!(PsfModel::airy(1.0, 0.3).half_px(1e-4), LARGEST_HALF_PX, "Airy wings end at the cap");
    }
}
