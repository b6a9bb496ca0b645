//! A field for measurements: stars of a few brightnesses at random pixel phases, well separated, and empty places.
//!
//! In: the detector's size, electrons of each brightness, a seed. Out: sources for a planner, with the cell of each
//! star. The detector is divided into cells of [`CELL_PX`]; brightnesses and empty cells are assigned at random, so
//! that each is spread over all quadrants.

use base::random::philox;
use plan::exposure::{Source, SourcePlace};

/// Side of the cell around a star or an empty place, px.
pub const CELL_PX: usize = 40;
/// Side of an empty place whose background is measured, px (the published comparison's).
pub const REGION_PX: usize = 20;
/// Half-width of the window around a star that is measured, px.
pub const HALF_PX: i64 = 3;

/// One star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldStar {
    /// Index of its brightness.
    pub bin: usize,
    /// Its position.
    pub px: [f64; 2],
}

/// Stars and empty places.
#[derive(Debug, Clone, PartialEq)]
pub struct StarField {
    /// Electrons of each brightness.
    pub electrons: Vec<f64>,
    /// Stars.
    pub stars: Vec<FieldStar>,
    /// Top left pixel of every empty place.
    pub regions: Vec<[usize; 2]>,
}

impl StarField {
    /// Returns as many cells as fit a detector of `size_px`, assigned to the brightnesses and to empty places.
    pub fn new(size_px: [usize; 2], electrons: Vec<f64>, seed: u32) -> Self {
        let [columns, rows] = size_px.map(|side| side / CELL_PX);
        let mut cells: Vec<u32> = (0..).take(columns * rows).collect();
        cells.sort_by_key(|cell| philox([*cell, 1, 0, 0], [seed, 0])[0]);
        let mut field = Self { stars: Vec::new(), regions: Vec::new(), electrons };
        let kinds = field.electrons.len() + 1;
        for (i, cell) in cells.into_iter().enumerate() {
            let corner = [cell as usize % columns * CELL_PX, cell as usize / columns * CELL_PX];
            if i % kinds == field.electrons.len() {
                field.regions.push(corner.map(|v| v + (CELL_PX - REGION_PX) / 2));
                continue;
            }
            let off = philox([cell, 2, 0, 0], [seed, 0]).map(|word| f64::from(word) / 4_294_967_296.0 - 0.5);
            let middle = |v: usize, off: f64| (v + CELL_PX / 2) as f64 + off;
            field.stars.push(FieldStar { bin: i % kinds, px: [middle(corner[0], off[0]), middle(corner[1], off[1])] });
        }
        field
    }

    /// Returns its stars for a planner.
    pub fn sources(&self) -> Vec<Source> {
        let source = |(id, star): (u32, &FieldStar)| Source {
            id,
            electrons: self.electrons[star.bin],
            mag: f32::NAN,
            place: SourcePlace::Pixel(star.px),
        };
        (0..).zip(&self.stars).map(source).collect()
    }
}

impl FieldStar {
    /// Returns the pixels of its window, by row.
    pub fn window(&self) -> impl Iterator<Item = [usize; 2]> + Clone + use<> {
        #[allow(clippy::cast_possible_truncation, reason = "a place on a detector")]
        let [column, row] = self.px.map(|v| v.round() as i64);
        let span = |middle: i64| (middle - HALF_PX..=middle + HALF_PX).filter_map(|v| usize::try_from(v).ok());
        span(row).flat_map(move |y| span(column).map(move |x| [x, y]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightnesses_and_empty_places_are_dealt_out_evenly_and_stay_apart() {
        let field = StarField::new([1024, 800], vec![1e3, 1e4, 1e5], 7);
        assert_eq!(field.stars.len() + field.regions.len(), 25 * 20);
        for bin in 0..3 {
            let of_bin: Vec<_> = field.stars.iter().filter(|star| star.bin == bin).collect();
            assert_eq!(of_bin.len(), 125);
            let left = of_bin.iter().filter(|star| star.px[0] < 512.0).count();
            assert!((40..=85).contains(&left), "both halves: {left}");
        }
        for (i, star) in field.stars.iter().enumerate() {
            let apart = |other: &FieldStar| (star.px[0] - other.px[0]).abs().max((star.px[1] - other.px[1]).abs());
            assert!(field.stars[..i].iter().all(|other| apart(other) > CELL_PX as f64 - 1.5));
            assert_eq!(star.window().count(), 49);
        }
        assert_ne!(field, StarField::new([1024, 800], vec![1e3, 1e4, 1e5], 8), "follows the seed");
    }
}
