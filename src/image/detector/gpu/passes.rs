//! The passes of the detector on a device: one for all stages, or one before and one after the neighbours.

use crate::detector::outliers::{Outlier, Outliers};
use crate::detector::{Detector, DetectorParams, Nonlinearity};
use crate::detector::{effect_order::FrameAt, poisson::INVERSION_LIMIT};
use crate::gpu::buffers::GrowableBuffer;
use crate::gpu::shader::{ComputePass, WORKGROUP, grid};
use crate::gpu::{GpuDevice, GpuError, shader};
use base::random::Stage;

/// Multipliers and key steps of Philox (see [`base::random`]).
const PHILOX: [(&str, u32); 4] =
    [("PHILOX_M0", 0xD251_1F53), ("PHILOX_M1", 0xCD9E_8D57), ("PHILOX_W0", 0x9E37_79B9), ("PHILOX_W1", 0xBB67_AE85)];

/// `Outlier` of `outliers.wgsl`.
const OUTLIER_BYTES: u64 = size_of::<Outlier>() as u64;

/// Buffers that the pixel-local stages read.
#[derive(Debug)]
pub(super) struct Maps {
    prnu: GrowableBuffer,
    dark_factor: GrowableBuffer,
    dsnu_e: GrowableBuffer,
    illumination: GrowableBuffer,
    outliers: GrowableBuffer,
    /// Outliers on the device.
    outlier_count: usize,
    /// Row noise of the frame, gains and offsets of the columns, offsets of the rows; a stub when all are off.
    lines: GrowableBuffer,
    rows_e: Vec<f32>,
}

impl Maps {
    /// Returns the patterns of `detector` on the device; a stub for each that is off.
    pub(super) fn new(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        let patterns = detector.patterns();
        let outliers_capacity = detector.disturbances().outliers().capacity();
        Ok(Self {
            prnu: pattern(gpu, "PRNU map", patterns.prnu.as_deref())?,
            dark_factor: pattern(gpu, "dark current map", patterns.dark_factor.as_deref())?,
            dsnu_e: pattern(gpu, "DSNU map", patterns.dsnu_e.as_deref())?,
            lines: pattern(gpu, "columns and rows", lines(detector).as_deref())?,
            illumination: pattern(gpu, "illumination map", detector.illumination_map())?,
            rows_e: vec![0.0; if detector.params().row_noise.is_on() { detector.adc_px()[1] } else { 0 }],
            // One more: the first element holds the number of the others.
            outliers: GrowableBuffer::storage(gpu, "outliers", (outliers_capacity + 1) as u64 * OUTLIER_BYTES)?,
            outlier_count: 0,
        })
    }

    /// Draws the random numbers of one frame, and writes its outliers to the device.
    ///
    /// # Errors
    /// When the device failed.
    pub(super) fn draw(
        &mut self,
        gpu: &GpuDevice,
        params: &DetectorParams,
        outliers: &Outliers,
        at: &FrameAt,
    ) -> Result<(), GpuError> {
        if !self.rows_e.is_empty() {
            params.row_noise.draw(at.frame, at.key, &mut self.rows_e);
            self.lines.write(gpu, &self.rows_e)?;
        }
        self.write_outliers(gpu, outliers);
        Ok(())
    }

    /// Writes the outliers to the device, unless there were none and are none.
    #[allow(clippy::cast_possible_truncation, reason = "fewer than there are pixels")]
    fn write_outliers(&mut self, gpu: &GpuDevice, outliers: &Outliers) {
        let list = outliers.list();
        if list.is_empty() && self.outlier_count == 0 {
            return;
        }
        self.outlier_count = list.len();
        let (queue, buffer) = (gpu.queue(), self.outliers.buffer());
        queue.write_buffer(buffer, 0, bytemuck::bytes_of(&Outlier::none(list.len() as u32)));
        if !list.is_empty() {
            queue.write_buffer(buffer, OUTLIER_BYTES, bytemuck::cast_slice(list));
        }
    }

    /// Sets another map of the illumination; passes must be bound again.
    pub(super) fn set_illumination(&mut self, gpu: &GpuDevice, map: Option<&[f32]>) -> Result<(), GpuError> {
        self.illumination = pattern(gpu, "illumination map", map)?;
        Ok(())
    }
}

