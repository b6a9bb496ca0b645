//! Tabulated pixel PSF, for PSFs without a closed form and for effective PSFs.
//!
//! `P(u)`: share of the light in the pixel whose centre lies `u` px from the star, sampled every `1 / S` px, stored as
//! cubic B-spline coefficients. A star of fraction `f` needs `P(i - f)` for all pixels `i`: with integer `S` the four
//! taps per axis are the same for every pixel, so the table is kept by phase, `[phase_y][phase_x][row][column]`, and a
//! star is a weighted sum of 16 small images. Error: `3 / (384 (S sigma)^4)` of the peak; `S` is chosen to keep it
//! below [`TABLE_ERROR`]. Tests below compare with the exact integral.

use crate::exposure::ExposurePlan;
use crate::exposure::planner::TABLE_ERROR;
use crate::optics::PsfModel;
use crate::optics::airy::Airy;
use crate::optics::quadrature::gauss_legendre;
use crate::render::erf::erf;
use crate::render::spline;

/// Columns of every stored image are a multiple of this.
pub const LANES: usize = 16;
/// Largest oversampling.
const MOST_OVERSAMPLING: usize = 32;
/// Gauss-Legendre nodes per axis and subcell of an Airy table.
const SUBCELL_NODES: usize = 4;

/// A tabulated pixel PSF.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PsfTable {
    /// Grid points per pixel.
    pub oversampling: usize,
    /// Half-width of the images, px.
    pub half_px: usize,
    /// Floats per row of an image (a multiple of [`LANES`]; beyond `2 half_px + 1` they are 0).
    pub stride: usize,
    /// Coefficients by phase.
    pub data: Vec<f32>,
    grid: Grid,
    axes: [Vec<f32>; 2],
}

/// Samples or coefficients on the square grid of step `1 / S`, centre in the middle.
#[derive(Debug, Clone, PartialEq, Default)]
struct Grid {
    half: usize,
    values: Vec<f32>,
}

impl Grid {
    fn side(&self) -> usize {
        2 * self.half + 1
    }

    fn reset(&mut self, half: usize) {
        self.half = half;
        let side = self.side();
        self.values.clear();
        self.values.resize(side * side, 0.0);
    }
}

impl PsfTable {
    /// Phases per axis: taps reach from `-S/2 - 1` to `S/2 + 2`.
    #[must_use]
    pub fn phases(&self) -> usize {
        self.oversampling + 4
    }

    /// Rows (and used columns) of an image.
    #[must_use]
    pub fn rows(&self) -> usize {
        2 * self.half_px + 1
    }

    /// Floats of one image.
    #[must_use]
    pub fn image_len(&self) -> usize {
        self.rows() * self.stride
    }

    /// First tap and the four weights for a star fraction in [-1/2, 1/2]: `(first phase, weights)`.
    #[inline(always)]
    #[must_use]
    pub fn taps(&self, fraction: f32) -> (usize, [f32; 4]) {
        let half = (self.oversampling / 2) as f32;
        let s = half - fraction * self.oversampling as f32;
        let j = s.floor().clamp(0.0, 2.0 * half);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=S")]
        (j as usize, spline::weights(s - j))
    }

    /// The PSF itself.
    #[must_use]
    pub fn of_psf(psf: &PsfModel, half_px: usize) -> Self {
        let mut table = Self { oversampling: oversampling(psf), ..Self::default() };
        match psf {
            PsfModel::Gaussian { sigma_px } => {
                table.size(half_px);
                table.add_gaussian(*sigma_px, 1.0, 0.0, 0.0);
            }
            PsfModel::Airy(airy) => {
                table.size(half_px);
                sample_airy(airy, table.oversampling, &mut table.grid);
                table.prefilter();
            }
        }
        table.arrange();
        table
    }

    /// The PSF convolved with the plan's path, about the path's mean. `base` is the table of the PSF itself.
    pub fn rebuild_effective(&mut self, plan: &ExposurePlan, base: &Self) {
        let reach = plan.kernel_path().fold(0.0_f64, |reach, (_, x, y)| reach.max(x.abs()).max(y.abs()));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a path on a detector, px")]
        let half_px = plan.half_px + reach.ceil() as usize;
        self.oversampling = oversampling(&plan.psf);
        self.size(half_px);
        match &plan.psf {
            PsfModel::Gaussian { sigma_px } => {
                for (weight, dx, dy) in plan.kernel_path() {
                    self.add_gaussian(*sigma_px, weight, dx, dy);
                }
            }
            PsfModel::Airy(_) => {
                for (weight, dx, dy) in plan.kernel_path() {
                    self.add_shifted(&base.grid, weight, dx, dy);
                }
                self.prefilter();
            }
        }
        self.arrange();
    }

