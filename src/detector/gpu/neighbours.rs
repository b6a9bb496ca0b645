//! The neighbour stages on a device: the same list as [`crate::detector::neighbours`], each a pass over the charge
//! buffer, `array<vec2<f32>>` of electrons, two pixels an element, row by row.

use crate::detector::neighbours::FrameAt;
use crate::detector::{Detector, Effect, full_well};
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use core::fmt::Debug;

/// One stage. Its pipeline, buffers and bind groups are made once, in [`stages`].
pub trait GpuNeighbourStage: Debug + Send + Sync {
    /// Which effect it is.
    fn effect(&self) -> Effect;

    /// Records the stage's work on the charge it was made for.
    ///
    /// # Errors
    /// When the device failed.
    fn record(&mut self, gpu: &GpuDevice, encoder: &mut wgpu::CommandEncoder, at: &FrameAt) -> Result<(), GpuError>;
}

/// The stages that are on, in order, and the buffer that the readout reads: `charge`, or the last stage's own.
pub type Stages = (Vec<Box<dyn GpuNeighbourStage>>, wgpu::Buffer);

/// The stages of `detector`, bound to `charge`.
///
/// # Errors
/// When the device refuses a shader or a buffer.
pub fn stages(
    gpu: &GpuDevice,
    detector: &Detector,
    size_px: [usize; 2],
    charge: &wgpu::Buffer,
) -> Result<Stages, GpuError> {
    // Made in the order of `ORDER`: a stage that changes the size hands on a buffer of its own.
    let mut stages: Vec<Box<dyn GpuNeighbourStage>> = Vec::new();
    for effect in detector.neighbour_effects() {
        if effect == Effect::FullWell {
            stages.push(Box::new(ClipFullWell::new(gpu, detector, size_px, charge)?));
        }
    }
    Ok((stages, charge.clone()))
}

/// `full_well.wgsl`.
#[derive(Debug)]
struct ClipFullWell {
    pass: ComputePass,
    group: wgpu::BindGroup,
    pairs: u32,
}

impl ClipFullWell {
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    fn new(
        gpu: &GpuDevice,
        detector: &Detector,
        [width, height]: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let pairs = (width * height).div_ceil(2) as u32;
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("PAIRS", pairs);
        text += &shader::constant("FULL_WELL_E", full_well::limit_e(detector.params()));
        let pass = ComputePass::new(gpu, "full well", shader::assemble(&text, [include_str!("full_well.wgsl")]))?;
        let group = pass.bind(gpu, [charge.as_entire_binding()]);
        Ok(Self { pass, group, pairs })
    }
}

impl GpuNeighbourStage for ClipFullWell {
    fn effect(&self) -> Effect {
        Effect::FullWell
    }

    fn record(&mut self, _: &GpuDevice, encoder: &mut wgpu::CommandEncoder, _: &FrameAt) -> Result<(), GpuError> {
        self.pass.record(encoder, &self.group, grid(self.pairs));
        Ok(())
    }
}
