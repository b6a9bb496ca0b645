//! The detector on a GPU: electrons in fixed point on the device -> digital numbers on the host, in one pass; or in a
//! pass that makes charge, the neighbour stages, and a pass that reads out.
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

pub mod neighbours;
mod passes;

use crate::detector::conditions::{Constants, DetectorConditions};
use crate::detector::{Detector, DetectorParams, PoissonMethod};
use crate::detector::{background::normalisation, disturbances::Disturbances, effect_order::FrameAt, output::Output};
use crate::gpu::buffers::{GrowableBuffer, ReadbackRing};
use crate::gpu::device::FrameTimes;
use crate::gpu::{DeviceElectrons, GpuDevice, GpuError};
use base::{clock::Stopwatch, image::DnImage, random::key};
use bytemuck::{Pod, Zeroable};
use neighbours::GpuNeighbourStage;
use passes::{ImagePass, Maps};
use std::sync::Arc;

/// Frames in flight between device and host.
const RING_DEPTH: usize = 1;

/// `Frame` of `frame.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct FrameUniform {
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
    // Uniform structs are as long as a multiple of their alignment, 8 bytes.
    stray_light_e: f32,
    width: u32,
    offset: [f32; 2],
    scale: f32,
    gradient_e: [f32; 2],
    quadratic_e: f32,
    /// 0 without a map: the sky is in `stray_light_e` then.
    sky_e: f32,
}

/// The passes of a frame.
#[derive(Debug)]
enum Passes {
    /// All stages in one.
    One(ImagePass),
    /// Passes with a charge image between them.
    Apart { charge: ImagePass, charge_e: GrowableBuffer, neighbours: Neighbours, readout: ImagePass },
}

/// The stages between the passes, and the buffer they leave the charge in.
#[derive(Debug)]
struct Neighbours {
    stages: Vec<Box<dyn GpuNeighbourStage>>,
    charge_out: wgpu::Buffer,
}

/// A detector whose stages run on the device.
#[derive(Debug)]
pub struct GpuDetector {
    gpu: Arc<GpuDevice>,
    model: DetectorParams,
    noise_seed: u64,
    has_map: bool,
    size: [usize; 2],
    disturbances: Disturbances,
    output: Output,
    passes: Passes,
    params: GrowableBuffer,
    maps: Maps,
    dn: GrowableBuffer,
    readback: ReadbackRing,
    times: FrameTimes,
}

impl GpuDetector {
    /// Builds `detector` on the device: its parameters, seed, fixed patterns and neighbour stages, for images of this
    /// size.
    ///
    /// # Errors
    /// When the device refuses a shader or an image of this size, or the Poisson method is not `auto`.
    pub fn new(gpu: Arc<GpuDevice>, detector: &Detector, width_px: usize, height_px: usize) -> Result<Self, GpuError> {
        let poisson = detector.params().poisson;
        if poisson != PoissonMethod::Auto {
            let wanted = PoissonMethod::Auto.name();
            return Err(GpuError::CpuOnly { what: "Poisson method", got: poisson.to_string(), wanted });
        }
        let output = detector.output().clone();
        let [adc_width, adc_height] = output.adc_px();
        let pairs = (adc_width * adc_height).div_ceil(2) as u64;
        Ok(Self {
            passes: Passes::new(&gpu, detector, [width_px, height_px])?,
            params: GrowableBuffer::uniform(&gpu, "detector parameters", size_of::<FrameUniform>() as u64)?,
            maps: Maps::new(&gpu, detector)?,
            dn: GrowableBuffer::storage(&gpu, "digital numbers", 4 * pairs)?,
            readback: ReadbackRing::new(&gpu, RING_DEPTH, 4 * pairs)?,
            times: FrameTimes::default(),
            size: [width_px, height_px],
            disturbances: detector.disturbances().clone(),
            output,
            model: *detector.params(),
            noise_seed: detector.seeds().noise,
            has_map: detector.illumination_map().is_some(),
            gpu,
        })
    }

    /// Sets the map of the illumination, as [`Detector::set_illumination_map`] does.
    ///
    /// # Errors
    /// When the device has no memory for it.
    pub fn set_illumination_map(&mut self, map: Option<&[f32]>) -> Result<(), GpuError> {
        let map = map.filter(|map| map.len() == self.size[0] * self.size[1]);
        self.maps.set_illumination(&self.gpu, map)?;
        self.has_map = map.is_some();
        match &mut self.passes {
            Passes::One(pass) | Passes::Apart { charge: pass, .. } => pass.unbind(),
        }
        Ok(())
    }

    /// Defects and protons.
    pub fn disturbances(&self) -> &Disturbances {
        &self.disturbances
    }

    /// Defects and protons, to be changed from the next frame on.
    pub fn disturbances_mut(&mut self) -> &mut Disturbances {
        &mut self.disturbances
    }

    /// Clears the state that is kept from frame to frame: the next frame is as the first.
    pub fn reset(&mut self) {
        if let Passes::Apart { neighbours, .. } = &mut self.passes {
            neighbours.stages.iter_mut().for_each(|stage| stage.reset());
        }
    }

