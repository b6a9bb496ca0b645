//! One axis of a Gaussian star, by sampling method: positions of pixel edges -> running sums whose differences are the
//! pixel values.
//!
//! Exact: `erf / 2`. Point and supersampled: what a sum of points would give, written as values at pixel centres; the
//! differences of their running sums are those values again, so one drawing loop serves all. Bicubic: the points on
//! whole pixels, convolved with Keys's kernel.
//!
//! *Error function* in single precision, for vector loops: a quotient of polynomials, no exponential, no branch.
//!
//! `erf(x) ~ x P(x^2) / Q(x^2)` on |x| <= 3.9 (beyond: clamped; erf(3.9) = 1 - 3.5e-8). Coefficients: minimax fit of
//! degree 5 over 5 made for starloop (Lawson iteration on erf in f64; 1.5e-8 before rounding). Error in f32: 5e-7,
//! most of it rounding near 1. The GPU's shader has the same coefficients.

use base::fused::mul_add;
use plan::{exposure::PsfSampling, exposure::sampling::keys};

/// Sampling of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Profile {
    kind: Kind,
    sigma_px: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Exact,
    Points(usize),
    Bicubic,
}

/// Pixels on each side whose running sum is taken: as many as an analytic footprint has.
const REACH: i32 = 9;

impl Profile {
    pub(super) fn new(sampling: PsfSampling, sigma_px: f64) -> Self {
        let kind = match sampling {
            PsfSampling::Auto | PsfSampling::Table { .. } => Kind::Exact,
            PsfSampling::Point => Kind::Points(1),
            PsfSampling::Supersampled { n } => Kind::Points(n),
            PsfSampling::Bicubic => Kind::Bicubic,
        };
        Self { kind, sigma_px: sigma_px as f32 }
    }

    /// Returns whether pixels have the exact integrals of the PSF.
    pub(super) fn is_exact(&self) -> bool {
        self.kind == Kind::Exact
    }

    /// Positions of pixel edges from the star, px -> running sums there.
    #[inline(always)]
    pub(super) fn apply<const FUSED: bool>(&self, edges: &mut [f32]) {
        match self.kind {
            Kind::Exact => {
                let scale = core::f32::consts::FRAC_1_SQRT_2 / self.sigma_px;
                for value in edges {
                    *value = 0.5 * erf::<FUSED>(*value * scale);
                }
            }
            Kind::Points(_) | Kind::Bicubic => edges.iter_mut().for_each(|edge| *edge = self.running_sum(*edge)),
        }
    }

    /// Returns the sum of the values of the pixels that end at or before this edge.
    fn running_sum(&self, edge: f32) -> f32 {
        (1..=2 * REACH).map(|i| self.value(f64::from(edge) + 0.5 - f64::from(i))).sum::<f64>() as f32
    }

    /// Returns the value of the pixel whose centre lies `x` px from the star.
    fn value(&self, x: f64) -> f64 {
        match self.kind {
            Kind::Exact => 0.0,
            Kind::Points(n) => {
                let at = |i: usize| x + (i as f64 + 0.5) / n as f64 - 0.5;
                (0..n).map(|i| self.density(at(i))).sum::<f64>() / n as f64
            }
            Kind::Bicubic => {
                let first = x.floor() - 1.0;
                (0..4).map(|m| first + f64::from(m)).map(|at| self.density(at) * keys(x - at)).sum()
            }
        }
    }

    fn density(&self, x: f64) -> f64 {
        let sigma = f64::from(self.sigma_px);
        (-0.5 * (x / sigma).powi(2)).exp() / (sigma * core::f64::consts::TAU.sqrt())
    }
}

/// Numerator, ascending powers of x^2.
pub const ERF_P: [f32; 6] =
    [1.128_379_03, 0.191_942_573, 0.052_967_090_6, 0.003_836_935_53, 0.000_287_457_189, 2.050_355_29e-6];
/// Denominator, ascending powers of x^2.
pub const ERF_Q: [f32; 6] = [1.0, 0.503_436_454, 0.114_758_817, 0.015_109_322_1, 0.001_181_746_39, 3.823_041_09e-5];
/// Limit at which the argument is clamped.
pub const ERF_CLAMP: f32 = 3.9;

/// Returns the error function; see the module for its error.
#[inline(always)]
pub fn erf<const FUSED: bool>(x: f32) -> f32 {
    let x = x.clamp(-ERF_CLAMP, ERF_CLAMP);
    let t = x * x;
    let (mut p, mut q) = (ERF_P[5], ERF_Q[5]);
    p = mul_add::<FUSED>(p, t, ERF_P[4]);
    q = mul_add::<FUSED>(q, t, ERF_Q[4]);
    p = mul_add::<FUSED>(p, t, ERF_P[3]);
    q = mul_add::<FUSED>(q, t, ERF_Q[3]);
    p = mul_add::<FUSED>(p, t, ERF_P[2]);
    q = mul_add::<FUSED>(q, t, ERF_Q[2]);
    p = mul_add::<FUSED>(p, t, ERF_P[1]);
    q = mul_add::<FUSED>(q, t, ERF_Q[1]);
    p = mul_add::<FUSED>(p, t, ERF_P[0]);
    q = mul_add::<FUSED>(q, t, ERF_Q[0]);
    x * p / q
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_running_sums_are_pixel_values() {
        for (sampling, wanted) in
            [(PsfSampling::Point, 0.498_677_85 * (-0.5_f64 * (0.3 / 0.8_f64).powi(2)).exp()), (PsfSampling::Auto, 0.0)]
        {
            let profile = Profile::new(sampling, 0.8);
            let mut edges = [-0.2_f32, 0.8];
            profile.apply::<true>(&mut edges);
            let exact = 0.5 * (libm::erf(0.8 / 0.8 / 2_f64.sqrt()) - libm::erf(-0.2 / 0.8 / 2_f64.sqrt()));
            let wanted = if sampling == PsfSampling::Auto { exact } else { wanted };
            let got = f64::from(edges[1] - edges[0]);
            assert!((got - wanted).abs() < 1e-6, "{sampling}: {got} {wanted}");
        }
    }

    #[test]
    fn the_bicubic_kernel_passes_constants_and_whole_shifts() {
        for t in [0.0, 0.2, 0.5, 0.9] {
            let sum: f64 = (-2..3).map(|m| keys(t + f64::from(m))).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{t}: {sum}");
        }
        assert!((keys(0.0) - 1.0).abs() < 1e-12 && keys(1.0).abs() < 1e-12);
    }
}

#[cfg(test)]
mod erf_tests {
    use super::*;

    /// Fit 1.5e-8, clamp 3.5e-8, f32 rounding of a value near 1 through about eight operations.
    const ERF_F32: f64 = 5e-7;

    #[test]
    fn stays_within_its_error_everywhere() {
        let mut worst = 0.0_f64;
        for i in -60_000..=60_000_i32 {
            let x = i as f32 * 1e-4;
            let exact = libm::erf(f64::from(x));
            worst = worst.max((f64::from(erf::<true>(x)) - exact).abs());
            worst = worst.max((f64::from(erf::<false>(x)) - exact).abs());
        }
        assert!(worst < ERF_F32, "worst {worst:e}");
        assert!(worst > ERF_F32 / 10.0, "the bound is not idle: {worst:e}");
    }
}
