//! Whole stars on a device: tiles that the host drew are added to the image in fixed point.
//!
//! The unit of a frame follows its brightest pixel, and every star of the frame is rounded to it. So a pixel takes at
//! most [`MOST_PIXEL_E`] of a whole star: far above any full well, and above what a column of 2,048 pixels of 1.3e5 e-
//! holds when it blooms. Test: `tests/gpu/whole.rs`.

use crate::gpu::shader::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use crate::render::whole::{TILE_PIXELS, TILE_PX, WholeImage};
use crate::{gpu::buffers::GrowableBuffer, render::gpu::scale::TileBounds};
use bytemuck::{Pod, Zeroable};

/// Most electrons of whole stars in a pixel: units of a quarter of an electron.
const MOST_PIXEL_E: f32 = 268_435_456.0;
/// Tiles for which there is space from the start.
const TILES_RESERVED: u64 = 64;

/// `Frame` of `whole.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FrameParams {
    size: [u32; 2],
    columns: u32,
    tiles: u32,
    scale: f32,
    most_e: f32,
}

/// The pass and its buffers.
#[derive(Debug)]
pub(super) struct WholePass {
    pass: ComputePass,
    params: GrowableBuffer,
    places: GrowableBuffer,
    values: GrowableBuffer,
    group: Option<wgpu::BindGroup>,
}

impl WholePass {
    /// Builds the pass.
    ///
    /// # Errors
    /// When the device refuses the shader.
    #[allow(clippy::cast_possible_truncation, reason = "a tile is small")]
    pub(super) fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        let constants = shader::constant_u32("WORKGROUP", WORKGROUP) + &shader::constant_u32("TILE_PX", TILE_PX as u32);
        Ok(Self {
            pass: ComputePass::new(gpu, "whole stars", constants + include_str!("whole.wgsl"))?,
            params: GrowableBuffer::uniform(gpu, "parameters of whole stars", size_of::<FrameParams>() as u64)?,
            places: GrowableBuffer::storage(gpu, "places of whole stars", 4 * TILES_RESERVED)?,
            values: GrowableBuffer::storage(gpu, "light of whole stars", 4 * TILES_RESERVED * TILE_PIXELS as u64)?,
            group: None,
        })
    }

    /// Adds the light of whole stars to the bounds from which the scale is chosen.
    pub(super) fn add_bounds(whole: &WholeImage, bounds: &mut TileBounds) {
        for (place, values) in whole.tiles() {
            let most_e = values.iter().copied().fold(0.0, f32::max).min(MOST_PIXEL_E);
            bounds.add(whole.box_px(place), f64::from(most_e));
        }
    }

    /// Records the addition of whole stars to the sums of an image.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    #[allow(clippy::cast_possible_truncation, reason = "an image has fewer than 2^32 pixels")]
    pub(super) fn record(
        &mut self,
        gpu: &GpuDevice,
        whole: &WholeImage,
        (sums, size, scale): (&wgpu::Buffer, [usize; 2], f32),
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        let tiles = whole.places().len() as u32;
        if tiles == 0 {
            return Ok(());
        }
        let size = size.map(|side| side as u32);
        let columns = whole.columns() as u32;
        self.params.write(gpu, &[FrameParams { size, columns, tiles, scale, most_e: MOST_PIXEL_E }])?;
        let grew = [self.places.write(gpu, whole.places())?, self.values.write(gpu, whole.values())?];
        if grew.contains(&true) {
            self.group = None;
        }
        let Self { pass, params, places, values, group } = self;
        let buffers = [params.buffer(), places.buffer(), values.buffer(), sums];
        let group = group.get_or_insert_with(|| pass.bind(gpu, buffers.map(wgpu::Buffer::as_entire_binding)));
        pass.record(encoder, group, grid(tiles * TILE_PIXELS as u32));
        Ok(())
    }
}
