//! A PSF that depends only on the distance from the star, and the functions needed to plan and draw it.
//!
//! A new one is a file beside this one that implements [`RoundPsf`] and passes `round_psf_checks`, a variant of
//! [`PsfModel`](crate::optics::PsfModel) and a value of `[psf] model`: every backend draws it from its table.

use core::fmt::Debug;

/// A round PSF: optics only, unit flux over the infinite plane.
pub trait RoundPsf: Debug + Send + Sync {
    /// Returns the irradiance at distance `r_px` from the star, share of the flux per square pixel.
    fn irradiance(&self, r_px: f64) -> f64;

    /// Returns the share of the light in the pixel whose centre lies (`x_px`, `y_px`) from the star, to 1e-12.
    fn pixel(&self, x_px: f64, y_px: f64) -> f64;

    /// Returns the share of the light outside a circle of `r_px`, at most 1: an upper bound beyond 7 times the core's
    /// sigma.
    fn lost_flux(&self, r_px: f64) -> f64;

    /// Returns the share of the light within a circle of `r_px`, to 1e-9.
    fn encircled_energy(&self, r_px: f64) -> f64;

    /// Returns the full width at half height, px.
    fn fwhm_px(&self) -> f64;

    /// Returns the standard deviation of the Gaussian with the same core, px.
    fn core_sigma_px(&self) -> f64;

    /// Returns the interpolation error of a cubic spline table of the pixel integral with `per_px` grid points per
    /// pixel, relative to the peak (upper bound).
    fn table_error(&self, per_px: f64) -> f64;

    /// Returns the step at which the light within a straight line is tabulated, px: linear interpolation has an error
    /// of `step^2 / 8` of the line-spread function's slope, which should be below 1e-4.
    fn line_step_px(&self) -> f64;
}