    /// Returns the wall times of the latest frame.
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
        conditions: &DetectorConditions,
        out: &mut DnImage,
    ) -> Result<(), GpuError> {
        check_size("electrons to read out", [electrons.width(), electrons.height()], self.size)?;
        check_size("digital numbers", [out.width(), out.height()], self.output.geometry().size_px)?;
        let mut watch = Stopwatch::start();
        self.submit(electrons, frame, conditions)?;
        let submit = watch.lap();
        let adc = self.output.adc_image(out);
        let wait = self.readback.receive(&self.gpu, |bytes| {
            let wait = watch.lap();
            let pixels: &mut [u8] = bytemuck::cast_slice_mut(adc.pixels_mut());
            // The device's copy is rounded up to whole words.
            let count = pixels.len().min(bytes.len());
            pixels[..count].copy_from_slice(&bytes[..count]);
            wait
        })?;
        self.disturbances.stick(adc);
        self.output.finish(out);
        // The device reads out the whole image: reading a part is not faster.
        conditions.regions.clear_outside(out);
        self.times = FrameTimes { submit, wait, copy: watch.lap() };
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    fn submit(
        &mut self,
        electrons: &DeviceElectrons,
        frame: u32,
        conditions: &DetectorConditions,
    ) -> Result<(), GpuError> {
        let background = conditions.background;
        let constants = Constants::new(&self.model, conditions, background.level_e(self.has_map));
        let (offset, scale) = normalisation(self.size);
        let pixels = (self.size[0] * self.size[1]) as u32;
        self.disturbances.advance(frame, conditions, self.model.dark_law);
        let [adc_width, adc_height] = self.output.adc_px();
        let adc_pixels = (adc_width * adc_height) as u32;
        let at = FrameAt { frame, exposure_s: conditions.exposure_s, key: key(self.noise_seed) };
        let uniform = FrameUniform {
            pixels,
            frame,
            key: at.key,
            electrons_per_unit: 1.0 / electrons.scale(),
            dark_e: constants.dark_e,
            full_well_e: constants.full_well_e,
            read_noise_e: constants.read_noise_e,
            dn_per_e: constants.dn_per_e,
            black_dn: constants.black_dn + constants.rounding_dn,
            largest_dn: constants.largest_dn,
            stray_light_e: constants.stray_light_e,
            width: self.size[0] as u32,
            offset,
            scale,
            gradient_e: background.gradient_e,
            quadratic_e: background.quadratic_e,
            sky_e: if self.has_map { background.sky_e } else { 0.0 },
        };
        self.params.write(&self.gpu, &[uniform])?;
        self.maps.draw(&self.gpu, &self.model, self.disturbances.outliers(), &at)?;
        let mut encoder = self.gpu.encoder("read out");
        let buffers = [self.params.buffer(), electrons.buffer(), self.dn.buffer()];
        self.passes.record(&self.gpu, &mut encoder, &self.maps, buffers, [pixels, adc_pixels], &at)?;
        if !self.readback.record(&mut encoder, self.dn.buffer()) {
            return Err(GpuError::Failed("an earlier frame was never read back".into()));
        }
        self.gpu.submit(encoder)
    }
}

fn check_size(what: &'static str, got: [usize; 2], wanted: [usize; 2]) -> Result<(), GpuError> {
    if got == wanted { Ok(()) } else { Err(GpuError::Size { what, got, wanted }) }
}

impl Passes {
    fn new(gpu: &GpuDevice, detector: &Detector, size: [usize; 2]) -> Result<Self, GpuError> {
        if detector.is_one_pass() {
            return Ok(Self::One(ImagePass::all(gpu, detector)?));
        }
        let pairs = (size[0] * size[1]).div_ceil(2) as u64;
        let charge_e = GrowableBuffer::storage(gpu, "charge", 8 * pairs)?;
        let (stages, charge_out) = neighbours::stages(gpu, detector, size, charge_e.buffer())?;
        Ok(Self::Apart {
            charge: ImagePass::charge(gpu, detector)?,
            charge_e,
            neighbours: Neighbours { stages, charge_out },
            readout: ImagePass::readout(gpu, detector)?,
        })
    }

    /// Records all passes from `electrons` to `dn`.
    fn record(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        maps: &Maps,
        [frame, electrons, dn]: [&wgpu::Buffer; 3],
        [pixels, adc_pixels]: [u32; 2],
        at: &FrameAt,
    ) -> Result<(), GpuError> {
        match self {
            Self::One(pass) => pass.record(gpu, encoder, pixels, electrons, maps.for_all([frame, electrons, dn])),
            Self::Apart { charge, charge_e, neighbours, readout } => {
                let bindings = maps.for_charge([frame, electrons, charge_e.buffer()]);
                charge.record(gpu, encoder, pixels, electrons, bindings);
                for stage in &mut neighbours.stages {
                    stage.record(gpu, encoder, at)?;
                }
                let charge = &neighbours.charge_out;
                readout.record(gpu, encoder, adc_pixels, charge, maps.for_readout([frame, charge, dn]));
            }
        }
        Ok(())
    }
}
