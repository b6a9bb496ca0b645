//! Tabulated pixel PSF, for PSFs without a closed form and for effective PSFs.
//!
//! `P(u)`: share of the light in the pixel whose centre lies `u` px from the star, sampled every `1 / S` px, stored as
//! cubic B-spline coefficients. A star of fraction `f` needs `P(i - f)` for all pixels `i`: with integer `S` the four
//! taps per axis are the same for every pixel, so the table is kept by phase, `[phase_y][row][16
//! columns][phase_x][column]`, and a star is a weighted sum of 16 small images; the four phases along x that a pixel
//! needs are adjacent in memory. Error: `3 / (384 (S sigma)^4)` of the peak; `S` is chosen to keep it below
//! [`TABLE_ERROR`](plan::exposure::sampling::TABLE_ERROR). Tests below compare with the exact integral.

use crate::render::grid::{Grid, LANES, flush, reserve_as};
use crate::render::kernel::{GaussianPath, accumulate};
use crate::render::products::{Phases, Products};
use crate::render::{psf_samples, spline};
use plan::exposure::moments::TracePoint;
use plan::optics::{PsfForm, PsfModel};

/// A tabulated pixel PSF.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PsfTable {
    /// Grid points per pixel.
    pub oversampling: usize,
    /// Half-width of the images along x and y, px.
    pub half_px: [usize; 2],
    /// Columns of an image, padded to a multiple of [`LANES`]; beyond `2 half_px + 1` they are 0.
    pub stride: usize,
    /// Coefficients by phase; stale where there is a sum of products.
    pub data: Vec<f32>,
    /// The same as a sum of products, where it was asked for and is cheaper.
    pub(super) products: Products,
    form: Form,
    grid: Grid,
    path: GaussianPath,
    /// Buffer for one column of the grid.
    column: Vec<f32>,
}

/// Storage form of a table's images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// By phase.
    #[default]
    Images,
    /// A sum of products where that is cheaper.
    Products,
    /// The grid alone: for whole stars.
    Grid,
}

impl PsfTable {
    /// Phases per axis: taps reach from `-S/2 - 1` to `S/2 + 2`.
    pub fn phases(&self) -> usize {
        self.oversampling + 4
    }

    /// Returns columns and rows of one image.
    pub fn size_px(&self) -> [usize; 2] {
        self.half_px.map(|half| 2 * half + 1)
    }

    /// Returns the first tap and the four weights for a star fraction in [-1/2, 1/2]: `(first phase, weights)`.
    #[inline(always)]
    pub fn taps(&self, fraction: f32) -> (usize, [f32; 4]) {
        let half = (self.oversampling / 2) as f32;
        let s = half - fraction * self.oversampling as f32;
        let j = s.floor().clamp(0.0, 2.0 * half);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=S")]
        (j as usize, spline::weights(s - j))
    }

    /// Returns the sixteen columns (the `c`-th) of a row at four phases along x, from `px` on.
    #[inline(always)]
    pub(super) fn four(&self, py: usize, row: usize, c: usize, px: usize) -> Option<&[[f32; LANES]; 4]> {
        let (vectors, _) = self.data.as_chunks::<LANES>();
        let at = ((py * self.size_px()[1] + row) * (self.stride / LANES) + c) * self.phases() + px;
        vectors.get(at..)?.first_chunk::<4>()
    }

    /// Returns one coefficient.
    pub fn value(&self, py: usize, px: usize, row: usize, column: usize) -> f32 {
        let (c, lane) = (column / LANES, column % LANES);
        let at = ((py * self.size_px()[1] + row) * (self.stride / LANES) + c) * self.phases() + px;
        self.data.get(at * LANES + lane).copied().unwrap_or(0.0)
    }

    /// Returns a table to be filled.
    pub fn empty(form: Form) -> Self {
        Self { form, ..Self::default() }
    }

    /// Returns the PSF itself, `s` grid points per pixel.
    pub fn of_psf(psf: &PsfModel, half_px: usize, s: usize, form: Form) -> Self {
        let mut table = Self::empty(form);
        table.size([half_px; 2], s);
        match psf.form() {
            PsfForm::Gaussian(sigma_px) => {
                table.path.trace([[1.0, 0.0, 0.0]].into_iter());
                accumulate(&mut table.path, &mut table.grid, sigma_px, s);
            }
            PsfForm::Round(psf) => {
                psf_samples::of_profile(psf, s, &mut table.grid);
                table.prefilter();
            }
            PsfForm::Grid(grid) => {
                if !psf_samples::refine(grid, s, &mut table.grid) {
                    psf_samples::of_grid(grid, s, &mut table.grid);
                    table.prefilter();
                }
            }
            // A field has a table for every node.
            PsfForm::Field(_) => {}
        }
        table.finish();
        table
    }

