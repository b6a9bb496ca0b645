//! CPU backend: all cores, vectorised by the compiler for the processor it finds (AVX-512, AVX2 + FMA, NEON, SSE2).
//!
//! The image is cut into bands of rows; a band is cleared and drawn by one thread, its stars in source order, so a
//! repeated plan gives the same bits whatever the number of threads. A Gaussian is drawn analytically for every node
//! (two vectors of erf, then one multiply-add per row); other PSFs and effective PSFs come from tables. Error: f32,
//! < 2e-7 of the peak (Gaussian), `TABLE_ERROR` (tables); `tests/physics`.

use crate::base::fused::mul_add;
use crate::base::image::Image;
use crate::exposure::ExposurePlan;
use crate::gpu::Electrons;
use crate::render::bands::{BAND_ROWS, Bands, Members, NO_KERNEL, NODE_LANES, NodeColumns, Spot, Trail};
use crate::render::plan_tables::PlanTables;
use crate::render::profile::Profile;
use crate::render::table::{LANES, PAD, PsfTable};
use crate::render::{Backend, RenderError, check_kernel, check_sampling};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

/// Splats drawn together.
const BLOCK: usize = 8;
/// Widest analytic footprint: its edges must fit the lanes.
const ANALYTIC_HALF_PX: usize = 7;

/// The CPU backend.
#[derive(Debug)]
pub struct Cpu {
    arch: Arch,
    image: Image<f32>,
    tables: PlanTables,
    bands: Bands,
}

impl Cpu {
    /// For a detector of this size.
    #[must_use]
    pub fn new(width_px: usize, height_px: usize) -> Self {
        Self {
            arch: Arch::new(),
            image: Image::new(width_px, height_px),
            tables: PlanTables::new(ANALYTIC_HALF_PX),
            bands: Bands::new(height_px),
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
        check_sampling(plan, self.tables.is_analytic(plan))?;
        self.tables.prepare(plan);
        let Self { arch, image, tables, bands } = self;
        let kernel_half = tables.kernels().first().map_or(0, |kernel| kernel.half_px[1]);
        let half_px = |list: usize| if tables.kernel_of(list).is_some() { kernel_half } else { plan.half_px };
        bands.sort(plan, half_px, |list| tables.kernel_of(list));
        let width = image.width().max(1);
        let draw = Draw {
            bands,
            kernels: tables.kernels(),
            base: tables.base(plan),
            half_px: plan.half_px as i32,
            profile: Profile::new(plan.sampling, plan.psf.core_sigma_px()),
            mask: core::array::from_fn(|lane| if lane <= 2 * plan.half_px { 1.0 } else { 0.0 }),
        };
        let (arch, draw) = (*arch, &draw);
        image.pixels_mut().par_chunks_mut(BAND_ROWS * width).enumerate().for_each(|(index, pixels)| {
            let target = Band { pixels, width, first_row: (index * BAND_ROWS) as i32 };
            let fused = !matches!(arch, Arch::Scalar);
            arch.dispatch(DrawBand { draw, target, index, fused });
        });
        Ok(())
    }

    fn electrons(&self) -> Electrons<'_> {
        Electrons::Host(&self.image)
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
}

/// What is drawn into the bands.
struct Draw<'a> {
    bands: &'a Bands,
    kernels: &'a [PsfTable],
    base: Option<&'a PsfTable>,
    half_px: i32,
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
        let Self { draw, mut target, index, fused } = self;
        target.pixels.fill(0.0);
        for members in draw.bands.members(index) {
            if fused {
                draw.members::<true>(&mut target, members);
            } else {
                draw.members::<false>(&mut target, members);
            }
        }
    }
}

/// Splats waiting to be drawn: pixel, fraction and light.
struct Splats {
    count: usize,
    origin: [[i32; 2]; BLOCK],
    fraction: [[f32; 2]; BLOCK],
    electrons: [f32; BLOCK],
}

impl Splats {
    const NONE: Self = Self { count: 0, origin: [[0; 2]; BLOCK], fraction: [[0.0; 2]; BLOCK], electrons: [0.0; BLOCK] };
}

/// Displacements of one star at a block of nodes, px.
struct Steps {
    weight: [f32; NODE_LANES],
    x: [f32; NODE_LANES],
    y: [f32; NODE_LANES],
}

