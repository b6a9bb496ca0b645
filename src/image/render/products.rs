//! A table as a short sum of products `across_k(x) down_k(y)`: a star then costs two small sets of vectors and one
//! multiply-add for every term and row, in place of sixteen images that no first-level cache holds.
//!
//! In: spline coefficients on the table's grid. Out: the terms, by phase. Method: elimination with complete pivoting
//! (the adaptive cross approximation; Bebendorf, Numerische Mathematik 86 (2000), 565, with every entry looked at),
//! which leaves nothing of the largest entry's row and column, until no entry is larger than [`PRODUCTS_ERROR`] of the
//! largest: an exact bound of what any pixel lacks, since spline weights are positive and sum to 1. A Gaussian is one
//! term, one that moves along a line three to eight. Where the terms would cost more than the images, the images are
//! drawn. Tests in `stamp`, and the agreement tests of the backend.

use crate::render::grid::{Grid, LANES, flush};
use base::{fused::mul_add, vector_level::vector_level};
use plan::exposure::sampling::PRODUCTS_ERROR;
use pulp::{Arch, NullaryFnOnce};

/// Terms at most.
pub(super) const MOST_TERMS: usize = 16;
/// Rows of an image at most.
const MOST_ROWS: usize = 96;
/// A sum of products is drawn where its multiply-adds are at most this share of those of the images.
const WORTHWHILE: f64 = 0.8;

/// The terms of one table.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Products {
    /// Number of terms, including zero terms that fill up a vector; 0: the sum is not available.
    pub(super) terms: usize,
    /// Vectors of a row.
    pub(super) per_row: usize,
    /// Vectors of a column.
    pub(super) per_column: usize,
    /// By phase along x, term and vector: columns of the image.
    across: Vec<[f32; LANES]>,
    /// By phase along y, term and vector: rows of the image.
    down: Vec<[f32; LANES]>,
    /// Residual of the grid.
    rest: Vec<f32>,
    /// Rows and columns of the elimination, one after the other.
    rows: Vec<f32>,
    columns: Vec<f32>,
}

/// Relation of a grid's points to the pixels of images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Phases {
    /// Grid points per pixel.
    pub(super) oversampling: usize,
    /// Phases.
    pub(super) count: usize,
    /// Columns and rows of an image.
    pub(super) size_px: [usize; 2],
}

impl Products {
    /// Replaces the terms by those of `grid`; false where its images are cheaper.
    pub(super) fn find(&mut self, grid: &Grid, phases: Phases) -> bool {
        self.per_row = phases.size_px[0].div_ceil(LANES);
        self.per_column = phases.size_px[1].div_ceil(LANES);
        self.terms = 0;
        let most = most_terms(phases.size_px);
        if most == 0 {
            return false;
        }
        self.reserve(grid, phases, most);
        let arch = vector_level();
        let fused = !matches!(arch, Arch::Scalar);
        let found = arch.dispatch(Eliminate { products: self, grid, most, fused });
        let Some(drawn) = found.map(drawn_terms).filter(|drawn| *drawn <= most.max(2)) else { return false };
        self.terms = drawn;
        self.arrange(grid, phases);
        true
    }

    /// Reserves capacity for the terms of a table.
    pub(super) fn reserve_most(&mut self, grid: &Grid, phases: Phases) {
        [self.per_row, self.per_column] = phases.size_px.map(|side| side.div_ceil(LANES));
        self.rest.reserve_exact(grid.values.len());
        self.reserve(grid, phases, MOST_TERMS);
    }

    /// Reserves capacity for the most terms: the next path may need more than this one.
    fn reserve(&mut self, grid: &Grid, phases: Phases, most: usize) {
        let drawn = drawn_terms(most);
        self.across.clear();
        self.across.reserve_exact(phases.count * drawn * self.per_row);
        self.down.clear();
        self.down.reserve_exact(phases.count * drawn * self.per_column);
        self.rows.clear();
        self.rows.reserve_exact(drawn * grid.stride);
        self.columns.clear();
        self.columns.reserve_exact(drawn * grid.rows());
    }

