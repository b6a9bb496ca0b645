//! Stars that are drawn once, in groups of rows: stars that are drawn after one another lie in few rows, which stay in
//! the processor's nearest cache, and a star is kept once, also where two bands of rows draw it.
//!
//! Each chunk of stars is sorted by itself. A band takes the first group of all chunks, then the next one: its
//! stars come by group, then in source order, whatever the number of chunks and threads.

use core::ops::Range;

/// Rows of a group.
const GROUP_ROWS: usize = 4;
/// Lists between which a star may be divided.
const PARTS: usize = 4;
/// Groups above and below an image that are allocated from the start.
const GROUPS_BEYOND: usize = 256;

/// A star drawn once, at its mean position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) column: i32,
    pub(super) row: i32,
    pub(super) fraction: [f32; 2],
    pub(super) electrons: f32,
    /// Index of its kernel, or of its PSF down from [`NO_KERNEL`](crate::render::bands::NO_KERNEL).
    pub(super) kernel: u32,
}

impl Spot {
    #[inline(always)]
    pub(super) fn at(px: [f64; 2], electrons: f64, kernel: u32) -> Self {
        let ([column, row], fraction) = pixel_and_fraction(px);
        Self { column, row, fraction, electrons: electrons as f32, kernel }
    }
}

/// Splits a position into its pixel and the rest, within 1/2 px. Beyond 2^30 px, and for no number, the pixel is far off every
/// detector.
#[inline(always)]
pub(super) fn pixel_and_fraction(px: [f64; 2]) -> ([i32; 2], [f32; 2]) {
    let whole = px.map(|px| (px + 0.5).floor());
    (whole.map(whole_i32), core::array::from_fn(|axis| (px[axis] - whole[axis]) as f32))
}

/// Returns a whole number within 2^30 as an integer; beyond, and of no number, one far off every detector: a target may
/// lead there. An `as` cast takes four times as many instructions.
#[inline(always)]
fn whole_i32(whole: f64) -> i32 {
    const FAR: f64 = 1_073_741_824.0;
    const INTEGER_MAGIC: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
    #[allow(clippy::manual_clamp, reason = "of no number, `clamp` makes none; `max` takes the other one")]
    let within = whole.max(-FAR).min(FAR);
    ((within + INTEGER_MAGIC).to_bits() as u32).cast_signed()
}

/// A place for a star that is not there yet.
const NOWHERE: Spot = Spot { column: 0, row: 0, fraction: [0.0; 2], electrons: 0.0, kernel: 0 };

/// Groups of the rows from which stars with footprints of one height reach an image.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Groups {
    half_px: i32,
    /// Rows above the image: a whole number of groups.
    above: i32,
    count: usize,
}

impl Groups {
    /// Returns the groups for footprints of `2 half_px + 1` rows on an image of so many rows.
    pub(super) fn new(rows: usize, half_px: usize) -> Self {
        let above = half_px.next_multiple_of(GROUP_ROWS);
        Self { half_px: half_px as i32, above: above as i32, count: (rows + 2 * above).div_ceil(GROUP_ROWS) }
    }

    /// Returns the group of a row; beyond the last group for a row from which nothing reaches the image.
    #[inline(always)]
    fn of_row(&self, row: i32) -> usize {
        // A row above the first group wraps to a large number.
        row.wrapping_add(self.above).cast_unsigned() as usize / GROUP_ROWS
    }

    /// Returns the rows from which a star reaches so many rows from `first`, and their groups.
    fn of_band(&self, first: i32, rows: i32) -> (Range<i32>, Range<usize>) {
        let reaching = first - self.half_px..first + rows + self.half_px;
        let groups = self.of_row(reaching.start)..(self.of_row(reaching.end - 1) + 1).min(self.count);
        (reaching, groups)
    }
}

/// The stars of one chunk.
#[derive(Debug, Default)]
pub(super) struct Spots {
    groups: Groups,
    /// In source order.
    taken: Vec<Spot>,
    /// Group by group.
    sorted: Vec<Spot>,
    /// Where each group ends in `sorted`.
    ends: Vec<u32>,
}

impl Spots {
    /// Returns an empty list with memory for so many stars, each in as many lists as may be, on an image of so many rows;
    /// memory that is never written is never taken.
    pub(super) fn with_space(stars: usize, rows: usize) -> Self {
        let ends = Vec::with_capacity(rows.div_ceil(GROUP_ROWS) + GROUPS_BEYOND);
        let stars = || Vec::with_capacity(PARTS * stars);
        Self { groups: Groups::default(), taken: stars(), sorted: stars(), ends }
    }

    /// Removes all stars, for those of these groups.
    pub(super) fn clear(&mut self, groups: Groups) {
        self.groups = groups;
        self.taken.clear();
        self.ends.clear();
        self.ends.resize(groups.count, 0);
    }

    /// Adds a star, if it reaches the image.
    #[inline(always)]
    pub(super) fn push(&mut self, spot: Spot) {
        // The number in the group, until the stars are sorted.
        if let Some(count) = self.ends.get_mut(self.groups.of_row(spot.row)) {
            *count += 1;
            self.taken.push(spot);
        }
    }

