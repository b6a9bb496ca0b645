//! GPU backend: wgpu compute, the same methods and coefficients as the CPU backend.
//!
//! Plan -> electrons per pixel in fixed point on the device ([`crate::gpu::DeviceElectrons`]). Three passes:
//!
//! * `splat`: Gaussian PSFs, analytically. One invocation per star and block of 16 x 8 pixels of the star's box; it
//!   sums its nodes in registers and adds the block to the image once.
//! * `table`: tabulated and effective PSFs, from the tables of [`crate::render::table`]. One
//!   invocation per star and block of 8 x 1 pixels, 16 taps per pixel and node.
//!
//! * `whole`: whole stars, which the host draws in double precision (`crate::render::whole`), added last.
//!
//! A field of more stars than [`Gpu::limit_block`] allows comes in blocks, one after another into the same image.
//! Additions are integer, so they commute: a repeated plan gives the same bits. The scale is chosen per frame so that
//! no pixel can wrap ([`crate::render::gpu::scale`]). Error against the CPU backend: f32 rounding, 5e-7 of the peak;
//! half a unit (3e-5 e-) per star and pixel. `tests/gpu` holds all of this.

pub mod brighter;
mod chunks;
pub mod scale;
mod stars;
mod whole;

use crate::gpu::buffers::{GrowableBuffer, ReadbackRing, TableTexture};
use crate::gpu::shader::{ComputePass, MOST_WORKGROUPS, WORKGROUP};
use crate::gpu::{DeviceElectrons, Electrons, GpuDevice, GpuError, shader};
use crate::render::profile::{ERF_CLAMP, ERF_P, ERF_Q};
use crate::render::table::{Form, PsfTable};
use crate::render::{Backend, check_kernel, check_sampling};
use crate::{render::plan_tables::PlanTables, render::whole::WholeImage};
use base::{image::Image, refused::Refused};
use bytemuck::{Pod, Zeroable};
use chunks::Chunks;
use core::ops::Range;
use plan::exposure::ExposurePlan;
use stars::{NodeRecord, Source, SpotRecord, TrackRecord, fill_nodes};
use std::sync::Arc;
use whole::WholePass;

/// Widest footprint that is drawn analytically; wider Gaussians come from a table, whose cost per pixel is lower.
const ANALYTIC_HALF_PX: usize = 15;
/// Stars on the device at a time; those beyond follow in further blocks: 64 MiB of tracks, which every device takes.
const MOST_STARS_A_BLOCK: usize = 1 << 20;
/// Nodes one invocation takes: enough work to hide its set-up, and long paths spread over the device.
const NODES_PER_SLICE: usize = 128;
/// Number of additions to one pixel that the fixed point can hold without overflow.
const MOST_ADDITIONS: usize = 1 << 28;
/// Workgroups along y at most: a box with more blocks is walked through in strides.
const MOST_BLOCK_GROUPS: usize = 4096;

/// `Frame` of `place.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct FrameParams {
    size: [i32; 2],
    analytic: u32,
    stars: u32,
    nodes_per_slice: u32,
    scale: f32,
    edge_scale: f32,
    oversampling: i32,
    first_track: u32,
    padding: u32,
}

/// Device buffers and their bind groups.
#[derive(Debug)]
struct Resources {
    params: GrowableBuffer,
    spots: GrowableBuffer,
    tracks: GrowableBuffer,
    nodes: GrowableBuffer,
    table: TableTexture,
    texels: Vec<[f32; 4]>,
    splat: ComputePass,
    tabulated: ComputePass,
    groups: Option<[wgpu::BindGroup; 2]>,
}

/// The GPU backend.
#[derive(Debug)]
pub struct Gpu {
    gpu: Arc<GpuDevice>,
    resources: Resources,
    image: DeviceElectrons,
    readback: Option<ReadbackRing>,
    stars: Chunks,
    stars_a_block: usize,
    nodes: Vec<NodeRecord>,
    tables: PlanTables,
    whole: WholeImage,
    whole_pass: WholePass,
    /// The first layers of the texture hold the PSF's own tables.
    bases_are_loaded: bool,
}