    /// Computes the PSF convolved with a path about its mean. `bases`: tables of the PSF itself, for PSFs that are not
    /// Gaussian, with as many grid points; `shares`: which of them, and how much of each.
    pub fn rebuild_kernel(
        &mut self,
        psf: &PsfModel,
        half_px: [usize; 2],
        s: usize,
        path: impl Iterator<Item = TracePoint>,
        shares: [(usize, f64); 4],
        bases: &[Self],
    ) {
        self.size(half_px, s);
        match psf.form() {
            PsfForm::Gaussian(sigma_px) => {
                self.path.trace(path);
                accumulate(&mut self.path, &mut self.grid, sigma_px, s);
            }
            PsfForm::Round(_) | PsfForm::Grid(_) | PsfForm::Field(_) => {
                for [weight, dx, dy] in path {
                    for (base, share) in shares.iter().filter(|(_, share)| *share > 0.0) {
                        let Some(base) = bases.get(*base) else { continue };
                        self.add_shifted(&base.grid, share * weight, dx, dy);
                    }
                }
                self.prefilter();
            }
        }
        self.finish();
    }

    /// Reserves capacity for the kernel of a path of so many nodes.
    pub(super) fn reserve_kernel(&mut self, half_px: [usize; 2], s: usize, nodes: usize) {
        self.size(half_px, s);
        let phases = Phases { oversampling: s, count: self.phases(), size_px: self.size_px() };
        self.data.reserve_exact(phases.count * phases.count * phases.size_px[1] * self.stride);
        self.path.reserve(&self.grid, s, nodes);
        self.products.reserve_most(&self.grid, phases);
    }

    /// Reserves capacity for a table like `other`.
    pub(super) fn reserve_as(&mut self, other: &Self) {
        reserve_as(&mut self.data, &other.data);
        reserve_as(&mut self.grid.values, &other.grid.values);
        reserve_as(&mut self.column, &other.column);
        self.products.reserve_as(&other.products);
        self.path.reserve_as(&other.path);
    }

    fn size(&mut self, half_px: [usize; 2], s: usize) {
        self.oversampling = s;
        self.half_px = half_px;
        self.stride = (2 * half_px[0] + 1).next_multiple_of(LANES);
        self.grid.reset(half_px.map(|half| half * s + s / 2 + 2));
    }

    /// Adds samples of a displaced base table (given as coefficients).
    fn add_shifted(&mut self, base: &Grid, weight: f64, dx: f64, dy: f64) {
        let s = self.oversampling as f64;
        let split = |shift: f64| {
            let at = -shift * s;
            let j = at.floor();
            #[allow(clippy::cast_possible_truncation, reason = "a displacement on a detector in grid steps")]
            (j as isize, spline::weights((at - j) as f32))
        };
        let ((jx, wx), (jy, wy)) = (split(dx), split(dy));
        let columns = self.grid.columns();
        let offset: [isize; 2] = core::array::from_fn(|i| base.half[i].cast_signed() - self.grid.half[i].cast_signed());
        for (gy, row) in self.grid.values.chunks_exact_mut(self.grid.stride).enumerate() {
            for (m, wy) in wy.iter().enumerate() {
                let by = gy.cast_signed() + offset[1] + jy + m.cast_signed() - 1;
                let Some(source) =
                    usize::try_from(by).ok().and_then(|by| base.values.chunks_exact(base.stride).nth(by))
                else {
                    continue;
                };
                for (n, wx) in wx.iter().enumerate() {
                    let gain = weight as f32 * wy * wx;
                    let first = offset[0] + jx + n.cast_signed() - 1;
                    add_scaled(&mut row[..columns], &source[..base.columns()], first, gain);
                }
            }
        }
    }

    fn prefilter(&mut self) {
        let (columns, rows, stride) = (self.grid.columns(), self.grid.rows(), self.grid.stride);
        for row in self.grid.values.chunks_exact_mut(stride) {
            spline::prefilter(&mut row[..columns]);
        }
        let mut column = core::mem::take(&mut self.column);
        column.resize(rows, 0.0);
        for x in 0..columns {
            for (y, value) in column.iter_mut().enumerate() {
                *value = self.grid.values[y * stride + x];
            }
            spline::prefilter(&mut column);
            for (y, value) in column.iter().enumerate() {
                self.grid.values[y * stride + x] = *value;
            }
        }
        self.column = column;
    }

