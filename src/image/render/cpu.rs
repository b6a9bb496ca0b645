//! CPU backend: all cores, vectorised by the compiler for the processor it finds (AVX-512, AVX2 + FMA, NEON, SSE2).
//!
//! The image is cut into bands of rows; a band is cleared and drawn by one thread, its stars in source order, so a
//! repeated plan gives the same bits whatever the number of threads, and parts of an image have the bits of the whole.
//! A Gaussian is drawn analytically for every node (two vectors of erf, then one multiply-add per row); other PSFs and
//! effective PSFs come from tables. Error: f32, < 2e-7 of the peak (Gaussian), `TABLE_ERROR` (tables); `tests/physics`.

use crate::gpu::Electrons;
use crate::render::bands::{BAND_ROWS, BLOCK, Bands, NO_KERNEL, NodeColumns, Spot, Trail};
use crate::render::bands::{Band, add_clipped, add_lanes};
use crate::render::stamp::{Stamped, stamp};
use crate::render::table::{Form, PsfTable};
use crate::render::whole::{TILE_PX, WholeImage};
use crate::render::{Backend, check_kernel, check_sampling};
use crate::render::{grid::LANES, plan_tables::PlanTables, profile::Profile, spline::Taps};
use base::fused::{mul_add, whole_bits};
use base::{image::Image, refused::Refused, region::Regions, vector_level};
use plan::exposure::{ExposurePlan, sampling::ANALYTIC_HALF_PX};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// The CPU backend.
#[derive(Debug)]
pub struct Cpu {
    arch: Arch,
    image: Image<f32>,
    tables: PlanTables,
    bands: Bands,
    whole: WholeImage,
    /// Parts of the image that are drawn.
    regions: Regions,
}

impl Cpu {
    /// Returns a renderer for a detector of this size.
    pub fn new(width_px: usize, height_px: usize) -> Self {
        Self {
            arch: vector_level::vector_level(),
            image: Image::new(width_px, height_px),
            tables: PlanTables::new(ANALYTIC_HALF_PX, Form::Products),
            bands: Bands::new(height_px),
            whole: WholeImage::new([width_px, height_px]),
            regions: Regions::WHOLE,
        }
    }
}

impl Backend for Cpu {
    fn name(&self) -> &'static str {
        "cpu"
    }

    fn description(&self) -> String {
        format!("{} threads, vector level {}", rayon::current_num_threads(), vector_level::name(self.arch))
    }

    fn render(&mut self, plan: &ExposurePlan) -> Result<(), Refused> {
        check_kernel(plan)?;
        check_sampling(plan, self.tables.is_analytic(plan))?;
        self.tables.prepare(plan);
        let Self { arch, image, tables, bands, whole, regions } = self;
        let kernel_half = tables.kernels().first().map_or(0, |kernel| kernel.half_px[1]);
        let half_px = |list: usize| if tables.kernel_of(list).is_some() { kernel_half } else { plan.half_px };
        let table_of = |list: usize| {
            let number = |n: usize| u32::try_from(n).unwrap_or(0);
            tables.kernel_of(list).map_or_else(|| NO_KERNEL - number(tables.psf_of(plan, list)), number)
        };
        bands.sort(plan, regions, half_px, table_of);
        whole.draw(plan, tables, bands.whole());
        let width = image.width().max(1);
        let draw = Draw {
            bands,
            whole,
            regions,
            kernels: tables.kernels(),
            bases: tables.bases(plan),
            half_px: plan.half_px as i32,
            profile: Profile::new(plan.sampling, plan.psf.core_sigma_px()),
            oversampling: tables.kernels().first().or(tables.bases(plan).first()).map_or(1, |table| table.oversampling),
            mask: core::array::from_fn(|lane| if lane <= 2 * plan.half_px { 1.0 } else { 0.0 }),
        };
        let (arch, draw) = (*arch, &draw);
        image.pixels_mut().par_chunks_mut(BAND_ROWS * width).enumerate().for_each(|(index, pixels)| {
            if !draw.regions.show_rows(&(index * BAND_ROWS..(index + 1) * BAND_ROWS)) {
                return;
            }
            let target = Band { pixels, width, first_row: (index * BAND_ROWS) as i32 };
            let fused = !matches!(arch, Arch::Scalar);
            arch.dispatch(DrawBand { draw, target, index, fused });
        });
        Ok(())
    }

    fn set_regions(&mut self, regions: &Regions) {
        self.regions = *regions;
    }

    fn electrons(&self) -> Electrons<'_> {
        Electrons::Host(&self.image)
    }
}

