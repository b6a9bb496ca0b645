//! Gaussian PSF integrated over square pixels, exact in f64.
//!
//! `P(x) = 1/2 [erf((x + 1/2) / (sigma sqrt 2)) - erf((x - 1/2) / (sigma sqrt 2))]` per axis; x is the pixel centre
//! minus the star, px. Error: that of `libm::erf` (< 1 ulp). Compared with independent truth in `tests/physics`.

use core::f64::consts::FRAC_1_SQRT_2;

/// Returns the share of the light in the unit cell centred `x_px` from the star, one axis.
pub fn cell(x_px: f64, sigma_px: f64) -> f64 {
    let scale = FRAC_1_SQRT_2 / sigma_px;
    let (low, high) = ((x_px - 0.5) * scale, (x_px + 0.5) * scale);
    // Far from the star both erf are near one: the complement keeps the digits.
    if low > 1.0 {
        0.5 * (libm::erfc(low) - libm::erfc(high))
    } else if high < -1.0 {
        0.5 * (libm::erfc(-high) - libm::erfc(-low))
    } else {
        0.5 * (libm::erf(high) - libm::erf(low))
    }
}

/// Shares of a Gaussian's light beyond an edge from a table, for thousands of places: cubic interpolation whose error is at
/// most [`EDGE_ERROR`].
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeTable {
    /// Coefficients of each interval of `1 / PER_SIGMA` sigma.
    intervals: Vec<[f64; 4]>,
}

/// Bound of a share's error: the fourth derivative is at most 0.55, `h^4 / 384` of it.
pub const EDGE_ERROR: f64 = 1.4e-9;
/// Intervals per sigma.
const PER_SIGMA: u32 = 32;
/// Furthest edge, sigma: 1e-15 of the light is beyond it.
const FURTHEST_SIGMA: u32 = 8;

impl EdgeTable {
    /// Returns the table.
    pub fn filled() -> Self {
        let step = 1.0 / f64::from(PER_SIGMA);
        let intervals = (0..2 * FURTHEST_SIGMA * PER_SIGMA).map(|i| {
            let ends = [i, i + 1].map(|i| f64::from(i) * step - f64::from(FURTHEST_SIGMA));
            let [low, high] = ends.map(|z| 0.5 * (1.0 + libm::erf(z * FRAC_1_SQRT_2)));
            let [rises, then] = ends.map(|z| step * (-0.5 * z * z).exp() / (2.0 * core::f64::consts::PI).sqrt());
            [low, rises, 3.0 * (high - low) - 2.0 * rises - then, 2.0 * (low - high) + rises + then]
        });
        Self { intervals: intervals.collect() }
    }

    /// Returns the share of the light below an edge `z` sigma from the star.
    #[inline]
    pub fn below(&self, z: f64) -> f64 {
        let at = (z + f64::from(FURTHEST_SIGMA)) * f64::from(PER_SIGMA);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below zero counts as zero")]
        let i = at as usize;
        match self.intervals.get(i) {
            Some([a, b, c, d]) if at > 0.0 => {
                let t = at - i as f64;
                a + t * (b + t * (c + t * d))
            }
            _ => f64::from(u8::from(at > 0.0)),
        }
    }
}

/// Returns the share of the light outside the square of half-width `half_px + 1/2` about any star within half a pixel
/// of its centre (worst case: the star half a pixel off in both axes).
pub fn lost_flux(half_px: usize, sigma_px: f64) -> f64 {
    let edge = half_px as f64 * FRAC_1_SQRT_2 / sigma_px;
    let far = (half_px as f64 + 1.0) * FRAC_1_SQRT_2 / sigma_px;
    libm::erfc(edge) + libm::erfc(far)
}

/// Returns the interpolation error of a cubic spline table with `per_px` grid points per pixel, relative to the peak:
/// `h^4 |f''''| / 384` along both axes. `f''''` at the peak is `3 / sigma^4` of it, and a pixel adds its own variance.
pub fn table_error(sigma_px: f64, per_px: f64) -> f64 {
    let variance = sigma_px * sigma_px;
    // A pixel much wider than the PSF has two edges instead: the Gaussian's own third derivative.
    let fourth = (3.0 / (variance + 1.0 / 12.0).powi(2)).max(0.56 / variance.powi(2));
    2.0 * fourth / (384.0 * per_px.powi(4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_sum_to_one_and_stay_accurate_in_the_tail() {
        for sigma in [0.3, 0.5, 0.8, 2.0] {
            let sum: f64 = (-40..=40).map(|i| cell(f64::from(i) - 0.37, sigma)).sum();
            assert!((sum - 1.0).abs() < 1e-14, "sigma {sigma}: {sum}");
        }
        // Tail cell by Simpson's rule on the density, relative.
        let (x, sigma) = (6.0, 0.8);
        let density =
            |u: f64| (-0.5 * (u / sigma) * (u / sigma)).exp() / (sigma * (2.0 * core::f64::consts::PI).sqrt());
        let n = 2000;
        let simpson: f64 = (0..=n)
            .map(|k| {
                let weight = if k == 0 || k == n {
                    1.0
                } else if k % 2 == 1 {
                    4.0
                } else {
                    2.0
                };
                weight * density(x - 0.5 + f64::from(k) / f64::from(n))
            })
            .sum::<f64>()
            / (3.0 * f64::from(n));
        assert!((cell(x, sigma) / simpson - 1.0).abs() < 1e-9, "{} against {simpson}", cell(x, sigma));
    }

    #[test]
    fn edges_from_the_table_are_those_of_erf_within_their_bound() {
        let table = EdgeTable::filled();
        let apart = |z: f64| (table.below(z) - 0.5 * (1.0 + libm::erf(z * FRAC_1_SQRT_2))).abs();
        let worst = (-90_000..=90_000).map(|i| apart(f64::from(i) * 1e-4)).fold(0.0, f64::max);
        assert!(worst <= EDGE_ERROR && worst > 0.5 * EDGE_ERROR, "{worst:e}");
        let far = [-1e300, -8.0, 8.0, 1e300, f64::NAN];
        assert_eq!(far.map(|z| table.below(z)), [0.0, 0.0, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn lost_flux_bounds_what_a_square_loses() {
        let (half, sigma, offset) = (3_i32, 0.8, 0.5);
        let inside: f64 = (-half..=half).map(|i| cell(f64::from(i) - offset, sigma)).sum();
        let lost = 1.0 - inside * inside;
        let bound = lost_flux(3, sigma);
        assert!(lost <= bound && bound < 1.01 * lost + 1e-12, "lost {lost}, bound {bound}");
    }
}
