//! A band's spots in an order that keeps to the first-level cache: where stars crowd, by blocks of columns, and in source
//! order within each, so that a repeated plan gives the same bits.
//!
//! A band of rows is larger than that cache, and stars in source order jump about in it: every row of every star then comes
//! from the next level, which is most of what a crowded frame costs. Few stars are left in source order.

use crate::render::bands::{Members, Spot};

/// Columns of a block: with a band's rows and a footprint's width, a quarter of a first-level cache.
const BLOCK_PX: i32 = 64;
/// Spots of a band from which they are put in order: sorting costs less than it saves.
const CROWD: usize = 1024;

/// Buffers of one band, kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Crowd {
    spots: Vec<Spot>,
    /// Where the next spot of every block goes.
    next: Vec<u32>,
}

impl Crowd {
    /// The spots of `members` by blocks of columns of an image `width` px wide; `None` where they are few.
    pub(super) fn sorted<'a>(
        &mut self,
        members: impl Iterator<Item = &'a Members> + Clone,
        width: usize,
    ) -> Option<&[Spot]> {
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
        Some(spots)
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
        let sorted = crowd.sorted(chunks.iter(), 1000).expect("a crowd").to_vec();
        let key = |spot: &Spot| (spot.column.clamp(0, 1000) / BLOCK_PX, spot.column);
        assert!(sorted.is_sorted_by_key(|spot| key(spot).0));
        let mut wanted: Vec<Spot> = chunks.iter().flat_map(|chunk| chunk.spots.clone()).collect();
        assert!(!wanted.is_sorted_by_key(|spot| key(spot).0), "control: they were not");
        wanted.sort_by_key(|spot| key(spot).0);
        assert_eq!(sorted, wanted, "a stable sort");
        assert_eq!(crowd.sorted(chunks[..1].iter(), 1000), None, "few");
    }
}
