//! The neighbour stages on a device: the same list as [`crate::detector::neighbours`], each a pass over the charge
//! buffer, `array<vec2<f32>>` of electrons, two pixels an element, row by row.

use crate::detector::binning::{Binning, BinningKind};
use crate::detector::gpu::{
    blooming::GpuBlooming, charge_binning::GpuChargeBinning, charge_transfer::GpuChargeTransfer,
    image_lag::GpuImageLag, neighbour_stage::GpuNeighbourStage,
};
use crate::detector::neighbour_stage::FrameAt;
use crate::detector::{Detector, Effect, full_well};
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};

/// The stages that are on, in order, and the buffer that the readout reads: `charge`, or the last stage's own.
pub type Stages = (Vec<Box<dyn GpuNeighbourStage>>, wgpu::Buffer);

/// Builds the stages of `detector`, bound to `charge`.
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
    let spatial = &detector.params().spatial;
    let full_well_e = full_well::limit_e(detector.params());
    let mut charge_out = charge.clone();
    for effect in detector.neighbour_effects() {
        match effect {
            Effect::ImageLag => {
                if let Some(lag) = &spatial.image_lag {
                    stages.push(Box::new(GpuImageLag::new(gpu, lag, full_well_e, size_px, charge)?));
                }
            }
            Effect::FullWell => stages.push(match &spatial.blooming {
                Some(blooming) => Box::new(GpuBlooming::new(gpu, blooming, full_well_e, size_px, charge)?),
                None => Box::new(ClipFullWell::new(gpu, full_well_e, size_px, charge)?),
            }),
            Effect::ChargeTransfer => {
                if let Some(transfer) = &spatial.charge_transfer {
                    stages.push(Box::new(GpuChargeTransfer::new(gpu, transfer, size_px, charge)?));
                }
            }
            Effect::Binning => {
                if let Some(Binning { factor, kind: BinningKind::Charge { full_well_e } }) = spatial.binning {
                    let stage = GpuChargeBinning::new(gpu, factor, full_well_e, size_px, charge)?;
                    charge_out = stage.sums().clone();
                    stages.push(Box::new(stage));
                }
            }
            // They act pixel by pixel, in other passes.
            Effect::Background
            | Effect::PhotoResponse
            | Effect::Dark
            | Effect::Defects
            | Effect::Shot
            | Effect::ProtonTracks
            | Effect::Nonlinearity
            | Effect::LinePattern
            | Effect::Offset
            | Effect::RowNoise
            | Effect::ReadNoise
            | Effect::Adc
            | Effect::Stuck
            | Effect::Window => {}
        }
    }
    Ok((stages, charge_out))
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
        full_well_e: f32,
        [width, height]: [usize; 2],
        charge: &wgpu::Buffer,
    ) -> Result<Self, GpuError> {
        let pairs = (width * height).div_ceil(2) as u32;
        let mut text = shader::constant_u32("WORKGROUP", WORKGROUP);
        text += &shader::constant_u32("PAIRS", pairs);
        text += &shader::constant("FULL_WELL_E", full_well_e);
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
