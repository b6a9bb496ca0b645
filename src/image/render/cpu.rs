//! CPU backend: all cores, vectorised by the compiler for the processor it finds (AVX-512, AVX2 + FMA, NEON, SSE2).
//!
//! The image is cut into bands of rows; a band is cleared and drawn by one thread, its stars in one order, so a
//! repeated plan gives the same bits whatever the number of threads, and parts of an image have the bits of the whole.
//! A Gaussian is drawn analytically for every node: its shares across and down come from polynomials
//! (`render::weights`) or the error function, then one multiply-add per row. Other PSFs and
//! effective PSFs come from tables. Error: f32, < 3e-7 of the peak (Gaussian), `TABLE_ERROR` (tables); `tests/physics`.

use crate::gpu::Electrons;
use crate::render::bands::{BAND_ROWS, BLOCK, Bands, NO_KERNEL, NodeColumns, Trail};
use crate::render::bands::{Band, add_clipped};
use crate::render::spots::Spot;
use crate::render::stamp::{Stamped, stamp};
use crate::render::table::{Form, PsfTable};
use crate::render::weights::{self, Weights};
use crate::render::whole::{TILE_PX, WholeImage};
use crate::render::{Backend, check_kernel, check_sampling};
use crate::render::{grid::LANES, plan_tables::PlanTables, profile::Profile, spline::Taps};
use base::fused::{mul_add, whole_bits};
use base::{image::Image, refused::Refused, region::Regions, vector_level};
use core::ops::Range;
use plan::exposure::{ExposurePlan, sampling::ANALYTIC_HALF_PX};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// The CPU backend.
#[derive(Debug)]
pub struct Cpu {
    arch: Arch,
    image: Image<f32>,
    tables: PlanTables,
    bands: Bands,
    whole: WholeImage,
    /// Polynomials of the latest Gaussian; `None` outside their domain.
    weights: Option<Weights>,
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
            weights: None,
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
        let Self { arch, image, tables, bands, whole, weights, regions } = self;
        let kernel_half = tables.kernels().first().map_or(0, |kernel| kernel.half_px[1]);
        let table_of = |list: usize| {
            let number = |n: usize| u32::try_from(n).unwrap_or(0);
            let of_psf = || (NO_KERNEL - number(tables.psf_of(plan, list)), false);
            tables.kernel_of(list).map_or_else(of_psf, |kernel| (number(kernel), true))
        };
        bands.sort(plan, regions, [plan.half_px, kernel_half], table_of);
        whole.draw(plan, tables, bands.whole());
        let width = image.width().max(1);
        let profile = Profile::new(plan.sampling, plan.psf.core_sigma_px());
        let is_gaussian = profile.is_exact() && tables.bases(plan).is_empty();
        set_weights(weights, is_gaussian.then(|| plan.psf.core_sigma_px()), plan.half_px);
        let draw = Draw {
            bands,
            whole,
            regions,
            kernels: tables.kernels(),
            bases: tables.bases(plan),
            half_px: plan.half_px as i32,
            profile,
            weights: weights.as_ref(),
            oversampling: tables.kernels().first().or(tables.bases(plan).first()).map_or(1, |table| table.oversampling),
            mask: core::array::from_fn(|lane| if lane <= 2 * plan.half_px { 1.0 } else { 0.0 }),
        };
        let (arch, draw) = (*arch, &draw);
        image.pixels_mut().par_chunks_mut(BAND_ROWS * width).enumerate().for_each(|(index, pixels)| {
            if !draw.regions.show_rows(&(index * BAND_ROWS..(index + 1) * BAND_ROWS)) {
                return;
            }
            let rows = (pixels.len() / width) as i32;
            let target = Band { pixels, width, first_row: (index * BAND_ROWS) as i32, rows };
            arch.dispatch(DrawBand { draw, target, index });
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

/// Makes the polynomials of a Gaussian where the latest ones are for another.
fn set_weights(weights: &mut Option<Weights>, sigma_px: Option<f64>, half_px: usize) {
    let made = weights.take();
    *weights = sigma_px.and_then(|sigma_px| {
        made.filter(|made| made.are_for(sigma_px, half_px)).or_else(|| Weights::new(sigma_px, half_px))
    });
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
    /// Polynomials instead of the profile, where the PSF is a Gaussian in their domain.
    weights: Option<&'a Weights>,
    /// 1 for lanes inside the footprint, else 0.
    mask: [f32; LANES],
}

/// One band's work, in the shape `pulp` compiles once per vector level.
struct DrawBand<'a> {
    draw: &'a Draw<'a>,
    target: Band<'a>,
    index: usize,
}

impl WithSimd for DrawBand<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if S::IS_SCALAR { self.draw::<S, false>(simd) } else { self.draw::<S, true>(simd) }
    }
}