impl Gpu {
    /// Builds a renderer for a detector of this size.
    ///
    /// # Errors
    /// When the device refuses the shaders or an image of this size.
    pub fn new(gpu: Arc<GpuDevice>, width_px: usize, height_px: usize) -> Result<Self, Refused> {
        Ok(Self {
            resources: Resources::new(&gpu)?,
            image: DeviceElectrons::new(&gpu, width_px, height_px)?,
            readback: None,
            stars: Chunks::new([width_px, height_px]),
            stars_a_block: MOST_STARS_A_BLOCK,
            nodes: Vec::new(),
            tables: PlanTables::new(ANALYTIC_HALF_PX, Form::Images),
            whole: WholeImage::new([width_px, height_px]),
            whole_pass: WholePass::new(&gpu)?,
            bases_are_loaded: false,
            gpu,
        })
    }

    /// Limits the stars that are on the device at a time, to one at least; the image does not change.
    pub fn limit_block(&mut self, stars: usize) {
        self.stars_a_block = stars.clamp(1, MOST_STARS_A_BLOCK);
    }

    /// Returns the device, to share with a detector.
    pub fn device(&self) -> &Arc<GpuDevice> {
        &self.gpu
    }

    /// Returns the latest image, still on the device.
    pub fn device_electrons(&self) -> &DeviceElectrons {
        &self.image
    }

    /// Waits for the latest image and copies it to the host.
    ///
    /// # Errors
    /// When the device failed or `out` has another size.
    pub fn read_electrons(&mut self, out: &mut Image<f32>) -> Result<(), Refused> {
        let ring = readback(&mut self.readback, &self.gpu, &self.image)?;
        Ok(self.image.read(&self.gpu, ring, out)?)
    }

    /// Returns the same for an image that others made on the device.
    ///
    /// # Errors
    /// When the device failed or `out` has another size.
    pub fn read_image(&mut self, image: &DeviceElectrons, out: &mut Image<f32>) -> Result<(), Refused> {
        let ring = readback(&mut self.readback, &self.gpu, image)?;
        Ok(image.read(&self.gpu, ring, out)?)
    }

    /// Builds the tables this plan needs and brings them to the device, where they are not there yet: the PSF's own in
    /// the first layers, kernels in the others.
    fn prepare_tables(&mut self, plan: &ExposurePlan) -> Result<(), GpuError> {
        let prepared = self.tables.prepare(plan);
        let Self { gpu, resources, tables, bases_are_loaded, .. } = self;
        let bases = tables.bases(plan);
        let all = bases.iter().chain(tables.kernels());
        let size = all.fold([0, 0], |[width, height]: [usize; 2], table| {
            let [columns, rows] = texels_of(table);
            [width.max(columns), height.max(rows)]
        });
        if size == [0, 0] {
            return Ok(());
        }
        if resources.table.reserve(gpu, size, first_kernel(plan) + tables.kernels().len())? {
            resources.groups = None;
            *bases_are_loaded = false;
        }
        if !bases.is_empty() && (prepared.base_rebuilt || !*bases_are_loaded) {
            for (layer, table) in (0..).zip(bases) {
                resources.load_table(gpu, layer, table);
            }
            *bases_are_loaded = true;
        }
        for (layer, table) in (first_kernel(plan)..).zip(tables.kernels()) {
            resources.load_table(gpu, u32::try_from(layer).unwrap_or(u32::MAX), table);
        }
        gpu.check()
    }

    /// Returns the number of nodes that one invocation takes.
    fn nodes_per_slice(&self) -> usize {
        let most_slices = (MOST_ADDITIONS / self.stars.len().max(1)).clamp(1, MOST_WORKGROUPS as usize);
        self.stars.most_nodes().div_ceil(most_slices).max(NODES_PER_SLICE)
    }

    /// Prepares the stars of a plan whose tables are prepared.
    fn fill_stars(&mut self, plan: &ExposurePlan) {
        let (tables, bases) = (&self.tables, self.tables.bases(plan));
        let source = |list: usize| match tables.kernel_of(list).and_then(|i| tables.kernels().get(i).map(|k| (i, k))) {
            Some((i, kernel)) => Source { layer: u32::try_from(first_kernel(plan) + i).ok(), half_px: kernel.half_px },
            None => {
                let layer = (!bases.is_empty()).then(|| u32::try_from(tables.psf_of(plan, list)).unwrap_or(0));
                Source { layer, half_px: [plan.half_px; 2] }
            }
        };
        let own = if bases.is_empty() { plan.psf.peak() } else { 0.0 };
        let peak = bases.iter().chain(tables.kernels()).map(largest_coefficient).fold(own, f64::max);
        self.stars.fill(plan, source, peak);
        self.whole.draw(plan, tables, self.stars.whole());
        WholePass::add_bounds(&self.whole, self.stars.bounds_mut());
    }

