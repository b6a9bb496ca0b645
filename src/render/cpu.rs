//! CPU backend: all cores, vectorised by the compiler for the processor it finds (AVX-512, AVX2 + FMA, NEON, SSE2).
//!
//! The image is cut into bands of rows; a band is cleared and drawn by one thread, its stars in source order, so a
//! repeated plan gives the same bits whatever the number of threads. Positions are integer + fraction. A Gaussian is
//! drawn analytically for every node (two vectors of erf, then one multiply-add per row); other PSFs and effective
//! PSFs come from tables. Error: f32, < 2e-7 of the peak (Gaussian), `TABLE_ERROR` (tables); `tests/physics`.

use crate::base::fused::mul_add;
use crate::base::image::Image;
use crate::exposure::features::FEATURES;
use crate::exposure::{ExposurePlan, Method, PlannedStar};
use crate::gpu::Electrons;
use crate::render::erf::erf;
use crate::render::plan_tables::PlanTables;
use crate::render::table::{LANES, PsfTable};
use crate::render::{Backend, RenderError, check_kernel};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// Rows of one band.
const BAND_ROWS: usize = 32;
/// Nodes drawn together.
const NODE_BLOCK: usize = 8;
/// Widest analytic footprint: its edges must fit the lanes.
const ANALYTIC_HALF_PX: usize = 7;

/// One star as the inner loops want it.
#[derive(Debug, Clone, Copy)]
struct BandStar {
    column: i32,
    row: i32,
    fraction: [f32; 2],
    electrons: f32,
    response: [[f32; FEATURES]; 2],
    /// Displacements stay within these rows of `row`.
    rows: (i32, i32),
}

/// The CPU backend.
#[derive(Debug)]
pub struct Cpu {
    arch: Arch,
    image: Image<f32>,
    stars: Vec<BandStar>,
    nodes: Vec<[f32; FEATURES + 1]>,
    tables: PlanTables,
    bands: Vec<Vec<u32>>,
}

impl Cpu {
    /// For a detector of this size.
    #[must_use]
    pub fn new(width_px: usize, height_px: usize) -> Self {
        Self {
            arch: Arch::new(),
            image: Image::new(width_px, height_px),
            stars: Vec::new(),
            nodes: Vec::new(),
            tables: PlanTables::new(ANALYTIC_HALF_PX),
            bands: vec![Vec::new(); height_px.div_ceil(BAND_ROWS)],
        }
    }

    /// Stars and nodes in single precision, and which band sees which star.
    fn prepare_stars(&mut self, plan: &ExposurePlan, half_px: usize) {
        let shared = matches!(plan.chosen.method, Method::EffectivePsf { .. } | Method::Static);
        self.nodes.clear();
        if shared {
            self.nodes.push([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        } else {
            self.nodes.extend(plan.nodes.iter().map(|node| {
                let [a, b, c, d, e, f] = node.phi.map(|v| v as f32);
                [node.weight as f32, a, b, c, d, e, f]
            }));
        }
        let extent = feature_extent(&self.nodes);
        self.stars.clear();
        self.stars.extend(plan.stars.iter().map(|star| band_star(star, shared, &extent)));
        let height = self.image.height();
        for band in &mut self.bands {
            band.clear();
        }
        let half = half_px.cast_signed() as i64;
        for (i, star) in self.stars.iter().enumerate() {
            let first = (i64::from(star.row + star.rows.0) - half).max(0);
            let last = (i64::from(star.row + star.rows.1) + half).min(height as i64 - 1);
            if first > last {
                continue;
            }
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image's rows")]
            for band in first as usize / BAND_ROWS..=last as usize / BAND_ROWS {
                self.bands[band].push(i as u32);
            }
        }
    }
}

impl Backend for Cpu {
    fn name(&self) -> &'static str {
        "cpu"
    }

    fn description(&self) -> String {
        let simd = format!("{:?}", self.arch);
        let simd = simd.split(['(', ' ', '{']).next().unwrap_or_default();
        format!("{} threads, vector level {simd}", rayon::current_num_threads())
    }

    fn render(&mut self, plan: &ExposurePlan) -> Result<(), RenderError> {
        check_kernel(plan)?;
        self.tables.prepare(plan);
        let half_px = self.tables.of(plan).map_or(plan.half_px, |table| table.half_px);
        self.prepare_stars(plan, half_px);
        let table = self.tables.of(plan);
        let width = self.image.width().max(1);
        let (arch, stars, nodes, bands) = (self.arch, &self.stars, &self.nodes, &self.bands);
        let sigma_px = plan.psf.core_sigma_px() as f32;
        let mask = core::array::from_fn(|lane| if lane <= 2 * half_px { 1.0 } else { 0.0 });
        self.image.pixels_mut().par_chunks_mut(BAND_ROWS * width).zip(bands).enumerate().for_each(
            |(band, (pixels, members))| {
                let target = Band { pixels, width, first_row: (band * BAND_ROWS) as i32 };
                let draw = Draw { stars, members, nodes, half_px: half_px as i32, sigma_px, mask };
                let fused = !matches!(arch, Arch::Scalar);
                arch.dispatch(DrawBand { draw, target, table, fused });
            },
        );
        Ok(())
    }

    fn electrons(&self) -> Electrons<'_> {
        Electrons::Host(&self.image)
    }
}