    /// Reserves capacity for the terms of a table like `other`.
    pub(super) fn reserve_as(&mut self, other: &Self) {
        use crate::render::grid::reserve_as;
        reserve_as(&mut self.across, &other.across);
        reserve_as(&mut self.down, &other.down);
        reserve_as(&mut self.rest, &other.rest);
        reserve_as(&mut self.rows, &other.rows);
        reserve_as(&mut self.columns, &other.columns);
    }

    /// Returns vector `c` of the columns of every term at the four phases from `px` on, by their weights.
    #[inline(always)]
    pub(super) fn across<const TERMS: usize, const FUSED: bool>(
        &self,
        px: usize,
        c: usize,
        weights: [f32; 4],
    ) -> [[f32; LANES]; TERMS] {
        taken::<TERMS, FUSED>(&self.across, px, [c, self.per_row], weights)
    }

    /// Returns vector `c` of the rows of every term at the four phases from `py` on, by their weights.
    #[inline(always)]
    pub(super) fn down<const TERMS: usize, const FUSED: bool>(
        &self,
        py: usize,
        c: usize,
        weights: [f32; 4],
    ) -> [[f32; LANES]; TERMS] {
        taken::<TERMS, FUSED>(&self.down, py, [c, self.per_column], weights)
    }

    /// Returns the number of denormal numbers among the terms.
    #[cfg(test)]
    pub(super) fn denormals(&self) -> usize {
        let (across, down) = (self.across.as_flattened(), self.down.as_flattened());
        across.iter().chain(down).chain(&self.rest).filter(|value| value.is_subnormal()).count()
    }

    /// Sorts rows and columns of the elimination into vectors by phase.
    fn arrange(&mut self, grid: &Grid, phases: Phases) {
        let Self { terms, rows, columns, across, down, per_row, per_column, .. } = self;
        by_phase(rows, grid.stride, *terms, [phases.size_px[0], *per_row], phases, across);
        by_phase(columns, grid.rows(), *terms, [phases.size_px[1], *per_column], phases, down);
    }
}

/// Lines of the grid, `stride` apart -> `[phase][term][vector]` of their pixels; beyond the image's `size` zeros.
fn by_phase(
    lines: &mut [f32],
    stride: usize,
    terms: usize,
    [size, vectors]: [usize; 2],
    phases: Phases,
    out: &mut Vec<[f32; LANES]>,
) {
    flush(lines);
    out.clear();
    out.resize(phases.count * terms * vectors, [0.0; LANES]);
    for (phase, out) in out.chunks_exact_mut(terms * vectors).enumerate() {
        for (line, out) in lines.chunks_exact(stride).zip(out.chunks_exact_mut(vectors)) {
            // As for the images: phase p of the first pixel is at grid point p + 1.
            let pixels = line.iter().skip(phase + 1).step_by(phases.oversampling).take(size);
            for (value, pixel) in out.as_flattened_mut().iter_mut().zip(pixels) {
                *value = *pixel;
            }
        }
    }
}

#[inline(always)]
fn taken<const TERMS: usize, const FUSED: bool>(
    vectors: &[[f32; LANES]],
    phase: usize,
    [c, per_line]: [usize; 2],
    weights: [f32; 4],
) -> [[f32; LANES]; TERMS] {
    let mut sums = [[0.0_f32; LANES]; TERMS];
    for (n, weight) in weights.into_iter().enumerate() {
        let lines = vectors.get((phase + n) * TERMS * per_line + c..).unwrap_or(&[]);
        // Most images are one vector wide: no steps to take then.
        if let (1, Some(lines)) = (per_line, lines.first_chunk::<TERMS>()) {
            for (sum, values) in sums.iter_mut().zip(lines) {
                add::<FUSED>(sum, values, weight);
            }
        } else {
            for (sum, values) in sums.iter_mut().zip(lines.iter().step_by(per_line)) {
                add::<FUSED>(sum, values, weight);
            }
        }
    }
    sums
}

