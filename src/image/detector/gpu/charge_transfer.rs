//! [`crate::detector::charge_transfer`] on a device: a pass along the columns into a second buffer, one along the rows
//! back.

use crate::detector::charge_transfer::{ChargeTransfer, Trails};
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use crate::{
    detector::Effect, detector::gpu::neighbour_stage::GpuNeighbourStage, detector::neighbour_stage::FrameAt,
    gpu::buffers::GrowableBuffer,
};

/// `charge_transfer.wgsl`, twice.
#[derive(Debug)]
pub(super) struct GpuChargeTransfer {
    passes: [(ComputePass, wgpu::BindGroup); 2],
    pixels: u32,
}

/// One direction.
struct Along<'a> {
    is_along_columns: bool,
    is_from_end: bool,
    trails: Trails,
    from: &'a wgpu::Buffer,
    to: &'a wgpu::Buffer,
}

impl GpuChargeTransfer {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    pub(super) fn new(
        gpu: &GpuDevice,
        transfer: &ChargeTransfer,
        size_px: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let [width, height] = size_px;
        let shifted = GrowableBuffer::storage(gpu, "charge shifted along columns", charge.size())?;
        let parallel = Along {
            is_along_columns: true,
            is_from_end: transfer.is_from_bottom(),
            trails: Trails::new(transfer.parallel_share, height),
            from: charge,
            to: shifted.buffer(),
        };
        let serial = Along {
            is_along_columns: false,
            is_from_end: transfer.is_from_right(),
            trails: Trails::new(transfer.serial_share, width),
            from: shifted.buffer(),
            to: charge,
        };
        let passes = [parallel.pass(gpu, size_px)?, serial.pass(gpu, size_px)?];
        Ok(Self { passes, pixels: (width * height) as u32 })
    }
}

impl Along<'_> {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    fn pass(&self, gpu: &GpuDevice, [width, height]: [usize; 2]) -> Result<(ComputePass, wgpu::BindGroup), GpuError> {
        let places = if self.is_along_columns { height } else { width };
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("WIDTH", width as u32);
        text += &shader::constant_u32("HEIGHT", height as u32);
        text += &shader::constant_u32("PLACES", places as u32);
        text += &shader::constant_u32("TERMS", self.trails.terms() as u32);
        text += &shader::switch("ALONG_COLUMNS", self.is_along_columns);
        text += &shader::switch("FROM_END", self.is_from_end);
        let text = shader::assemble(&text, [include_str!("charge_transfer.wgsl")]);
        let pass = ComputePass::new(gpu, "charge transfer", text)?;
        let mut shares = GrowableBuffer::storage(gpu, "shares left behind", size_of_val(self.trails.shares()) as u64)?;
        shares.write(gpu, self.trails.shares())?;
        let group = pass.bind(gpu, [self.from, shares.buffer(), self.to].map(wgpu::Buffer::as_entire_binding));
        Ok((pass, group))
    }
}

impl GpuNeighbourStage for GpuChargeTransfer {
    fn effect(&self) -> Effect {
        Effect::ChargeTransfer
    }

    fn record(&mut self, _: &GpuDevice, encoder: &mut wgpu::CommandEncoder, _: &FrameAt) -> Result<(), GpuError> {
        for (pass, group) in &self.passes {
            pass.record(encoder, group, grid(self.pixels));
        }
        Ok(())
    }
}