impl DrawBand<'_> {
    #[inline(always)]
    fn draw<S: Simd, const FUSED: bool>(self, simd: S) {
        let Self { draw, mut target, index } = self;
        target.pixels.fill(0.0);
        let [mut from_psf, mut from_kernels] = draw.bands.once(target.first_row, target.rows);
        if let Some(weights) = draw.weights {
            for spot in from_psf.by_ref() {
                draw.gaussian::<S, FUSED>(simd, &mut target, weights, spot);
            }
        }
        let mut splats = Splats::NONE;
        while splats.take(&mut from_psf) {
            draw.block::<S, FUSED>(simd, &mut target, &splats);
        }
        while splats.take(&mut from_kernels) {
            draw.stamps::<FUSED>(&mut target, &splats);
        }
        for trail in draw.bands.trails(index) {
            draw.trail::<S, FUSED>(simd, &mut target, &mut splats, trail);
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
    /// Kernel of each star, as in [`Spot::kernel`](crate::render::spots::Spot).
    kernel: [u32; BLOCK],
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

    /// Replaces the splats by the next block of stars; returns false when none is left.
    #[inline(always)]
    fn take<'a>(&mut self, spots: &mut impl Iterator<Item = &'a Spot>) -> bool {
        self.count = 0;
        for (k, spot) in spots.take(BLOCK).enumerate() {
            self.column[k] = spot.column;
            self.row[k] = spot.row;
            [self.x[k], self.y[k]] = spot.fraction;
            self.electrons[k] = spot.electrons;
            self.kernel[k] = spot.kernel;
            self.count = k + 1;
        }
        self.count > 0
    }

    #[inline(always)]
    fn spot(&self, k: usize) -> Spot {
        Spot {
            column: self.column[k],
            row: self.row[k],
            fraction: [self.x[k], self.y[k]],
            electrons: self.electrons[k],
            kernel: self.kernel[k],
        }
    }
}

