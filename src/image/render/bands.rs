//! A plan's stars in single precision, sorted into bands of image rows for the threads of the CPU backend.
//!
//! Positions are integer + fraction, so that f32 keeps 1e-8 px of the fraction wherever the star is. Stars are
//! taken in chunks, each sorted by its own thread. A band reads the chunks in order: its trails come in source order, and
//! its stars that are drawn once by groups of rows ([`spots`](crate::render::spots)), whatever the number of threads.
//!
//! [`Band`] has the pixels of a band of rows, and adds vectors to them.

use crate::render::grid::LANES;
use crate::render::spots::{BandSpots, Groups, Spot, Spots};
use base::{fused::mul_add, region::Regions, vector_level::vector_level};
use plan::exposure::pose::{POSE, PathNode};
use plan::exposure::track::StarTrack;
use plan::exposure::{Drawing, ExposurePlan, PlannedStar};
use pulp::NullaryFnOnce;
use rayon::prelude::*;

/// Rows of one band.
pub(super) const BAND_ROWS: usize = 64;
/// Stars one thread sorts at a time, at most; and at least where there are so many.
const CHUNK: usize = 4096;
const LEAST_CHUNK: usize = 1024;
/// Number of chunks that are allocated from the start.
const CHUNKS_RESERVED: usize = 4;
/// Number of lists of nodes that are allocated from the start, and nodes in each: those of the bands of a rolling shutter, in a
/// path with jitter.
const LISTS_RESERVED: usize = 64;
const NODES_RESERVED: usize = 1024;
/// Number of lists whose places are allocated from the start.
const PLACES_RESERVED: usize = 4096;
/// Capacity of a chunk for whole stars.
const WHOLE_RESERVED: usize = 64;
/// Capacity of a band of a chunk, as a multiple of its share of the stars.
const SPACE: usize = 8;
/// A star that is drawn from the PSF itself: this, less the PSF's number where it is one of several.
pub(super) const NO_KERNEL: u32 = u32::MAX;

/// A star drawn at every node of its list.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trail {
    pub(super) spot: Spot,
    pub(super) list: u32,
    pub(super) tangent: [f32; 2],
    pub(super) px_per_tangent: [[f32; 2]; 2],
    pub(super) from_principal_px: [f32; 2],
}

/// The stars of one chunk: those that are drawn once, from the PSF and from kernels, trails by band, and whole ones.
#[derive(Debug)]
struct Chunk {
    once: [Spots; 2],
    trails: Vec<Vec<Trail>>,
    whole: Vec<PlannedStar>,
}

/// Where the stars of one list go.
#[derive(Debug, Clone, Copy)]
struct ListPlace {
    /// Its kernel or PSF.
    table: u32,
    is_kernel: bool,
    /// Each is drawn once, by this list alone.
    is_spot: bool,
}

/// Nodes of one list, number by number: weight, then the thirteen of the pose; padded with weight 0.
#[derive(Debug, Default)]
pub(super) struct NodeColumns {
    pub(super) count: usize,
    pub(super) padded: usize,
    pub(super) values: Vec<f32>,
}

/// All bands.
#[derive(Debug)]
pub(super) struct Bands {
    rows: usize,
    bands: usize,
    chunks: Vec<Chunk>,
    used: usize,
    /// Of footprints of the PSF, and of those of kernels.
    groups: [Groups; 2],
    pub(super) nodes: Vec<NodeColumns>,
    places: Vec<ListPlace>,
}

/// Splats that inner loops take together.
pub(super) const BLOCK: usize = 16;

impl Bands {
    pub(super) fn new(rows: usize) -> Self {
        let bands = rows.div_ceil(BAND_ROWS);
        let chunks = (0..CHUNKS_RESERVED).map(|_| chunk(rows, bands)).collect();
        let columns =
            || NodeColumns { values: Vec::with_capacity((POSE + 1) * NODES_RESERVED), ..NodeColumns::default() };
        let nodes = core::iter::repeat_with(columns).take(LISTS_RESERVED).collect();
        let (groups, places) = ([Groups::default(); 2], Vec::with_capacity(PLACES_RESERVED));
        Self { rows, bands, chunks, used: 0, groups, nodes, places }
    }

