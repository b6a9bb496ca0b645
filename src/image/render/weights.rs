//! *Polynomials*: shares of a Gaussian star's light in the pixels of one axis, in a few multiply-adds of whole vectors.
//!
//! The share of each pixel is a smooth function of the star's place `f` within its own pixel, |f| <= 1/2. It is the
//! Chebyshev series of the exact share, cut where the rest is below [`CUT`]; one vector has all pixels of a footprint.
//!
//! Domain: exact pixel integrals, sigma of [`LEAST_SIGMA_PX`] or more, footprints of a vector or less; elsewhere there is
//! the error function ([`profile`](crate::render::profile)). Bound: [`CUT`] and the rounding of f32, together 1e-7 of the
//! star's light in any pixel of an axis. Tests: below, at both sides of the domain's edge; `tests/physics` for images.

use crate::render::grid::LANES;
use pulp::Simd;

/// Largest part of a series that is left out.
const CUT: f64 = 1e-8;
/// Narrowest Gaussian: its polynomials have the degree [`MOST_DEGREE`].
const LEAST_SIGMA_PX: f64 = 0.25;
const MOST_DEGREE: usize = 15;
/// Terms of the series from which the polynomials are cut: those beyond are below 1e-16.
const TERMS: usize = 32;

/// Polynomials of one Gaussian and footprint.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Weights {
    sigma_px: f64,
    half_px: usize,
    degree: usize,
    /// By power of `f`, the coefficients of all pixels; 0 beyond the footprint.
    coefficients: [[f32; LANES]; MOST_DEGREE + 1],
}

impl Weights {
    /// Returns the polynomials for footprints of `2 half_px + 1` pixels; `None` outside the domain.
    pub(super) fn new(sigma_px: f64, half_px: usize) -> Option<Self> {
        if sigma_px < LEAST_SIGMA_PX || 2 * half_px + 1 > LANES {
            return None;
        }
        let cosines = cosines();
        let of_pixel = |pixel: usize| series(sigma_px, pixel as f64 - half_px as f64, &cosines);
        let mut series = [[0.0; TERMS]; LANES];
        let series = &mut series[..=2 * half_px];
        series.iter_mut().enumerate().for_each(|(pixel, terms)| *terms = of_pixel(pixel));
        let is_enough = |degree: usize| series.iter().all(|terms| rest(terms, degree) <= CUT);
        let degree = (0..=MOST_DEGREE).find(|degree| is_enough(*degree))?;
        let mut weights = Self { sigma_px, half_px, degree, coefficients: [[0.0; LANES]; MOST_DEGREE + 1] };
        for (pixel, terms) in series.iter().enumerate() {
            for (row, value) in weights.coefficients.iter_mut().zip(powers(&terms[..=degree])) {
                row[pixel] = value as f32;
            }
        }
        Some(weights)
    }

    /// Returns whether these are the polynomials for a Gaussian and a footprint.
    pub(super) fn are_for(&self, sigma_px: f64, half_px: usize) -> bool {
        (self.sigma_px, self.half_px) == (sigma_px, half_px)
    }

    /// Returns the shares of the pixels across and down, in the first vectors of each array; `fraction` is the star's place
    /// within its own pixel, px.
    #[inline(always)]
    pub(super) fn of<S: Simd, const FUSED: bool>(&self, simd: S, fraction: [f32; 2]) -> [[S::f32s; LANES]; 2] {
        let [x, y] = fraction.map(|f| simd.splat_f32s(f));
        let [mut across, mut down] = [[simd.splat_f32s(0.0); LANES]; 2];
        for coefficients in self.coefficients[..=self.degree].iter().rev() {
            let (coefficients, _) = S::as_simd_f32s(coefficients);
            for i in 0..LANES / S::F32_LANES {
                across[i] = mul_add::<S, FUSED>(simd, across[i], x, coefficients[i]);
                down[i] = mul_add::<S, FUSED>(simd, down[i], y, coefficients[i]);
            }
        }
        [across, down]
    }
}

/// Returns `a * b + c`, rounded once when `FUSED`, else twice (see [`base::fused`]).
#[inline(always)]
pub(super) fn mul_add<S: Simd, const FUSED: bool>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    if FUSED { simd.mul_add_f32s(a, b, c) } else { simd.add_f32s(simd.mul_f32s(a, b), c) }
}

/// Returns the cosines of a series: of each term at each node, whose own are those of term 1.
fn cosines() -> [[f64; TERMS]; TERMS] {
    let angle = |node: usize| core::f64::consts::PI * (node as f64 + 0.5) / TERMS as f64;
    core::array::from_fn(|term| core::array::from_fn(|node| libm::cos(term as f64 * angle(node))))
}

