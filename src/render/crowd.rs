//! A band's spots in an order that keeps to the first-level cache: where stars crowd, by blocks of columns, and in source
//! order within each, so that a repeated plan gives the same bits.
//!
//! A band of rows is larger than that cache, and stars in source order jump about in it: every row of every star then comes
//! from the next level. Neighbours one after the other would be as slow: a sum cannot be read back while the rows that
//! overlap it are still being written. So several blocks, as many as that cache holds, take turns. Few stars are left in
//! source order.

use crate::render::bands::{Members, Spot};

/// Columns of a block.
const BLOCK_PX: i32 = 16;
/// Blocks that take turns, in an order in which no two neighbours follow one another: together a band's rows of them are
/// 32 KiB.
const TURNS: [usize; 8] = [0, 4, 1, 5, 2, 6, 3, 7];
/// Spots of a band from which they are put in order: sorting costs less than it saves.
const CROWD: usize = 1024;

/// Buffers of one band, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Crowd {
    spots: Vec<Spot>,
    /// Where the next spot of every block goes; then where each block ends.
    next: Vec<u32>,
}

/// Spots of a band, sorted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sorted<'a> {
    spots: &'a [Spot],
    ends: &'a [u32],
}

impl<'a> Sorted<'a> {
    /// All of them, blocks taking turns.
    #[inline(always)]
    pub(super) fn turns(self) -> Turns<'a> {
        Turns { sorted: self, group: 0, turn: 0, left: [[0; 2]; TURNS.len()], waiting: 0 }
    }
}

/// The order in which sorted spots are drawn. (No closure takes them: it would not be compiled for the vector level.)
#[derive(Debug, Clone)]
pub(super) struct Turns<'a> {
    sorted: Sorted<'a>,
    /// Blocks taken so far.
    group: usize,
    turn: usize,
    /// Next spot and end of each block of the group.
    left: [[usize; 2]; TURNS.len()],
    /// Spots of the group that wait.
    waiting: usize,
}

impl<'a> Iterator for Turns<'a> {
    type Item = &'a Spot;

    #[inline(always)]
    fn next(&mut self) -> Option<&'a Spot> {
        while self.waiting == 0 {
            self.take_group()?;
        }
        loop {
            let [next, end] = &mut self.left[TURNS[self.turn]];
            self.turn = (self.turn + 1) % TURNS.len();
            if *next < *end {
                let spot = self.sorted.spots.get(*next);
                *next += 1;
                self.waiting -= 1;
                return spot;
            }
        }
    }
}

impl Turns<'_> {
    /// The next blocks.
    fn take_group(&mut self) -> Option<()> {
        let ends = self.sorted.ends.get(self.group..).filter(|ends| !ends.is_empty())?;
        let first = self.group.checked_sub(1).map_or(0, |before| self.sorted.ends[before] as usize);
        let mut begin = first;
        self.left = [[0; 2]; TURNS.len()];
        for (left, end) in self.left.iter_mut().zip(ends) {
            *left = [begin, *end as usize];
            begin = *end as usize;
        }
        self.group += ends.len().min(TURNS.len());
        (self.turn, self.waiting) = (0, begin - first);
        Some(())
    }
}

impl Crowd {
    /// The spots of `members` by blocks of columns of an image `width` px wide; `None` where they are few.
    pub(super) fn sorted<'a>(
        &mut self,
        members: impl Iterator<Item = &'a Members> + Clone,
        width: usize,
    ) -> Option<Sorted<'_>> {
        let count: usize = members.clone().map(|members| members.spots.len()).sum();
        if count < CROWD {
            return None;
        }
        let Self { spots, next } = self;
        let last = width / BLOCK_PX as usize;
        let block = |spot: &Spot| (spot.column.max(0) / BLOCK_PX) as usize;
        next.clear();
        next.resize(last + 2, 0);
        let all = || members.clone().flat_map(|members| &members.spots);
        for spot in all() {
            next[block(spot).min(last) + 1] += 1;
        }
        for i in 0..=last {
            next[i + 1] += next[i];
        }
        if spots.capacity() < count {
            spots.reserve(count + count / 4 - spots.len().min(count));
        }
        spots.resize(count, Spot::NONE);
        for spot in all() {
            let at = &mut next[block(spot).min(last)];
            spots[*at as usize] = *spot;
            *at += 1;
        }
        Some(Sorted { spots, ends: &next[..=last] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn members(columns: impl Iterator<Item = i32>) -> Members {
        let spots = columns.zip(0..).map(|(column, row)| Spot { column, row, ..Spot::NONE }).collect();
        Members { spots, trails: Vec::new() }
    }

    #[test]
    fn crowds_are_sorted_by_blocks_in_source_order_and_nothing_is_lost() {
        let chunks = [
            members((0..700).map(|i| (i * 389) % 1100 - 40)),
            members(core::iter::empty()),
            members((0..500).map(|i| (i * 577) % 1100 - 40)),
        ];
        let mut crowd = Crowd::default();
        let crowd_of = crowd.sorted(chunks.iter(), 1000).expect("a crowd");
        let sorted = crowd_of.spots.to_vec();
        let mut drawn: Vec<Spot> = crowd_of.turns().copied().collect();
        let key = |spot: &Spot| (spot.column.clamp(0, 1000) / BLOCK_PX, spot.column);
        assert!(sorted.is_sorted_by_key(|spot| key(spot).0));
        let mut wanted: Vec<Spot> = chunks.iter().flat_map(|chunk| chunk.spots.clone()).collect();
        assert!(!wanted.is_sorted_by_key(|spot| key(spot).0), "control: they were not");
        wanted.sort_by_key(|spot| key(spot).0);
        assert_eq!(sorted, wanted, "a stable sort");
        let close = |spots: &[Spot]| spots.windows(2).filter(|pair| key(&pair[0]).0 == key(&pair[1]).0).count();
        assert!(
            close(&sorted) > 1000 && 5 * close(&drawn) < close(&sorted),
            "in turns: {} {}",
            close(&sorted),
            close(&drawn)
        );
        drawn.sort_by_key(|spot| key(spot).0);
        assert_eq!(drawn, wanted, "each once, in source order within its block");
        assert!(crowd.sorted(chunks[..1].iter(), 1000).is_none(), "few");
    }
}