    /// Sorts a plan; paths that do not reach `regions` are left out. `half_px`: half-height of the footprints of the PSF and
    /// of kernels; `table_of`: the kernel or PSF of a list ([`Spot::kernel`]), and whether it is a kernel.
    pub(super) fn sort(
        &mut self,
        plan: &ExposurePlan,
        regions: &Regions,
        half_px: [usize; 2],
        table_of: impl Fn(usize) -> (u32, bool),
    ) {
        self.fill_nodes(plan);
        self.places.clear();
        self.places.extend(plan.lists.iter().enumerate().map(|(number, list)| {
            let (table, is_kernel) = table_of(number);
            let is_spot = matches!(list.drawing, Drawing::Once | Drawing::Kernel(_));
            ListPlace { table, is_kernel, is_spot }
        }));
        let parts = rayon::current_num_threads().min(CHUNKS_RESERVED);
        let length = plan.stars.len().div_ceil(parts).clamp(LEAST_CHUNK, CHUNK);
        self.used = plan.stars.len().div_ceil(length);
        let (bands, rows, arch) = (self.bands, self.rows, vector_level());
        if self.chunks.len() < self.used {
            self.chunks.resize_with(self.used, || chunk(rows, bands));
        }
        self.groups = half_px.map(|half_px| Groups::new(rows, half_px));
        let (groups, places) = (self.groups, self.places.as_slice());
        let fill = |(chunk, stars): (&mut Chunk, &[PlannedStar])| {
            chunk.whole.clear();
            chunk.trails.iter_mut().for_each(Vec::clear);
            chunk.once.iter_mut().zip(groups).for_each(|(once, groups)| once.clear(groups));
            arch.dispatch(SortStars { plan, regions, stars, places, rows, chunk });
            chunk.once.iter_mut().for_each(Spots::sort);
            chunk.trails.iter_mut().for_each(reserve);
        };
        if self.used == 1 {
            self.chunks.iter_mut().zip(plan.stars.chunks(length)).for_each(fill);
        } else {
            self.chunks[..self.used].par_iter_mut().zip(plan.stars.par_chunks(length)).for_each(fill);
        }
    }

    /// Stars that are drawn once and reach so many rows from `first`: from the PSF, and from kernels.
    #[inline(always)]
    pub(super) fn once(&self, first: i32, rows: i32) -> [impl Iterator<Item = &Spot>; 2] {
        let chunks = self.chunks[..self.used].iter();
        [0, 1].map(|kind| {
            BandSpots::new(chunks.clone().map(move |chunk| &chunk.once[kind]), self.groups[kind], first, rows)
        })
    }

    /// Trails of band `band`, in source order.
    #[inline(always)]
    pub(super) fn trails(&self, band: usize) -> impl Iterator<Item = &Trail> {
        self.chunks[..self.used].iter().flat_map(move |chunk| &chunk.trails[band])
    }

    /// Stars that are drawn whole, in source order.
    pub(super) fn whole(&self) -> impl Iterator<Item = &PlannedStar> {
        self.chunks[..self.used].iter().flat_map(|chunk| &chunk.whole)
    }

    fn fill_nodes(&mut self, plan: &ExposurePlan) {
        if self.nodes.len() < plan.lists.len() {
            self.nodes.resize_with(plan.lists.len(), NodeColumns::default);
        }
        for (columns, list) in self.nodes.iter_mut().zip(&plan.lists) {
            let nodes = if matches!(list.drawing, Drawing::Nodes) { plan.nodes_of(list) } else { &[] };
            columns.fill(nodes);
        }
    }
}

impl NodeColumns {
    fn fill(&mut self, nodes: &[PathNode]) {
        self.count = nodes.len();
        self.padded = nodes.len().next_multiple_of(BLOCK);
        self.values.clear();
        self.values.resize((POSE + 1) * self.padded, 0.0);
        for (i, node) in nodes.iter().enumerate() {
            self.values[i] = node.weight as f32;
            for (k, value) in node.pose.0.iter().enumerate() {
                self.values[(k + 1) * self.padded + i] = *value as f32;
            }
        }
    }

    /// Returns the number `k` (0: weight) of the nodes from `first`.
    #[inline(always)]
    pub(super) fn lanes(&self, k: usize, first: usize) -> &[f32; BLOCK] {
        const NONE: [f32; BLOCK] = [0.0; BLOCK];
        let at = k * self.padded + first;
        self.values.get(at..at + BLOCK).and_then(|lanes| lanes.try_into().ok()).unwrap_or(&NONE)
    }
}

/// Returns an empty chunk for an image of so many rows; memory that is never written is never taken.
fn chunk(rows: usize, bands: usize) -> Chunk {
    let space = (SPACE * CHUNK).div_ceil(bands.max(1)).min(CHUNK);
    let trails = (0..bands).map(|_| Vec::with_capacity(space)).collect();
    let once = [(); 2].map(|()| Spots::with_space(CHUNK, rows));
    Chunk { once, trails, whole: Vec::with_capacity(WHOLE_RESERVED) }
}

/// Reserves capacity for all stars of a chunk before a slowly changing field needs it.
fn reserve(members: &mut Vec<Trail>) {
    if (members.len() + members.len() / 4).min(CHUNK) > members.capacity() {
        members.reserve_exact(CHUNK - members.len());
    }
}

