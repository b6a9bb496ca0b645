//! Fractions of pixels -> phases and spline weights of a table, for a block of stars at once: a vector loop.
//!
//! Test: `a_block_is_what_each_star_has`.

use crate::render::bands::BLOCK;
use base::fused::{mul_add, whole_bits};

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
