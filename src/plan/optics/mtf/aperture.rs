//! The pixel's sensitive area: the mean over a square.
//!
//! Frequency -> factor `sinc(w fx) sinc(w fy)`, `sinc(u) = sin(pi u) / (pi u)`, `w` the width of the sensitive square
//! in pixels (1: the whole pixel; the fill factor is `w^2`). Source: Boreman, Modulation Transfer Function in Optical
//! and Electro-Optical Systems (2001), 2.1. Light between the squares is lost: that loss belongs to the quantum
//! efficiency, the factor here is 1 at frequency 0. Domain: `0 < w <= 1`. The test integrates over the square.

use core::f64::consts::PI;

/// Returns the factor at `[fx, fy]` (cycles/px) of a square of width `width_px`.
pub fn mtf(frequency: [f64; 2], width_px: f64) -> f64 {
    sinc(width_px * frequency[0]) * sinc(width_px * frequency[1])
}

/// Returns `sin(pi u) / (pi u)`, 1 at 0.
pub fn sinc(u: f64) -> f64 {
    let angle = PI * u;
    if angle.abs() < 1e-5 { 1.0 - angle * angle / 6.0 } else { angle.sin() / angle }
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
            let (ours, theirs) = (mtf(f, width), mean(f, width));
            assert!((ours - theirs).abs() < 1e-13, "f {f:?}, width {width}: {ours} against {theirs}");
        }
        assert!((mtf([0.5, 0.0], 0.7) - mean([0.5, 0.0], 0.71)).abs() > 1e-3, "another width must show");
        assert!((mtf([1e-6, 0.0], 1.0) - 1.0).abs() < 1e-11 && mtf([1.0, 0.0], 1.0).abs() < 1e-15, "ends");
    }
}
