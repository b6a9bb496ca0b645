//! Blurs in closed form: by the pixel's area, of Gaussian profile, and by the readout along the rows.
//!
//! *The pixel's sensitive area* ([`square`]): the mean over a square.
//! Frequency -> factor `sinc(w fx) sinc(w fy)`, `sinc(u) = sin(pi u) / (pi u)`, `w` the width of the sensitive square
//! in pixels (1: the whole pixel; the fill factor is `w^2`). Source: Boreman, Modulation Transfer Function in Optical
//! and Electro-Optical Systems (2001), 2.1. Light between the squares is lost: that loss belongs to the quantum
//! efficiency, the factor here is 1 at frequency 0. Domain: `0 < w <= 1`. The test integrates over the square.
//!
//! *Gaussian profile* ([`gaussian()`]): errors of assembly and of fabrication, and any blur known by its width only.
//! Frequency -> factor `exp(-2 pi^2 s^2 f^2)`, the transform of a Gaussian of standard deviation `s` (px, one axis);
//! `f` in cycles/px, its magnitude in two dimensions. Source: Holst, Electro-Optical Imaging System Performance, 5th
//! ed. Two such blurs are one of `sqrt(s1^2 + s2^2)`. The test integrates the Gaussian.
//!
//! *Bandwidth of the readout along the rows* ([`low_pass`]). Frequency along x -> factor: one pole (RC) `1 / sqrt(1 +
//! (f/fc)^2)`, Butterworth of order n `1 / sqrt(1 + (f/fc)^(2 n))`; `f` in cycles/px, `fc` the frequency of half power.
//! With a pixel clock of `R` pixels per second a bandwidth of `B` hertz gives `fc = B / R`. Source: Holst, CCD Arrays,
//! Cameras and Displays, 2nd ed., chapter on electronics; Butterworth (1930). Limits: the magnitude only. A causal
//! filter also delays, by `atan(f/fc)` for RC: mostly a shift of the whole image, which a camera's calibration removes,
//! and a slight asymmetry, which is not modelled. Off by default: a settled pixel amplifier has no such term. The tests
//! filter a wave in time.

use core::f64::consts::PI;

/// Returns the factor at `[fx, fy]` (cycles/px) of a square of width `width_px`.
pub fn square(frequency: [f64; 2], width_px: f64) -> f64 {
    sinc(width_px * frequency[0]) * sinc(width_px * frequency[1])
}

/// Returns `sin(pi u) / (pi u)`, 1 at 0.
pub fn sinc(u: f64) -> f64 {
    let angle = PI * u;
    if angle.abs() < 1e-5 { 1.0 - angle * angle / 6.0 } else { angle.sin() / angle }
}

/// Returns the factor at `frequency` (cycles/px) of a blur of standard deviation `sigma_px`.
pub fn gaussian(frequency: f64, sigma_px: f64) -> f64 {
    (-2.0 * (PI * sigma_px * frequency).powi(2)).exp()
}

/// Returns the frequency above which the factor is below `least`, cycles/px.
pub fn gaussian_cutoff(sigma_px: f64, least: f64) -> f64 {
    (-0.5 * least.ln()).sqrt() / (PI * sigma_px)
}

/// A low pass of the readout.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circuit {
    /// Frequency of half power, cycles/px.
    pub cutoff: f64,
    /// Poles of a Butterworth filter; 1: RC.
    pub order: u32,
}

/// Lowest bandwidth accepted, cycles/px: below it one pixel's charge spreads over tens of its neighbours.
pub const LOWEST_CUTOFF: f64 = 0.1;