    fn size(&mut self, half_px: usize) {
        self.half_px = half_px;
        self.stride = self.rows().next_multiple_of(LANES);
        self.grid.reset(half_px * self.oversampling + self.oversampling / 2 + 2);
    }

    /// Adds a displaced Gaussian's coefficients: an outer product of two prefiltered axes.
    fn add_gaussian(&mut self, sigma_px: f64, weight: f64, dx: f64, dy: f64) {
        let side = self.grid.side();
        let (half, step) = (self.grid.half as f64, 1.0 / self.oversampling as f64);
        let scale = core::f64::consts::FRAC_1_SQRT_2 / sigma_px;
        for (axis, (shift, gain)) in self.axes.iter_mut().zip([(dx, 1.0), (dy, weight)]) {
            axis.clear();
            axis.extend((0..side).map(|g| {
                let u = (g as f64 - half) * step - shift;
                let (low, high) = (((u - 0.5) * scale) as f32, ((u + 0.5) * scale) as f32);
                0.5 * gain as f32 * (erf::<false>(high) - erf::<false>(low))
            }));
            spline::prefilter(axis);
        }
        let [along_x, along_y] = &self.axes;
        for (row, y) in self.grid.values.chunks_exact_mut(side).zip(along_y) {
            for (value, x) in row.iter_mut().zip(along_x) {
                *value += y * x;
            }
        }
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
        let (side, base_side) = (self.grid.side(), base.side());
        let offset = base.half.cast_signed() - self.grid.half.cast_signed();
        for (gy, row) in self.grid.values.chunks_exact_mut(side).enumerate() {
            for (m, wy) in wy.iter().enumerate() {
                let by = gy.cast_signed() + offset + jy + m.cast_signed() - 1;
                let Some(source) = usize::try_from(by).ok().and_then(|by| base.values.chunks_exact(base_side).nth(by))
                else {
                    continue;
                };
                for (n, wx) in wx.iter().enumerate() {
                    let gain = weight as f32 * wy * wx;
                    let first = offset + jx + n.cast_signed() - 1;
                    add_scaled(row, source, first, gain);
                }
            }
        }
    }

    fn prefilter(&mut self) {
        let side = self.grid.side();
        for row in self.grid.values.chunks_exact_mut(side) {
            spline::prefilter(row);
        }
        let mut column = vec![0.0; side];
        for x in 0..side {
            for (y, value) in column.iter_mut().enumerate() {
                *value = self.grid.values[y * side + x];
            }
            spline::prefilter(&mut column);
            for (y, value) in column.iter().enumerate() {
                self.grid.values[y * side + x] = *value;
            }
        }
    }

    /// Grid -> images by phase.
    fn arrange(&mut self) {
        let (phases, rows, stride, side) = (self.phases(), self.rows(), self.stride, self.grid.side());
        self.data.clear();
        self.data.resize(phases * phases * rows * stride, 0.0);
        // Phase p at pixel 0 stands at grid point half_px * S + S / 2 + 2 + (p - S / 2 - 1); so pixel -half_px at p + 1.
        for (image, data) in self.data.chunks_exact_mut(rows * stride).enumerate() {
            let (py, px) = (image / phases, image % phases);
            for (row, line) in data.chunks_exact_mut(stride).enumerate() {
                let gy = py + 1 + row * self.oversampling;
                // The last phase would read one past the grid's edge, where the PSF has ended.
                let Some(source) = self.grid.values.get(gy * side..(gy + 1) * side) else { continue };
                let taps = source.iter().skip(px + 1).step_by(self.oversampling);
                for (value, tap) in line.iter_mut().take(rows).zip(taps) {
                    *value = *tap;
                }
            }
        }
    }
}

/// `row[x] += gain * source[x + first]` where both exist.
fn add_scaled(row: &mut [f32], source: &[f32], first: isize, gain: f32) {
    let skip_row = usize::try_from(-first).unwrap_or(0);
    let skip_source = usize::try_from(first).unwrap_or(0);
    for (value, s) in row.iter_mut().skip(skip_row).zip(source.iter().skip(skip_source)) {
        *value += gain * s;
    }
}

