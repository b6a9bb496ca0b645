//! Tiles of a field -> the sources of its stars, on all cores, in the tiles' order for any number of threads.
//!
//! Two passes, each over the blocks in parallel: selection of the stars, then their sources. Blocks write where those
//! before them end, so nothing is moved afterwards; buffers are reused. Test: `order_and_choice_are_those_of_a_loop`.

use core::ops::Range;
use glam::DVec3;
use plan::exposure::{Source, SourcePlace};

/// Initial capacity for blocks of a field.
const BLOCKS_RESERVED: usize = 16_384;
/// Number of stars below which one thread handles them.
const FEW: usize = 4096;
/// Placeholder that is overwritten.
const NO_SOURCE: Source = Source { id: 0, electrons: 0.0, mag: 0.0, place: SourcePlace::Icrf(DVec3::Z) };

/// Buffers kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct FieldStars {
    /// Start of the stars of each block, and the end of the last block.
    first: Vec<usize>,
    /// The same for the selected ones.
    first_wanted: Vec<usize>,
    /// Indices of the selected stars in their block, at the front of the block's part.
    wanted: Vec<u32>,
}

impl FieldStars {
    /// Returns buffers with capacity for this many stars.
    pub(super) fn with_capacity(stars: usize) -> Self {
        let blocks = || Vec::with_capacity(BLOCKS_RESERVED);
        Self { first: blocks(), first_wanted: blocks(), wanted: Vec::with_capacity(stars) }
    }

    /// Replaces `sources` by the results of `seen` for the selected stars of `blocks`.
    pub(super) fn take<'a, T: Sync + 'a>(
        &mut self,
        block: impl Fn(usize) -> &'a [T] + Sync,
        blocks: usize,
        is_wanted: impl Fn(&T) -> bool + Sync,
        seen: impl Fn(&T) -> Source + Sync,
        sources: &mut Vec<Source>,
    ) {
        let Self { first, first_wanted, wanted } = self;
        first.clear();
        first.push(0);
        for number in 0..blocks {
            first.push(first[number] + block(number).len());
        }
        wanted.resize(first[blocks], 0);
        first_wanted.clear();
        first_wanted.resize(blocks + 1, 0);
        let find = |number: usize, wanted: &mut [u32], count: &mut [usize]| {
            let mut found = 0;
            for (i, star) in (0..).zip(block(number)) {
                wanted[found] = i;
                found += usize::from(is_wanted(star));
            }
            count[0] = found;
        };
        side_by_side(0..blocks, first, wanted, &mut first_wanted[1..], &find);
        for number in 0..blocks {
            first_wanted[number + 1] += first_wanted[number];
        }
        sources.resize(first_wanted[blocks], NO_SOURCE);
        let see = |number: usize, sources: &mut [Source], _: &mut [()]| {
            let stars = block(number);
            for (source, star) in sources.iter_mut().zip(&wanted[first[number]..]) {
                *source = seen(&stars[*star as usize]);
            }
        };
        side_by_side(0..blocks, first_wanted, sources, &mut [(); 0], &see);
    }
}

/// Calls `work` on every block with its part of `parts`, which starts at `first`, and its element of `each`, if there
/// are any.
fn side_by_side<T: Send, E: Send>(
    blocks: Range<usize>,
    first: &[usize],
    parts: &mut [T],
    each: &mut [E],
    work: &(impl Fn(usize, &mut [T], &mut [E]) + Sync),
) {
    let middle = blocks.start + blocks.len() / 2;
    let (parts_before, parts_after) = parts.split_at_mut(first[middle] - first[blocks.start]);
    let (each_before, each_after) = each.split_at_mut((middle - blocks.start).min(each.len()));
    match blocks.len() {
        0 => {}
        1 => work(blocks.start, parts_after, each_after),
        _ => {
            let (before, after) = (blocks.start..middle, middle..blocks.end);
            let few = first[blocks.end] - first[blocks.start] < FEW;
            let front = || side_by_side(before, first, parts_before, each_before, work);
            let back = || side_by_side(after, first, parts_after, each_after, work);
            if few {
                (front)();
                (back)();
            } else {
                rayon::join(front, back);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_and_choice_are_those_of_a_loop() {
        let lengths = [3_u32, 0, 5000, 1, 0, 12_000, 7, 0];
        let stars: Vec<Vec<u32>> = lengths.iter().map(|n| (0..*n).map(|i| i * 7 + n).collect()).collect();
        let seen = |star: &u32| Source { id: *star, ..NO_SOURCE };
        let mut field = FieldStars::with_capacity(10);
        let mut sources = vec![NO_SOURCE; 5];
        for (blocks, divisor) in [(8, 3), (8, 1), (0, 3), (1, 2), (3, 5), (8, 100_000)] {
            let is_wanted = |star: &u32| star.is_multiple_of(divisor);
            field.take(|block| stars[block].as_slice(), blocks, is_wanted, seen, &mut sources);
            let wanted: Vec<u32> = stars[..blocks].iter().flatten().copied().filter(is_wanted).collect();
            let got: Vec<u32> = sources.iter().map(|source| source.id).collect();
            assert_eq!(got, wanted, "{blocks} blocks, every {divisor}th");
            assert!(divisor != 3 || blocks == 0 || got.len() > 1000, "control: there are some");
        }
    }
}
