//! The neighbour stages on a device: the same list as [`crate::detector::neighbours`], each a pass over the charge
//! buffer, `array<vec2<f32>>` of electrons, two pixels an element, row by row.
//!
//! * [`crate::detector::blooming`]: one invocation for a column;
//! * charge binning of [`crate::detector::binning`]: into a smaller buffer;
//! * [`crate::detector::charge_transfer`]: a pass along the columns into a second buffer, one along the rows back;
//! * [`crate::detector::image_lag`]: the rest is a buffer on the device.

use crate::detector::binning::{Binning, BinningKind};
use crate::detector::charge_transfer::{ChargeTransfer, Trails};
use crate::detector::image_lag::{ImageLag, LEAST_E, Memory};
use crate::detector::{Detector, Effect, readout};
use crate::detector::{blooming::Blooming, effect_order::FrameAt};
use crate::gpu::buffers::GrowableBuffer;
use crate::gpu::shader::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use core::fmt::Debug;

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
    let full_well_e = readout::limit_e(detector.params());
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

/// One stage. Its pipeline, buffers and bind groups are made once, in
/// [`stages`].
pub trait GpuNeighbourStage: Debug + Send + Sync {
    /// Returns which effect it is.
    fn effect(&self) -> Effect;

    /// Records the stage's work on the charge it was made for.
    ///
    /// # Errors
    /// When the device failed.
    fn record(&mut self, gpu: &GpuDevice, encoder: &mut wgpu::CommandEncoder, at: &FrameAt) -> Result<(), GpuError>;

    /// Clears its state from frame to frame.
    fn reset(&mut self) {}
}

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