/// Smallest and largest value of every feature over the nodes.
fn feature_extent(nodes: &[[f32; FEATURES + 1]]) -> [(f32, f32); FEATURES] {
    core::array::from_fn(|i| {
        nodes.iter().fold((f32::MAX, f32::MIN), |(low, high), node| (low.min(node[i + 1]), high.max(node[i + 1])))
    })
}

#[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors of the origin")]
fn band_star(star: &PlannedStar, shared: bool, extent: &[(f32, f32); FEATURES]) -> BandStar {
    let px = if shared { star.mean_px } else { star.track.mid_px };
    let response = star.track.response.map(|row| row.map(|v| v as f32));
    let (mut low, mut high) = (0.0_f32, 0.0_f32);
    for (r, (min, max)) in response[1].iter().zip(extent) {
        let (a, b) = (r * min, r * max);
        low += a.min(b);
        high += a.max(b);
    }
    let (column, row) = ((px[0] + 0.5).floor(), (px[1] + 0.5).floor());
    BandStar {
        column: column as i32,
        row: row as i32,
        fraction: [(px[0] - column) as f32, (px[1] - row) as f32],
        electrons: star.electrons as f32,
        response,
        rows: ((low - 1.0).floor() as i32, (high + 1.0).ceil() as i32),
    }
}

/// Rows of the image that one thread draws.
struct Band<'a> {
    pixels: &'a mut [f32],
    width: usize,
    first_row: i32,
}

impl Band<'_> {
    /// Rows in the band.
    #[inline(always)]
    fn rows(&self) -> i32 {
        (self.pixels.len() / self.width) as i32
    }

    /// The row at image height `row`, or `None` outside the band.
    #[inline(always)]
    fn row(&mut self, row: i32) -> Option<&mut [f32]> {
        let y = usize::try_from(row - self.first_row).ok()?;
        self.pixels.get_mut(y * self.width..(y + 1) * self.width)
    }
}

/// What is drawn into a band.
struct Draw<'a> {
    stars: &'a [BandStar],
    members: &'a [u32],
    nodes: &'a [[f32; FEATURES + 1]],
    half_px: i32,
    sigma_px: f32,
    /// 1 for lanes inside the footprint, else 0.
    mask: [f32; LANES],
}

/// One band's work, in the shape `pulp` compiles once per vector level.
struct DrawBand<'a> {
    draw: Draw<'a>,
    target: Band<'a>,
    table: Option<&'a PsfTable>,
    fused: bool,
}

impl NullaryFnOnce for DrawBand<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        match (self.table, self.fused) {
            (None, true) => self.draw.analytic::<true>(self.target),
            (None, false) => self.draw.analytic::<false>(self.target),
            (Some(table), true) => self.draw.tabulated::<true>(self.target, table),
            (Some(table), false) => self.draw.tabulated::<false>(self.target, table),
        }
    }
}

impl Draw<'_> {
    /// Gaussian stars, every node by its own error functions.
    #[inline(always)]
    fn analytic<const FUSED: bool>(&self, mut band: Band<'_>) {
        band.pixels.fill(0.0);
        let scale = core::f32::consts::FRAC_1_SQRT_2 / self.sigma_px;
        for &member in self.members {
            let star = &self.stars[member as usize];
            for block in self.nodes.chunks(NODE_BLOCK) {
                self.analytic_block::<FUSED>(&mut band, star, block, scale);
            }
        }
    }

    #[inline(always)]
    fn analytic_block<const FUSED: bool>(
        &self,
        band: &mut Band<'_>,
        star: &BandStar,
        block: &[[f32; FEATURES + 1]],
        scale: f32,
    ) {
        let mut origin = [[0_i32; 2]; NODE_BLOCK];
        // One row of edges per node; the last lane of a node reads the first of the next, and is masked.
        let mut edges = [[0.0_f32; NODE_BLOCK * LANES + LANES]; 2];
        let half = self.half_px as f32 + 0.5;
        for (k, node) in block.iter().enumerate() {
            let (pixel, fractions) = node_place::<FUSED>(star, node);
            origin[k] = pixel;
            for (edges, fraction) in edges.iter_mut().zip(fractions) {
                let start = -(half + fraction);
                for lane in 0..LANES {
                    edges[k * LANES + lane] = (start + lane as f32) * scale;
                }
            }
        }
        for edges in &mut edges {
            for value in &mut edges[..block.len() * LANES] {
                *value = erf::<FUSED>(*value);
            }
        }
        for (k, node) in block.iter().enumerate() {
            let gain = 0.25 * star.electrons * node[0];
            let [across, down] = &edges;
            let (across, down) = (&across[k * LANES..k * LANES + LANES + 1], &down[k * LANES..k * LANES + LANES]);
            let mut stamp = [0.0_f32; LANES];
            for lane in 0..LANES {
                stamp[lane] = gain * self.mask[lane] * (across[lane + 1] - across[lane]);
            }
            self.add_separable::<FUSED>(band, origin[k], &stamp, down);
        }
    }

    /// Adds the outer product of a row and the differences of `down` around `origin`.
    #[inline(always)]
    fn add_separable<const FUSED: bool>(
        &self,
        band: &mut Band<'_>,
        origin: [i32; 2],
        across: &[f32; LANES],
        down: &[f32],
    ) {
        let used = 2 * self.half_px + 1;
        let top = origin[1] - self.half_px - band.first_row;
        let left = origin[0] - self.half_px;
        let (first, end) = ((-top).max(0), used.min(band.rows() - top));
        for r in first..end {
            let gain = down[r as usize + 1] - down[r as usize];
            let at = (top + r) as usize * band.width;
            add_lanes::<FUSED>(&mut band.pixels[at..at + band.width], left, used as usize, across, gain);
        }
    }

    /// Stars from a table of the PSF, or of the PSF convolved with the path.
    #[inline(always)]
    fn tabulated<const FUSED: bool>(&self, mut band: Band<'_>, table: &PsfTable) {
        band.pixels.fill(0.0);
        let rows = table.rows();
        for &member in self.members {
            let star = &self.stars[member as usize];
            for node in self.nodes {
                let ([column, row], fractions) = node_place::<FUSED>(star, node);
                let taps = StarTaps::new(table, fractions, star.electrons * node[0]);
                for r in 0..rows {
                    let Some(line) = band.row(row - self.half_px + r as i32) else { continue };
                    let mut done = 0;
                    while done < rows {
                        let values = taps.chunk::<FUSED>(table, r, done);
                        let first = column - self.half_px + done as i32;
                        add_lanes::<FUSED>(line, first, (rows - done).min(LANES), &values, 1.0);
                        done += LANES;
                    }
                }
            }
        }
    }
}

