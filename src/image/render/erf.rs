//! Error function in single precision, for vector loops: a quotient of polynomials, no exponential, no branch.
//!
//! `erf(x) ~ x P(x^2) / Q(x^2)` on |x| <= 3.9 (beyond: clamped; erf(3.9) = 1 - 3.5e-8). Coefficients: minimax fit of
//! degree 5 over 5 made for starloop (Lawson iteration on erf in f64; 1.5e-8 before rounding). Error in f32: 5e-7,
//! most of it rounding near 1. The GPU's shader has the same coefficients.

use base::fused::mul_add;

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
