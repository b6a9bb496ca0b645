//! Charge binning of [`crate::detector::binning`] on a device, into a smaller buffer.

use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use crate::{
    detector::Effect, detector::gpu::neighbour_stage::GpuNeighbourStage, detector::neighbour_stage::FrameAt,
    gpu::buffers::GrowableBuffer,
};

/// `charge_binning.wgsl`.
#[derive(Debug)]
pub(super) struct GpuChargeBinning {
    pass: ComputePass,
    group: wgpu::BindGroup,
    sums: wgpu::Buffer,
    squares: u32,
}

impl GpuChargeBinning {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels; the shader's precision")]
    pub(super) fn new(
        gpu: &GpuDevice,
        factor: u32,
        full_well_e: f64,
        sensor_px: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let [columns, rows] = sensor_px.map(|side| side as u32 / factor);
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("WIDTH", sensor_px[0] as u32);
        text += &shader::constant_u32("COLUMNS", columns);
        text += &shader::constant_u32("ROWS", rows);
        text += &shader::constant_u32("FACTOR", factor);
        text += &shader::constant("FULL_WELL_E", full_well_e as f32);
        let text = shader::assemble(&text, [include_str!("charge_binning.wgsl")]);
        let pass = ComputePass::new(gpu, "charge binning", text)?;
        // Whole pairs: the readout takes two pixels at a time.
        let pairs = u64::from(columns * rows).div_ceil(2);
        let sums = GrowableBuffer::storage(gpu, "binned charge", 8 * pairs)?.buffer().clone();
        let group = pass.bind(gpu, [charge, &sums].map(wgpu::Buffer::as_entire_binding));
        Ok(Self { pass, group, sums, squares: columns * rows })
    }

    /// Returns where the sums are.
    pub(super) fn sums(&self) -> &wgpu::Buffer {
        &self.sums
    }
}

impl GpuNeighbourStage for GpuChargeBinning {
    fn effect(&self) -> Effect {
        Effect::Binning
    }

    fn record(&mut self, _: &GpuDevice, encoder: &mut wgpu::CommandEncoder, _: &FrameAt) -> Result<(), GpuError> {
        self.pass.record(encoder, &self.group, grid(self.squares));
        Ok(())
    }
}
