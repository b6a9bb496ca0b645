//! Elementary functions in single precision for vector loops: no branch, no table, the same steps as in the GPU's
//! shader, so that both sides draw the same noise.
//!
//! Errors (tests below): `ln` 3e-7 relative to max(1, |ln|), `exp_negative` 4e-7 relative, `sin_cos_turns` 2e-7.

use base::fused::{mul_add, whole_bits};

/// Returns the natural logarithm of a positive normal number: exponent, then the series of `2 atanh((m - 1) / (m +
/// 1))`.
#[inline(always)]
pub fn ln<const FUSED: bool>(x: f32) -> f32 {
    const SQRT_HALF_BITS: u32 = 0x3f35_04f3;
    let bits = x.to_bits().wrapping_sub(SQRT_HALF_BITS);
    let exponent = (bits.cast_signed() >> 23) as f32;
    let m = f32::from_bits((bits & 0x007f_ffff) + SQRT_HALF_BITS);
    let s = (m - 1.0) / (m + 1.0);
    let t = s * s;
    let mut p = mul_add::<FUSED>(t, 2.0 / 9.0, 2.0 / 7.0);
    p = mul_add::<FUSED>(p, t, 2.0 / 5.0);
    p = mul_add::<FUSED>(p, t, 2.0 / 3.0);
    p = mul_add::<FUSED>(p, t, 2.0);
    mul_add::<FUSED>(exponent, core::f32::consts::LN_2, s * p)
}

/// Returns `exp(-x)` for `0 <= x <= 80`.
#[inline(always)]
pub fn exp_negative<const FUSED: bool>(x: f32) -> f32 {
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let k = mul_add::<FUSED>(x, -core::f32::consts::LOG2_E, 0.5).floor();
    let r = mul_add::<FUSED>(k, -LN2_LOW, mul_add::<FUSED>(k, -LN2_HIGH, -x));
    let mut p = mul_add::<FUSED>(r, 1.0 / 5040.0, 1.0 / 720.0);
    p = mul_add::<FUSED>(p, r, 1.0 / 120.0);
    p = mul_add::<FUSED>(p, r, 1.0 / 24.0);
    p = mul_add::<FUSED>(p, r, 1.0 / 6.0);
    p = mul_add::<FUSED>(p, r, 0.5);
    p = mul_add::<FUSED>(p, r, 1.0);
    p = mul_add::<FUSED>(p, r, 1.0);
    p * f32::from_bits(whole_bits(k + 127.0) << 23)
}

/// Returns the sine and cosine of `u` turns, `0 <= u < 1`.
#[inline(always)]
pub fn sin_cos_turns<const FUSED: bool>(u: f32) -> (f32, f32) {
    let quarter = mul_add::<FUSED>(u, 4.0, 0.5).floor();
    let x = (u - 0.25 * quarter) * core::f32::consts::TAU;
    let t = x * x;
    let mut s = mul_add::<FUSED>(t, 1.0 / 362_880.0, -1.0 / 5040.0);
    s = mul_add::<FUSED>(s, t, 1.0 / 120.0);
    s = mul_add::<FUSED>(s, t, -1.0 / 6.0);
    s = mul_add::<FUSED>(s * t, x, x);
    let mut c = mul_add::<FUSED>(t, -1.0 / 3_628_800.0, 1.0 / 40_320.0);
    c = mul_add::<FUSED>(c, t, -1.0 / 720.0);
    c = mul_add::<FUSED>(c, t, 1.0 / 24.0);
    c = mul_add::<FUSED>(c, t, -0.5);
    c = mul_add::<FUSED>(c, t, 1.0);
    let q = whole_bits(quarter);
    let swap = q & 1 != 0;
    let (a, b) = if swap { (c, s) } else { (s, c) };
    let sin = if q & 2 != 0 { -a } else { a };
    let cos = if (q.wrapping_add(1)) & 2 != 0 { -b } else { b };
    (sin, cos)
}

