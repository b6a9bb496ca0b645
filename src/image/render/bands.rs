//! A plan's stars in single precision, sorted into bands of image rows for the threads of the CPU backend.
//!
//! Positions are integer + fraction, so that f32 keeps 1e-8 px of the fraction wherever the star is. Stars are
//! taken in chunks, each sorted by its own thread; a band reads the chunks in order, so its stars come in source order
//! whatever the number of threads.
//!
//! [`Band`] has the pixels of a band of rows, and adds vectors to them.

use crate::render::grid::LANES;
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

/// A star drawn once, at its mean position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    pub(super) column: i32,
    pub(super) row: i32,
    pub(super) fraction: [f32; 2],
    pub(super) electrons: f32,
    /// Index of its kernel, or of its PSF down from [`NO_KERNEL`].
    pub(super) kernel: u32,
}

/// A star drawn at every node of its list.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trail {
    pub(super) spot: Spot,
    pub(super) list: u32,
    pub(super) tangent: [f32; 2],
    pub(super) px_per_tangent: [[f32; 2]; 2],
    pub(super) from_principal_px: [f32; 2],
}

/// One band's stars from one chunk.
#[derive(Debug, Default)]
pub(super) struct Members {
    pub(super) spots: Vec<Spot>,
    pub(super) trails: Vec<Trail>,
}

/// The stars of one chunk by band, and those that are drawn whole.
#[derive(Debug, Default)]
struct Chunk {
    bands: Vec<Members>,
    whole: Vec<PlannedStar>,
}

/// Where the stars of one list go.
#[derive(Debug, Clone, Copy)]
struct ListPlace {
    /// Half-height of its footprint, px.
    half_px: i64,
    /// Its kernel or PSF.
    table: u32,
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
    pub(super) nodes: Vec<NodeColumns>,
    places: Vec<ListPlace>,
}

/// Splats that inner loops take together.
pub(super) const BLOCK: usize = 16;

impl Bands {
    pub(super) fn new(rows: usize) -> Self {
        let bands = rows.div_ceil(BAND_ROWS);
        let chunks = (0..CHUNKS_RESERVED).map(|_| chunk(bands)).collect();
        let columns =
            || NodeColumns { values: Vec::with_capacity((POSE + 1) * NODES_RESERVED), ..NodeColumns::default() };
        let nodes = core::iter::repeat_with(columns).take(LISTS_RESERVED).collect();
        Self { rows, bands, chunks, used: 0, nodes, places: Vec::with_capacity(PLACES_RESERVED) }
    }

    /// Sorts a plan; paths that do not reach `regions` are left out. `half_px`: half-height of the footprint of a list;
    /// `table_of`: its kernel or PSF ([`Spot::kernel`]).
    pub(super) fn sort(
        &mut self,
        plan: &ExposurePlan,
        regions: &Regions,
        half_px: impl Fn(usize) -> usize,
        table_of: impl Fn(usize) -> u32,
    ) {
        self.fill_nodes(plan);
        self.places.clear();
        self.places.extend(plan.lists.iter().enumerate().map(|(number, list)| ListPlace {
            half_px: half_px(number).cast_signed() as i64,
            table: table_of(number),
            is_spot: matches!(list.drawing, Drawing::Once | Drawing::Kernel(_)),
        }));
        let parts = rayon::current_num_threads().min(CHUNKS_RESERVED);
        let length = plan.stars.len().div_ceil(parts).clamp(LEAST_CHUNK, CHUNK);
        self.used = plan.stars.len().div_ceil(length);
        let bands = self.bands;
        if self.chunks.len() < self.used {
            self.chunks.resize_with(self.used, || chunk(bands));
        }
        let (rows, places, arch) = (self.rows, self.places.as_slice(), vector_level());
        let fill = |(chunk, stars): (&mut Chunk, &[PlannedStar])| {
            chunk.whole.clear();
            for members in &mut chunk.bands {
                members.spots.clear();
                members.trails.clear();
            }
            arch.dispatch(SortStars { plan, regions, stars, places, rows, chunk });
            for members in &mut chunk.bands {
                reserve(&mut members.spots);
                reserve(&mut members.trails);
            }
        };
        if self.used == 1 {
            self.chunks.iter_mut().zip(plan.stars.chunks(length)).for_each(fill);
        } else {
            self.chunks[..self.used].par_iter_mut().zip(plan.stars.par_chunks(length)).for_each(fill);
        }
    }

