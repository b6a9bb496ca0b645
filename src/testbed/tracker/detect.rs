//! Image and background -> spots that may be stars, brightest first.
//!
//! A spot is a connected region (8 neighbours) of pixels above 3 sigma with at least one above 5 sigma: 1e6 pixels of
//! Gaussian noise give 0.3 such peaks. Refused: regions on the image's edge, larger than a bright star's, and hot
//! pixels, whose light sits in one pixel more than any spot's could. Limit: two stars closer than about 3 spot widths
//! are one spot. Tests: `stars_are_found_and_hot_pixels_are_not`, `noise_gives_few_spots`.

use super::background::BackgroundGrid;
use super::params::{Reason, TrackerParams};
use base::image::DnImage;
use glam::DVec2;

/// Least height of a spot's brightest pixel, in standard deviations of the background.
pub(super) const PEAK_SIGMA: f64 = 5.0;
/// Least height of the pixels counted to a spot.
const MEMBER_SIGMA: f64 = 3.0;
/// Most pixels of a star's region: a star of G = -1.5 with its trail. The Moon and reflections have more.
const MOST_PIXELS: usize = 300;
/// Share of pixels above the threshold from which the image is light, not stars.
const MOST_BRIGHT_SHARE: f64 = 0.05;

/// A region of the image that may be a star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blob {
    /// Flux-weighted mean place, px.
    pub(super) place_px: DVec2,
    /// Sum above the background, DN.
    pub(super) flux_dn: f64,
    /// Second moments about the place: xx, xy, yy, px^2.
    pub(super) moments_px2: [f64; 3],
}

/// Finds blobs; keeps its buffers.
#[derive(Debug, Clone)]
pub(super) struct Detector {
    seen: Vec<u64>,
    stack: Vec<(usize, usize)>,
    members: Vec<(usize, usize)>,
    blobs: Vec<Blob>,
    hot_share: f64,
    saturation_dn: u16,
}

impl Detector {
    pub(super) fn new(params: &TrackerParams) -> Self {
        let g = &params.geometry;
        Self {
            seen: vec![0; (g.width_px * g.height_px).div_ceil(64)],
            stack: Vec::with_capacity(MOST_PIXELS * 8),
            members: Vec::with_capacity(MOST_PIXELS * 8),
            blobs: Vec::with_capacity(1024),
            hot_share: hot_share(params.psf_sigma_px),
            saturation_dn: params.detector.saturation_dn,
        }
    }

    /// Spots of an image, brightest first, at most `most`.
    pub(super) fn find(&mut self, image: &DnImage, grid: &BackgroundGrid, most: usize) -> Result<&[Blob], Reason> {
        self.seen.fill(0);
        self.blobs.clear();
        let (columns, rows, cell_px) = grid.shape();
        let mut bright = 0;
        let most_bright = MOST_BRIGHT_SHARE * (image.width() * image.height()) as f64;
        for (y, line) in image.rows().enumerate() {
            let row = (y / cell_px).min(rows - 1);
            for column in 0..columns {
                let x = column * cell_px;
                let end = if column + 1 == columns { line.len() } else { x + cell_px };
                let threshold = grid.threshold_dn(column, row);
                let cell = &line[x..end];
                // The maximum of a stretch vectorises; most stretches end here.
                if f64::from(cell.iter().fold(0, |most, dn| most.max(*dn))) <= threshold {
                    continue;
                }
                for (offset, dn) in cell.iter().enumerate() {
                    if f64::from(*dn) > threshold {
                        bright += 1;
                        self.grow(image, grid, x + offset, y);
                    }
                }
            }
            if f64::from(bright) > most_bright {
                return Err(Reason::StrayLight);
            }
        }
        self.blobs.sort_unstable_by(|a, b| b.flux_dn.total_cmp(&a.flux_dn));
        self.blobs.truncate(most);
        Ok(&self.blobs)
    }

    fn take(&mut self, index: usize) -> bool {
        let (word, bit) = (index / 64, 1 << (index % 64));
        let fresh = self.seen[word] & bit == 0;
        self.seen[word] |= bit;
        fresh
    }

    /// Collects the region about a peak if the peak is bright enough against the local background.
    fn grow(&mut self, image: &DnImage, grid: &BackgroundGrid, x: usize, y: usize) {
        let local = grid.at(x as f64, y as f64);
        let width = image.width();
        let peak = image.get(x, y).map_or(0.0, f64::from);
        if peak <= local.level_dn + PEAK_SIGMA * local.sigma_dn || !self.take(y * width + x) {
            return;
        }
        let member_dn = local.level_dn + MEMBER_SIGMA * local.sigma_dn;
        self.stack.clear();
        self.members.clear();
        self.stack.push((x, y));
        while let Some((x, y)) = self.stack.pop() {
            self.members.push((x, y));
            for ny in y.saturating_sub(1)..(y + 2).min(image.height()) {
                for nx in x.saturating_sub(1)..(x + 2).min(width) {
                    let above = image.get(nx, ny).is_some_and(|dn| f64::from(dn) > member_dn);
                    if above && self.take(ny * width + nx) {
                        self.stack.push((nx, ny));
                    }
                }
            }
        }
        self.keep(image, local.level_dn);
    }

    fn keep(&mut self, image: &DnImage, level_dn: f64) {
        let on_edge = |&(x, y): &(usize, usize)| x == 0 || y == 0 || x + 1 == image.width() || y + 1 == image.height();
        if self.members.len() > MOST_PIXELS || self.members.iter().any(on_edge) || self.is_hot(image, level_dn) {
            return;
        }
        let (mut flux, mut first, mut second) = (0.0, DVec2::ZERO, [0.0; 3]);
        for &(x, y) in &self.members {
            let dn = image.get(x, y).map_or(0.0, f64::from) - level_dn;
            let place = DVec2::new(x as f64, y as f64);
            flux += dn;
            first += dn * place;
            for (sum, product) in second.iter_mut().zip([place.x * place.x, place.x * place.y, place.y * place.y]) {
                *sum += dn * product;
            }
        }
        let mean = first / flux;
        let moments_px2 = [
            second[0] / flux - mean.x * mean.x,
            second[1] / flux - mean.x * mean.y,
            second[2] / flux - mean.y * mean.y,
        ];
        self.blobs.push(Blob { place_px: mean, flux_dn: flux, moments_px2 });
    }

    /// Returns whether the brightest pixel holds more of its 3 x 3 neighbourhood than any spot's could. Saturated
    /// regions of several pixels are stars.
    fn is_hot(&self, image: &DnImage, level_dn: f64) -> bool {
        let value = |&(x, y): &(usize, usize)| image.get(x, y).unwrap_or(0);
        let Some(&(x, y)) = self.members.iter().max_by_key(|place| value(place)) else { return true };
        let saturated = self.members.iter().filter(|place| value(place) >= self.saturation_dn).count();
        if saturated > 1 {
            return false;
        }
        let mut sum = 0.0;
        for ny in y - 1..y + 2 {
            for nx in x - 1..x + 2 {
                sum += image.get(nx, ny).map_or(0.0, f64::from) - level_dn;
            }
        }
        f64::from(value(&(x, y))) - level_dn > self.hot_share * sum
    }
}

/// Returns the share of the 3 x 3 light above which the middle pixel is hot: half-way between a centred star's share
/// and 1.
pub(super) fn hot_share(psf_sigma_px: f64) -> f64 {
    let inside = |half_px: f64| libm::erf(half_px / (core::f64::consts::SQRT_2 * psf_sigma_px)).powi(2);
    0.5 * (1.0 + inside(0.5) / inside(1.5))
}
