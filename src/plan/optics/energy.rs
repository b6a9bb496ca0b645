//! Concentration of a star's light: encircled and ensquared energy, energy on one pixel, width at half height.
//!
//! In: a PSF model, lengths in px. Out: shares of the star's light (of all of it, over the infinite plane), px.
//! * [`encircled_energy`] and [`fwhm_px`] describe the *light* on the detector: Gaussian `1 - exp(-r^2 / 2 s^2)`, for a
//!   round PSF its own function. A grid of samples only contains the light as pixels *see* it, blurred by a pixel, and
//!   its results refer to that, as do those of a field for its middle. [`seen_encircled_energy`] and [`seen_fwhm_px`]
//!   do so for every model, and serve to compare models.
//! * [`ensquared_energy`] and [`energy_on_detector`] are sums of whole pixels, the same for every model.
//!
//! Errors below 1e-9 of the flux for closed forms and Airy, 1e-6 for light as pixels see it. Definitions: Strojnik,
//! Optical Engineering (2023), for energy on detector; ISO 15529 for the others. The tests compare closed forms with
//! sums.

use crate::optics::quadrature::{gauss_legendre, half_width, ringed};
use crate::optics::{PsfForm, PsfModel};
use base::bisection::bisected;
use core::f64::consts::{PI, TAU};

/// Position of the star on its pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Centring {
    /// On the pixel's centre: the largest share in a pixel.
    Centre,
    /// On the corner of four.
    Corner,
}

/// Returns the share of the light within `radius_px` of the star; for a grid and a field of the light as pixels see it.
pub fn encircled_energy(psf: &PsfModel, radius_px: f64) -> f64 {
    match psf.form() {
        PsfForm::Gaussian(sigma_px) => -(-0.5 * (radius_px / sigma_px).powi(2)).exp_m1(),
        PsfForm::Round(psf) => psf.encircled_energy(radius_px),
        PsfForm::Grid(_) | PsfForm::Field(_) => seen_encircled_energy(psf, radius_px),
    }
}

/// Returns the share of the light as pixels see it within `radius_px` of the star.
pub fn seen_encircled_energy(psf: &PsfModel, radius_px: f64) -> f64 {
    ringed(radius_px, 0.25, |r| around(psf, r))
}

/// Returns the integral of the light as pixels see it over the angle, at a distance.
fn around(psf: &PsfModel, r_px: f64) -> f64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few tens a pixel")]
    let steps = (24.0 + 12.0 * r_px).ceil().min(2000.0) as u32;
    let at = |k: u32| {
        let (sin, cos) = (TAU * (f64::from(k) + 0.5) / f64::from(steps)).sin_cos();
        psf.pixel(r_px * cos, r_px * sin)
    };
    (0..steps).map(at).sum::<f64>() * TAU / f64::from(steps)
}

/// Returns the share of the light in a square of `side_px` whole pixels with the star in its middle: for an odd side
/// the star is on a pixel's centre, for an even one on a corner.
pub fn ensquared_energy(psf: &PsfModel, side_px: usize) -> f64 {
    let middle = 0.5 * (side_px as f64 - 1.0);
    let at = |i: usize| i as f64 - middle;
    (0..side_px * side_px).map(|i| psf.pixel(at(i % side_px), at(i / side_px))).sum()
}

/// Returns the share of the light in the pixel with the star on its centre, or in one of the four around the star.
pub fn energy_on_detector(psf: &PsfModel, centring: Centring) -> f64 {
    match centring {
        Centring::Centre => psf.pixel(0.0, 0.0),
        Centring::Corner => psf.pixel(0.5, 0.5),
    }
}

/// Returns the full width at half height of the light, px, mean of x and y; for a grid and a field as pixels see it.
pub fn fwhm_px(psf: &PsfModel) -> f64 {
    match psf.form() {
        PsfForm::Gaussian(sigma_px) => 2.0 * (2.0 * core::f64::consts::LN_2).sqrt() * sigma_px,
        PsfForm::Round(psf) => psf.fwhm_px(),
        PsfForm::Grid(_) | PsfForm::Field(_) => seen_fwhm_px(psf),
    }
}

/// Returns the full width at half height of the light as pixels see it, px, mean of x and y.
pub fn seen_fwhm_px(psf: &PsfModel) -> f64 {
    let toward = |x: f64, y: f64| half_width(0.05, |r| psf.pixel(r * x, r * y));
    0.5 * (toward(1.0, 0.0) + toward(-1.0, 0.0) + toward(0.0, 1.0) + toward(0.0, -1.0))
}

/// Returns the radius of the circle with `share` of the light as pixels see it; `None` if it exceeds `most_px`.
pub fn seen_radius_px(psf: &PsfModel, share: f64, most_px: f64) -> Option<f64> {
    // Each ring is integrated once: the sum over the inner rings is kept.
    const STEP: f64 = 0.25;
    let (mut held, mut low) = (0.0, 0.0);
    while low < most_px {
        let ring = within_ring(psf, low, low + STEP);
        if held + ring >= share {
            return Some(bisected([low, low + STEP], 50, |r| held + within_ring(psf, low, r) - share < 0.0));
        }
        (held, low) = (held + ring, low + STEP);
    }
    None
}

fn within_ring(psf: &PsfModel, from_px: f64, to_px: f64) -> f64 {
    let (middle, width) = (0.5 * (from_px + to_px), to_px - from_px);
    let ring = |x: f64| (middle + width * x) * around(psf, middle + width * x);
    gauss_legendre(6).iter().map(|node| node.weight * width * ring(node.x)).sum()
}

