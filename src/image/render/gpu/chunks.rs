//! All stars of a frame as the device takes them, prepared in chunks on all cores.
//!
//! Chunks depend on the number of stars alone, and sums over them are taken in their order: the image is the same whatever
//! the number of threads. Stars without a table layer come first: the pass that draws them takes the first of a block.

use crate::render::gpu::stars::{BoxPx, NO_TRACK, Source, SpotRecord, TrackRecord, spot, trail};
use crate::{gpu::GpuError, gpu::buffers::GrowableBuffer, gpu::device::GpuDevice, render::gpu::scale::TileBounds};
use base::vector_level::vector_level;
use core::ops::Range;
use plan::exposure::{Drawing, ExposurePlan, PlannedStar};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// Chunks at most.
const MOST_CHUNKS: usize = 16;
/// Stars of a chunk at least: fewer are not worth a thread.
const LEAST_STARS: usize = 1024;
/// Capacity of a chunk for stars that are drawn whole.
const WHOLE_RESERVED: usize = 64;
/// Lists that are allocated from the start.
const LISTS_RESERVED: usize = 4096;
/// Block of one invocation of the splat pass.
const SPLAT_BLOCK_PX: [usize; 2] = [16, 8];
/// Block of one invocation of the table pass.
const TABLE_BLOCK_PX: [usize; 2] = [8, 1];

/// Stars that one pass draws.
#[derive(Debug, Default)]
struct Group {
    spots: Vec<SpotRecord>,
    /// Tracks of those that have one, in their order.
    tracks: Vec<TrackRecord>,
    /// Blocks of the largest box.
    most_blocks: usize,
}

/// The source of the stars of one list.
#[derive(Debug, Clone, Copy)]
struct ListSource {
    source: Source,
    /// Each is drawn once, by this list alone.
    is_spot: bool,
}

/// The stars that one thread prepared.
#[derive(Debug)]
struct Chunk {
    analytic: Group,
    tabled: Group,
    bounds: TileBounds,
    most_nodes: usize,
    /// Stars that are drawn whole, by the host.
    whole: Vec<PlannedStar>,
}

/// The stars of a frame.
#[derive(Debug)]
pub(super) struct Chunks {
    arch: Arch,
    size: [usize; 2],
    lists: Vec<ListSource>,
    chunks: Vec<Chunk>,
    used: usize,
    bounds: TileBounds,
}

impl Group {
    #[inline(always)]
    fn push(&mut self, spot: SpotRecord, (_, size): BoxPx, block: [usize; 2]) {
        self.most_blocks = self.most_blocks.max(size[0].div_ceil(block[0]) * size[1].div_ceil(block[1]));
        self.spots.push(spot);
    }

    fn clear(&mut self) {
        self.spots.clear();
        self.tracks.clear();
        self.most_blocks = 0;
    }

    /// Numbers the tracks, from `first` on, and returns the next number.
    fn number_tracks(&mut self, first: u32) -> u32 {
        let mut next = first;
        if !self.tracks.is_empty() {
            for spot in self.spots.iter_mut().filter(|spot| spot.track != NO_TRACK) {
                spot.track = next;
                next += 1;
            }
        }
        next
    }

    /// Returns the number of tracks of the first `spots`.
    fn tracks_before(&self, spots: usize) -> usize {
        match &self.spots[..spots] {
            _ if self.tracks.is_empty() => 0,
            all if all.len() == self.spots.len() => self.tracks.len(),
            some => some.iter().filter(|spot| spot.track != NO_TRACK).count(),
        }
    }
}

impl Chunk {
    fn new(size: [usize; 2]) -> Self {
        let [analytic, tabled] = core::array::from_fn(|_| Group::default());
        Self {
            analytic,
            tabled,
            bounds: TileBounds::new(size),
            most_nodes: 1,
            whole: Vec::with_capacity(WHOLE_RESERVED),
        }
    }