    /// Members of band `band`, chunk by chunk.
    pub(super) fn members(&self, band: usize) -> impl Iterator<Item = &Members> {
        self.chunks[..self.used].iter().map(move |chunk| &chunk.bands[band])
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

/// Returns the empty bands of one chunk; memory that is never written is never taken.
fn chunk(bands: usize) -> Chunk {
    let space = (SPACE * CHUNK).div_ceil(bands.max(1)).min(CHUNK);
    let members = |_| Members { spots: Vec::with_capacity(space), trails: Vec::with_capacity(space) };
    Chunk { bands: (0..bands).map(members).collect(), whole: Vec::with_capacity(WHOLE_RESERVED) }
}

/// Reserves capacity for all stars of a chunk before a slowly changing field needs it.
fn reserve<T>(members: &mut Vec<T>) {
    if (members.len() + members.len() / 4).min(CHUNK) > members.capacity() {
        members.reserve_exact(CHUNK - members.len());
    }
}

/// Splits a position into pixel and fraction.
#[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors of the origin")]
#[inline(always)]
fn spot(px: [f64; 2], electrons: f64, kernel: u32) -> Spot {
    let (column, row) = ((px[0] + 0.5).floor(), (px[1] + 0.5).floor());
    Spot {
        column: column as i32,
        row: row as i32,
        fraction: [(px[0] - column) as f32, (px[1] - row) as f32],
        electrons: electrons as f32,
        kernel,
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
        for star in stars {
            if let Some(ListPlace { half_px, table, is_spot: true }) = places.get(star.list as usize) {
                push_spot(&mut chunk.bands, spot(star.mean_px, star.drawn_e, *table), *half_px, rows);
                continue;
            }
            for (list, share) in plan.parts(star) {
                let ListPlace { half_px: half, table, .. } = places[list];
                let electrons = share * star.drawn_e;
                match plan.lists[list].drawing {
                    Drawing::Nodes => {
                        sort_trail((plan, regions), star, (list, electrons, table), half, rows, &mut chunk.bands);
                        continue;
                    }
                    Drawing::Whole => {
                        chunk.whole.push(*star);
                        continue;
                    }
                    Drawing::Once | Drawing::Kernel(_) | Drawing::Blend(_) => {}
                }
                push_spot(&mut chunk.bands, spot(star.mean_px, electrons, table), half, rows);
            }
        }
    }
}

/// Adds a star that is drawn once to the bands that its footprint reaches.
#[inline(always)]
fn push_spot(bands: &mut [Members], spot: Spot, half_px: i64, rows: usize) {
    let row = i64::from(spot.row);
    for members in &mut bands[bands_of(row - half_px, row + half_px, rows)] {
        members.spots.push(spot);
    }
}

fn sort_trail(
    (plan, regions): (&ExposurePlan, &Regions),
    star: &PlannedStar,
    (list, electrons, table): (usize, f64, u32),
    half: i64,
    rows: usize,
    chunk: &mut [Members],
) {
    let track = StarTrack::new(&plan.camera, star.place);
    let origin_px = plan.origin_px(star, &track);
    let trail = Trail {
        spot: spot(origin_px, electrons, table),
        list: u32::try_from(list).unwrap_or(u32::MAX),
        tangent: star.place.tangent.to_array().map(|v| v as f32),
        px_per_tangent: track.px_per_tangent.map(|row| row.map(|v| v as f32)),
        from_principal_px: track.from_principal_px.map(|v| v as f32),
    };
    // The path stays within its extent of the mean; one pixel for motion between the probes, one for rounding.
    #[allow(clippy::cast_possible_truncation, reason = "a path on a detector, px")]
    let reach = half + plan.extent_px.ceil() as i64 + 2;
    #[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors")]
    let [column, row] = star.mean_px.map(|px| px.round() as i64);
    if !regions.show(column - reach, row - reach, [2 * reach + 1; 2]) {
        return;
    }
    for band in bands_of(row - reach, row + reach, rows) {
        chunk[band].trails.push(trail);
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
}

impl Band<'_> {
    /// Returns rows in the band.
    #[inline(always)]
    pub(super) fn rows(&self) -> i32 {
        (self.pixels.len() / self.width) as i32
    }
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
