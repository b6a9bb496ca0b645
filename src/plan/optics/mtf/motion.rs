//! Motion of the image in the exposure, as transfer functions.
//!
//! Frequency along the motion -> factor. *The drawn PSF never contains smear and jitter*: an exposure integrates the
//! motion itself, star by star, and would count it twice. These factors show the effect of a motion, and are compared
//! with each other. TDI is a motion of the charge, not of the line of sight: it is a link of the chain.
//! * smear of length `a` at constant speed: `sinc(a f)`;
//! * jitter, many cycles, standard deviation `s` on the axis: `exp(-2 pi^2 s^2 f^2)`, see [`super::blur`];
//! * sinusoid of amplitude `A`, whole cycles: `J0(2 pi A f)`;
//! * TDI (time delay and integration) of `n` stages: charge moves in steps, `phases` per pixel, while the image moves
//!   evenly: `sinc(f / phases)`; a velocity error of `d` pixels per stage smears by steps of `d`:
//!   `sin(n pi d f) / (n sin(pi d f))`.
//!
//! `f` in cycles/px, lengths in px. Sources: Holst, CCD Arrays, Cameras and Displays, 2nd ed.; Wong and Yao, Proc. SPIE
//! 1693 (1992) for TDI. Limits: straight motion, uniform in time; the factors may be negative. The tests average a wave
//! over the motion.

use crate::optics::{mtf::TdiBlur, mtf::blur::sinc};
use core::f64::consts::{PI, TAU};

/// Returns the factor of motion at constant speed over `length_px`.
pub fn smear(frequency: f64, length_px: f64) -> f64 {
    sinc(length_px * frequency)
}

/// Returns the factor of a sinusoid of `amplitude_px` over whole cycles.
pub fn sinusoid(frequency: f64, amplitude_px: f64) -> f64 {
    libm::j0(TAU * amplitude_px * frequency)
}

/// Returns the factor of the discrete steps of the charge, `phases` to a pixel, under an image that moves evenly.
pub fn tdi_steps(frequency: f64, phases: u32) -> f64 {
    sinc(frequency / f64::from(phases))
}

/// Returns the factor of TDI: steps and mismatch.
pub fn tdi(frequency: f64, TdiBlur { stages, phases, mismatch_px }: TdiBlur) -> f64 {
    tdi_steps(frequency, phases) * tdi_mismatch(frequency, stages, mismatch_px)
}

/// Returns the factor of a drift of `mismatch_px` between image and charge from one of `stages` to the next.
pub fn tdi_mismatch(frequency: f64, stages: u32, mismatch_px: f64) -> f64 {
    let angle = PI * mismatch_px * frequency;
    let n = f64::from(stages);
    // At whole numbers of cycles per step all stages agree; near them the ratio is one of small numbers.
    let off = angle - PI * (angle / PI).round();
    if (n * off).abs() < 1e-6 {
        let sign = if stages.is_multiple_of(2) && (angle / PI).round() % 2.0 != 0.0 { -1.0 } else { 1.0 };
        return sign * (1.0 - (n * n - 1.0) * off * off / 6.0);
    }
    (n * angle).sin() / (n * angle.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the mean of a wave of frequency `f` over places `x(t)`, `t` in (0, 1).
    fn averaged(f: f64, n: i32, x: impl Fn(f64) -> f64) -> f64 {
        (0..n).map(|i| (TAU * f * x((f64::from(i) + 0.5) / f64::from(n))).cos()).sum::<f64>() / f64::from(n)
    }

    #[test]
    fn smooth_motions_are_means_of_a_wave() {
        for f in [0.1, 0.5, 1.2] {
            let smeared = averaged(f, 20_000, |t| 1.7 * (t - 0.5));
            assert!((smear(f, 1.7) - smeared).abs() < 1e-7, "smear, f {f}");
            assert!((smear(f, 1.75) - smeared).abs() > 1e-4, "another length must show");
            // Whole cycles: the sum converges faster than any power.
            let swung = averaged(f, 256, |t| 0.8 * (TAU * t).sin());
            assert!((sinusoid(f, 0.8) - swung).abs() < 1e-13, "sinusoid, f {f}");
            assert!((sinusoid(f, 0.82) - swung).abs() > 1e-4, "another amplitude must show");
        }
    }

    #[test]
    fn tdi_is_the_mean_over_its_stages() {
        for f in [0.1, 0.5, 1.2] {
            // The image moves on while the charge is at rest: a sawtooth of one step's length.
            let saw = averaged(f, 30_000, |t| ((3.0 * t).fract() - 0.5) / 3.0);
            assert!((tdi_steps(f, 3) - saw).abs() < 1e-7, "steps, f {f}");
            let stages = 16;
            let drifted = (0..stages).map(|k| (TAU * f * 0.03 * (f64::from(k) - 7.5)).cos()).sum::<f64>() / 16.0;
            assert!((tdi_mismatch(f, 16, 0.03) - drifted).abs() < 1e-13, "mismatch, f {f}");
            assert!((tdi_mismatch(f, 15, 0.03) - drifted).abs() > 1e-5, "another number of stages must show");
        }
        assert_eq!(tdi_mismatch(0.4, 96, 0.0), 1.0, "no mismatch");
        // A whole cycle per step: an even number of stages is half a step off the middle, and reverses the wave.
        for (stages, sign) in [(4, -1.0), (5, 1.0)] {
            let near = tdi_mismatch(1.0 - 1e-4, stages, 1.0);
            assert!((tdi_mismatch(1.0, stages, 1.0) - sign).abs() < 1e-12 && (near - sign).abs() < 1e-4, "{stages}");
        }
    }
}
