//! Cubic B-spline interpolation on a regular grid: prefilter and weights.
//!
//! The prefilter turns samples into spline coefficients (recursive filter, pole `sqrt(3) - 2`, zero beyond the ends);
//! the four weights evaluate the spline between grid points. Error `h^4 |f''''| / 384` at most, nine times smaller
//! than Lagrange's cubic. Source: Unser, Aldroubi and Eden, IEEE Trans. Signal Processing 41 (1993), 821.
//!
//! *Taps.* Fractions of pixels -> phases and spline weights of a table, for a block of stars at once: a vector loop.
//!
//! Test: `a_block_is_what_each_star_has`.

use crate::render::bands::BLOCK;
use base::fused::{mul_add, whole_bits};

/// Samples -> spline coefficients, in place. The samples are taken to vanish beyond both ends.
#[inline(always)]
pub fn prefilter(samples: &mut [f32]) {
    const POLE: f32 = -0.267_949_2;
    let mut before = 0.0;
    for value in samples.iter_mut() {
        before = *value + POLE * before;
        *value = before;
    }
    // The causal pass goes on ringing beyond the last sample; its anticausal sum there is geometric.
    let mut after = -before * POLE * POLE / (1.0 - POLE * POLE) / POLE;
    for value in samples.iter_mut().rev() {
        after = POLE * (after - *value);
        *value = after;
    }
    for value in samples {
        *value *= 6.0;
    }
}

/// Returns weights of the coefficients at offsets -1, 0, 1, 2 for a point a share `t` in [0, 1) past offset 0.
#[inline(always)]
pub fn weights(t: f32) -> [f32; 4] {
    let r = 1.0 - t;
    let sixth = 1.0 / 6.0;
    let (t3, r3) = (t * t * t, r * r * r);
    let w1 = sixth * (4.0 - 3.0 * t * t * (2.0 - t));
    let w2 = sixth * (4.0 - 3.0 * r * r * (2.0 - r));
    [sixth * r3, w1, w2, sixth * t3]
}

/// The taps of a block along one axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Taps {
    /// First phases, whole numbers.
    first: [u32; BLOCK],
    weights: [[f32; BLOCK]; 4],
}

impl Taps {
    /// Returns the taps of fractions in [-1/2, 1/2], for tables of `oversampling` grid points per pixel.
    #[inline(always)]
    pub(super) fn of<const FUSED: bool>(fractions: &[f32; BLOCK], oversampling: usize) -> Self {
        let (s, half) = (oversampling as f32, (oversampling / 2) as f32);
        let mut taps = Self { first: [0; BLOCK], weights: [[0.0; BLOCK]; 4] };
        for k in 0..BLOCK {
            let at = half - fractions[k] * s;
            let whole = at.floor().clamp(0.0, 2.0 * half);
            taps.first[k] = whole_bits(whole) & 0x3f_ffff;
            let t = at - whole;
            let r = 1.0 - t;
            let sixth = 1.0 / 6.0;
            taps.weights[0][k] = sixth * (r * r * r);
            taps.weights[1][k] = mul_add::<FUSED>(-0.5 * (t * t), 2.0 - t, 4.0 * sixth);
            taps.weights[2][k] = mul_add::<FUSED>(-0.5 * (r * r), 2.0 - r, 4.0 * sixth);
            taps.weights[3][k] = sixth * (t * t * t);
        }
        taps
    }

    /// Returns the first phase and weights of the `k`-th star.
    #[inline(always)]
    pub(super) fn of_star(&self, k: usize) -> (usize, [f32; 4]) {
        (self.first[k] as usize, self.weights.map(|weights| weights[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bump(x: f32) -> f32 {
        (-0.5 * x * x).exp()
    }

    #[test]
    fn reproduces_samples_and_interpolates_a_gaussian_to_fourth_order() {
        for (step, bound) in [(0.5_f32, 6e-4_f32), (0.25, 4e-5), (0.125, 3e-6)] {
            let half = (7.0 / step) as i32;
            let mut grid: Vec<f32> = (-half..=half).map(|i| bump(i as f32 * step)).collect();
            prefilter(&mut grid);
            let value = |x: f32| {
                let s = x / step + half as f32;
                let j = s.floor();
                let w = weights(s - j);
                let first = j as usize - 1;
                (0..4).map(|m| w[m] * grid[first + m]).sum::<f32>()
            };
            let mut worst = 0.0_f32;
            for k in -400..400 {
                let x = k as f32 * 0.01;
                worst = worst.max((value(x) - bump(x)).abs());
            }
            // h^4 * 3 / 384 and the f32 floor.
            assert!(worst < bound, "step {step}: {worst:e}");
            assert!(worst > bound / 20.0, "step {step}: the bound is not idle: {worst:e}");
        }
    }

    #[test]
    fn weights_sum_to_one() {
        for t in [0.0_f32, 0.25, 0.5, 0.999] {
            let sum: f32 = weights(t).iter().sum();
            assert!((sum - 1.0).abs() < 3e-7, "t {t}: {sum}");
        }
    }
}

#[cfg(test)]
mod taps_tests {
    use super::*;
    use crate::render::table::{Form, PsfTable};
    use plan::optics::PsfModel;

    #[test]
    fn a_block_is_what_each_star_has() {
        let table = PsfTable::of_psf(&PsfModel::gaussian(0.8), 3, 8, Form::Images);
        let fractions = core::array::from_fn(|k| (k as f32 / 15.0 - 0.5) * 0.999_999);
        let taps = Taps::of::<false>(&fractions, 8);
        for (k, fraction) in fractions.into_iter().enumerate() {
            let ((first, weights), (wanted, wanted_weights)) = (taps.of_star(k), table.taps(fraction));
            assert_eq!(first, wanted, "{fraction}");
            for (weight, wanted) in weights.iter().zip(wanted_weights) {
                assert!((weight - wanted).abs() < 2e-7, "{fraction}: {weights:?}");
            }
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 3e-7, "{weights:?}");
        }
    }
}