#[inline(always)]
fn add<const FUSED: bool>(sum: &mut [f32; LANES], values: &[f32; LANES], weight: f32) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum = mul_add::<FUSED>(weight, *value, *sum);
    }
}

/// Returns numbers of terms for which there is a loop.
fn drawn_terms(terms: usize) -> usize {
    [1, 2, 3, 4, 5, 6, 8, 12].into_iter().find(|drawn| *drawn >= terms).unwrap_or(MOST_TERMS)
}

/// Returns the number of terms up to which they cost less than the images.
fn most_terms([columns, rows]: [usize; 2]) -> usize {
    if rows > MOST_ROWS {
        return 0;
    }
    let (per_row, per_column) = (columns.div_ceil(LANES), rows.div_ceil(LANES));
    let each = 4 * per_column * per_row + 4 * per_row + rows * per_row;
    let images = WORTHWHILE * (16 * rows * per_row) as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small number of terms")]
    let most = (images / each as f64) as usize;
    most.min(MOST_TERMS)
}

/// The elimination, in the shape `pulp` compiles once per vector level.
struct Eliminate<'a> {
    products: &'a mut Products,
    grid: &'a Grid,
    most: usize,
    fused: bool,
}

impl NullaryFnOnce for Eliminate<'_> {
    type Output = Option<usize>;
    #[inline(always)]
    fn call(self) -> Option<usize> {
        if self.fused { self.terms::<true>() } else { self.terms::<false>() }
    }
}

impl Eliminate<'_> {
    /// Returns how many terms there are; `None`: more than the most.
    #[inline(always)]
    fn terms<const FUSED: bool>(self) -> Option<usize> {
        let Self { products: Products { rest, rows, columns, .. }, grid, most, .. } = self;
        let (stride, height) = (grid.stride, grid.rows());
        rest.clear();
        rest.extend_from_slice(&grid.values[..height * stride]);
        let mut pivot = largest(rest, stride);
        let allowed = pivot.size * PRODUCTS_ERROR as f32;
        for term in 0..=most {
            if pivot.size <= allowed {
                return Some(term.max(1));
            }
            if term == most {
                break;
            }
            let [row, column] = pivot.at;
            let over = 1.0 / rest[row * stride + column];
            columns.extend(rest.chunks_exact(stride).map(|line| line[column] * over));
            rows.extend_from_slice(&rest[row * stride..(row + 1) * stride]);
            let (taken, gains) = (&rows[term * stride..], &columns[term * height..]);
            pivot = Pivot::default();
            for (at, (line, gain)) in rest.chunks_exact_mut(stride).zip(gains).enumerate() {
                for (value, taken) in line.iter_mut().zip(taken) {
                    *value = mul_add::<FUSED>(-gain, *taken, *value);
                }
                flush(line);
                pivot.see(at, line);
            }
        }
        None
    }
}

/// The largest entry.
#[derive(Debug, Clone, Copy, Default)]
struct Pivot {
    size: f32,
    at: [usize; 2],
}

impl Pivot {
    /// Looks at a row; the first of equals counts.
    #[inline(always)]
    fn see(&mut self, row: usize, line: &[f32]) {
        let (vectors, _) = line.as_chunks::<LANES>();
        let mut most = [0.0_f32; LANES];
        for vector in vectors {
            for (most, value) in most.iter_mut().zip(vector) {
                *most = if value.abs() > *most { value.abs() } else { *most };
            }
        }
        let size = most.into_iter().fold(0.0, f32::max);
        if size > self.size {
            let column = line.iter().position(|value| value.abs() == size).unwrap_or(0);
            *self = Self { size, at: [row, column] };
        }
    }
}

#[inline(always)]
fn largest(values: &[f32], stride: usize) -> Pivot {
    let mut pivot = Pivot::default();
    for (row, line) in values.chunks_exact(stride).enumerate() {
        pivot.see(row, line);
    }
    pivot
}