/// Inputs of drawing into the bands.
struct Draw<'a> {
    bands: &'a Bands,
    whole: &'a WholeImage,
    /// Stars that do not reach these are left out where they would be drawn: the others are added in the same order as
    /// in the whole image, and so to the same bits.
    regions: &'a Regions,
    kernels: &'a [PsfTable],
    /// Tables of the PSF itself; none where it is drawn analytically.
    bases: &'a [PsfTable],
    half_px: i32,
    /// Grid points per pixel of all tables of a plan.
    oversampling: usize,
    profile: Profile,
    /// 1 for lanes inside the footprint, else 0.
    mask: [f32; LANES],
}

/// One band's work, in the shape `pulp` compiles once per vector level.
struct DrawBand<'a> {
    draw: &'a Draw<'a>,
    target: Band<'a>,
    index: usize,
    fused: bool,
}

impl NullaryFnOnce for DrawBand<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        if self.fused { self.draw::<true>() } else { self.draw::<false>() }
    }
}

impl DrawBand<'_> {
    #[inline(always)]
    fn draw<const FUSED: bool>(self) {
        let Self { draw, mut target, index, .. } = self;
        target.pixels.fill(0.0);
        let mut waiting = Waiting { analytic: Splats::NONE, tabled: Splats::NONE };
        for members in draw.bands.members(index) {
            if draw.has_tables() {
                for spot in &members.spots {
                    draw.spot::<FUSED>(&mut target, &mut waiting, spot);
                }
            } else {
                for spots in members.spots.chunks(BLOCK) {
                    waiting.analytic.take(spots);
                    draw.splat::<FUSED>(&mut target, &waiting.analytic);
                }
                waiting.analytic.count = 0;
            }
        }
        draw.rest::<FUSED>(&mut target, &mut waiting);
        let mut splats = Splats::NONE;
        for members in draw.bands.members(index) {
            for trail in &members.trails {
                draw.trail::<FUSED>(&mut target, &mut splats, trail);
            }
        }
        draw.add_whole(&mut target, index);
    }
}

/// Splats waiting to be drawn: pixel, fraction and light.
struct Splats {
    count: usize,
    column: [i32; BLOCK],
    row: [i32; BLOCK],
    x: [f32; BLOCK],
    y: [f32; BLOCK],
    electrons: [f32; BLOCK],
    /// Kernel of each star, as in [`Spot::kernel`](crate::render::bands::Spot).
    kernel: [u32; BLOCK],
}

/// Stars that are drawn once, until there is a block of them.
struct Waiting {
    analytic: Splats,
    tabled: Splats,
}

impl Splats {
    const NONE: Self = Self {
        count: 0,
        column: [0; BLOCK],
        row: [0; BLOCK],
        x: [0.0; BLOCK],
        y: [0.0; BLOCK],
        electrons: [0.0; BLOCK],
        kernel: [NO_KERNEL; BLOCK],
    };

    /// Replaces the splats by at most a block of others, which need no kernel.
    #[inline(always)]
    fn take(&mut self, spots: &[Spot]) {
        for (k, spot) in spots.iter().enumerate().take(BLOCK) {
            self.column[k] = spot.column;
            self.row[k] = spot.row;
            [self.x[k], self.y[k]] = spot.fraction;
            self.electrons[k] = spot.electrons;
        }
        self.count = spots.len().min(BLOCK);
    }

