//! Image -> background level and noise: a coarse grid for the whole image, or a ring about one window.
//!
//! Each cell's level is the mean, and its noise the standard deviation, of a subsample clipped about its median
//! (Bertin & Arnouts, "SExtractor", A&AS 117 (1996), 393, section 2). Between cell centres the level is bilinear.
//! Limit: a cell filled with stars or with structure finer than a cell is not followed. Tests:
//! `background_is_found_under_stars`, `background_follows_a_slope`.

use base::image::DnImage;

/// Samples along each axis of one cell.
const SAMPLES_PER_AXIS: usize = 24;
/// Clipping about the median, in standard deviations.
const CLIP_SIGMA: f64 = 3.0;
/// Standard deviation of a Gaussian clipped at 3 sigma, relative: sqrt(1 - 6 phi(3) / erf(3 / sqrt 2)).
const CLIPPED_SIGMA: f64 = 0.9866;
/// Quartile of a Gaussian to its standard deviation.
const SIGMA_PER_QUARTILE_RANGE: f64 = 0.7413;
/// Noise of an ideal converter, DN (uniform over one step): nothing is quieter.
const QUANTISATION_DN: f64 = 0.288_675;

/// Level and noise of a patch of sky.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Background {
    /// Mean, DN.
    pub(super) level_dn: f64,
    /// Standard deviation of one pixel, DN.
    pub(super) sigma_dn: f64,
}

/// Returns the background of samples, which are reordered. No samples give zeros.
pub(super) fn clipped(samples: &mut [u16]) -> Background {
    if samples.is_empty() {
        return Background::default();
    }
    let count = samples.len();
    let [low, middle, high] = [count / 4, count / 2, (3 * count / 4).min(count - 1)];
    let (below, median, above) = samples.select_nth_unstable(middle);
    let median = f64::from(*median);
    let lower = if below.is_empty() { median } else { f64::from(*below.select_nth_unstable(low.min(middle - 1)).1) };
    let upper = if above.is_empty() {
        median
    } else {
        f64::from(*above.select_nth_unstable((high.saturating_sub(middle + 1)).min(above.len() - 1)).1)
    };
    let rough = (SIGMA_PER_QUARTILE_RANGE * (upper - lower)).max(2.0 * QUANTISATION_DN);
    // Half a step more: a whole number represents the interval about it.
    let reach = CLIP_SIGMA * rough + 0.5;
    let (mut number, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for offset in samples.iter().map(|dn| f64::from(*dn) - median).filter(|offset| offset.abs() <= reach) {
        number += 1.0;
        sum += offset;
        squares += offset * offset;
    }
    let mean = sum / number;
    let sigma_dn = (squares / number - mean * mean).max(0.0).sqrt() / CLIPPED_SIGMA;
    Background { level_dn: median + mean, sigma_dn: sigma_dn.max(QUANTISATION_DN) }
}

/// Background of the whole image in square cells.
#[derive(Debug, Clone)]
pub(super) struct BackgroundGrid {
    cell_px: usize,
    columns: usize,
    rows: usize,
    cells: Vec<Background>,
    thresholds_dn: Vec<f64>,
    samples: Vec<u16>,
}

impl BackgroundGrid {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let cell_px = if width.min(height) >= 512 { 64 } else { 32 };
        let (columns, rows) = ((width / cell_px).max(1), (height / cell_px).max(1));
        let samples = Vec::with_capacity((2 * SAMPLES_PER_AXIS + 2) * (2 * SAMPLES_PER_AXIS + 2));
        let cells = vec![Background::default(); columns * rows];
        Self { cell_px, columns, rows, thresholds_dn: vec![0.0; cells.len()], cells, samples }
    }

    /// Measures every cell, and sets thresholds of `sigmas` above it. The last cells take what is left over.
    pub(super) fn measure(&mut self, image: &DnImage, sigmas: f64) {
        let step = (self.cell_px / SAMPLES_PER_AXIS).max(1);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (x, y) = (column * self.cell_px, row * self.cell_px);
                let (end_x, end_y) = self.cell_end(column, row, image);
                self.samples.clear();
                for line in image.rows().take(end_y).skip(y).step_by(step) {
                    self.samples.extend(line[x..end_x].iter().step_by(step));
                }
                self.cells[row * self.columns + column] = clipped(&mut self.samples);
            }
        }
        for row in 0..self.rows {
            for column in 0..self.columns {
                self.thresholds_dn[row * self.columns + column] = self.lowest_threshold(column, row, sigmas);
            }
        }
    }

    /// Returns a threshold in DN that is nowhere in the cell above the local one.
    pub(super) fn threshold_dn(&self, column: usize, row: usize) -> f64 {
        self.thresholds_dn[row * self.columns + column]
    }

    fn cell_end(&self, column: usize, row: usize, image: &DnImage) -> (usize, usize) {
        let end = |at: usize, count: usize, size: usize| if at + 1 == count { size } else { (at + 1) * self.cell_px };
        (end(column, self.columns, image.width()), end(row, self.rows, image.height()))
    }

    /// Columns, rows and edge of the cells.
    pub(super) fn shape(&self) -> (usize, usize, usize) {
        (self.columns, self.rows, self.cell_px)
    }

    /// Returns the background at a place: level bilinear between cell centres, noise likewise.
    pub(super) fn at(&self, x_px: f64, y_px: f64) -> Background {
        let (c, fx) = between(x_px, self.cell_px, self.columns);
        let (r, fy) = between(y_px, self.cell_px, self.rows);
        let (next_c, next_r) = ((c + 1).min(self.columns - 1), (r + 1).min(self.rows - 1));
        let mix = |of: fn(&Background) -> f64| {
            let cell = |c: usize, r: usize| of(&self.cells[r * self.columns + c]);
            let top = cell(c, r) + fx * (cell(next_c, r) - cell(c, r));
            let bottom = cell(c, next_r) + fx * (cell(next_c, next_r) - cell(c, next_r));
            top + fy * (bottom - top)
        };
        Background { level_dn: mix(|b| b.level_dn), sigma_dn: mix(|b| b.sigma_dn) }
    }

    /// Returns the lowest midpoint to a neighbour: bilinear levels inside the cell are between its midpoints.
    fn lowest_threshold(&self, column: usize, row: usize, sigmas: f64) -> f64 {
        let own = &self.cells[row * self.columns + column];
        let mut lowest = own.level_dn + sigmas * own.sigma_dn;
        for r in row.saturating_sub(1)..(row + 2).min(self.rows) {
            for c in column.saturating_sub(1)..(column + 2).min(self.columns) {
                let cell = &self.cells[r * self.columns + c];
                let midpoint = Background {
                    level_dn: 0.5 * (own.level_dn + cell.level_dn),
                    sigma_dn: 0.5 * (own.sigma_dn + cell.sigma_dn),
                };
                lowest = lowest.min(midpoint.level_dn + sigmas * midpoint.sigma_dn);
            }
        }
        lowest
    }

    /// Returns the mean level of all cells, DN.
    pub(super) fn mean_level_dn(&self) -> f64 {
        self.cells.iter().map(|cell| cell.level_dn).sum::<f64>() / self.cells.len() as f64
    }
}