/// Returns the radius of the first dark ring of a clear pupil, px: `1.22 lambda N` over the pitch.
pub fn airy_radius_px(lambda_n_px: f64) -> f64 {
    // First zero of J1 over pi.
    3.831_705_970_207_512 / PI * lambda_n_px
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::psf_grid::PsfGrid;

    #[test]
    fn airys_circles_are_rayleighs() {
        // EE(r) = 1 - J0(v)^2 - J1(v)^2, v = pi r / L.
        for l in [0.3, 1.0, 2.0] {
            let psf = PsfModel::airy(l, 0.0);
            for r in [0.4, 1.22 * l, 3.0, 12.0] {
                let v = PI * r / l;
                let exact = 1.0 - libm::j0(v).powi(2) - libm::j1(v).powi(2);
                let ours = encircled_energy(&psf, r);
                assert!((ours - exact).abs() < 1e-9, "L {l}, r {r}: {ours} against {exact}");
            }
        }
        assert!((encircled_energy(&PsfModel::airy(1.0, 0.0), airy_radius_px(1.0)) - 0.837_785).abs() < 1e-6, "83.8 %");
        // An obscuration moves light from the disc into the rings.
        assert!(encircled_energy(&PsfModel::airy(1.0, 0.3), airy_radius_px(1.0)) < 0.72, "obscured");
    }

    #[test]
    fn a_gaussians_pixels_are_products_of_erf() {
        let (psf, s) = (PsfModel::gaussian(0.8), 0.8);
        let within = |half: f64| libm::erf(half / (s * core::f64::consts::SQRT_2));
        for side in [1, 2, 3, 5] {
            let exact = within(0.5 * side as f64).powi(2);
            assert!((ensquared_energy(&psf, side) - exact).abs() < 1e-14, "{side} px");
        }
        assert!((energy_on_detector(&psf, Centring::Centre) - within(0.5).powi(2)).abs() < 1e-15, "centre");
        assert!((energy_on_detector(&psf, Centring::Corner) - 0.25 * within(1.0).powi(2)).abs() < 1e-15, "corner");
        assert!((encircled_energy(&psf, 1.3) - (1.0 - (-0.5 * (1.3_f64 / s).powi(2)).exp())).abs() < 1e-15, "circle");
        assert!((fwhm_px(&psf) / s - 2.354_820).abs() < 1e-6, "width");
    }

    #[test]
    fn widths_at_half_height_are_known_ones() {
        // Airy: 1.02899 L (half height of (2 J1(v) / v)^2 at v = 1.61634).
        assert!((fwhm_px(&PsfModel::airy(0.7, 0.0)) / 0.7 - 1.028_993).abs() < 1e-5, "Airy");
        assert!((fwhm_px(&PsfModel::moffat(1.0, 1.0 + 1e-9)) - 2.0).abs() < 1e-6, "a Lorentzian's half is at alpha");
        // A narrow star is as wide as its pixel.
        assert!((seen_fwhm_px(&PsfModel::gaussian(0.05)) - 1.0).abs() < 1e-6, "a pixel");
        assert!(seen_fwhm_px(&PsfModel::gaussian(0.8)) > fwhm_px(&PsfModel::gaussian(0.8)) + 0.1, "and a star");
    }

    #[test]
    fn seen_light_is_the_light_averaged_over_a_pixel() {
        let psf = PsfModel::gaussian(0.7);
        let brute = |radius: f64| -> f64 {
            // Sum of the star's light as pixels see it over fine cells within the circle.
            let n = 400;
            let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * 2.0 * radius - radius;
            let cell = (2.0 * radius / f64::from(n)).powi(2);
            let all = (0..n * n).map(|i| (at(i % n), at(i / n)));
            all.filter(|(x, y)| x * x + y * y < radius * radius).map(|(x, y)| psf.pixel(x, y) * cell).sum()
        };
        for radius in [0.8, 1.7] {
            let (ours, summed) = (seen_encircled_energy(&psf, radius), brute(radius));
            assert!((ours - summed).abs() < 1e-3, "r {radius}: {ours} against {summed}");
            assert!(ours < encircled_energy(&psf, radius), "a pixel blurs");
        }
        let grid = PsfModel::grid(PsfGrid::sampled(16, 6, |x, y| psf.pixel(x, y)).unwrap());
        let difference = seen_encircled_energy(&grid, 1.3) - seen_encircled_energy(&psf, 1.3);
        assert!(difference.abs() < 1e-6, "a grid of the same star: {difference}");
        assert_eq!(encircled_energy(&grid, 1.3), seen_encircled_energy(&grid, 1.3), "a grid knows what is seen");
        assert!((fwhm_px(&grid) - seen_fwhm_px(&psf)).abs() < 1e-5, "and its width");
    }

    #[test]
    fn the_radius_of_a_share_holds_that_share() {
        for psf in [PsfModel::gaussian(0.6), PsfModel::airy(1.2, 0.0), PsfModel::moffat(0.9, 3.0)] {
            let radius = seen_radius_px(&psf, 0.9, 40.0).unwrap();
            assert!((seen_encircled_energy(&psf, radius) - 0.9).abs() < 1e-7, "{radius}");
        }
        assert_eq!(seen_radius_px(&PsfModel::airy(1.0, 0.0), 0.999, 20.0), None, "its wings reach further");
    }
}