/// Grid points per pixel that keep the interpolation error below [`TABLE_ERROR`].
fn oversampling(psf: &PsfModel) -> usize {
    let error = |s: f64| match psf {
        PsfModel::Gaussian { sigma_px } => 3.0 / (384.0 * (s * sigma_px).powi(4)),
        // Band limit 1 / L cycles per px: the pattern's own fourth derivative at the peak, (2 pi / L)^4 / 24.
        PsfModel::Airy(airy) => (2.0 * core::f64::consts::PI / (airy.lambda_n_px() * s)).powi(4) / (24.0 * 384.0),
    };
    [4, 8, 16].into_iter().find(|&s| error(s as f64) <= TABLE_ERROR).unwrap_or(MOST_OVERSAMPLING)
}

/// Pixel integrals of an Airy pattern on the grid, by summing subcells of side `1 / S`.
fn sample_airy(airy: &Airy, oversampling: usize, grid: &mut Grid) {
    let (side, half) = (grid.side(), grid.half);
    let margin = oversampling / 2;
    let cells = side - 1 + oversampling; // subcell c spans grid coordinate (c - half - margin) .. + 1
    let step = 1.0 / oversampling as f64;
    let nodes = gauss_legendre(SUBCELL_NODES);
    let middle = cells / 2; // even: symmetric about the centre
    let quadrant: Vec<f64> = {
        use rayon::prelude::*;
        (0..middle * middle)
            .into_par_iter()
            .map(|i| {
                let (cx, cy) = (i % middle, i / middle);
                if cx < cy {
                    return 0.0; // by symmetry from (cy, cx)
                }
                let value = |nx: f64, ny: f64| {
                    let (x, y) = ((cx as f64 + 0.5 + nx) * step, (cy as f64 + 0.5 + ny) * step);
                    airy.irradiance(x.hypot(y))
                };
                let sum: f64 = nodes
                    .iter()
                    .flat_map(|a| nodes.iter().map(move |b| (a, b)))
                    .map(|(a, b)| a.weight * b.weight * value(a.x, b.x))
                    .sum();
                sum * step * step
            })
            .collect()
    };
    let fold = |c: usize| if c >= middle { c - middle } else { middle - 1 - c };
    let cell = |x: usize, y: usize| {
        let (x, y) = (fold(x), fold(y));
        quadrant[x.min(y) * middle + x.max(y)]
    };
    // Running sums along x, then along y.
    let mut along_x = vec![0.0_f64; side * cells];
    for y in 0..cells {
        let mut sum: f64 = (0..oversampling).map(|x| cell(x, y)).sum();
        for x in 0..side {
            along_x[y * side + x] = sum;
            if x + 1 < side {
                sum += cell(x + oversampling, y) - cell(x, y);
            }
        }
    }
    for x in 0..side {
        let mut sum: f64 = (0..oversampling).map(|y| along_x[y * side + x]).sum();
        for y in 0..side {
            grid.values[y * side + x] = sum as f32;
            if y + 1 < side {
                sum += along_x[(y + oversampling) * side + x] - along_x[y * side + x];
            }
        }
    }
    debug_assert_eq!(cells, 2 * (half + margin), "the subcells are centred");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error over pixels and fractions, relative to the peak.
    fn worst(psf: &PsfModel, half_px: usize) -> f64 {
        let table = PsfTable::of_psf(psf, half_px);
        let phases = table.phases();
        let mut worst = 0.0_f64;
        for fraction in [[0.0_f32, 0.0], [0.5, -0.5], [0.25, 0.4375], [-0.3, 0.11], [0.06, -0.44]] {
            let ((px, wx), (py, wy)) = (table.taps(fraction[0]), table.taps(fraction[1]));
            for row in 0..table.rows() {
                for column in 0..table.rows() {
                    let mut value = 0.0;
                    for (m, wy) in wy.iter().enumerate() {
                        for (n, wx) in wx.iter().enumerate() {
                            let image = ((py + m) * phases + px + n) * table.image_len();
                            value += f64::from(wy * wx) * f64::from(table.data[image + row * table.stride + column]);
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
        for sigma in [0.5, 0.8, 1.5] {
            let worst = worst(&PsfModel::gaussian(sigma), 8);
            assert!(worst < TABLE_ERROR, "sigma {sigma}: {worst:e}");
        }
        for (l, e) in [(0.978_909, 0.0), (0.244_727, 0.3)] {
            let worst = worst(&PsfModel::airy(l, e), 6);
            assert!(worst < TABLE_ERROR, "L {l}: {worst:e}");
        }
    }

    #[test]
    fn a_table_too_coarse_breaks_the_promise() {
        let narrow = PsfModel::gaussian(0.15);
        assert_eq!(oversampling(&narrow), MOST_OVERSAMPLING, "the finest there is");
        assert!(oversampling(&PsfModel::gaussian(1.5)) < oversampling(&PsfModel::gaussian(0.5)), "follows sigma");
    }
}
