//! [`crate::render::overlap`] on a device: the stars' image is kept, the targets' is drawn, and a pass takes the larger
//! of both in fixed point. Error against the CPU: a unit of the coarser of the two scales. What is lost comes back as a
//! number per workgroup.

use crate::gpu::buffers::{GrowableBuffer, ReadbackRing};
use crate::gpu::shader::{ComputePass, WORKGROUP, grid};
use crate::gpu::{DeviceElectrons, GpuDevice, GpuError, shader};
use crate::{render::Backend, render::gpu::Gpu, render::overlap::Apart};
use base::refused::Refused;
use bytemuck::{Pod, Zeroable};
use plan::exposure::ExposurePlan;

/// `Frame` of `brighter.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct FrameParams {
    pixels: u32,
    kept_shift: u32,
    other_shift: u32,
    electrons_per_unit: f32,
}

/// The pass and its buffers.
#[derive(Debug)]
pub struct Brighter {
    pass: ComputePass,
    params: GrowableBuffer,
    kept: DeviceElectrons,
    lost_e: GrowableBuffer,
    readback: ReadbackRing,
    pixels: u32,
    bound: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl Brighter {
    /// Builds the stage for images of this size.
    ///
    /// # Errors
    /// When the device refuses the shader or an image of this size.
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    pub fn new(gpu: &GpuDevice, [width, height]: [usize; 2]) -> Result<Self, GpuError> {
        let pixels = (width * height) as u32;
        let [columns, rows, _] = grid(pixels);
        let bytes = 4 * u64::from(columns) * u64::from(rows);
        let wgsl = shader::constant_u32("WORKGROUP", WORKGROUP) + include_str!("brighter.wgsl");
        Ok(Self {
            pass: ComputePass::new(gpu, "brighter", wgsl)?,
            params: GrowableBuffer::uniform(gpu, "overlap parameters", size_of::<FrameParams>() as u64)?,
            kept: DeviceElectrons::new(gpu, width, height)?,
            lost_e: GrowableBuffer::storage(gpu, "light lost", bytes)?,
            readback: ReadbackRing::new(gpu, 1, bytes)?,
            pixels,
            bound: None,
        })
    }

    /// Draws stars and targets apart; the larger of both is in [`Self::electrons`].
    ///
    /// # Errors
    /// When the device failed.
    pub fn render(&mut self, backend: &mut Gpu, plan: &ExposurePlan, apart: &mut Apart) -> Result<(), Refused> {
        backend.render(apart.stars_of(plan))?;
        let gpu = std::sync::Arc::clone(backend.device());
        let drawn = backend.device_electrons();
        let mut encoder = gpu.encoder("keep the stars");
        let (from, to) = (drawn.buffer(), self.kept.buffer());
        encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size().min(to.size()));
        let stars_scale = drawn.scale();
        gpu.submit(encoder)?;
        backend.render(apart.targets_of(plan))?;
        let lost_e = self.combine(&gpu, backend.device_electrons(), stars_scale)?;
        apart.set_lost_e(lost_e);
        Ok(())
    }

    /// Returns the image of both.
    pub fn electrons(&self) -> &DeviceElectrons {
        &self.kept
    }

    fn combine(&mut self, gpu: &GpuDevice, other: &DeviceElectrons, kept_scale: f32) -> Result<f64, GpuError> {
        let scale = kept_scale.min(other.scale());
        let params = FrameParams {
            pixels: self.pixels,
            kept_shift: shift(kept_scale / scale),
            other_shift: shift(other.scale() / scale),
            electrons_per_unit: 1.0 / scale,
        };
        self.params.write(gpu, &[params])?;
        self.kept.set_scale(scale);
        let group = self.bind(gpu, other);
        let mut encoder = gpu.encoder("keep the brighter");
        self.pass.record(&mut encoder, &group, grid(self.pixels));
        self.readback.record(&mut encoder, self.lost_e.buffer());
        gpu.submit(encoder)?;
        self.readback
            .receive(gpu, |bytes| bytes.as_chunks::<4>().0.iter().map(|sum| f64::from(f32::from_ne_bytes(*sum))).sum())
    }

    fn bind(&mut self, gpu: &GpuDevice, other: &DeviceElectrons) -> wgpu::BindGroup {
        if let Some((_, group)) = self.bound.as_ref().filter(|(buffer, _)| buffer == other.buffer()) {
            return group.clone();
        }
        let buffers = [self.params.buffer(), self.kept.buffer(), other.buffer(), self.lost_e.buffer()];
        let group = self.pass.bind(gpu, buffers.map(wgpu::Buffer::as_entire_binding));
        self.bound = Some((other.buffer().clone(), group.clone()));
        group
    }
}

/// Returns bits by which a power of two shifts.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a ratio of two scales, both powers of two")]
fn shift(ratio: f32) -> u32 {
    ratio.log2().round().clamp(0.0, 31.0) as u32
}
