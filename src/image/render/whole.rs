//! Whole stars ([`plan::exposure::whole`]): bright stars in double precision, as far as their PSF goes.
//!
//! In: a plan and its stars with [`Drawing::Whole`]. Out: their electrons in tiles of [`TILE_PX`] x [`TILE_PX`] px, which
//! each backend adds to its image after the other stars: both get the same light from the same code. A Gaussian is a
//! product of differences of complementary error functions, which keep their digits far from the star; another PSF comes
//! from the grid of its table, not from the sum of products that omits 1e-6 of the peak. Error: rounding of a pixel's own
//! light to single precision, 1e-6 of it. Tests below; `tests/physics/whole.rs`, `tests/gpu/whole.rs`.

use crate::render::{plan_tables::PlanTables, table::PsfTable};
use plan::exposure::track::StarTrack;
use plan::exposure::{ExposurePlan, PlannedStar};
use plan::optics::{PsfForm, gaussian};

/// Side of a tile, px; bands of rows have a whole number of them.
pub(super) const TILE_PX: usize = 16;
/// Pixels of a tile.
pub(super) const TILE_PIXELS: usize = TILE_PX * TILE_PX;
/// Marks a place without a tile.
const NO_TILE: u32 = u32::MAX;
/// Tiles that are allocated from the start.
const TILES_RESERVED: usize = 256;
/// Places further away are not on any detector, px.
const FURTHEST_PX: f64 = 1e6;

/// The light of whole stars.
#[derive(Debug)]
pub(super) struct WholeImage {
    size_px: [usize; 2],
    /// Tiles of a row of the image.
    columns: usize,
    /// By place on the image, row by row: the number of its tile.
    tile_of: Vec<u32>,
    /// Places of the tiles.
    places: Vec<u32>,
    tiles: Vec<[f32; TILE_PIXELS]>,
    across: Vec<f64>,
    row: Vec<f32>,
}

/// The part of a footprint that lies on the image: first column and row, and how many of each.
type Part = ([usize; 2], [usize; 2]);

impl WholeImage {
    /// Returns no light, for an image of this size.
    pub(super) fn new(size_px: [usize; 2]) -> Self {
        let [columns, rows] = size_px.map(|side| side.div_ceil(TILE_PX));
        Self {
            size_px,
            columns,
            tile_of: vec![NO_TILE; columns * rows],
            places: Vec::with_capacity(TILES_RESERVED),
            tiles: Vec::with_capacity(TILES_RESERVED),
            across: Vec::with_capacity(128),
            row: Vec::with_capacity(128),
        }
    }