    fn finish(&mut self) {
        flush(&mut self.grid.values);
        if self.form == Form::Grid {
            return;
        }
        let phases = Phases { oversampling: self.oversampling, count: self.phases(), size_px: self.size_px() };
        if self.form == Form::Images || !self.products.find(&self.grid, phases) {
            self.products.terms = 0;
            self.arrange();
        }
    }

    /// Adds `gain` times the shares of pixels in a row, whose first one has its centre at `from_px` from the star: from
    /// the grid itself, whatever form the table has.
    pub(super) fn add_line(&self, from_px: [f64; 2], gain: f64, out: &mut [f32]) {
        let s = self.oversampling;
        let taps = |axis: usize| {
            let at = from_px[axis] * s as f64 + self.grid.half[axis] as f64;
            #[allow(clippy::cast_possible_truncation, reason = "a place on a grid")]
            (at.floor() as isize - 1, spline::weights((at - at.floor()) as f32))
        };
        let ((x, wx), (y, wy)) = (taps(0), taps(1));
        let lines = (y..).zip(wy).filter_map(|(y, weight)| {
            let first = usize::try_from(y).ok().filter(|y| *y < self.grid.rows())? * self.grid.stride;
            Some((weight, self.grid.values.get(first..first + self.grid.columns())?))
        });
        for (weight, line) in lines {
            for (i, value) in out.iter_mut().enumerate() {
                let first = x + (i * s).cast_signed();
                let tap = |n: usize| usize::try_from(first + n.cast_signed()).ok().and_then(|at| line.get(at));
                let sum: f32 = wx.iter().enumerate().filter_map(|(n, weight)| Some(weight * tap(n)?)).sum();
                *value += (gain * f64::from(weight * sum)) as f32;
            }
        }
    }

    /// Sorts the grid into images by phase.
    fn arrange(&mut self) {
        let (phases, [columns, rows], per_row) = (self.phases(), self.size_px(), self.stride / LANES);
        let (stride, s) = (self.grid.stride, self.oversampling);
        self.data.resize(phases * rows * per_row * phases * LANES, 0.0);
        let (vectors, _) = self.data.as_chunks_mut::<LANES>();
        // Phase p at pixel 0 is at grid point half_px * S + S / 2 + 2 + (p - S / 2 - 1); so pixel -half_px at p + 1.
        for (i, vectors) in vectors.chunks_exact_mut(phases).enumerate() {
            let (py, row, c) = (i / per_row / rows, i / per_row % rows, i % per_row);
            let gy = py + 1 + row * s;
            // The last phase would read one past the grid's edge, where the PSF has ended.
            let source = self.grid.values.get(gy * stride..(gy + 1) * stride).unwrap_or(&[]);
            for (px, vector) in vectors.iter_mut().enumerate() {
                let first = c * LANES;
                for (lane, value) in vector.iter_mut().enumerate() {
                    let taken = source.get(px + 1 + (first + lane) * s).filter(|_| first + lane < columns);
                    *value = taken.copied().unwrap_or(0.0);
                }
            }
        }
    }
}