    /// Returns the group of stars that are drawn from a source, and the block of its pass.
    #[inline(always)]
    fn group(&mut self, source: Source) -> (&mut Group, [usize; 2]) {
        match source.layer {
            None => (&mut self.analytic, SPLAT_BLOCK_PX),
            Some(_) => (&mut self.tabled, TABLE_BLOCK_PX),
        }
    }

    /// Adds a star that reaches the image.
    #[inline(always)]
    fn take(&mut self, star: Option<(SpotRecord, BoxPx)>, source: Source, peak: f64) {
        if let Some((spot, box_px)) = star {
            self.bounds.add(box_px, f64::from(spot.electrons.abs()) * peak);
            let (group, block_px) = self.group(source);
            group.push(spot, box_px, block_px);
        }
    }

    fn clear(&mut self) {
        self.analytic.clear();
        self.tabled.clear();
        self.bounds.clear();
        self.most_nodes = 1;
        self.whole.clear();
    }
}

impl Chunks {
    /// Returns no stars, for an image of this size.
    pub(super) fn new(size: [usize; 2]) -> Self {
        let lists = Vec::with_capacity(LISTS_RESERVED);
        Self { arch: vector_level(), size, lists, chunks: Vec::new(), used: 0, bounds: TileBounds::new(size) }
    }

    /// Takes the stars of a plan that touch the image. `source`: the image of the stars of a list; `peak`: the largest
    /// share of a star's electrons that any pixel receives.
    pub(super) fn fill(&mut self, plan: &ExposurePlan, source: impl Fn(usize) -> Source, peak: f64) {
        let Self { arch, size, lists, chunks, used, bounds } = self;
        lists.clear();
        lists.extend(plan.lists.iter().enumerate().map(|(number, list)| {
            let is_spot = matches!(list.drawing, Drawing::Once | Drawing::Kernel(_));
            ListSource { source: source(number), is_spot }
        }));
        let stars_a_chunk = plan.stars.len().div_ceil(MOST_CHUNKS).max(LEAST_STARS);
        *used = plan.stars.len().div_ceil(stars_a_chunk);
        if chunks.len() < *used {
            chunks.resize_with(*used, || Chunk::new(*size));
        }
        let (chunks, lists, size) = (&mut chunks[..*used], lists.as_slice(), *size);
        let fill = |(chunk, stars): (&mut Chunk, &[PlannedStar])| {
            arch.dispatch(FillChunk { plan, stars, lists, peak, size, chunk });
        };
        match &mut *chunks {
            [] => {}
            [chunk] => fill((chunk, &plan.stars)),
            chunks => chunks.par_iter_mut().zip(plan.stars.par_chunks(stars_a_chunk)).for_each(fill),
        }
        bounds.clear();
        chunks.iter().for_each(|chunk| bounds.join(&chunk.bounds));
        let first = chunks.iter_mut().fold(0, |next, chunk| chunk.analytic.number_tracks(next));
        chunks.iter_mut().fold(first, |next, chunk| chunk.tabled.number_tracks(next));
    }

    /// Returns the stars that are drawn whole, in source order; the others do not count them.
    pub(super) fn whole(&self) -> impl Iterator<Item = &PlannedStar> {
        self.used().iter().flat_map(|chunk| &chunk.whole)
    }

    /// Returns the bounds of the sums, for light that is added to them.
    pub(super) fn bounds_mut(&mut self) -> &mut TileBounds {
        &mut self.bounds
    }

    /// Returns the number of stars.
    pub(super) fn len(&self) -> usize {
        self.groups().map(|group| group.spots.len()).sum()
    }

    /// Returns the number of stars that are drawn analytically.
    pub(super) fn analytic(&self) -> usize {
        self.used().iter().map(|chunk| chunk.analytic.spots.len()).sum()
    }

    /// Returns the number of nodes of the longest list of any star, at least one.
    pub(super) fn most_nodes(&self) -> usize {
        self.used().iter().map(|chunk| chunk.most_nodes).max().unwrap_or(1)
    }