/// One chunk's stars, in the shape `pulp` compiles once per vector level.
struct SortStars<'a> {
    plan: &'a ExposurePlan,
    regions: &'a Regions,
    stars: &'a [PlannedStar],
    places: &'a [ListPlace],
    rows: usize,
    chunk: &'a mut Chunk,
}

impl NullaryFnOnce for SortStars<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { plan, regions, stars, places, rows, chunk } = self;
        let Chunk { once, trails, whole } = chunk;
        let mut push = |place: &ListPlace, mean_px: [f64; 2], electrons: f64| {
            once[usize::from(place.is_kernel)].push(Spot::at(mean_px, electrons, place.table));
        };
        for star in stars {
            if let Some(place) = places.get(star.list as usize).filter(|place| place.is_spot) {
                push(place, star.mean_px, star.drawn_e);
                continue;
            }
            for (list, share) in plan.parts(star) {
                let electrons = share * star.drawn_e;
                match plan.lists[list].drawing {
                    Drawing::Nodes => {
                        let of_list = (list, electrons, places[list].table);
                        sort_trail((plan, regions), star, of_list, rows, trails);
                    }
                    Drawing::Whole => whole.push(*star),
                    Drawing::Once | Drawing::Kernel(_) | Drawing::Blend(_) => {
                        push(&places[list], star.mean_px, electrons);
                    }
                }
            }
        }
    }
}

fn sort_trail(
    (plan, regions): (&ExposurePlan, &Regions),
    star: &PlannedStar,
    (list, electrons, table): (usize, f64, u32),
    rows: usize,
    trails: &mut [Vec<Trail>],
) {
    let track = StarTrack::new(&plan.camera, star.place);
    let origin_px = plan.origin_px(star, &track);
    // The path stays within its extent of the mean; one pixel for motion between the probes, one for rounding.
    #[allow(clippy::cast_possible_truncation, reason = "a path on a detector, px")]
    let reach = plan.half_px as i64 + plan.extent_px.ceil() as i64 + 2;
    #[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors")]
    let [column, row] = star.mean_px.map(|px| px.round() as i64);
    if !regions.show(column - reach, row - reach, [2 * reach + 1; 2]) {
        return;
    }
    let trail = Trail {
        spot: Spot::at(origin_px, electrons, table),
        list: u32::try_from(list).unwrap_or(u32::MAX),
        tangent: star.place.tangent.to_array().map(|v| v as f32),
        px_per_tangent: track.px_per_tangent.map(|row| row.map(|v| v as f32)),
        from_principal_px: track.from_principal_px.map(|v| v as f32),
    };
    for band in bands_of(row - reach, row + reach, rows) {
        trails[band].push(trail);
    }
}

/// Bands that hold any of the rows `first..=last`.
#[inline(always)]
fn bands_of(first: i64, last: i64, rows: usize) -> core::ops::Range<usize> {
    let (first, last) = (first.max(0), last.min(rows as i64 - 1));
    if first > last {
        return 0..0;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image's rows")]
    let bands = first as usize / BAND_ROWS..last as usize / BAND_ROWS + 1;
    bands
}

/// Rows of the image that one thread draws.
pub(super) struct Band<'a> {
    pub(super) pixels: &'a mut [f32],
    pub(super) width: usize,
    pub(super) first_row: i32,
    pub(super) rows: i32,
}

/// Adds `gain * values` to `target`, through a copy: the compiler need not check whether the two overlap.
#[inline(always)]
pub(super) fn add_lanes<const FUSED: bool>(target: &mut [f32; LANES], values: &[f32; LANES], gain: f32) {
    let mut sum = *target;
    for lane in 0..LANES {
        sum[lane] = mul_add::<FUSED>(gain, values[lane], sum[lane]);
    }
    *target = sum;
}

/// Adds `gain * values[i]` to `line[first + i]` for the used lanes that lie on the line, through a whole vector: code
/// that reads `values` lane by lane makes the compiler take the loops that sum them up apart into single lanes.
#[inline(always)]
pub(super) fn add_clipped<const FUSED: bool>(
    line: &mut [f32],
    first: i32,
    used: usize,
    values: &[f32; LANES],
    gain: f32,
) {
    let (skipped, start) = ((-first).max(0) as usize, first.max(0) as usize);
    let used = used.min(LANES);
    if skipped >= used || start >= line.len() {
        return;
    }
    let pixels = &mut line[start..];
    let count = (used - skipped).min(pixels.len());
    let (pixels, lanes) = (&mut pixels[..count], skipped..skipped + count);
    let mut target = [0.0_f32; LANES];
    target[lanes.clone()].copy_from_slice(pixels);
    add_lanes::<FUSED>(&mut target, values, gain);
    pixels.copy_from_slice(&target[lanes]);
}