/// Adds `gain * source[x + first]` to `row[x]` where both exist.
fn add_scaled(row: &mut [f32], source: &[f32], first: isize, gain: f32) {
    let skip_row = usize::try_from(-first).unwrap_or(0);
    let skip_source = usize::try_from(first).unwrap_or(0);
    for (value, s) in row.iter_mut().skip(skip_row).zip(source.iter().skip(skip_source)) {
        *value += gain * s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plan::exposure::sampling::{MOST_OVERSAMPLING, TABLE_ERROR, drawn_table_error, oversampling};

    /// Returns the largest error over pixels and fractions, relative to the peak.
    fn worst(psf: &PsfModel, half_px: usize) -> f64 {
        let table = PsfTable::of_psf(psf, half_px, oversampling(psf), Form::Images);
        let mut worst = 0.0_f64;
        for fraction in [[0.0_f32, 0.0], [0.5, -0.5], [0.25, 0.4375], [-0.3, 0.11], [0.06, -0.44]] {
            let ((px, wx), (py, wy)) = (table.taps(fraction[0]), table.taps(fraction[1]));
            for row in 0..table.size_px()[0] {
                for column in 0..table.size_px()[0] {
                    let mut value = 0.0;
                    for (m, wy) in wy.iter().enumerate() {
                        for (n, wx) in wx.iter().enumerate() {
                            value += f64::from(wy * wx) * f64::from(table.value(py + m, px + n, row, column));
                        }
                    }
                    let half = half_px as f64;
                    let x = column as f64 - half - f64::from(fraction[0]);
                    let y = row as f64 - half - f64::from(fraction[1]);
                    worst = worst.max((value - psf.pixel(x, y)).abs());
                }
            }
        }
        worst / psf.peak()
    }

    #[test]
    fn tables_keep_the_error_they_promise() {
        let gaussians = [0.3, 0.5, 0.55, 0.8, 1.0, 1.2, 1.5].map(|sigma| (PsfModel::gaussian(sigma), 8));
        let airys = [(0.978_909, 0.0), (0.244_727, 0.3)].map(|(l, e)| (PsfModel::airy(l, e), 6));
        for (psf, half_px) in gaussians.into_iter().chain(airys) {
            let (worst, bound) = (worst(&psf, half_px), drawn_table_error(&psf).peak);
            println!("core {:.2} px: error {worst:.1e}, bound {bound:.1e}", psf.core_sigma_px());
            assert!(worst < TABLE_ERROR && worst < bound, "core {}: {worst:e}", psf.core_sigma_px());
        }
    }

    #[test]
    fn lines_of_the_grid_keep_their_digits_in_the_wings() {
        let (psf, half_px) = (PsfModel::moffat(1.2, 3.0), 30);
        let table = PsfTable::of_psf(&psf, half_px, oversampling(&psf), Form::Grid);
        assert!(table.data.is_empty(), "the grid alone");
        let mut worst = 0.0_f64;
        for y in [-20.3, -6.1, 0.2, 3.7, 29.9] {
            let mut line = vec![0.0_f32; 61];
            table.add_line([-30.2, y], 2.0, &mut line);
            for (i, value) in line.iter().enumerate() {
                let x = i as f64 - 30.2;
                if x.hypot(y) > 5.0 {
                    worst = worst.max((0.5 * f64::from(*value) / psf.pixel(x, y) - 1.0).abs());
                }
            }
        }
        // The error of the grid itself; in digits of the peak it would be a hundred times as much.
        assert!(worst < 3e-5, "{worst:e} of a pixel's own light");
    }

    #[test]
    fn no_table_has_denormal_numbers() {
        let is_denormal = |value: &f32| value.is_subnormal();
        // Control: a filter's tail over zeros ends in them.
        let mut tail = [0.0_f32; 300];
        tail[150] = 1.0;
        spline::prefilter(&mut tail);
        assert!(tail.iter().any(is_denormal), "control: {:e} at the end", tail[299]);
        let path = |i: u32| {
            let at = f64::from(i) / 31.0 - 0.5;
            [1.0 / 32.0, 20.0 * at, 9.0 * (at + 0.4 * (9.0 * at).sin())]
        };
        for psf in [PsfModel::gaussian(0.3), PsfModel::gaussian(0.8), PsfModel::airy(0.978_909, 0.3)] {
            let s = oversampling(&psf);
            for form in [Form::Images, Form::Products] {
                let bases = [PsfTable::of_psf(&psf, 6, s, Form::Images)];
                let mut table = PsfTable::empty(form);
                table.rebuild_kernel(
                    &psf,
                    [18, 14],
                    s,
                    (0..32).map(path),
                    [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
                    &bases,
                );
                for table in [&table, &bases[0]] {
                    let denormals =
                        table.data.iter().chain(&table.grid.values).filter(|value| is_denormal(value)).count();
                    assert_eq!(denormals + table.products.denormals(), 0, "sigma {}, {form:?}", psf.core_sigma_px());
                }
                assert!(table.grid.values.contains(&0.0), "control: the path leaves corners empty");
            }
        }
    }

    #[test]
    fn a_table_too_coarse_breaks_the_promise() {
        let narrow = PsfModel::gaussian(0.15);
        assert_eq!(oversampling(&narrow), MOST_OVERSAMPLING, "the finest there is");
        assert!(oversampling(&PsfModel::gaussian(1.5)) < oversampling(&PsfModel::gaussian(0.5)), "follows sigma");
    }
}