/// Integer pixel and fraction of a star at one node.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "the planner keeps displacements within a few detectors")]
fn node_place<const FUSED: bool>(star: &BandStar, node: &[f32; FEATURES + 1]) -> ([i32; 2], [f32; 2]) {
    let [mut x, mut y] = star.fraction;
    for i in 0..FEATURES {
        x = mul_add::<FUSED>(star.response[0][i], node[i + 1], x);
        y = mul_add::<FUSED>(star.response[1][i], node[i + 1], y);
    }
    let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
    ([star.column + column as i32, star.row + row as i32], [x - column, y - row])
}

/// `line[first + i] += gain * values[i]` for the used lanes that lie on the line.
#[inline(always)]
fn add_lanes<const FUSED: bool>(line: &mut [f32], first: i32, used: usize, values: &[f32; LANES], gain: f32) {
    if let Ok(first) = usize::try_from(first)
        && let Some(target) = line.get_mut(first..first + LANES)
    {
        // Lanes beyond the footprint hold zeros.
        for (pixel, value) in target.iter_mut().zip(values) {
            *pixel = mul_add::<FUSED>(gain, *value, *pixel);
        }
        return;
    }
    for (i, value) in values.iter().take(used).enumerate() {
        if let Some(pixel) = usize::try_from(first + i as i32).ok().and_then(|x| line.get_mut(x)) {
            *pixel = mul_add::<FUSED>(gain, *value, *pixel);
        }
    }
}

/// The 16 table images a star is made of, and their weights.
struct StarTaps {
    first: [usize; 4],
    weights: [[f32; 4]; 4],
}

impl StarTaps {
    #[inline(always)]
    fn new(table: &PsfTable, fractions: [f32; 2], electrons: f32) -> Self {
        let ((px, wx), (py, wy)) = (table.taps(fractions[0]), table.taps(fractions[1]));
        let (phases, len) = (table.phases(), table.image_len());
        Self {
            first: core::array::from_fn(|m| ((py + m) * phases + px) * len),
            weights: wy.map(|wy| wx.map(|wx| electrons * wy * wx)),
        }
    }

    /// Sixteen columns from `column` of row `row`.
    #[inline(always)]
    fn chunk<const FUSED: bool>(&self, table: &PsfTable, row: usize, column: usize) -> [f32; LANES] {
        let mut sum = [0.0_f32; LANES];
        for (first, weights) in self.first.iter().zip(&self.weights) {
            for (n, weight) in weights.iter().enumerate() {
                let at = first + n * table.image_len() + row * table.stride + column;
                if let Some(values) = table.data.get(at..at + LANES) {
                    for (sum, value) in sum.iter_mut().zip(values) {
                        *sum = mul_add::<FUSED>(*weight, *value, *sum);
                    }
                }
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_clipped_at_both_ends() {
        let values: [f32; LANES] = core::array::from_fn(|i| if i < 3 { 1.0 } else { 0.0 });
        let mut line = [0.0_f32; 20];
        for first in [-2, 19, 5, -40, 400] {
            add_lanes::<true>(&mut line, first, 3, &values, 2.0);
        }
        let mut wanted = [0.0_f32; 20];
        for x in [0, 5, 6, 7, 19] {
            wanted[x] = 2.0;
        }
        assert_eq!(line, wanted);
    }
}