    #[allow(clippy::cast_possible_truncation, reason = "a block has fewer than 2^32 stars")]
    fn submit(&mut self, plan: &ExposurePlan) -> Result<(), GpuError> {
        self.prepare_tables(plan)?;
        fill_nodes(plan, &mut self.nodes);
        self.fill_stars(plan);
        let nodes_per_slice = self.nodes_per_slice();
        let slices = self.stars.most_nodes().div_ceil(nodes_per_slice);
        let scale = self.stars.scale(slices);
        let params = self.params(plan, nodes_per_slice, scale);
        let slices = u32::try_from(slices).unwrap_or(MOST_WORKGROUPS);
        let mut encoder = self.gpu.encoder("draw");
        self.image.clear(&mut encoder, scale);
        self.resources.write_nodes(&self.gpu, &self.nodes)?;
        let mut first = 0;
        loop {
            let end = self.stars.len().min(first + self.stars_a_block);
            let analytic = self.stars.analytic().clamp(first, end) - first;
            let first_track = self.stars.tracks_before(first);
            let params = FrameParams { stars: (end - first) as u32, analytic: analytic as u32, first_track, ..params };
            self.record_block(first..end, &params, slices, &mut encoder)?;
            let is_last = end == self.stars.len();
            if is_last {
                let image = &self.image;
                let sums = (image.buffer(), [image.width(), image.height()], scale);
                self.whole_pass.record(&self.gpu, &self.whole, sums, &mut encoder)?;
            }
            self.gpu.submit(encoder)?;
            if is_last {
                return Ok(());
            }
            first = end;
            encoder = self.gpu.encoder("draw on");
        }
    }

    /// Writes some of the stars to the device and records the passes that draw them.
    fn record_block(
        &mut self,
        stars: Range<usize>,
        params: &FrameParams,
        slices: u32,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        let Self { gpu, resources, image, stars: all, .. } = self;
        resources.params.write(gpu, core::slice::from_ref(params))?;
        if all.write(gpu, stars, [&mut resources.spots, &mut resources.tracks])? {
            resources.groups = None;
        }
        let [splat, tabulated] = all.most_blocks();
        let splat = workgroups(params.analytic, splat);
        let tabulated = workgroups(params.stars - params.analytic, tabulated);
        let [splat_group, table_group] = resources.bind(gpu, image.buffer());
        for (pass, group, [x, y]) in
            [(&resources.splat, splat_group, splat), (&resources.tabulated, table_group, tabulated)]
        {
            if x > 0 && y > 0 {
                pass.record(encoder, &group, [x, y, slices]);
            }
        }
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, reason = "the device's buffer limits bound counts and sizes")]
    /// Returns the parameters that all blocks of stars have in common.
    fn params(&self, plan: &ExposurePlan, nodes_per_slice: usize, scale: f32) -> FrameParams {
        let table = self.tables.bases(plan).first().or_else(|| self.tables.kernels().first());
        FrameParams {
            size: [self.image.width() as i32, self.image.height() as i32],
            analytic: 0,
            stars: 0,
            nodes_per_slice: nodes_per_slice as u32,
            scale,
            edge_scale: core::f32::consts::FRAC_1_SQRT_2 / plan.psf.core_sigma_px() as f32,
            oversampling: table.map_or(0, |table| table.oversampling as i32),
            first_track: 0,
            padding: 0,
        }
    }
}

/// Returns the layer of the first kernel: after the PSF's own tables.
fn first_kernel(plan: &ExposurePlan) -> usize {
    plan.psf.nodes().len()
}

/// Returns the ring for images of this size, made when it is first wanted.
fn readback<'a>(
    ring: &'a mut Option<ReadbackRing>,
    gpu: &GpuDevice,
    image: &DeviceElectrons,
) -> Result<&'a mut ReadbackRing, GpuError> {
    match ring {
        Some(ring) => Ok(ring),
        none => Ok(none.insert(ReadbackRing::new(gpu, 1, image.buffer().size())?)),
    }
}

/// Returns workgroups along x (stars) and y (blocks of the largest box).
#[allow(clippy::cast_possible_truncation, reason = "clamped first")]
fn workgroups(stars: u32, most_blocks: usize) -> [u32; 2] {
    [stars.div_ceil(WORKGROUP), most_blocks.min(MOST_BLOCK_GROUPS) as u32]
}

/// Texels along x and y of a table on the device.
fn texels_of(table: &PsfTable) -> [usize; 2] {
    let [columns, rows] = table.size_px();
    [(table.phases() - 3) * columns, table.phases() * rows]
}

