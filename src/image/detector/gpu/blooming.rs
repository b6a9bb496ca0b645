//! [`crate::detector::blooming`] on a device: one invocation for a column.

use crate::detector::{blooming::Blooming, gpu::neighbour_stage::GpuNeighbourStage, neighbour_stage::FrameAt};
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use crate::{detector::Effect, gpu::buffers::GrowableBuffer};

/// `blooming.wgsl`.
#[derive(Debug)]
pub(super) struct GpuBlooming {
    pass: ComputePass,
    group: wgpu::BindGroup,
    columns: u32,
}

impl GpuBlooming {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    pub(super) fn new(
        gpu: &GpuDevice,
        blooming: &Blooming,
        full_well_e: f32,
        [width, height]: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("WIDTH", width as u32);
        text += &shader::constant_u32("HEIGHT", height as u32);
        text += &shader::constant("FULL_WELL_E", full_well_e);
        text += &shader::constant("EACH_WAY", blooming.each_way());
        let pass = ComputePass::new(gpu, "blooming", shader::assemble(&text, [include_str!("blooming.wgsl")]))?;
        let bytes = 4 * width as u64 * height as u64;
        let down_first = GrowableBuffer::storage(gpu, "charge spilled down first", bytes)?;
        let up_first = GrowableBuffer::storage(gpu, "charge spilled up first", bytes)?;
        let buffers = [charge, down_first.buffer(), up_first.buffer()];
        let group = pass.bind(gpu, buffers.map(wgpu::Buffer::as_entire_binding));
        Ok(Self { pass, group, columns: width as u32 })
    }
}

impl GpuNeighbourStage for GpuBlooming {
    fn effect(&self) -> Effect {
        Effect::FullWell
    }

    fn record(&mut self, _: &GpuDevice, encoder: &mut wgpu::CommandEncoder, _: &FrameAt) -> Result<(), GpuError> {
        self.pass.record(encoder, &self.group, grid(self.columns));
        Ok(())
    }
}