    /// Sorts the stars by group.
    pub(super) fn sort(&mut self) {
        let Self { groups, taken, sorted, ends } = self;
        let mut next = 0;
        for end in &mut *ends {
            (*end, next) = (next, next + *end);
        }
        // Not cleared: every star is overwritten.
        sorted.resize(taken.len(), NOWHERE);
        for spot in &*taken {
            let end = &mut ends[groups.of_row(spot.row)];
            sorted[*end as usize] = *spot;
            *end += 1;
        }
    }

    /// Returns the stars of a group.
    #[inline(always)]
    fn of_group(&self, group: usize) -> &[Spot] {
        let begin = group.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.sorted[begin as usize..self.ends[group] as usize]
    }
}

/// The stars that reach a band.
#[derive(Debug)]
pub(super) struct BandSpots<'a, C> {
    /// The chunks of all stars.
    chunks: C,
    /// Chunks whose stars of the first of `groups` are still to come.
    left: C,
    /// Rows of stars that reach the band.
    reaching: Range<i32>,
    groups: Range<usize>,
    spots: core::slice::Iter<'a, Spot>,
}

impl<'a, C: Iterator<Item = &'a Spots> + Clone> BandSpots<'a, C> {
    /// Returns the stars of chunks with these groups that reach so many rows of the image from `first`.
    #[inline(always)]
    pub(super) fn new(chunks: C, groups: Groups, first: i32, rows: i32) -> Self {
        let (reaching, mut groups) = groups.of_band(first, rows);
        if chunks.clone().all(|chunk| chunk.sorted.is_empty()) {
            groups = 0..0;
        }
        Self { left: chunks.clone(), chunks, reaching, groups, spots: [].iter() }
    }
}

impl<'a, C: Iterator<Item = &'a Spots> + Clone> Iterator for BandSpots<'a, C> {
    type Item = &'a Spot;

    #[inline(always)]
    fn next(&mut self) -> Option<&'a Spot> {
        loop {
            for spot in self.spots.by_ref() {
                if self.reaching.contains(&spot.row) {
                    return Some(spot);
                }
            }
            if self.groups.is_empty() {
                return None;
            }
            if let Some(chunk) = self.left.next() {
                self.spots = chunk.of_group(self.groups.start).iter();
            } else {
                self.left = self.chunks.clone();
                self.groups.start += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(row: i32, number: u32) -> Spot {
        Spot { column: 0, row, fraction: [0.0; 2], electrons: 0.0, kernel: number }
    }

    /// Returns stars all over an image of 150 rows and beyond it.
    fn stars() -> Vec<Spot> {
        (0..500_u32).map(|i| at((i * 131 % 191).cast_signed() - 20, i)).collect()
    }

    /// Returns the numbers of those that reach a band, taken in chunks of `length`.
    fn found(length: usize, half_px: usize, first: i32, rows: i32) -> Vec<u32> {
        let groups = Groups::new(150, half_px);
        let chunk = |part: &[Spot]| {
            let mut spots = Spots::default();
            spots.clear(groups);
            part.iter().for_each(|spot| spots.push(*spot));
            spots.sort();
            spots
        };
        let chunks: Vec<_> = stars().chunks(length).map(chunk).collect();
        BandSpots::new(chunks.iter(), groups, first, rows).map(|spot| spot.kernel).collect()
    }

    #[test]
    fn a_band_has_the_stars_that_reach_it_whatever_the_chunks() {
        for half_px in [0, 1, 4, 7, 9] {
            let half = i32::try_from(half_px).unwrap();
            for (first, rows) in [(0, 64), (64, 64), (128, 22)] {
                let (all, found_whole) = (stars(), found(500, half_px, first, rows));
                let reaches = |spot: &&Spot| spot.row + half >= first && spot.row - half < first + rows;
                let wanted: Vec<_> = all.iter().filter(reaches).map(|spot| spot.kernel).collect();
                let mut sorted = found_whole.clone();
                sorted.sort_unstable();
                assert_eq!(sorted, wanted, "half {half_px}, from row {first}");
                assert!(wanted.len() < all.len() / 2 + 20, "control: others do not");
                for length in [1, 7, 100, 499] {
                    assert_eq!(found(length, half_px, first, rows), found_whole, "chunks of {length}");
                }
            }
        }
    }

    #[test]
    fn stars_come_by_rows_then_in_source_order() {
        let (all, groups) = (stars(), Groups::new(150, 4));
        let found = found(100, 4, 0, 150);
        let key = |number: &u32| (groups.of_row(all[*number as usize].row), *number);
        assert!(found.is_sorted_by_key(key));
        assert!(!(0..500).collect::<Vec<_>>().is_sorted_by_key(key), "control: they were not");
    }
    #[test]
    fn far_places_stay_off_the_detector() {
        for px in [1e10, -1e10, 4_294_967_346.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
            assert!(whole_i32(px).unsigned_abs() > 1_000_000_000, "{px}");
        }
        for px in [-3, 0, 7, 100_000] {
            assert_eq!(whole_i32(f64::from(px)), px, "control: near ones are themselves");
        }
    }
}