impl Backend for Gpu {
    fn name(&self) -> &'static str {
        "gpu"
    }

    fn description(&self) -> String {
        self.gpu.description()
    }

    fn render(&mut self, plan: &ExposurePlan) -> Result<(), Refused> {
        check_kernel(plan)?;
        check_sampling(plan, false)?;
        Ok(self.submit(plan)?)
    }

    fn electrons(&self) -> Electrons<'_> {
        Electrons::Device(&self.image)
    }
}

impl Resources {
    fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        let head = shader::constant_u32("WORKGROUP", WORKGROUP) + include_str!("place.wgsl");
        let tail = include_str!("blocks.wgsl");
        let erf = shader::coefficients("ERF_P", &ERF_P)
            + &shader::coefficients("ERF_Q", &ERF_Q)
            + &shader::constant("ERF_CLAMP", ERF_CLAMP);
        Ok(Self {
            params: GrowableBuffer::uniform(gpu, "frame parameters", size_of::<FrameParams>() as u64)?,
            spots: GrowableBuffer::storage(gpu, "stars", 4096 * size_of::<SpotRecord>() as u64)?,
            tracks: GrowableBuffer::storage(gpu, "tracks of stars", 1024 * size_of::<TrackRecord>() as u64)?,
            nodes: GrowableBuffer::storage(gpu, "path nodes", 256 * size_of::<NodeRecord>() as u64)?,
            table: TableTexture::new(gpu, "PSF table")?,
            texels: Vec::new(),
            splat: ComputePass::new(gpu, "splat", format!("{head}{erf}{}{tail}", include_str!("splat.wgsl")))?,
            tabulated: ComputePass::new(gpu, "table", format!("{head}{}{tail}", include_str!("table.wgsl")))?,
            groups: None,
        })
    }

    /// Brings a table to a layer: texel (phase_x, column; phase_y, row) holds the taps of four phases along x.
    fn load_table(&mut self, gpu: &GpuDevice, layer: u32, table: &PsfTable) {
        let (phases, [columns, rows]) = (table.phases(), table.size_px());
        self.texels.clear();
        for (phase_row, row) in (0..phases).flat_map(|phase| (0..rows).map(move |row| (phase, row))) {
            for first in 0..phases - 3 {
                let taps = |column| core::array::from_fn(|n| table.value(phase_row, first + n, row, column));
                self.texels.extend((0..columns).map(taps));
            }
        }
        self.table.write(gpu, layer, (phases - 3) * columns, &self.texels);
    }

    fn write_nodes(&mut self, gpu: &GpuDevice, nodes: &[NodeRecord]) -> Result<(), GpuError> {
        if self.nodes.write(gpu, nodes)? {
            self.groups = None;
        }
        Ok(())
    }

    /// Returns the bind groups of both passes; new ones are made only after a buffer has grown.
    fn bind(&mut self, gpu: &GpuDevice, sums: &wgpu::Buffer) -> [wgpu::BindGroup; 2] {
        let Self { params, spots, tracks, nodes, table, splat, tabulated, groups, .. } = self;
        let make = || {
            let common = || {
                [params.buffer(), spots.buffer(), nodes.buffer(), sums, tracks.buffer()]
                    .map(wgpu::Buffer::as_entire_binding)
            };
            let [a, b, c, d, e] = common();
            [splat.bind(gpu, common()), tabulated.bind(gpu, [a, b, c, d, e, table.binding()])]
        };
        groups.get_or_insert_with(make).clone()
    }
}

impl From<GpuError> for Refused {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::NoAdapter { .. } | GpuError::NoDevice { .. } | GpuError::CpuOnly { .. } => {
                Refused(format!("no GPU backend: {error}"))
            }
            GpuError::TooLarge { what, got, most } => Refused(format!(
                "{what}: got {got}, the device takes at most {most}; lower the limiting magnitude or use the CPU backend",
                got = usize::try_from(got).unwrap_or(usize::MAX),
                most = usize::try_from(most).unwrap_or(usize::MAX)
            )),
            GpuError::Failed(message) => Refused(format!("the GPU failed while drawing: {message}")),
            GpuError::Size { .. } => Refused(format!("the GPU failed while drawing: {error}")),
        }
    }
}

/// Returns the bound of a table's values: spline weights are positive and sum to 1, so no value lies beyond the
/// coefficients.
fn largest_coefficient(table: &PsfTable) -> f64 {
    f64::from(table.data.iter().fold(0.0_f32, |most, value| most.max(value.abs())))
}