/// Returns the Chebyshev series of the share of the pixel `offset` px from the star's own, over `2 f`.
fn series(sigma_px: f64, offset: f64, cosines: &[[f64; TERMS]; TERMS]) -> [f64; TERMS] {
    let values = cosines[1].map(|node| share(sigma_px, offset - 0.5 * node));
    core::array::from_fn(|term| {
        let sum: f64 = values.iter().zip(&cosines[term]).map(|(value, cosine)| value * cosine).sum();
        sum * if term == 0 { 1.0 } else { 2.0 } / TERMS as f64
    })
}

/// Returns the share of the light in a pixel whose middle lies `x` px from the star.
fn share(sigma_px: f64, x: f64) -> f64 {
    let to = |edge: f64| libm::erf(edge / sigma_px * core::f64::consts::FRAC_1_SQRT_2);
    0.5 * (to(x + 0.5) - to(x - 0.5))
}

/// Returns the bound of what a series has beyond a degree.
fn rest(terms: &[f64; TERMS], degree: usize) -> f64 {
    terms[degree + 1..].iter().map(|term| term.abs()).sum()
}

/// Returns the coefficients of the powers of `f` of a series over `2 f`.
fn powers(terms: &[f64]) -> [f64; MOST_DEGREE + 1] {
    let mut sums = [0.0; MOST_DEGREE + 1];
    // The Chebyshev polynomials of this degree and the one before: T(k + 1) = 4 f T(k) - T(k - 1).
    let (mut now, mut before) = ([0.0; MOST_DEGREE + 1], [0.0; MOST_DEGREE + 1]);
    now[0] = 1.0;
    for (k, term) in terms.iter().enumerate() {
        for (sum, coefficient) in sums.iter_mut().zip(&now) {
            *sum += term * coefficient;
        }
        let gain = if k == 0 { 2.0 } else { 4.0 };
        let next = core::array::from_fn(|i| i.checked_sub(1).map_or(0.0, |lower| gain * now[lower]) - before[i]);
        (before, now) = (now, next);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    /// Bound of the shares, of the star's light.
    const BOUND: f64 = 1e-7;

    /// Returns the largest difference from the exact shares, all over a pixel.
    fn worst(weights: &Weights) -> f64 {
        let mut worst = 0.0_f64;
        for i in -500..=500_i16 {
            let f = f32::from(i) / 1000.0;
            for got in [weights.of::<_, false>(Scalar::new(), [f, -f]), weights.of::<_, true>(Scalar::new(), [f, -f])] {
                for (shares, f) in got.into_iter().zip([f, -f]) {
                    for (pixel, share_of_pixel) in shares.into_iter().enumerate() {
                        let is_used = pixel <= 2 * weights.half_px;
                        let offset = pixel as f64 - weights.half_px as f64;
                        let exact = if is_used { share(weights.sigma_px, offset - f64::from(f)) } else { 0.0 };
                        worst = worst.max((f64::from(share_of_pixel) - exact).abs());
                    }
                }
            }
        }
        worst
    }

    #[test]
    fn shares_are_exact_in_the_whole_domain() {
        let mut degrees = Vec::new();
        for (sigma_px, half_px) in [(LEAST_SIGMA_PX, 2), (0.3, 2), (0.5, 3), (0.8, 4), (0.8, 7), (1.3, 7), (3.0, 7)] {
            let weights = Weights::new(sigma_px, half_px).unwrap();
            let worst = worst(&weights);
            assert!(worst < BOUND, "sigma {sigma_px} px: {worst:e}, degree {}", weights.degree);
            degrees.push(weights.degree);
        }
        assert!(degrees.is_sorted_by(|a, b| a >= b), "wider stars take fewer terms: {degrees:?}");
        assert_eq!(degrees[0], MOST_DEGREE, "the edge of the domain takes all");
    }

    #[test]
    fn narrower_stars_are_outside_the_domain() {
        assert!(Weights::new(0.99 * LEAST_SIGMA_PX, 2).is_none() && Weights::new(0.8, LANES / 2).is_none());
        let beyond = series(0.8 * LEAST_SIGMA_PX, 0.0, &cosines());
        assert!(rest(&beyond, MOST_DEGREE) > CUT, "{:e}", rest(&beyond, MOST_DEGREE));
    }

    #[test]
    fn a_shorter_series_is_found_by_the_test() {
        let mut weights = Weights::new(0.5, 3).unwrap();
        weights.degree -= 3;
        assert!(worst(&weights) > BOUND);
    }
}
