//! The PSF of a camera and its properties: exact (f64) integral over a pixel, extent, widths, required table
//! resolution. Other files use it through these; where images are drawn differently they use its [`PsfForm`].

pub use crate::optics::psf_grid::LARGEST_HALF_PX;
use crate::optics::{
    airy::Airy, gaussian, halo::Halo, moffat::Moffat, psf_field::PsfField, psf_grid::PsfGrid, round_psf::RoundPsf,
};
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
    /// A Gaussian with a halo.
    Halo(Halo),
    /// Samples of the pixel integral, and the spline through them.
    Grid(Arc<PsfGrid>),
    /// A different PSF at every place of the detector.
    Field(Arc<PsfField>),
}

/// Form in which a PSF is drawn: the only cases that backends and the planner distinguish.
#[derive(Debug, Clone, Copy)]
pub enum PsfForm<'a> {
    /// A product of two error functions, by standard deviation in px.
    Gaussian(f64),
    /// A function of the distance from the star.
    Round(&'a dyn RoundPsf),
    /// A spline through samples.
    Grid(&'a PsfGrid),
    /// A blend of the PSFs at the nodes about the star.
    Field(&'a Arc<PsfField>),
}

impl PsfModel {
    /// Returns a circular Gaussian.
    pub fn gaussian(sigma_px: f64) -> Self {
        Self::Gaussian { sigma_px }
    }

    /// Returns an Airy pattern; see [`Airy::new`].
    pub fn airy(lambda_n_px: f64, obscuration: f64) -> Self {
        Self::Airy(Airy::new(lambda_n_px, obscuration))
    }

    /// Returns a Moffat profile; see [`Moffat::new`].
    pub fn moffat(alpha_px: f64, beta: f64) -> Self {
        Self::Moffat(Moffat::new(alpha_px, beta))
    }

    /// Returns a Gaussian with a halo; see [`Halo::new`].
    pub fn halo(sigma_px: f64, halo_sigma_px: f64, halo_share: f64) -> Self {
        Self::Halo(Halo::new(sigma_px, halo_sigma_px, halo_share))
    }

    /// Returns a PSF of samples of the pixel integral.
    pub fn grid(grid: PsfGrid) -> Self {
        Self::Grid(Arc::new(grid))
    }

    /// Returns a field of PSFs over the detector.
    pub fn field(field: PsfField) -> Self {
        Self::Field(Arc::new(field))
    }

    /// Returns the form in which it is drawn.
    pub fn form(&self) -> PsfForm<'_> {
        match self {
            Self::Gaussian { sigma_px } => PsfForm::Gaussian(*sigma_px),
            Self::Airy(airy) => PsfForm::Round(airy),
            Self::Moffat(moffat) => PsfForm::Round(moffat),
            Self::Halo(halo) => PsfForm::Round(halo),
            Self::Grid(grid) => PsfForm::Grid(grid),
            Self::Field(field) => PsfForm::Field(field),
        }
    }

    /// Returns true for a Gaussian, which needs no table.
    pub fn is_gaussian(&self) -> bool {
        matches!(self, Self::Gaussian { .. })
    }

    /// Returns the field, if the PSF depends on the place.
    pub fn as_field(&self) -> Option<&Arc<PsfField>> {
        if let Self::Field(field) = self { Some(field) } else { None }
    }

    /// Returns the PSFs that form this one: itself, or those at the nodes of a field.
    pub fn nodes(&self) -> &[Self] {
        self.as_field().map_or(core::slice::from_ref(self), |field| field.nodes())
    }

    /// Returns the number of PSFs from which one star is drawn.
    pub fn blended(&self) -> usize {
        if self.as_field().is_some() { 4 } else { 1 }
    }

    /// Returns the PSFs among [`Self::nodes`] that form that of a place, and their shares.
    pub fn around(&self, px: [f64; 2]) -> [(usize, f64); 4] {
        self.as_field().map_or([(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)], |field| field.around(px))
    }

    /// Returns the share of the light in the pixel whose centre lies (`x_px`, `y_px`) from a star at `star_px`.
    pub fn pixel_of(&self, star_px: [f64; 2], x_px: f64, y_px: f64) -> f64 {
        self.as_field().map_or_else(|| self.pixel(x_px, y_px), |field| field.pixel(star_px, x_px, y_px))
    }

    /// Returns the share of the light in the pixel whose centre lies (`x_px`, `y_px`) from the star, which in a field
    /// is in the middle of the detector.
    pub fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        match self.form() {
            PsfForm::Gaussian(sigma_px) => gaussian::cell(x_px, sigma_px) * gaussian::cell(y_px, sigma_px),
            PsfForm::Round(psf) => psf.pixel(x_px, y_px),
            PsfForm::Grid(grid) => grid.pixel(x_px, y_px),
            PsfForm::Field(field) => field.pixel(field.middle_px(), x_px, y_px),
        }
    }

    /// Returns the largest share any pixel can receive (the star at its centre, where the PSF is symmetric), anywhere
    /// in a field.
    pub fn peak(&self) -> f64 {
        match self.form() {
            PsfForm::Grid(grid) => grid.peak(),
            PsfForm::Field(field) => field.nodes().iter().map(Self::peak).fold(0.0, f64::max),
            PsfForm::Gaussian(_) | PsfForm::Round(_) => self.pixel(0.0, 0.0),
        }
    }

    /// Returns the standard deviation of the Gaussian with the same core, px: the scale for the length of a motion.
    pub fn core_sigma_px(&self) -> f64 {
        match self.form() {
            PsfForm::Gaussian(sigma_px) => sigma_px,
            PsfForm::Round(psf) => psf.core_sigma_px(),
            PsfForm::Grid(grid) => grid.core_sigma_px(),
            // The sharpest: limits derived from it also suit the others.
            PsfForm::Field(field) => field.nodes().iter().map(Self::core_sigma_px).fold(f64::INFINITY, f64::min),
        }
    }

    /// Returns the share of the light outside a square footprint of half-width `half_px + 1/2` px (upper bound).
    pub fn lost_flux(&self, half_px: usize) -> f64 {
        match self.form() {
            PsfForm::Gaussian(sigma_px) => gaussian::lost_flux(half_px, sigma_px),
            // The circle inside the footprint for any position of the star on its pixel.
            PsfForm::Round(psf) => psf.lost_flux(half_px as f64),
            PsfForm::Grid(grid) => grid.lost_flux(half_px),
            PsfForm::Field(field) => field.nodes().iter().map(|node| node.lost_flux(half_px)).fold(0.0, f64::max),
        }
    }

    /// Returns the footprint half-width that contains all light within double precision, for a PSF that ends there: a
    /// Gaussian of any width; other PSFs are cut as by [`Self::half_px`].
    pub fn whole_half_px(&self) -> usize {
        /// Largest light loss.
        const LOST_FLUX: f64 = 1e-13;
        /// Half-width of a Gaussian, sigma.
        const GAUSSIAN_SIGMAS: f64 = 8.0;
        match self.form() {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a PSF is narrower than a detector"
            )]
            PsfForm::Gaussian(sigma_px) => (GAUSSIAN_SIGMAS * sigma_px).ceil().max(0.0) as usize + 1,
            PsfForm::Round(_) | PsfForm::Grid(_) | PsfForm::Field(_) => self.half_px(LOST_FLUX),
        }
    }

    /// Returns the smallest footprint half-width that loses no more than `flux_rel`, at most [`LARGEST_HALF_PX`] and a
    /// grid's own.
    pub fn half_px(&self, flux_rel: f64) -> usize {
        let most = match self.form() {
            PsfForm::Grid(grid) => grid.half_px(),
            PsfForm::Field(field) => return field.nodes().iter().map(|node| node.half_px(flux_rel)).max().unwrap_or(1),
            PsfForm::Gaussian(_) | PsfForm::Round(_) => LARGEST_HALF_PX,
        };
        (1..most).find(|&half| self.lost_flux(half) <= flux_rel).unwrap_or(most)
    }

    /// Returns the interpolation error of a cubic spline table with `per_px` grid points per pixel, relative to the
    /// peak.
    pub fn table_error(&self, per_px: f64) -> f64 {
        match self.form() {
            PsfForm::Gaussian(sigma_px) => gaussian::table_error(sigma_px, per_px),
            PsfForm::Round(psf) => psf.table_error(per_px),
            PsfForm::Grid(grid) => grid.table_error(per_px),
            PsfForm::Field(field) => field.nodes().iter().map(|node| node.table_error(per_px)).fold(0.0, f64::max),
        }
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
