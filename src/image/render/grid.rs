//! The grid of a table's samples and coefficients, in rows of whole vectors.

/// Columns of every stored image are a multiple of this.
pub const LANES: usize = 16;

/// Samples or coefficients on the grid of step `1 / S`, centre in the middle; rows padded to whole vectors.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Grid {
    pub(super) half: [usize; 2],
    pub(super) stride: usize,
    pub(super) values: Vec<f32>,
}

impl Grid {
    pub(super) fn columns(&self) -> usize {
        2 * self.half[0] + 1
    }

    pub(super) fn rows(&self) -> usize {
        2 * self.half[1] + 1
    }

    /// Clears the grid for another size.
    pub(super) fn reset(&mut self, half: [usize; 2]) {
        self.half = half;
        self.stride = self.columns().next_multiple_of(LANES);
        self.values.clear();
        self.values.resize(self.rows() * self.stride, 0.0);
    }
}

/// Coefficients below this are zero: tails of filters and products would end in denormal numbers, with which processors
/// are ten times slower, and no star has so many electrons that it could be seen.
const NOTHING: f32 = 1e-18;

/// Replaces coefficients that are next to nothing by zero.
#[inline(always)]
pub(super) fn flush(values: &mut [f32]) {
    for value in values {
        *value = if value.abs() < NOTHING { 0.0 } else { *value };
    }
}

/// Makes `space` hold as much as `other` could without growing.
pub(super) fn reserve_as<T>(space: &mut Vec<T>, other: &Vec<T>) {
    space.reserve_exact(other.capacity().saturating_sub(space.len()));
}