    #[inline(always)]
    fn push(&mut self, spot: &Spot) {
        let k = self.count;
        self.column[k] = spot.column;
        self.row[k] = spot.row;
        [self.x[k], self.y[k]] = spot.fraction;
        self.electrons[k] = spot.electrons;
        self.kernel[k] = spot.kernel;
        self.count += 1;
    }
}

impl Draw<'_> {
    /// Returns the kernel or the PSF that a star is drawn from (see [`Spot::kernel`](crate::render::bands::Spot)).
    #[inline(always)]
    fn table(&self, number: u32) -> Option<&PsfTable> {
        self.kernels.get(number as usize).or_else(|| self.bases.get((NO_KERNEL - number) as usize))
    }

    /// Returns true when any star may be drawn from a kernel or a table.
    fn has_tables(&self) -> bool {
        !self.kernels.is_empty() || !self.bases.is_empty()
    }

    /// Returns true when a star that reaches so far to all sides has a pixel in the regions.
    #[inline(always)]
    fn shows(&self, [column, row]: [i32; 2], half_px: [i64; 2]) -> bool {
        if self.regions.is_whole() {
            return true;
        }
        let [left, top] = [i64::from(column) - half_px[0], i64::from(row) - half_px[1]];
        self.regions.show(left, top, half_px.map(|half| 2 * half + 1))
    }

    /// Draws a star that is drawn once: it waits until a block is full.
    #[inline(always)]
    fn spot<const FUSED: bool>(&self, band: &mut Band<'_>, waiting: &mut Waiting, spot: &Spot) {
        if self.table(spot.kernel).is_some() {
            waiting.tabled.push(spot);
            if waiting.tabled.count == BLOCK {
                self.stamps::<FUSED>(band, &waiting.tabled);
                waiting.tabled.count = 0;
            }
        } else {
            waiting.analytic.push(spot);
            if waiting.analytic.count == BLOCK {
                self.splat::<FUSED>(band, &waiting.analytic);
                waiting.analytic.count = 0;
            }
        }
    }

    /// Adds the light of whole stars to the band of this number.
    fn add_whole(&self, band: &mut Band<'_>, index: usize) {
        for (place, values) in self.whole.tiles() {
            let ([column, row], [columns, rows]) = self.whole.box_px(place);
            if row / BAND_ROWS != index {
                continue;
            }
            let lines = band.pixels.chunks_exact_mut(band.width).skip(row % BAND_ROWS).take(rows);
            for (line, values) in lines.zip(values.chunks_exact(TILE_PX)) {
                for (pixel, value) in line[column..column + columns].iter_mut().zip(values) {
                    *pixel += value;
                }
            }
        }
    }

    /// Draws the stars that still wait.
    #[inline(always)]
    fn rest<const FUSED: bool>(&self, band: &mut Band<'_>, waiting: &mut Waiting) {
        self.stamps::<FUSED>(band, &waiting.tabled);
        self.splat::<FUSED>(band, &waiting.analytic);
    }

    /// Draws splats from their tables.
    #[inline(always)]
    fn stamps<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &Splats) {
        // No closure: it would not be compiled for the vector level.
        let across = Taps::of::<FUSED>(&splats.x, self.oversampling);
        let down = Taps::of::<FUSED>(&splats.y, self.oversampling);
        for k in 0..splats.count {
            let Some(table) = self.table(splats.kernel[k]) else { continue };
            if !self.shows([splats.column[k], splats.row[k]], table.half_px.map(|half| half as i64)) {
                continue;
            }
            let ((px, wx), (py, wy)) = (across.of_star(k), down.of_star(k));
            let origin = [splats.column[k], splats.row[k]];
            stamp::<FUSED>(
                band,
                table,
                &Stamped { origin, phases: [px, py], wx, wy: wy.map(|wy| splats.electrons[k] * wy) },
            );
        }
    }

    /// Draws a star at every node of its list.
    #[inline(always)]
    fn trail<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &mut Splats, trail: &Trail) {
        let Some(nodes) = self.bands.nodes.get(trail.list as usize) else { return };
        let mut first = 0;
        while first < nodes.count {
            steps::<FUSED>(nodes, first, trail, splats);
            splats.count = (nodes.count - first).min(BLOCK);
            if self.table(trail.spot.kernel).is_some() {
                splats.kernel = [trail.spot.kernel; BLOCK];
                self.stamps::<FUSED>(band, splats);
            } else {
                self.splat::<FUSED>(band, splats);
            }
            first += BLOCK;
        }
    }

    /// Draws splats: all profiles in one vector loop, then row by row. Those of other bands cost their profile.
    #[inline(always)]
    fn splat<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &Splats) {
        let used = (2 * self.half_px + 1) as usize;
        // Edges of neighbours follow one another; the last may be read a vector past its own.
        let stride = used + 1;
        let mut across = [0.0_f32; BLOCK * LANES + LANES];
        let mut down = [0.0_f32; BLOCK * LANES + LANES];
        let half = self.half_px as f32 + 0.5;
        for k in 0..splats.count {
            set_edges(&mut across, k * stride, half + splats.x[k]);
            set_edges(&mut down, k * stride, half + splats.y[k]);
        }
        let end = (splats.count * stride).next_multiple_of(LANES);
        self.profile.apply::<FUSED>(&mut across[..end]);
        self.profile.apply::<FUSED>(&mut down[..end]);
        for k in 0..splats.count {
            let top = splats.row[k] - self.half_px - band.first_row;
            if top >= band.rows() || top + used as i32 <= 0 {
                continue;
            }
            if !self.shows([splats.column[k], splats.row[k]], [i64::from(self.half_px); 2]) {
                continue;
            }
            let at = k * stride;
            let (Some(across), Some(down)) = (across.get(at..at + LANES + 1), down.get(at..at + LANES + 1)) else {
                continue;
            };
            let mut line = [0.0_f32; LANES];
            let mut gains = [0.0_f32; LANES];
            for lane in 0..LANES {
                line[lane] = splats.electrons[k] * self.mask[lane] * (across[lane + 1] - across[lane]);
                gains[lane] = down[lane + 1] - down[lane];
            }
            add_separable::<FUSED>(band, top, splats.column[k] - self.half_px, used, &line, &gains);
        }
    }
}

