//! Moffat profile, integrated over square pixels: a core with the wings of a real telescope.
//!
//! `I(r) = (beta - 1) / (pi alpha^2) [1 + (r / alpha)^2]^-beta`, alpha px, beta > 1; unit flux over the infinite plane.
//! Source: Moffat, Astronomy and Astrophysics 3 (1969), 455; the light outside a circle of r is
//! `[1 + (r / alpha)^2]^(1 - beta)`. The pixel integral is a tensor Gauss-Legendre rule: the profile is analytic but for `r = +- i alpha`, so n
//! nodes err by some times `(2 alpha + sqrt(4 alpha^2 + 1))^-2n`, and n is taken for 1e-15 of that: the error is below
//! 1e-12 of the flux (`alpha >= 0.25` px, `beta <= 5`). Tests below hold it to sums over finer cells and to the closed
//! form.

use crate::optics::quadrature::{Node, gauss_legendre, over_pixel};
use crate::optics::{psf_grid::BOTH_AXES, round_psf::RoundPsf};
use core::f64::consts::PI;

/// A Moffat profile on a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Moffat {
    alpha_px: f64,
    beta: f64,
    nodes: Vec<Node>,
    fourth_derivative: f64,
}

/// Error to which the number of nodes reduces the power above.
const PIXEL_ERROR: f64 = 1e-15;
/// Step for derivatives of the pixel integral, in units of the scale of its core.
const DERIVATIVE_STEP: f64 = 0.05;

impl Moffat {
    /// Returns a profile. `alpha_px`: scale of the core; `beta` > 1: steepness of the wings.
    pub fn new(alpha_px: f64, beta: f64) -> Self {
        let convergence = 2.0 * alpha_px + (4.0 * alpha_px * alpha_px + 1.0).sqrt();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive number")]
        let n = (-0.5 * PIXEL_ERROR.ln() / convergence.ln()).ceil().clamp(4.0, 64.0) as usize;
        let mut moffat = Self { alpha_px, beta, nodes: gauss_legendre(n), fourth_derivative: 0.0 };
        moffat.fourth_derivative = moffat.largest_fourth_derivative();
        moffat
    }

    /// Returns the profile with this width at half its height, px: `2 alpha sqrt(2^(1 / beta) - 1)`.
    pub fn of_fwhm(fwhm_px: f64, beta: f64) -> Self {
        Self::new(0.5 * fwhm_px / (2.0_f64.powf(1.0 / beta) - 1.0).sqrt(), beta)
    }

    /// Returns the largest fourth derivative of the pixel integral along an axis through the star, relative to the
    /// peak, 1 / px^4.
    fn largest_fourth_derivative(&self) -> f64 {
        const POINTS: u32 = 120;
        let step = DERIVATIVE_STEP * self.core_sigma_px().hypot(0.3);
        let profile: Vec<f64> = (0..POINTS + 2).map(|i| self.pixel(f64::from(i) * step, 0.0)).collect();
        // Symmetric about the star.
        let at = |i: i64| profile[usize::try_from(i.abs()).unwrap_or(0)];
        let fourth = |i: i64| at(i - 2) - 4.0 * at(i - 1) + 6.0 * at(i) - 4.0 * at(i + 1) + at(i + 2);
        let most = (0..i64::from(POINTS) - 1).map(|i| fourth(i).abs()).fold(0.0, f64::max);
        most / (step.powi(4) * profile[0])
    }
}

impl RoundPsf for Moffat {
    fn irradiance(&self, r_px: f64) -> f64 {
        let u = r_px / self.alpha_px;
        (self.beta - 1.0) / (PI * self.alpha_px * self.alpha_px) * (1.0 + u * u).powf(-self.beta)
    }

    fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        over_pixel(&self.nodes, [x_px, y_px], |r_px| self.irradiance(r_px))
    }

    fn lost_flux(&self, r_px: f64) -> f64 {
        let u = r_px / self.alpha_px;
        (1.0 + u * u).powf(1.0 - self.beta)
    }

    fn encircled_energy(&self, r_px: f64) -> f64 {
        1.0 - self.lost_flux(r_px)
    }

    fn fwhm_px(&self) -> f64 {
        2.0 * self.alpha_px * (2.0_f64.powf(1.0 / self.beta) - 1.0).sqrt()
    }

    /// Returns the standard deviation of the Gaussian with the same curvature at the peak, px: `alpha / sqrt(2 beta)`.
    fn core_sigma_px(&self) -> f64 {
        self.alpha_px / (2.0 * self.beta).sqrt()
    }

    /// Returns the table error: one part for the table, and one for the displacement by a kernel.
    fn table_error(&self, per_px: f64) -> f64 {
        2.0 * BOTH_AXES * self.fourth_derivative / (384.0 * per_px.powi(4))
    }

    fn line_step_px(&self) -> f64 {
        1.0 / 32.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_answers_agree_with_its_irradiance() {
        crate::optics::round_psf_checks::agrees(&Moffat::new(0.7, 2.5));
        crate::optics::round_psf_checks::agrees(&Moffat::new(1.5, 4.765));
    }

    #[test]
    fn pixels_are_the_integral_of_the_profile() {
        for (alpha, beta) in [(0.25, 1.5), (0.7, 2.5), (1.5, 4.765)] {
            let moffat = Moffat::new(alpha, beta);
            for (x, y) in [(0.0, 0.0), (0.5, -0.5), (0.31, 2.2), (-7.0, 3.0)] {
                // Sixteen cells along each side, eight nodes in each.
                let (cells, nodes) = (16, gauss_legendre(8));
                let mut sum = 0.0;
                for i in 0..cells * cells {
                    let at = |k: i32| (f64::from(k) + 0.5) / f64::from(cells) - 0.5;
                    for (a, b) in nodes.iter().flat_map(|a| nodes.iter().map(move |b| (a, b))) {
                        let (dx, dy) = (at(i % cells) + a.x / f64::from(cells), at(i / cells) + b.x / f64::from(cells));
                        let r2 = ((x + dx).powi(2) + (y + dy).powi(2)) / (alpha * alpha);
                        sum += a.weight * b.weight * (1.0 + r2).powf(-beta);
                    }
                }
                let wanted = sum * (beta - 1.0) / (PI * alpha * alpha) / f64::from(cells * cells);
                let got = moffat.pixel(x, y);
                assert!((got - wanted).abs() < 1e-12, "alpha {alpha}, beta {beta}, ({x}, {y}): {got} {wanted}");
            }
        }
    }

    #[test]
    fn wings_hold_what_the_closed_form_says() {
        let moffat = Moffat::new(0.9, 2.5);
        let half = 30_i32;
        let inside: f64 = (-half..=half)
            .flat_map(|y| (-half..=half).map(move |x| (x, y)))
            .filter(|(x, y)| f64::from(x * x + y * y) <= f64::from(half * half))
            .map(|(x, y)| moffat.pixel(f64::from(x), f64::from(y)))
            .sum();
        // A disc made of pixels is as large as the circle except for its rim.
        let (lost, reported) = (1.0 - inside, moffat.lost_flux(f64::from(half)));
        assert!((lost / reported - 1.0).abs() < 0.02, "{lost:e} against {reported:e}");
    }

    #[test]
    fn the_width_at_half_height_is_the_one_asked_for() {
        let moffat = Moffat::of_fwhm(2.4, 3.0);
        assert!((moffat.irradiance(1.2) / moffat.irradiance(0.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn the_fourth_derivative_is_that_of_a_wide_profile() {
        // A pixel is small relative to alpha = 6: 12 beta (beta + 1) / alpha^4 of the peak.
        let moffat = Moffat::new(6.0, 2.0);
        let wanted = 72.0 / 6.0_f64.powi(4);
        assert!((moffat.fourth_derivative / wanted - 1.0).abs() < 0.1, "{} {wanted}", moffat.fourth_derivative);
    }
}