/// Returns the index of the cell whose centre is at or before a coordinate, and the fraction of the way to the next
/// centre.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
fn between(coordinate_px: f64, cell_px: usize, count: usize) -> (usize, f64) {
    let place = ((coordinate_px + 0.5) / cell_px as f64 - 0.5).clamp(0.0, count as f64 - 1.0);
    let index = place as usize;
    (index, place - index as f64)
}

/// Width of the ring around a star from which its background is taken, px.
pub(super) const RING_PX: usize = 2;

/// Returns the background of the ring outside a square window of half-width `half_px` about (`x`, `y`); `buffer` is
/// reused. `None` when no part of the ring is on the image.
pub(super) fn ring(image: &DnImage, x: usize, y: usize, half_px: usize, buffer: &mut Vec<u16>) -> Option<Background> {
    let outer = half_px + RING_PX;
    let (left, right) = (x.saturating_sub(outer), (x + outer + 1).min(image.width()));
    buffer.clear();
    for (row, line) in image.rows().enumerate().take(y + outer + 1).skip(y.saturating_sub(outer)) {
        if row + half_px < y || row > y + half_px {
            buffer.extend_from_slice(&line[left..right]);
        } else {
            buffer.extend_from_slice(&line[left..(x.saturating_sub(half_px)).min(right)]);
            buffer.extend_from_slice(&line[(x + half_px + 1).min(right)..right]);
        }
    }
    (!buffer.is_empty()).then(|| clipped(buffer))
}
