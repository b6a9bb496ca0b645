//! [`crate::detector::image_lag`] on a device; the rest is a buffer there.

use crate::detector::image_lag::{ImageLag, LEAST_E, Memory};
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use crate::{
    detector::Effect, detector::gpu::neighbour_stage::GpuNeighbourStage, detector::neighbour_stage::FrameAt,
    gpu::buffers::GrowableBuffer,
};

/// `image_lag.wgsl`.
#[derive(Debug)]
pub(super) struct GpuImageLag {
    pass: ComputePass,
    group: wgpu::BindGroup,
    pairs: u32,
    share: f64,
    memory: Memory,
    uniform: GrowableBuffer,
}

impl GpuImageLag {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    pub(super) fn new(
        gpu: &GpuDevice,
        lag: &ImageLag,
        full_well_e: f32,
        [width, height]: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let pairs = (width * height).div_ceil(2) as u32;
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("PAIRS", pairs);
        text += &shader::constant("LEAST_E", LEAST_E);
        text += &shader::constant("FULL_WELL_E", full_well_e);
        let pass = ComputePass::new(gpu, "image lag", shader::assemble(&text, [include_str!("image_lag.wgsl")]))?;
        let rest_e = GrowableBuffer::storage(gpu, "charge that stays", 8 * u64::from(pairs))?;
        let uniform = GrowableBuffer::uniform(gpu, "image lag", 16)?;
        let buffers = [uniform.buffer(), charge, rest_e.buffer()];
        let group = pass.bind(gpu, buffers.map(wgpu::Buffer::as_entire_binding));
        Ok(Self { pass, group, pairs, share: lag.share, memory: Memory::default(), uniform })
    }
}

impl GpuNeighbourStage for GpuImageLag {
    fn effect(&self) -> Effect {
        Effect::ImageLag
    }

    #[allow(clippy::cast_possible_truncation, reason = "the shader works in single precision")]
    fn record(&mut self, gpu: &GpuDevice, encoder: &mut wgpu::CommandEncoder, at: &FrameAt) -> Result<(), GpuError> {
        let carried = self.memory.advance(at.frame, self.share);
        self.uniform.write(gpu, &[[carried, self.share as f32, 0.0, 0.0]])?;
        self.pass.record(encoder, &self.group, grid(self.pairs));
        Ok(())
    }

    fn reset(&mut self) {
        self.memory.reset();
    }
}
