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
        Self { taken: Vec::with_capacity(PARTS * stars), sorted: Vec::with_capacity(PARTS * stars), ends }
    }

    /// Removes all stars, for those of these groups.
    pub(super) fn clear(&mut self, groups: Groups) {
        self.taken.clear();
        self.ends.clear();
        self.ends.resize(groups.count, 0);
    }

    /// Adds a star, if it reaches the image.
    #[inline(always)]
    pub(super) fn push(&mut self, groups: Groups, spot: Spot) {
        // The number in the group, until the stars are sorted.
        if let Some(count) = self.ends.get_mut(groups.of_row(spot.row)) {
            *count += 1;
            self.taken.push(spot);
        }
    }

    /// Sorts the stars by group.
    pub(super) fn sort(&mut self, groups: Groups) {
        let Self { taken, sorted, ends } = self;
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

/// The stars of a plan whose footprints are equally high.
#[derive(Debug, Default)]
pub(super) struct Once {
    pub(super) groups: Groups,
    /// Chunk by chunk.
    pub(super) chunks: Vec<Spots>,
}

impl Once {
    /// Returns the stars of the first `used` chunks that reach so many rows of the image from `first`.
    #[inline(always)]
    pub(super) fn of_band(&self, used: usize, first: i32, rows: i32) -> BandSpots<'_> {
        let (reaching, groups) = self.groups.of_band(first, rows);
        BandSpots { chunks: &self.chunks[..used], reaching, groups, next: 0, spots: [].iter() }
    }
}

/// The stars that reach a band.
#[derive(Debug)]
pub(super) struct BandSpots<'a> {
    chunks: &'a [Spots],
    /// Rows of stars that reach the band.
    reaching: Range<i32>,
    /// The group that is taken, and those that follow.
    groups: Range<usize>,
    /// The next chunk.
    next: usize,
    spots: core::slice::Iter<'a, Spot>,
}

impl<'a> Iterator for BandSpots<'a> {
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
            if let Some(chunk) = self.chunks.get(self.next) {
                self.spots = chunk.of_group(self.groups.start).iter();
                self.next += 1;
            } else {
                (self.next, self.groups.start) = (0, self.groups.start + 1);
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

    /// Stars all over an image of 150 rows and beyond it, in chunks of `length`, and as they are.
    fn once(length: usize, half_px: usize) -> (Once, Vec<Spot>) {
        let all: Vec<_> = (0..500_u32).map(|i| at((i * 131 % 191).cast_signed() - 20, i)).collect();
        let groups = Groups::new(150, half_px);
        let mut once = Once { groups, chunks: Vec::new() };
        for part in all.chunks(length) {
            let mut spots = Spots::default();
            spots.clear(groups);
            part.iter().for_each(|spot| spots.push(groups, *spot));
            spots.sort(groups);
            once.chunks.push(spots);
        }
        (once, all)
    }

    #[test]
    fn a_band_has_the_stars_that_reach_it_whatever_the_chunks() {
        for half_px in [0, 1, 4, 7, 9] {
            let half = i32::try_from(half_px).unwrap();
            for (first, rows) in [(0, 64), (64, 64), (128, 22)] {
                let of = |length: usize| {
                    let (once, all) = once(length, half_px);
                    let found: Vec<_> = once.of_band(once.chunks.len(), first, rows).map(|spot| spot.kernel).collect();
                    (found, all)
                };
                let (found, all) = of(500);
                let reaches = |spot: &&Spot| spot.row + half >= first && spot.row - half < first + rows;
                let wanted: Vec<_> = all.iter().filter(reaches).map(|spot| spot.kernel).collect();
                let mut sorted = found.clone();
                sorted.sort_unstable();
                assert_eq!(sorted, wanted, "half {half_px}, from row {first}");
                assert!(wanted.len() < all.len() / 2 + 20, "control: others do not");
                for length in [1, 7, 100, 499] {
                    assert_eq!(of(length).0, found, "chunks of {length}");
                }
            }
        }
    }

    #[test]
    fn stars_come_by_rows_then_in_source_order() {
        let (once, all) = once(100, 4);
        let found: Vec<_> = once.of_band(once.chunks.len(), 0, 150).collect();
        let key = |spot: &&Spot| (once.groups.of_row(spot.row), spot.kernel);
        assert!(found.is_sorted_by_key(key));
        assert!(!all.iter().collect::<Vec<_>>().is_sorted_by_key(key), "control: they were not");
    }
}