    /// Replaces the light by that of `stars`, which their lists draw whole.
    pub(super) fn draw<'a>(
        &mut self,
        plan: &ExposurePlan,
        tables: &PlanTables,
        stars: impl Iterator<Item = &'a PlannedStar>,
    ) {
        for place in self.places.drain(..) {
            if let Some(tile) = self.tile_of.get_mut(place as usize) {
                *tile = NO_TILE;
            }
        }
        self.tiles.clear();
        for star in stars {
            self.add(plan, tables, star);
        }
    }

    /// Returns the tiles, with the number of each in rows of [`Self::columns`].
    pub(super) fn tiles(&self) -> impl Iterator<Item = (u32, &[f32; TILE_PIXELS])> {
        self.places.iter().copied().zip(&self.tiles)
    }

    /// Returns the numbers of the tiles.
    pub(super) fn places(&self) -> &[u32] {
        &self.places
    }

    /// Returns the tiles' pixels, tile by tile.
    pub(super) fn values(&self) -> &[f32] {
        self.tiles.as_flattened()
    }

    /// Returns the number of tiles in a row of the image.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// Returns the first pixel of a tile, and its size on the image.
    pub(super) fn box_px(&self, place: u32) -> Part {
        let first = [place as usize % self.columns, place as usize / self.columns].map(|at| at * TILE_PX);
        (first, core::array::from_fn(|i| TILE_PX.min(self.size_px[i] - first[i])))
    }

    /// Adds a star at the nodes of its list, by the PSFs about its mean place.
    fn add(&mut self, plan: &ExposurePlan, tables: &PlanTables, star: &PlannedStar) {
        let track = StarTrack::new(&plan.camera, star.place);
        let [x, y] = plan.origin_px(star, &track);
        for node in plan.nodes_of(plan.list_of(star)) {
            let [dx, dy] = track.displacement_px(&node.pose);
            let px = [x + dx, y + dy];
            let Some(part) = self.part(px, plan.whole.half_px) else { continue };
            for (psf, share) in plan.psf.around(star.mean_px).into_iter().filter(|(_, share)| *share > 0.0) {
                let electrons = share * node.weight * star.drawn_e;
                match (plan.psf.nodes().get(psf).map(|psf| psf.form()), tables.whole_of(plan, psf)) {
                    (Some(PsfForm::Gaussian(sigma_px)), _) => self.add_gaussian(px, part, sigma_px, electrons),
                    (_, Some(table)) => self.add_table(px, part, table, electrons),
                    (_, None) => {}
                }
            }
        }
    }

    /// Returns the part of a footprint about `px` that is on the image.
    fn part(&self, px: [f64; 2], half_px: usize) -> Option<Part> {
        let (mut first, mut count) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            if px[axis].is_nan() || px[axis].abs() >= FURTHEST_PX {
                return None;
            }
            #[allow(clippy::cast_possible_truncation, reason = "within the furthest place")]
            let middle = (px[axis] + 0.5).floor() as i64;
            let (half, size) = (half_px.cast_signed() as i64, self.size_px[axis].cast_signed() as i64);
            let (from, to) = ((middle - half).max(0), (middle + half + 1).min(size));
            first[axis] = usize::try_from(from).ok()?;
            count[axis] = usize::try_from(to - from).ok().filter(|count| *count > 0)?;
        }
        Some((first, count))
    }

    fn add_gaussian(&mut self, [x, y]: [f64; 2], (first, count): Part, sigma_px: f64, electrons: f64) {
        let mut across = core::mem::take(&mut self.across);
        let mut row = core::mem::take(&mut self.row);
        let share = |pixel: usize, px: f64| gaussian::cell(pixel as f64 - px, sigma_px);
        across.clear();
        across.extend((first[0]..first[0] + count[0]).map(|column| share(column, x)));
        for at in first[1]..first[1] + count[1] {
            let gain = electrons * share(at, y);
            row.clear();
            row.extend(across.iter().map(|across| (gain * across) as f32));
            self.add_row(at, first[0], &row);
        }
        (self.across, self.row) = (across, row);
    }

    fn add_table(&mut self, [x, y]: [f64; 2], (first, count): Part, table: &PsfTable, electrons: f64) {
        let mut row = core::mem::take(&mut self.row);
        for at in first[1]..first[1] + count[1] {
            row.clear();
            row.resize(count[0], 0.0);
            table.add_line([first[0] as f64 - x, at as f64 - y], electrons, &mut row);
            self.add_row(at, first[0], &row);
        }
        self.row = row;
    }

    /// Adds values to the pixels of a row of the image.
    fn add_row(&mut self, row: usize, first: usize, values: &[f32]) {
        let (mut column, mut values) = (first, values);
        while !values.is_empty() {
            let skipped = column % TILE_PX;
            let (own, rest) = values.split_at(values.len().min(TILE_PX - skipped));
            let at = row % TILE_PX * TILE_PX + skipped;
            let tile = self.tile(row / TILE_PX * self.columns + column / TILE_PX);
            for (pixel, value) in tile.iter_mut().skip(at).zip(own) {
                *pixel += value;
            }
            (column, values) = (column + own.len(), rest);
        }
    }

    fn tile(&mut self, place: usize) -> &mut [f32; TILE_PIXELS] {
        let Self { tile_of, places, tiles, .. } = self;
        let number = tile_of[place];
        if number == NO_TILE {
            tile_of[place] = u32::try_from(tiles.len()).unwrap_or(NO_TILE);
            places.push(u32::try_from(place).unwrap_or(NO_TILE));
            tiles.push([0.0; TILE_PIXELS]);
        }
        let number = tile_of[place] as usize;
        &mut tiles[number]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(image: &WholeImage) -> Vec<f32> {
        let [width, height] = image.size_px;
        let mut pixels = vec![0.0; width * height];
        for (place, values) in image.tiles() {
            let ([column, row], [columns, rows]) = image.box_px(place);
            for (y, values) in values.chunks_exact(TILE_PX).take(rows).enumerate() {
                let first = (row + y) * width + column;
                pixels[first..first + columns].copy_from_slice(&values[..columns]);
            }
        }
        pixels
    }

    #[test]
    fn stars_across_tiles_and_edges_keep_the_digits_of_their_wings() {
        let size = [70, 37];
        for px in [[31.6, 15.9], [0.2, 36.4], [69.9, 0.1], [-5.3, 20.0]] {
            let mut image = WholeImage::new(size);
            let part = image.part(px, 8).unwrap();
            image.add_gaussian(px, part, 0.8, 1e12);
            for (i, value) in light(&image).into_iter().enumerate() {
                let (x, y) = ((i % size[0]) as f64 - px[0], (i / size[0]) as f64 - px[1]);
                let wanted = 1e12 * gaussian::cell(x, 0.8) * gaussian::cell(y, 0.8);
                let is_inside = x.abs() <= 8.0 && y.abs() <= 8.0;
                let error = (f64::from(value) - wanted).abs();
                assert!(error <= 1e-6 * wanted || !is_inside, "{px:?}, pixel {i}: {value} {wanted}");
            }
        }
        assert_eq!(WholeImage::new(size).part([-9.6, 20.0], 8), None, "it does not reach the image");
        assert_eq!(WholeImage::new(size).part([f64::NAN, 20.0], 8), None);
    }
}