    /// Returns the blocks of the largest box: of stars that are drawn analytically, and of the others.
    pub(super) fn most_blocks(&self) -> [usize; 2] {
        let most = |group: fn(&Chunk) -> &Group| self.used().iter().map(|chunk| group(chunk).most_blocks).max();
        [most(|chunk| &chunk.analytic), most(|chunk| &chunk.tabled)].map(Option::unwrap_or_default)
    }

    /// Returns the largest scale of the sums when a star is added in up to `slices` parts.
    pub(super) fn scale(&self, slices: usize) -> f32 {
        // And the light of whole stars once.
        self.bounds.scale((self.len() * slices + 1) as f64)
    }

    /// Returns the part of every group that belongs to the stars in a range of all.
    fn parts(&self, stars: Range<usize>) -> impl Iterator<Item = (&Group, Range<usize>)> + Clone {
        let mut first = 0;
        self.groups().map(move |group| {
            let (begin, end) = (first, first + group.spots.len());
            first = end;
            (group, stars.start.clamp(begin, end) - begin..stars.end.clamp(begin, end) - begin)
        })
    }

    /// Returns the number of tracks of all stars before this one.
    #[allow(clippy::cast_possible_truncation, reason = "a frame has fewer than 2^32 stars")]
    pub(super) fn tracks_before(&self, star: usize) -> u32 {
        self.parts(0..star).map(|(group, part)| group.tracks_before(part.end)).sum::<usize>() as u32
    }

    /// Writes some of the stars, and their tracks, to the start of two buffers and returns true when one of these is new.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub(super) fn write(
        &self,
        gpu: &GpuDevice,
        stars: Range<usize>,
        [spots, tracks]: [&mut GrowableBuffer; 2],
    ) -> Result<bool, GpuError> {
        let spots_grew = spots.write_slices(gpu, self.parts(stars.clone()).map(|(group, part)| &group.spots[part]))?;
        let own = self
            .parts(stars)
            .map(|(group, part)| &group.tracks[group.tracks_before(part.start)..group.tracks_before(part.end)]);
        Ok(tracks.write_slices(gpu, own)? || spots_grew)
    }

    fn used(&self) -> &[Chunk] {
        &self.chunks[..self.used]
    }

    /// Returns the groups in the order of the device.
    fn groups(&self) -> impl Iterator<Item = &Group> + Clone {
        let used = self.used();
        used.iter().map(|chunk| &chunk.analytic).chain(used.iter().map(|chunk| &chunk.tabled))
    }
}

/// One chunk's work, in the shape `pulp` compiles once per vector level.
struct FillChunk<'a> {
    plan: &'a ExposurePlan,
    stars: &'a [PlannedStar],
    lists: &'a [ListSource],
    peak: f64,
    size: [usize; 2],
    chunk: &'a mut Chunk,
}

impl NullaryFnOnce for FillChunk<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { plan, stars, lists, peak, size, chunk } = self;
        chunk.clear();
        for star in stars {
            let own = lists[star.list as usize];
            if own.is_spot {
                chunk.take(spot(star.mean_px, star.drawn_e, own.source, size), own.source, peak);
                continue;
            }
            for (list, share) in plan.parts(star) {
                let (source, electrons) = (lists[list].source, share * star.drawn_e);
                let list = &plan.lists[list];
                match list.drawing {
                    Drawing::Whole => chunk.whole.push(*star),
                    Drawing::Nodes => {
                        let Some((spot, track, box_px)) = trail(plan, star, (list, electrons), source, size) else {
                            continue;
                        };
                        chunk.most_nodes = chunk.most_nodes.max(track.nodes as usize);
                        chunk.group(source).0.tracks.push(track);
                        chunk.take(Some((spot, box_px)), source, peak);
                    }
                    Drawing::Once | Drawing::Kernel(_) | Drawing::Blend(_) => {
                        chunk.take(spot(star.mean_px, electrons, source, size), source, peak);
                    }
                }
            }
        }
    }
}