/// Returns a uniform in (0, 1) from the high 24 bits of a word, never 0 or 1.
#[inline(always)]
pub fn open_unit(word: u32) -> f32 {
    // 23 bits and a half: exactly representable, at most 1 - 2^-24.
    ((word >> 9).cast_signed() as f32 + 0.5) * (1.0 / 8_388_608.0)
}

/// Returns a uniform in [0, 1) from the high 24 bits of a word.
#[inline(always)]
pub fn unit(word: u32) -> f32 {
    (word >> 8).cast_signed() as f32 * (1.0 / 16_777_216.0)
}

/// Returns the standard normal quantile of `u` in (0, 1). Source: M. Giles, "Approximating the erfinv function", GPU
/// Computing Gems Jade Edition (2010), single-precision form; error 2e-6 sigma up to |z| = 5.2.
#[inline(always)]
pub fn normal_quantile<const FUSED: bool>(u: f32) -> f32 {
    const CENTRE: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725_03e-3,
        -4.177_681_64e-3,
        0.246_640_727,
        1.501_409_41,
    ];
    const TAIL: [f32; 9] = [
        -2.002_142_57e-4,
        1.009_505_58e-4,
        1.349_343_22e-3,
        -3.673_428_44e-3,
        5.739_507_73e-3,
        -7.622_461_3e-3,
        9.438_870_47e-3,
        1.001_674_06,
        2.832_976_82,
    ];
    let w = -ln::<FUSED>(4.0 * u * (1.0 - u));
    let (near, far) = (w - 2.5, w.max(0.0).sqrt() - 3.0);
    let (mut a, mut b) = (CENTRE[0], TAIL[0]);
    for i in 1..9 {
        a = mul_add::<FUSED>(a, near, CENTRE[i]);
        b = mul_add::<FUSED>(b, far, TAIL[i]);
    }
    let p = if w < 5.0 { a } else { b };
    core::f32::consts::SQRT_2 * p * (2.0 * u - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithm() {
        let mut worst = 0.0_f64;
        for i in 1..200_000_u32 {
            let x = i as f32 * 5e-6;
            for value in [ln::<true>(x), ln::<false>(x)] {
                let exact = f64::from(x).ln();
                worst = worst.max((f64::from(value) - exact).abs() / exact.abs().max(1.0));
            }
        }
        assert!(worst < 3e-7, "{worst:e}");
    }

    #[test]
    fn exponential() {
        let mut worst = 0.0_f64;
        for i in 0..200_000_u32 {
            let x = i as f32 * 4e-4;
            for value in [exp_negative::<true>(x), exp_negative::<false>(x)] {
                worst = worst.max((f64::from(value) / (-f64::from(x)).exp() - 1.0).abs());
            }
        }
        assert!(worst < 4e-7, "{worst:e}");
    }

    #[test]
    fn circle() {
        let mut worst = 0.0_f64;
        for i in 0..100_000_u32 {
            let u = i as f32 / 100_000.0;
            let (s, c) = sin_cos_turns::<true>(u);
            let (sin, cos) = (core::f64::consts::TAU * f64::from(u)).sin_cos();
            worst = worst.max((f64::from(s) - sin).abs()).max((f64::from(c) - cos).abs());
        }
        assert!(worst < 2e-7, "{worst:e}");
    }

    #[test]
    fn quantile_inverts_the_distribution() {
        for word in [0_u32, 1 << 9, 1 << 14, 1 << 20, 1 << 28, 1 << 31, 3 << 30, u32::MAX - (1 << 12), u32::MAX] {
            let u = open_unit(word);
            let z = f64::from(normal_quantile::<true>(u));
            let back = 0.5 * libm::erfc(-z * core::f64::consts::FRAC_1_SQRT_2);
            let density = (-0.5 * z * z).exp() / (core::f64::consts::TAU).sqrt();
            let error_sigma = (back - f64::from(u)).abs() / density;
            assert!(error_sigma < 2e-6 * z.abs().max(1.0), "u {u}: z {z}, off by {error_sigma:e} sigma");
        }
        assert_eq!(normal_quantile::<true>(0.5), 0.0);
    }
}
