//! A small displacement that varies smoothly over the field: given at the nine probes, quadratic between them.

use crate::exposure::probes::SIDE;

/// Corrections below this are neglected, px.
const NOTHING_PX: f64 = 1e-9;

/// Displacements at the probes, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correction {
    size_px: [f64; 2],
    values: [[f64; 2]; SIDE * SIDE],
    is_nothing: bool,
}

impl Correction {
    /// Returns the correction through `values` at the probes (row by row) of a detector whose last pixel is at
    /// `size_px`.
    pub fn through(size_px: [f64; 2], values: [[f64; 2]; SIDE * SIDE]) -> Self {
        let is_nothing = values.iter().flatten().all(|v| v.abs() <= NOTHING_PX);
        Self { size_px, values, is_nothing }
    }

    /// Returns a correction of zero.
    pub fn none() -> Self {
        Self { size_px: [1.0; 2], values: [[0.0; 2]; SIDE * SIDE], is_nothing: true }
    }

    /// Returns the displacement at `px`.
    #[inline]
    pub fn at(&self, px: [f64; 2]) -> [f64; 2] {
        if self.is_nothing {
            return [0.0; 2];
        }
        let weights = |axis: usize| quadratic(2.0 * (px[axis] / self.size_px[axis]).clamp(-0.5, 1.5) - 1.0);
        let (across, down) = (weights(0), weights(1));
        let mut sum = [0.0; 2];
        for (row, wy) in self.values.chunks_exact(SIDE).zip(down) {
            for (value, wx) in row.iter().zip(across) {
                sum[0] += wx * wy * value[0];
                sum[1] += wx * wy * value[1];
            }
        }
        sum
    }
}

impl Correction {
    /// Adds the displacements at eight places to eight values, by component.
    #[inline(always)]
    pub(super) fn add_to_eight(&self, px: &[[f64; 8]; 2], to: &mut [[f64; 8]; 2]) {
        if self.is_nothing {
            return;
        }
        for k in 0..8 {
            let t = |axis: usize| 2.0 * (px[axis][k] / self.size_px[axis]).clamp(-0.5, 1.5) - 1.0;
            let (across, down) = (quadratic(t(0)), quadratic(t(1)));
            let mut sum = [0.0; 2];
            for row in 0..SIDE {
                for column in 0..SIDE {
                    let [x, y] = self.values[SIDE * row + column];
                    let weight = across[column] * down[row];
                    sum[0] += weight * x;
                    sum[1] += weight * y;
                }
            }
            to[0][k] += sum[0];
            to[1][k] += sum[1];
        }
    }
}

/// Returns the Lagrange weights at `t` for points at -1, 0, 1.
#[inline(always)]
pub fn quadratic(t: f64) -> [f64; 3] {
    [0.5 * t * (t - 1.0), 1.0 - t * t, 0.5 * t * (t + 1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_fields_come_back_exactly() {
        let field = |x: f64, y: f64| [1e-3 * x * x - 2e-3 * x * y, 3e-4 * y * y + 0.1];
        let values = core::array::from_fn(|i| field(50.0 * (i % 3) as f64, 40.0 * (i / 3) as f64));
        let correction = Correction::through([100.0, 80.0], values);
        let ([x, y], wanted) = (correction.at([17.0, 66.0]), field(17.0, 66.0));
        assert!((x - wanted[0]).abs() < 1e-12 && (y - wanted[1]).abs() < 1e-12, "{x} {y} {wanted:?}");
        assert_eq!(Correction::none().at([3.0, 4.0]), [0.0; 2]);
    }
}