/// Sets a vector of pixel edges from `at`: their distances from a star that lies `star_px` behind the first.
#[inline(always)]
fn set_edges(edges: &mut [f32], at: usize, star_px: f32) {
    const NUMBERS: [f32; LANES] = numbers();
    if let Some(edges) = edges.get_mut(at..).and_then(<[f32]>::first_chunk_mut::<LANES>) {
        *edges = core::array::from_fn(|lane| NUMBERS[lane] - star_px);
    }
}

/// Returns the numbers from 0.
const fn numbers() -> [f32; LANES] {
    let (mut numbers, mut lane) = ([0.0; LANES], 0);
    while lane < LANES {
        numbers[lane] = lane as f32;
        lane += 1;
    }
    numbers
}

/// Adds the outer product of a row and `gains` from row `top` of the band.
#[inline(always)]
fn add_separable<const FUSED: bool>(
    band: &mut Band<'_>,
    top: i32,
    left: i32,
    used: usize,
    line: &[f32; LANES],
    gains: &[f32; LANES],
) {
    let width = band.width;
    let (first, end) = ((-top).max(0), (used as i32).min(band.rows() - top));
    if left >= 0 && left as usize + LANES <= width {
        let from = (top + first) as usize * width + left as usize;
        let Some(pixels) = band.pixels.get_mut(from..) else { return };
        let rows = pixels.chunks_mut(width).filter_map(|row| row.first_chunk_mut::<LANES>());
        for (row, gain) in rows.zip(&gains[first as usize..end as usize]) {
            add_lanes::<FUSED>(row, line, *gain);
        }
        return;
    }
    for r in first..end {
        let at = (top + r) as usize * width;
        add_clipped::<FUSED>(&mut band.pixels[at..at + width], left, used, line, gains[r as usize]);
    }
}

