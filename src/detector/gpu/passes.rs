//! The passes of the detector on a device: one for all stages, or one before and one after the neighbours.

use crate::base::random::Stage;
use crate::detector::poisson::INVERSION_LIMIT;
use crate::detector::{Detector, DetectorParams};
use crate::gpu::buffers::GrowableBuffer;
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};

/// Multipliers and key steps of Philox (see [`crate::base::random`]).
const PHILOX: [(&str, u32); 4] =
    [("PHILOX_M0", 0xD251_1F53), ("PHILOX_M1", 0xCD9E_8D57), ("PHILOX_W0", 0x9E37_79B9), ("PHILOX_W1", 0xBB67_AE85)];

/// Buffers that the pixel-local stages read.
#[derive(Debug)]
pub(super) struct Maps {
    prnu: GrowableBuffer,
    dsnu_e: GrowableBuffer,
}

impl Maps {
    /// The patterns of `detector` on the device; a stub for each that is off.
    pub(super) fn new(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        let patterns = detector.patterns();
        Ok(Self {
            prnu: pattern(gpu, "PRNU map", patterns.prnu.as_deref())?,
            dsnu_e: pattern(gpu, "DSNU map", patterns.dsnu_e.as_deref())?,
        })
    }
}

fn pattern(gpu: &GpuDevice, what: &'static str, map: Option<&[f32]>) -> Result<GrowableBuffer, GpuError> {
    let map = map.unwrap_or_default();
    let mut buffer = GrowableBuffer::storage(gpu, what, size_of_val(map) as u64)?;
    buffer.write(gpu, map)?;
    Ok(buffer)
}

/// A pass whose first two bindings are the frame's parameters and an image, and the group bound for that image last.
#[derive(Debug)]
pub(super) struct ImagePass {
    pass: ComputePass,
    bound: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl ImagePass {
    /// All stages.
    pub(super) fn all(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        let parts = [include_str!("charge.wgsl"), include_str!("readout.wgsl"), include_str!("one_pass.wgsl")];
        Self::new(gpu, "detector", detector, &parts)
    }

    /// The stages before the neighbours.
    pub(super) fn charge(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        Self::new(gpu, "charge", detector, &[include_str!("charge.wgsl"), include_str!("charge_pass.wgsl")])
    }

    /// The stages after the neighbours.
    pub(super) fn readout(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        Self::new(gpu, "read out", detector, &[include_str!("readout.wgsl"), include_str!("readout_pass.wgsl")])
    }

    fn new(gpu: &GpuDevice, name: &'static str, detector: &Detector, parts: &[&str]) -> Result<Self, GpuError> {
        let common = [include_str!("random.wgsl"), include_str!("elementary.wgsl"), include_str!("frame.wgsl")];
        let text = shader::assemble(&constants(detector), [&common, parts].concat());
        Ok(Self { pass: ComputePass::new(gpu, name, text)?, bound: None })
    }

    /// Records the pass over `pixels` from `image`; a bind group is made anew only for another image.
    pub(super) fn record<const N: usize>(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        pixels: u32,
        image: &wgpu::Buffer,
        bindings: [&wgpu::Buffer; N],
    ) {
        if self.bound.as_ref().is_none_or(|(bound, _)| bound != image) {
            let group = self.pass.bind(gpu, bindings.map(wgpu::Buffer::as_entire_binding));
            self.bound = Some((image.clone(), group));
        }
        if let Some((_, group)) = &self.bound {
            self.pass.record(encoder, group, grid(pixels.div_ceil(2)));
        }
    }
}

impl Maps {
    /// Bindings of [`ImagePass::all`].
    pub(super) fn for_all<'a>(&'a self, [frame, image, dn]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 5] {
        [frame, image, self.prnu.buffer(), self.dsnu_e.buffer(), dn]
    }

    /// Bindings of [`ImagePass::charge`].
    pub(super) fn for_charge<'a>(&'a self, [frame, image, charge]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 4] {
        [frame, image, self.prnu.buffer(), charge]
    }

    /// Bindings of [`ImagePass::readout`].
    pub(super) fn for_readout<'a>(&'a self, [frame, charge, dn]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 4] {
        [frame, charge, self.dsnu_e.buffer(), dn]
    }
}

/// The shader's constants. What is off is a constant too, and the driver leaves it out.
fn constants(detector: &Detector) -> String {
    let DetectorParams { read_noise_e_rms, .. } = *detector.params();
    let patterns = detector.patterns();
    let mut text: String = PHILOX.iter().map(|(name, value)| shader::constant_u32(name, *value)).collect();
    text += &shader::constant_u32("WORKGROUP", WORKGROUP);
    text += &shader::constant_u32("STAGE_TEMPORAL", Stage::Temporal as u32);
    text += &shader::constant("INVERSION_LIMIT", INVERSION_LIMIT);
    text += &shader::switch("PRNU", patterns.prnu.is_some());
    text += &shader::switch("DSNU", patterns.dsnu_e.is_some());
    text + &shader::switch("READ_NOISE", read_noise_e_rms > 0.0)
}
