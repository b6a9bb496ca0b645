//! How many units an electron is worth, so that no pixel's sum can wrap.
//!
//! A star adds at most `electrons x peak share` to any pixel of its box and to no pixel outside. Summed per tile of
//! 32 x 32 px over the stars whose box touches it, this bounds every pixel; each addition may round up by half a unit.
//! The scale is the largest power of two, at most 2^14, that keeps the bound below 2^31. Its price is resolution: half
//! a unit per star and pixel, 3e-5 e- at the largest scale, 2e-3 e- for a star of 7e6 e- in one pixel. `tests/gpu`
//! draws 3e7 electrons.

/// Largest scale: 2^14 units per electron, up to 131 ke- per pixel.
pub const LARGEST_SCALE: f64 = 16_384.0;
/// Side of a tile, px.
const TILE_PX: usize = 32;
/// Share by which single-precision sums may exceed the bound.
const ROUNDING_SHARE: f64 = 1e-4;

/// Sums without a reader: of the tiles beside and below a box that has none there.
const SPARE: usize = 3;

/// Bound of the electrons in any pixel of a tile.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TileBounds {
    columns: usize,
    /// Row by row; behind them the spare sums.
    tiles: Vec<f64>,
}

impl TileBounds {
    /// Returns the scale for an image of this size.
    pub(super) fn new(size: [usize; 2]) -> Self {
        let [columns, rows] = size.map(|n| n.div_ceil(TILE_PX));
        Self { columns, tiles: vec![0.0; columns * rows + SPARE] }
    }

    pub(super) fn clear(&mut self) {
        self.tiles.fill(0.0);
    }

    /// Adds a star that gives no pixel of its box (first pixel, size) more than `most_e`.
    #[inline(always)]
    pub(super) fn add(&mut self, (start, size): ([usize; 2], [usize; 2]), most_e: f64) {
        let [columns, rows] =
            [0, 1].map(|axis| [start[axis] / TILE_PX, (start[axis] + size[axis]).saturating_sub(1) / TILE_PX]);
        let at = |row: usize, column: usize| rows[row] * self.columns + columns[column];
        let [across, down] = [columns, rows].map(|[first, last]| last - first);
        if across <= 1 && down <= 1 {
            // Most boxes: without a branch, and no tile twice, which would have to wait for its first sum.
            let spare = self.tiles.len() - SPARE;
            let (right, below) = (across > 0, down > 0);
            self.tiles[at(0, 0)] += most_e;
            self.tiles[if right { at(0, 1) } else { spare }] += most_e;
            self.tiles[if below { at(1, 0) } else { spare + 1 }] += most_e;
            self.tiles[if right && below { at(1, 1) } else { spare + 2 }] += most_e;
            return;
        }
        for row in rows[0]..=rows[1] {
            let row = row * self.columns;
            self.tiles[row + columns[0]..=row + columns[1]].iter_mut().for_each(|tile| *tile += most_e);
        }
    }

    /// Adds the stars of another image of the same size.
    pub(super) fn join(&mut self, other: &Self) {
        self.tiles.iter_mut().zip(&other.tiles).for_each(|(tile, more_e)| *tile += more_e);
    }

    /// Returns the scale when any pixel receives at most `additions` additions.
    pub(super) fn scale(&self, additions: f64) -> f32 {
        let tiles = &self.tiles[..self.tiles.len() - SPARE];
        let most_e = tiles.iter().copied().fold(0.0, f64::max) * (1.0 + ROUNDING_SHARE);
        let space = f64::from(i32::MAX) - 0.5 * additions;
        let mut scale = LARGEST_SCALE;
        while most_e * scale > space && scale > f64::from(f32::MIN_POSITIVE) {
            scale *= 0.5;
        }
        scale as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_the_largest_that_cannot_wrap() {
        let mut bounds = TileBounds::new([100, 70]);
        assert_eq!(f64::from(bounds.scale(0.0)), LARGEST_SCALE, "an empty field");
        for _ in 0..3 {
            bounds.add(([30, 60], [9, 10]), 1e7);
        }
        let scale = f64::from(bounds.scale(3.0));
        assert!(3e7 * scale <= f64::from(i32::MAX) && 3e7 * 2.0 * scale > f64::from(i32::MAX), "{scale}");
        bounds.clear();
        assert_eq!(f64::from(bounds.scale(0.0)), LARGEST_SCALE, "cleared");
    }

    #[test]
    fn stars_add_up_only_where_their_boxes_share_a_tile() {
        let mut bounds = TileBounds::new([256, 256]);
        bounds.add(([0, 0], [9, 9]), 1e5);
        bounds.add(([200, 200], [9, 9]), 1e5);
        assert_eq!(f64::from(bounds.scale(2.0)), LARGEST_SCALE, "far apart");
        bounds.add(([24, 24], [9, 9]), 1e5);
        assert_eq!(f64::from(bounds.scale(2.0)), LARGEST_SCALE / 2.0, "the same tile");
        bounds.clear();
        bounds.add(([31, 31], [2, 2]), 1e5);
        bounds.add(([33, 33], [2, 2]), 1e5);
        assert_eq!(f64::from(bounds.scale(2.0)), LARGEST_SCALE / 2.0, "a box across tiles");
    }
}