/// Places of a star at the nodes from `first` (see [`plan::exposure::track`]).
#[inline(always)]
fn steps<const FUSED: bool>(nodes: &NodeColumns, first: usize, trail: &Trail, splats: &mut Splats) {
    let pose: [&[f32; BLOCK]; 13] = core::array::from_fn(|k| nodes.lanes(k + 1, first));
    let weight = nodes.lanes(0, first);
    let ([u, v], [rx, ry]) = (trail.tangent, trail.from_principal_px);
    let [[xu, xv], [yu, yv]] = trail.px_per_tangent;
    let [fx, fy] = trail.spot.fraction;
    for k in 0..BLOCK {
        let d = |row: usize| {
            let [a, b, c] = [pose[3 * row][k], pose[3 * row + 1][k], pose[3 * row + 2][k]];
            mul_add::<FUSED>(a, u, mul_add::<FUSED>(b, v, c))
        };
        let dz = d(2);
        let scale = 1.0 / (1.0 + dz);
        let (du, dv) = (mul_add::<FUSED>(-u, dz, d(0)) * scale, mul_add::<FUSED>(-v, dz, d(1)) * scale);
        let (x, y) = (mul_add::<FUSED>(xu, du, xv * dv), mul_add::<FUSED>(yu, du, yv * dv));
        let (sin, less) = (pose[9][k], pose[10][k]);
        let (ax, ay) = (rx + x, ry + y);
        let x = fx + (x + mul_add::<FUSED>(less, ax, mul_add::<FUSED>(-sin, ay, pose[11][k])));
        let y = fy + (y + mul_add::<FUSED>(sin, ax, mul_add::<FUSED>(less, ay, pose[12][k])));
        let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
        splats.column[k] = trail.spot.column + whole_i32(column);
        splats.row[k] = trail.spot.row + whole_i32(row);
        splats.x[k] = x - column;
        splats.y[k] = y - row;
        splats.electrons[k] = trail.spot.electrons * weight[k];
    }
}

/// Returns a whole number within 2^22 as an integer; beyond, any number far off the detector. An `as` cast saturates,
/// and so does not vectorise.
#[inline(always)]
fn whole_i32(whole: f32) -> i32 {
    const FAR: f32 = 2_097_152.0;
    (whole_bits(whole.clamp(-FAR, FAR)).wrapping_sub(0x4b40_0000)).cast_signed()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_are_clipped_at_both_ends() {
        let line: [f32; LANES] = core::array::from_fn(|i| if i < 2 { 1.0 } else { 0.0 });
        let mut pixels = vec![0.0_f32; 40];
        for (top, left) in [(0, -2), (1, 19), (0, 2), (-1, 5), (0, -40), (0, 400)] {
            let mut band = Band { pixels: &mut pixels, width: 20, first_row: 0 };
            add_separable::<true>(&mut band, top, left, 2, &line, &[2.0; LANES]);
        }
        let mut wanted = [0.0_f32; 40];
        for at in [2, 3, 22, 23, 39, 5, 6] {
            wanted[at] += 2.0;
        }
        assert_eq!(pixels, wanted);
    }

    #[test]
    fn whole_numbers_become_integers() {
        for whole in [-3.0_f32, 0.0, 7.0, 100_000.0, -100_000.0] {
            assert_eq!(f64::from(whole_i32(whole)), f64::from(whole));
        }
        assert!(whole_i32(f32::INFINITY) > 1_000_000 && whole_i32(-1e30) < -1_000_000);
    }
}