/// Returns the contents of the buffer of lines, row noise first, as [`constants`] describes it to the shader; `None`
/// when all are off.
fn lines(detector: &Detector) -> Option<Vec<f32>> {
    let ([width, height], lines) = (detector.adc_px(), detector.lines());
    let parts = [(height, &[][..]), (width, &lines.column_gain), (width, &lines.column_e), (height, &lines.row_e)];
    let is_on = detector.params().row_noise.is_on() || parts.iter().any(|(_, part)| !part.is_empty());
    let filled = |(length, part): (usize, &[f32])| {
        let mut part = part.to_vec();
        part.resize(length, 0.0);
        part
    };
    is_on.then(|| parts.into_iter().flat_map(filled).collect())
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
    /// Returns all stages.
    pub(super) fn all(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        let charge = [include_str!("outliers.wgsl"), include_str!("charge.wgsl")];
        let parts = [charge[0], charge[1], include_str!("readout.wgsl"), include_str!("one_pass.wgsl")];
        Self::new(gpu, "detector", detector, &parts)
    }

    /// Returns the stages before the neighbours.
    pub(super) fn charge(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        Self::new(
            gpu,
            "charge",
            detector,
            &[include_str!("outliers.wgsl"), include_str!("charge.wgsl"), include_str!("charge_pass.wgsl")],
        )
    }

    /// Returns the stages after the neighbours.
    pub(super) fn readout(gpu: &GpuDevice, detector: &Detector) -> Result<Self, GpuError> {
        Self::new(gpu, "read out", detector, &[include_str!("readout.wgsl"), include_str!("readout_pass.wgsl")])
    }

    fn new(gpu: &GpuDevice, name: &'static str, detector: &Detector, parts: &[&str]) -> Result<Self, GpuError> {
        let common = [include_str!("random.wgsl"), include_str!("elementary.wgsl"), include_str!("frame.wgsl")];
        let text = shader::assemble(&constants(detector), [&common, parts].concat());
        Ok(Self { pass: ComputePass::new(gpu, name, text)?, bound: None })
    }

    /// Makes the next record bind its buffers again.
    pub(super) fn unbind(&mut self) {
        self.bound = None;
    }

    /// Records the pass over `pixels` from `image`; a new bind group is made only for another image.
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
    pub(super) fn for_all<'a>(&'a self, [frame, image, dn]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 9] {
        let [prnu, dark_factor, illumination] =
            [&self.prnu, &self.dark_factor, &self.illumination].map(GrowableBuffer::buffer);
        let [offsets, lines, outliers] = [&self.dsnu_e, &self.lines, &self.outliers].map(GrowableBuffer::buffer);
        [frame, image, prnu, dark_factor, offsets, lines, dn, illumination, outliers]
    }

    /// Bindings of [`ImagePass::charge`].
    pub(super) fn for_charge<'a>(&'a self, [frame, image, charge]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 7] {
        let [prnu, dark_factor] = [&self.prnu, &self.dark_factor].map(GrowableBuffer::buffer);
        [frame, image, prnu, dark_factor, charge, self.illumination.buffer(), self.outliers.buffer()]
    }

    /// Bindings of [`ImagePass::readout`].
    pub(super) fn for_readout<'a>(&'a self, [frame, charge, dn]: [&'a wgpu::Buffer; 3]) -> [&'a wgpu::Buffer; 5] {
        [frame, charge, self.dsnu_e.buffer(), self.lines.buffer(), dn]
    }
}

/// Returns the shader's constants. Effects that are off are constants too, and the driver leaves them out.
fn constants(detector: &Detector) -> String {
    let (params, patterns, lines) = (detector.params(), detector.patterns(), detector.lines());
    let mut text: String = PHILOX.iter().map(|(name, value)| shader::constant_u32(name, *value)).collect();
    text += &shader::constant_u32("WORKGROUP", WORKGROUP);
    text += &shader::constant_u32("STAGE_TEMPORAL", Stage::Temporal as u32);
    text += &shader::constant("INVERSION_LIMIT", INVERSION_LIMIT);
    let [width, height] = detector.adc_px();
    #[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
    let adc_pixels = (width * height) as u32;
    text += &shader::constant_u32("ADC_PIXELS", adc_pixels);
    text += &shader::switch("PRNU", patterns.prnu.is_some());
    text += &shader::switch("DARK_FACTOR", patterns.dark_factor.is_some());
    text += &shader::switch("DSNU", patterns.dsnu_e.is_some());
    text += &shader::switch("COLUMNS", !lines.column_gain.is_empty());
    text += &shader::switch("ROWS", !lines.row_e.is_empty());
    text += &shader::switch("ROW_NOISE", params.row_noise.is_on());
    text += &shader::switch("READ_NOISE", params.readout_noise_e_rms() > 0.0);
    text + &places(detector.adc_px()) + &response(&params.nonlinearity)
}

/// Returns the shader's constants for the starts of the parts of the buffer of lines.
#[allow(clippy::cast_possible_truncation, reason = "images hold fewer than 2^32 pixels")]
fn places([width, height]: [usize; 2]) -> String {
    let (width, height) = (width as u32, height as u32);
    let starts = [("COLUMN_GAIN", height), ("COLUMN_E", height + width), ("ROW_E", height + 2 * width)];
    let starts = starts.iter().map(|(name, start)| shader::constant_u32(name, *start));
    starts.chain([shader::constant_u32("WIDTH", width.max(1))]).collect()
}

/// Returns the response's pieces.
fn response(nonlinearity: &Nonlinearity) -> String {
    let pieces = nonlinearity.pieces();
    shader::switch("NONLINEAR", nonlinearity.is_on())
        + &shader::constant("SLOPE", pieces.slope)
        + &shader::coefficients("THRESHOLD", &pieces.thresholds_e)
        + &shader::coefficients("STEP", &pieces.steps)
}
