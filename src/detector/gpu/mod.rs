//! The detector on a GPU: electrons in fixed point on the device -> digital numbers on the host, in one pass.
//!
//! The same stages in the same order as [`crate::detector::Detector`], the same Philox words and the same steps of
//! every elementary function, so both draw the same noise. Differences are rounding: where the mean differs by 1e-5 e-
//! or the processor fuses a multiply-add, a Poisson count or the ADC's rounding may fall on the other side, one DN at
//! most when the gain is 1 e-/DN or more. `tests/gpu` bounds how often.
//!
//! Shot noise is drawn by `PoissonMethod::Auto` only; another method is refused when the detector is made.
//!
//! The numbers inside the shader's elementary functions are those of [`crate::detector::elementary`]; a slip in any of
//! them shows in `tests/gpu` as a share of differing pixels far beyond the bound.

use crate::base::clock::Stopwatch;
use crate::base::image::DnImage;
use crate::base::random::{Stage, key};
use crate::detector::params::Constants;
use crate::detector::poisson::INVERSION_LIMIT;
use crate::detector::{Detector, DetectorParams, PoissonMethod};
use crate::gpu::buffers::GrowableBuffer;
use crate::gpu::passes::{ComputePass, WORKGROUP, grid};
use crate::gpu::readback::ReadbackRing;
use crate::gpu::timing::FrameTimes;
use crate::gpu::{DeviceElectrons, GpuDevice, GpuError, shader};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// Frames in flight between device and host.
const RING_DEPTH: usize = 1;
/// Multipliers and key steps of Philox (see [`crate::base::random`]).
const PHILOX: [(&str, u32); 4] =
    [("PHILOX_M0", 0xD251_1F53), ("PHILOX_M1", 0xCD9E_8D57), ("PHILOX_W0", 0x9E37_79B9), ("PHILOX_W1", 0xBB67_AE85)];

/// `Readout` of `detector.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct ReadoutParams {
    pixels: u32,
    frame: u32,
    key: [u32; 2],
    electrons_per_unit: f32,
    dark_e: f32,
    full_well_e: f32,
    read_noise_e: f32,
    dn_per_e: f32,
    black_dn: f32,
    largest_dn: f32,
    patterns: u32,
    stray_light_e: f32,
    /// Uniform structs are as long as a multiple of their alignment.
    unused: u32,
}

/// A detector whose stages run on the device.
#[derive(Debug)]
pub struct GpuDetector {
    gpu: Arc<GpuDevice>,
    model: DetectorParams,
    seed: u64,
    stray_light_e: f32,
    patterns: u32,
    size: [usize; 2],
    pass: ComputePass,
    params: GrowableBuffer,
    prnu: GrowableBuffer,
    dsnu_e: GrowableBuffer,
    dn: GrowableBuffer,
    readback: ReadbackRing,
    bound: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    times: FrameTimes,
}

impl GpuDetector {
    /// `detector` on the device: its parameters, seed and fixed patterns, for images of this size.
    ///
    /// # Errors
    /// When the device refuses the shader or an image of this size, or the Poisson method is not `auto`.
    pub fn new(gpu: Arc<GpuDevice>, detector: &Detector, width_px: usize, height_px: usize) -> Result<Self, GpuError> {
        let poisson = detector.params().poisson;
        if poisson != PoissonMethod::Auto {
            let wanted = PoissonMethod::Auto.name();
            return Err(GpuError::CpuOnly { what: "Poisson method", got: poisson.to_string(), wanted });
        }
        let pairs = (width_px * height_px).div_ceil(2) as u64;
        let (prnu, dsnu_e) = detector.patterns();
        let patterns = u32::from(prnu.is_some()) | u32::from(dsnu_e.is_some()) << 1;
        let prnu = pattern(&gpu, "PRNU map", prnu)?;
        let dsnu_e = pattern(&gpu, "DSNU map", dsnu_e)?;
        Ok(Self {
            pass: ComputePass::new(&gpu, "detector", wgsl())?,
            params: GrowableBuffer::uniform(&gpu, "detector parameters", size_of::<ReadoutParams>() as u64)?,
            prnu,
            dsnu_e,
            dn: GrowableBuffer::storage(&gpu, "digital numbers", 4 * pairs)?,
            readback: ReadbackRing::new(&gpu, RING_DEPTH, 4 * pairs)?,
            bound: None,
            times: FrameTimes::default(),
            size: [width_px, height_px],
            model: *detector.params(),
            seed: detector.seed(),
            stray_light_e: 0.0,
            patterns,
            gpu,
        })
    }