/// Returns the factor at `fx` (cycles/px, along the rows).
pub fn low_pass(fx: f64, circuit: Circuit) -> f64 {
    let ratio = (fx / circuit.cutoff).abs();
    #[allow(clippy::cast_possible_wrap, reason = "a handful of poles")]
    let power = ratio.powi(2 * circuit.order as i32);
    1.0 / (1.0 + power).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::quadrature::gauss_legendre;

    #[test]
    fn it_is_the_mean_of_a_wave_over_the_square() {
        let nodes = gauss_legendre(20);
        let mean = |f: [f64; 2], width: f64| -> f64 {
            let rows = nodes.iter().flat_map(|y| nodes.iter().map(move |x| (x, y)));
            rows.map(|(x, y)| x.weight * y.weight * (2.0 * PI * width * (f[0] * x.x + f[1] * y.x)).cos()).sum()
        };
        for (f, width) in [([0.0, 0.0], 1.0), ([0.5, 0.1], 1.0), ([1.3, -0.7], 1.0), ([0.5, 0.5], 0.7)] {
            let (ours, theirs) = (square(f, width), mean(f, width));
            assert!((ours - theirs).abs() < 1e-13, "f {f:?}, width {width}: {ours} against {theirs}");
        }
        assert!((square([0.5, 0.0], 0.7) - mean([0.5, 0.0], 0.71)).abs() > 1e-3, "another width must show");
        assert!((square([1e-6, 0.0], 1.0) - 1.0).abs() < 1e-11 && square([1.0, 0.0], 1.0).abs() < 1e-15, "ends");
    }
}

#[cfg(test)]
mod gaussian_tests {
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
            let (ours, theirs) = (gaussian(f, sigma), integrated(f, sigma));
            assert!((ours - theirs).abs() < 1e-14, "f {f}, sigma {sigma}: {ours} against {theirs}");
            assert!((gaussian(f, 1.01 * sigma) - theirs).abs() > 1e-3 * f, "another width must show");
        }
        let edge = gaussian_cutoff(0.4, 1e-12);
        assert!(gaussian(edge, 0.4) < 1.001e-12 && gaussian(0.99 * edge, 0.4) > 1e-12, "both sides of its cutoff");
    }
}

#[cfg(test)]
mod circuit_tests {
    use super::*;
    use core::f64::consts::{FRAC_1_SQRT_2, TAU};

    /// Returns the amplitude of a wave after `dy/dt = wc (x - y)`, by small steps, independent of any transfer
    /// function.
    fn filtered_amplitude(f: f64, cutoff: f64) -> f64 {
        let step = 1e-4 / f;
        let (rate, mut y, mut largest) = (TAU * cutoff, 0.0_f64, 0.0_f64);
        for i in 0..200_000 {
            let middle = (TAU * f * (f64::from(i) + 0.5) * step).sin();
            // Crank-Nicolson: second order.
            y = (y * (1.0 - 0.5 * rate * step) + rate * step * middle) / (1.0 + 0.5 * rate * step);
            if i > 150_000 {
                largest = largest.max(y.abs());
            }
        }
        largest
    }

    #[test]
    fn one_pole_is_what_a_capacitor_does() {
        for (f, cutoff) in [(0.1, 0.8), (0.5, 0.8), (1.0, 0.3)] {
            let (ours, theirs) = (low_pass(f, Circuit { cutoff, order: 1 }), filtered_amplitude(f, cutoff));
            assert!((ours - theirs).abs() < 1e-5, "f {f}, cutoff {cutoff}: {ours} against {theirs}");
            let wrong = low_pass(f, Circuit { cutoff: 1.1 * cutoff, order: 1 });
            assert!((wrong - theirs).abs() > 1e-4, "another cutoff must show");
        }
    }

    #[test]
    fn butterworth_halves_the_power_at_its_cutoff_whatever_its_order() {
        for order in 1..=5 {
            let at = |f| low_pass(f, Circuit { cutoff: 0.6, order });
            assert!((at(0.6) - FRAC_1_SQRT_2).abs() < 1e-15 && (at(0.0) - 1.0).abs() < 1e-15, "order {order}");
            assert_eq!(at(-0.3), at(0.3), "even");
        }
        // Two poles from the product of their complex factors, at +-45 degrees (Butterworth 1930).
        let (f, cutoff) = (0.9_f64, 0.6);
        let s = f / cutoff;
        let damped = (1.0 - s * s).hypot(2.0 * FRAC_1_SQRT_2 * s);
        assert!((low_pass(f, Circuit { cutoff, order: 2 }) - 1.0 / damped).abs() < 1e-15, "two poles");
    }
}