impl Draw<'_> {
    /// Returns the kernel or the PSF that a star is drawn from (see [`Spot::kernel`](crate::render::spots::Spot)).
    #[inline(always)]
    fn table(&self, number: u32) -> Option<&PsfTable> {
        self.kernels.get(number as usize).or_else(|| self.bases.get((NO_KERNEL - number) as usize))
    }

    /// Returns true when a star that reaches so far to all sides has a pixel in the regions.
    #[inline(always)]
    fn shows(&self, [column, row]: [i32; 2], half_px: [i64; 2]) -> bool {
        let [left, top] = [i64::from(column) - half_px[0], i64::from(row) - half_px[1]];
        self.regions.show(left, top, half_px.map(|half| 2 * half + 1))
    }

    /// Draws splats from the PSF.
    #[inline(always)]
    fn block<S: Simd, const FUSED: bool>(&self, simd: S, band: &mut Band<'_>, splats: &Splats) {
        if self.bases.is_empty() {
            self.splat::<S, FUSED>(simd, band, splats);
        } else {
            self.stamps::<FUSED>(band, splats);
        }
    }

    /// Draws a Gaussian star by polynomials.
    #[inline(always)]
    fn gaussian<S: Simd, const FUSED: bool>(&self, simd: S, band: &mut Band<'_>, weights: &Weights, spot: &Spot) {
        let used = 2 * self.half_px + 1;
        let (left, top) = (spot.column - self.half_px, spot.row - self.half_px - band.first_row);
        let rows = (-top).max(0)..used.min(band.rows - top);
        if rows.is_empty() || !self.shows([spot.column, spot.row], [i64::from(self.half_px); 2]) {
            return;
        }
        let [mut line, down] = weights.of::<S, FUSED>(simd, spot.fraction);
        let electrons = simd.splat_f32s(spot.electrons);
        for line in &mut line[..LANES / S::F32_LANES] {
            *line = simd.mul_f32s(electrons, *line);
        }
        let mut gains = [0.0_f32; LANES];
        lanes_mut::<S>(&mut gains).copy_from_slice(&down[..LANES / S::F32_LANES]);
        add_line::<S, FUSED>(simd, band, [left, top], rows, &line, &gains);
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
    fn trail<S: Simd, const FUSED: bool>(&self, simd: S, band: &mut Band<'_>, splats: &mut Splats, trail: &Trail) {
        let Some(nodes) = self.bands.nodes.get(trail.list as usize) else { return };
        let mut first = 0;
        while first < nodes.count {
            steps::<FUSED>(nodes, first, trail, splats);
            splats.count = (nodes.count - first).min(BLOCK);
            if let Some(weights) = self.weights {
                for k in 0..splats.count {
                    self.gaussian::<S, FUSED>(simd, band, weights, &splats.spot(k));
                }
            } else {
                splats.kernel = [trail.spot.kernel; BLOCK];
                self.block::<S, FUSED>(simd, band, splats);
            }
            first += BLOCK;
        }
    }

    /// Draws splats: all profiles in one vector loop, then row by row. Those of other bands cost their profile.
    #[inline(always)]
    fn splat<S: Simd, const FUSED: bool>(&self, simd: S, band: &mut Band<'_>, splats: &Splats) {
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
            if top >= band.rows || top + used as i32 <= 0 {
                continue;
            }
            if !self.shows([splats.column[k], splats.row[k]], [i64::from(self.half_px); 2]) {
                continue;
            }
            let at = k * stride;
            let (Some(across), Some(down)) = (across.get(at..at + LANES + 1), down.get(at..at + LANES + 1)) else {
                continue;
            };
            let mut values = [0.0_f32; LANES];
            let mut gains = [0.0_f32; LANES];
            for lane in 0..LANES {
                values[lane] = splats.electrons[k] * self.mask[lane] * (across[lane + 1] - across[lane]);
                gains[lane] = down[lane + 1] - down[lane];
            }
            let mut line = [simd.splat_f32s(0.0); LANES];
            line[..LANES / S::F32_LANES].copy_from_slice(lanes_mut::<S>(&mut values));
            let rows = (-top).max(0)..(used as i32).min(band.rows - top);
            add_line::<S, FUSED>(simd, band, [splats.column[k] - self.half_px, top], rows, &line, &gains);
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

/// Returns the vectors of so many lanes.
#[inline(always)]
fn lanes_mut<S: Simd>(lanes: &mut [f32; LANES]) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(lanes).0
}

/// Adds these rows of the product of a line and gains, from column `left` and row `top` of the band on.
#[inline(always)]
fn add_line<S: Simd, const FUSED: bool>(
    simd: S,
    band: &mut Band<'_>,
    [left, top]: [i32; 2],
    rows: Range<i32>,
    line: &[S::f32s; LANES],
    gains: &[f32; LANES],
) {
    let (width, from) = (band.width, (top + rows.start) as usize * band.width);
    let gains = &gains[rows.start as usize..rows.end as usize];
    let Some(pixels) = band.pixels.get_mut(from..) else { return };
    let Some(last) = width.checked_sub(LANES) else {
        add_narrow::<S, FUSED>(pixels, (width, left), line, gains);
        return;
    };
    let mut line = *line;
    let start = left.clamp(0, last as i32);
    if start != left {
        line = shifted::<S>(simd, &line, start - left);
    }
    let rows = pixels[start as usize..].chunks_mut(width).filter_map(|row| row.first_chunk_mut::<LANES>());
    for (row, gain) in rows.zip(gains) {
        let gain = simd.splat_f32s(*gain);
        for (pixels, line) in lanes_mut::<S>(row).iter_mut().zip(&line) {
            *pixels = weights::mul_add::<S, FUSED>(simd, gain, *line, *pixels);
        }
    }
}

/// Adds rows on an image that is narrower than a vector.
fn add_narrow<S: Simd, const FUSED: bool>(
    pixels: &mut [f32],
    (width, left): (usize, i32),
    line: &[S::f32s; LANES],
    gains: &[f32],
) {
    let mut values = [0.0_f32; LANES];
    lanes_mut::<S>(&mut values).copy_from_slice(&line[..LANES / S::F32_LANES]);
    for (row, gain) in pixels.chunks_mut(width).zip(gains) {
        add_clipped::<FUSED>(row, left, LANES, &values, *gain);
    }
}

/// Returns the values so many lanes further on, and 0 beyond their ends: what of a line lies on the image.
#[inline(always)]
fn shifted<S: Simd>(simd: S, line: &[S::f32s; LANES], by: i32) -> [S::f32s; LANES] {
    const MIDDLE: i32 = LANES as i32;
    let vectors = LANES / S::F32_LANES;
    let mut padded = [0.0_f32; 3 * LANES];
    S::as_mut_simd_f32s(&mut padded[LANES..2 * LANES]).0.copy_from_slice(&line[..vectors]);
    let from = (MIDDLE + by).clamp(0, 2 * MIDDLE) as usize;
    let mut shifted = [simd.splat_f32s(0.0); LANES];
    shifted[..vectors].copy_from_slice(S::as_simd_f32s(&padded[from..from + LANES]).0);
    shifted
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
    fn lines_are_clipped_at_both_ends() {
        let simd = pulp::Scalar::new();
        let line: [f32; LANES] = core::array::from_fn(|i| if i < 2 { 1.0 } else { 0.0 });
        for width in [20_u16, 12] {
            let mut pixels = vec![0.0_f32; 2 * usize::from(width)];
            let last = i32::from(width) - 1;
            for (top, left) in [(0, -2), (1, last), (0, 2), (-1, 5), (0, -40), (0, 400)] {
                let mut band = Band { pixels: &mut pixels, width: width.into(), first_row: 0, rows: 2 };
                let rows = (-top).max(0)..2.min(2 - top);
                add_line::<_, true>(simd, &mut band, [left, top], rows, &line, &[2.0; LANES]);
            }
            let mut wanted = vec![0.0_f32; 2 * usize::from(width)];
            for at in [2, 3, width + 2, width + 3, 2 * width - 1, 5, 6] {
                wanted[usize::from(at)] += 2.0;
            }
            assert_eq!(pixels, wanted, "{width} columns");
        }
    }

    #[test]
    fn whole_numbers_become_integers() {
        for whole in [-3.0_f32, 0.0, 7.0, 100_000.0, -100_000.0] {
            assert_eq!(f64::from(whole_i32(whole)), f64::from(whole));
        }
        assert!(whole_i32(f32::INFINITY) > 1_000_000 && whole_i32(-1e30) < -1_000_000);
    }
}