impl Draw<'_> {
    #[inline(always)]
    fn members<const FUSED: bool>(&self, band: &mut Band<'_>, members: &Members) {
        let mut splats = Splats::NONE;
        for spot in &members.spots {
            self.spot::<FUSED>(band, &mut splats, spot);
        }
        for trail in &members.trails {
            self.trail::<FUSED>(band, &mut splats, trail);
        }
        self.flush::<FUSED>(band, &mut splats);
    }

    #[inline(always)]
    fn spot<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &mut Splats, spot: &Spot) {
        let table = if spot.kernel == NO_KERNEL { self.base } else { self.kernels.get(spot.kernel as usize) };
        let origin = [spot.column, spot.row];
        match table {
            Some(table) => stamp::<FUSED>(band, table, origin, spot.fraction, spot.electrons),
            None => self.push::<FUSED>(band, splats, origin, spot.fraction, spot.electrons),
        }
    }

    /// A star at every node of its list.
    #[inline(always)]
    fn trail<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &mut Splats, trail: &Trail) {
        let Some(nodes) = self.bands.nodes.get(trail.list as usize) else { return };
        let mut first = 0;
        while first < nodes.count {
            let steps = steps::<FUSED>(nodes, first, trail);
            for k in 0..(nodes.count - first).min(NODE_LANES) {
                let (x, y) = (trail.spot.fraction[0] + steps.x[k], trail.spot.fraction[1] + steps.y[k]);
                let (column, row) = ((x + 0.5).floor(), (y + 0.5).floor());
                #[allow(clippy::cast_possible_truncation, reason = "the planner keeps displacements on the detector")]
                let origin = [trail.spot.column + column as i32, trail.spot.row + row as i32];
                let electrons = trail.spot.electrons * steps.weight[k];
                match self.base {
                    Some(table) => stamp::<FUSED>(band, table, origin, [x - column, y - row], electrons),
                    None => self.push::<FUSED>(band, splats, origin, [x - column, y - row], electrons),
                }
            }
            first += NODE_LANES;
        }
    }

    #[inline(always)]
    fn push<const FUSED: bool>(
        &self,
        band: &mut Band<'_>,
        splats: &mut Splats,
        origin: [i32; 2],
        fraction: [f32; 2],
        electrons: f32,
    ) {
        // Nodes that leave no light in this band are another band's.
        let top = origin[1] - self.half_px - band.first_row;
        if top >= band.rows() || top + 2 * self.half_px < 0 {
            return;
        }
        let k = splats.count;
        splats.origin[k] = origin;
        splats.fraction[k] = fraction;
        splats.electrons[k] = electrons;
        splats.count += 1;
        if splats.count == BLOCK {
            self.flush::<FUSED>(band, splats);
        }
    }

    /// Draws the waiting splats: all profiles in one vector loop, then row by row.
    #[inline(always)]
    fn flush<const FUSED: bool>(&self, band: &mut Band<'_>, splats: &mut Splats) {
        let count = core::mem::take(&mut splats.count);
        let used = (2 * self.half_px + 1) as usize;
        // Edges of neighbours follow one another; the last may be read a vector past its own.
        let stride = used + 1;
        let mut values = [[0.0_f32; BLOCK * LANES + 2 * LANES]; 2];
        let half = self.half_px as f32 + 0.5;
        for k in 0..count {
            for (values, fraction) in values.iter_mut().zip(splats.fraction[k]) {
                let start = -(half + fraction);
                for lane in 0..LANES {
                    values[k * stride + lane] = start + lane as f32;
                }
            }
        }
        for values in &mut values {
            self.profile.apply::<FUSED>(&mut values[..(count * stride).next_multiple_of(LANES)]);
        }
        let [across, down] = &values;
        for k in 0..count {
            let at = k * stride;
            let across = &across[at..at + LANES + 1];
            let mut line = [0.0_f32; LANES];
            for lane in 0..LANES {
                line[lane] = splats.electrons[k] * self.mask[lane] * (across[lane + 1] - across[lane]);
            }
            self.add_separable::<FUSED>(band, splats.origin[k], &line, &down[at..at + used + 1]);
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
}

/// Displacements of a star at the nodes from `first` (see [`crate::exposure::track`]).
#[inline(always)]
fn steps<const FUSED: bool>(nodes: &NodeColumns, first: usize, trail: &Trail) -> Steps {
    let pose: [&[f32; NODE_LANES]; 13] = core::array::from_fn(|k| nodes.lanes(k + 1, first));
    let ([u, v], [rx, ry]) = (trail.tangent, trail.from_principal_px);
    let [[xu, xv], [yu, yv]] = trail.px_per_tangent;
    let mut steps = Steps { weight: *nodes.lanes(0, first), x: [0.0; NODE_LANES], y: [0.0; NODE_LANES] };
    for k in 0..NODE_LANES {
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
        steps.x[k] = x + mul_add::<FUSED>(less, ax, mul_add::<FUSED>(-sin, ay, pose[11][k]));
        steps.y[k] = y + mul_add::<FUSED>(sin, ax, mul_add::<FUSED>(less, ay, pose[12][k]));
    }
    steps
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

/// A star from a table: the weighted sum of sixteen of its images.
#[inline(always)]
fn stamp<const FUSED: bool>(
    band: &mut Band<'_>,
    table: &PsfTable,
    origin: [i32; 2],
    fraction: [f32; 2],
    electrons: f32,
) {
    let taps = StarTaps::new(table, fraction, electrons);
    let [columns, rows] = table.size_px();
    let [left, top] = [
        origin[0] - table.half_px[0].cast_signed() as i32,
        origin[1] - table.half_px[1].cast_signed() as i32 - band.first_row,
    ];
    let (first, end) = ((-top).max(0), (rows as i32).min(band.rows() - top));
    for r in first..end {
        let at = (top + r) as usize * band.width;
        let line = &mut band.pixels[at..at + band.width];
        let mut done = 0;
        while done < columns {
            let values = taps.chunk::<FUSED>(table, r as usize, done);
            add_lanes::<FUSED>(line, left + done as i32, (columns - done).min(LANES), &values, 1.0);
            done += LANES;
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

    /// Sixteen columns from `column` of row `row`; those beyond the row's padding are 0.
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
        if column + LANES > table.stride {
            // Half a vector: the rest is the next row.
            sum[PAD..].fill(0.0);
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
