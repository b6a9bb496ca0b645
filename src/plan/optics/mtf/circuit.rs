//! Bandwidth of the readout along the rows.
//!
//! Frequency along x -> factor: one pole (RC) `1 / sqrt(1 + (f/fc)^2)`, Butterworth of order n `1 / sqrt(1 + (f/fc)^(2
//! n))`; `f` in cycles/px, `fc` the frequency of half power. With a pixel clock of `R` pixels per second a bandwidth of
//! `B` hertz gives `fc = B / R`. Source: Holst, CCD Arrays, Cameras and Displays, 2nd ed., chapter on electronics;
//! Butterworth (1930). Limits: the magnitude only. A causal filter also delays, by `atan(f/fc)` for RC: mostly a shift
//! of the whole image, which a camera's calibration removes, and a slight asymmetry, which is not modelled. Off by
//! default: a settled pixel amplifier has no such term. The tests filter a wave in time.

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
pub fn mtf(fx: f64, circuit: Circuit) -> f64 {
    let ratio = (fx / circuit.cutoff).abs();
    #[allow(clippy::cast_possible_wrap, reason = "a handful of poles")]
    let power = ratio.powi(2 * circuit.order as i32);
    1.0 / (1.0 + power).sqrt()
}

#[cfg(test)]
mod tests {
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
            let (ours, theirs) = (mtf(f, Circuit { cutoff, order: 1 }), filtered_amplitude(f, cutoff));
            assert!((ours - theirs).abs() < 1e-5, "f {f}, cutoff {cutoff}: {ours} against {theirs}");
            let wrong = mtf(f, Circuit { cutoff: 1.1 * cutoff, order: 1 });
            assert!((wrong - theirs).abs() > 1e-4, "another cutoff must show");
        }
    }

    #[test]
    fn butterworth_halves_the_power_at_its_cutoff_whatever_its_order() {
        for order in 1..=5 {
            let at = |f| mtf(f, Circuit { cutoff: 0.6, order });
            assert!((at(0.6) - FRAC_1_SQRT_2).abs() < 1e-15 && (at(0.0) - 1.0).abs() < 1e-15, "order {order}");
            assert_eq!(at(-0.3), at(0.3), "even");
        }
        // Two poles from the product of their complex factors, at +-45 degrees (Butterworth 1930).
        let (f, cutoff) = (0.9_f64, 0.6);
        let s = f / cutoff;
        let damped = (1.0 - s * s).hypot(2.0 * FRAC_1_SQRT_2 * s);
        assert!((mtf(f, Circuit { cutoff, order: 2 }) - 1.0 / damped).abs() < 1e-15, "two poles");
    }
}