    /// Stray light of the frames from here on: mean electrons more in every pixel.
    pub fn set_stray_light_e(&mut self, stray_light_e: f32) {
        self.stray_light_e = stray_light_e;
    }

    /// Wall time of the latest frame.
    #[must_use]
    pub fn times(&self) -> FrameTimes {
        self.times
    }

    /// Reads `electrons` out as frame `frame`, and waits for the result.
    ///
    /// # Errors
    /// When the device failed or an image has another size.
    pub fn collect(
        &mut self,
        electrons: &DeviceElectrons,
        frame: u32,
        exposure_s: f64,
        out: &mut DnImage,
    ) -> Result<(), GpuError> {
        self.check_size("electrons to read out", [electrons.width(), electrons.height()])?;
        self.check_size("digital numbers", [out.width(), out.height()])?;
        let mut watch = Stopwatch::start();
        self.submit(electrons, frame, exposure_s)?;
        let submit = watch.lap();
        let wait = self.readback.receive(&self.gpu, |bytes| {
            let wait = watch.lap();
            let pixels: &mut [u8] = bytemuck::cast_slice_mut(out.pixels_mut());
            // The device's copy is rounded up to whole words.
            let count = pixels.len().min(bytes.len());
            pixels[..count].copy_from_slice(&bytes[..count]);
            wait
        })?;
        self.times = FrameTimes { submit, wait, copy: watch.lap() };
        Ok(())
    }

    fn check_size(&self, what: &'static str, got: [usize; 2]) -> Result<(), GpuError> {
        if got == self.size { Ok(()) } else { Err(GpuError::Size { what, got, wanted: self.size }) }
    }

    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    fn submit(&mut self, electrons: &DeviceElectrons, frame: u32, exposure_s: f64) -> Result<(), GpuError> {
        let constants = Constants::new(&self.model, exposure_s, self.stray_light_e);
        let pixels = (self.size[0] * self.size[1]) as u32;
        let params = ReadoutParams {
            pixels,
            frame,
            key: key(self.seed),
            electrons_per_unit: 1.0 / electrons.scale(),
            dark_e: constants.dark_e,
            full_well_e: constants.full_well_e,
            read_noise_e: constants.read_noise_e,
            dn_per_e: constants.dn_per_e,
            black_dn: constants.black_dn + 0.5,
            largest_dn: constants.largest_dn,
            patterns: self.patterns,
            stray_light_e: constants.stray_light_e,
            unused: 0,
        };
        self.params.write(&self.gpu, &[params])?;
        let group = self.bind(electrons);
        let mut encoder = self.gpu.encoder("read out");
        self.pass.record(&mut encoder, &group, grid(pixels.div_ceil(2)));
        if !self.readback.record(&mut encoder, self.dn.buffer()) {
            return Err(GpuError::Failed("an earlier frame was never read back".into()));
        }
        self.gpu.submit(encoder)
    }

    /// The bind group for this image; made anew only for another image.
    fn bind(&mut self, electrons: &DeviceElectrons) -> wgpu::BindGroup {
        let fresh = self.bound.as_ref().filter(|(buffer, _)| buffer == electrons.buffer());
        if let Some((_, group)) = fresh {
            return group.clone();
        }
        let buffers =
            [self.params.buffer(), electrons.buffer(), self.prnu.buffer(), self.dsnu_e.buffer(), self.dn.buffer()];
        let group = self.pass.bind(&self.gpu, buffers.map(wgpu::Buffer::as_entire_binding));
        self.bound = Some((electrons.buffer().clone(), group.clone()));
        group
    }
}

/// A fixed pattern on the device; a stub when it is off.
fn pattern(gpu: &GpuDevice, what: &'static str, map: Option<&[f32]>) -> Result<GrowableBuffer, GpuError> {
    let map = map.unwrap_or_default();
    let mut buffer = GrowableBuffer::storage(gpu, what, size_of_val(map) as u64)?;
    buffer.write(gpu, map)?;
    Ok(buffer)
}

fn wgsl() -> String {
    let mut text: String = PHILOX.iter().map(|(name, value)| shader::constant_u32(name, *value)).collect();
    text += &shader::constant_u32("WORKGROUP", WORKGROUP);
    text += &shader::constant_u32("STAGE_TEMPORAL", Stage::Temporal as u32);
    text += &shader::constant("INVERSION_LIMIT", INVERSION_LIMIT);
    text + include_str!("detector.wgsl")
}
