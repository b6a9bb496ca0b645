//! Blur with a Gaussian profile: errors of assembly and of fabrication, and any blur known by its width only.
//!
//! Frequency -> factor `exp(-2 pi^2 s^2 f^2)`, the transform of a Gaussian of standard deviation `s` (px, one axis);
//! `f` in cycles/px, its magnitude in two dimensions. Source: Holst, Electro-Optical Imaging System Performance, 5th
//! ed. Two such blurs are one of `sqrt(s1^2 + s2^2)`. The test integrates the Gaussian.

use core::f64::consts::PI;

/// Returns the factor at `frequency` (cycles/px) of a blur of standard deviation `sigma_px`.
pub fn mtf(frequency: f64, sigma_px: f64) -> f64 {
    (-2.0 * (PI * sigma_px * frequency).powi(2)).exp()
}

/// Returns the frequency above which the factor is below `least`, cycles/px.
pub fn cutoff(sigma_px: f64, least: f64) -> f64 {
    (-0.5 * least.ln()).sqrt() / (PI * sigma_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_transform_of_a_gaussian() {
        // The trapezoidal rule over 12 standard deviations is exact to rounding.
        let integrated = |f: f64, sigma: f64| -> f64 {
            let step = 0.05 * sigma;
            let term = |i: i32| {
                let x = f64::from(i) * step;
                (-0.5 * (x / sigma).powi(2)).exp() / (sigma * (2.0 * PI).sqrt()) * (2.0 * PI * f * x).cos() * step
            };
            (-240..=240).map(term).sum()
        };
        for (f, sigma) in [(0.0, 0.4), (0.25, 0.4), (0.5, 0.8), (1.0, 0.3)] {
            let (ours, theirs) = (mtf(f, sigma), integrated(f, sigma));
            assert!((ours - theirs).abs() < 1e-14, "f {f}, sigma {sigma}: {ours} against {theirs}");
            assert!((mtf(f, 1.01 * sigma) - theirs).abs() > 1e-3 * f, "another width must show");
        }
        let edge = cutoff(0.4, 1e-12);
        assert!(mtf(edge, 0.4) < 1.001e-12 && mtf(0.99 * edge, 0.4) > 1e-12, "both sides of its cutoff");
    }
}
