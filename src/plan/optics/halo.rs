//! A Gaussian core in a wider Gaussian halo: a star with light scattered by the optics.
//!
//! `I(r) = (1 - h) G(r, sigma) + h G(r, sigma_halo)`, `G(r, s) = exp(-r^2 / 2 s^2) / (2 pi s^2)`; unit flux over the
//! infinite plane. Pixels are products of error functions, exact in f64. The double Gaussian of King, Publications of
//! the Astronomical Society of the Pacific 83 (1971), 199, without its aureole.

use crate::optics::{gaussian, psf_grid::BOTH_AXES, quadrature::half_width, round_psf::RoundPsf};
use core::f64::consts::TAU;

/// A core and its halo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Halo {
    /// Share of the light and standard deviation in px, of the core and of the halo.
    parts: [(f64, f64); 2],
}

impl Halo {
    /// Returns a PSF with `halo_share` of the light in a halo of `halo_sigma_px`, the rest in a core of `sigma_px`.
    pub fn new(sigma_px: f64, halo_sigma_px: f64, halo_share: f64) -> Self {
        Self { parts: [(1.0 - halo_share, sigma_px), (halo_share, halo_sigma_px)] }
    }

    /// Returns the sum of a function of the standard deviation over both parts, weighted by their light.
    fn sum(&self, of: impl Fn(f64) -> f64) -> f64 {
        self.parts.iter().map(|(share, sigma_px)| share * of(*sigma_px)).sum()
    }
}

impl RoundPsf for Halo {
    fn irradiance(&self, r_px: f64) -> f64 {
        self.sum(|sigma| (-0.5 * (r_px / sigma).powi(2)).exp() / (TAU * sigma * sigma))
    }

    fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        self.sum(|sigma| gaussian::cell(x_px, sigma) * gaussian::cell(y_px, sigma))
    }

    fn lost_flux(&self, r_px: f64) -> f64 {
        self.sum(|sigma| (-0.5 * (r_px / sigma).powi(2)).exp())
    }

    fn encircled_energy(&self, r_px: f64) -> f64 {
        1.0 - self.lost_flux(r_px)
    }

    fn fwhm_px(&self) -> f64 {
        2.0 * half_width(0.05 * self.core_sigma_px(), |r| self.irradiance(r))
    }

    /// Returns the standard deviation of the Gaussian with the same curvature at the peak, px.
    fn core_sigma_px(&self) -> f64 {
        (self.sum(|sigma| sigma.powi(-2)) / self.sum(|sigma| sigma.powi(-4))).sqrt()
    }

    /// Returns the sum of both parts' errors by their share of the peak; once for the table, and once for a kernel's
    /// displacement.
    fn table_error(&self, per_px: f64) -> f64 {
        let peak = |sigma| gaussian::cell(0.0, sigma).powi(2);
        BOTH_AXES * self.sum(|sigma| peak(sigma) * gaussian::table_error(sigma, per_px)) / self.sum(peak)
    }

    fn line_step_px(&self) -> f64 {
        1.0 / 32.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::round_psf_checks::agrees;

    #[test]
    fn its_answers_agree_with_its_irradiance() {
        agrees(&Halo::new(0.7, 3.0, 0.15));
        agrees(&Halo::new(1.2, 2.0, 0.4));
    }

    #[test]
    fn without_a_halo_it_is_the_gaussian() {
        let halo = Halo::new(0.8, 4.0, 0.0);
        assert!((halo.pixel(0.3, -1.1) - gaussian::cell(0.3, 0.8) * gaussian::cell(-1.1, 0.8)).abs() < 1e-15);
        assert!((halo.core_sigma_px() - 0.8).abs() < 1e-15 && (halo.fwhm_px() / 0.8 - 2.354_820).abs() < 1e-6);
        assert!((Halo::new(0.8, 4.0, 0.1).pixel(0.3, -1.1) - halo.pixel(0.3, -1.1)).abs() > 1e-3, "control");
    }
}
