//! A mean electron image on the device, in fixed point.
//!
//! Every pixel is a signed 32-bit sum; `electrons = sum / scale`, with `scale` a power of two that the pass that drew
//! the image chose so that no sum can wrap. Signed, because tabulated PSFs dip below zero by a millionth of their peak.

use crate::gpu::buffers::{GrowableBuffer, ReadbackRing};
use crate::gpu::device::{GpuDevice, GpuError};
use base::image::Image;

/// Fixed-point electrons of every pixel, row by row.
#[derive(Debug)]
pub struct DeviceElectrons {
    buffer: GrowableBuffer,
    width: usize,
    height: usize,
    scale: f32,
}

impl DeviceElectrons {
    /// Returns an image of zeros.
    ///
    /// # Errors
    /// When the device takes no image of this size.
    pub fn new(gpu: &GpuDevice, width: usize, height: usize) -> Result<Self, GpuError> {
        let buffer = GrowableBuffer::storage(gpu, "electrons", 4 * width as u64 * height as u64)?;
        Ok(Self { buffer, width, height, scale: 1.0 })
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Units per electron: a power of two.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Returns the buffer of the sums, `i32` each.
    pub fn buffer(&self) -> &wgpu::Buffer {
        self.buffer.buffer()
    }

    /// Records that the sums go to zero, and in which scale the next ones will be.
    pub fn clear(&mut self, encoder: &mut wgpu::CommandEncoder, scale: f32) {
        self.scale = scale;
        encoder.clear_buffer(self.buffer.buffer(), 0, None);
    }

    /// Sets the scale of the sums that are now in the buffer, whichever pass wrote them.
    pub fn set_scale(&mut self, scale: f32) {
        self.scale = scale;
    }

    /// Waits for the image and copies it out as electrons.
    ///
    /// # Errors
    /// When the device failed or `out` has another size.
    pub fn read(&self, gpu: &GpuDevice, ring: &mut ReadbackRing, out: &mut Image<f32>) -> Result<(), GpuError> {
        let (got, wanted) = ([out.width(), out.height()], [self.width, self.height]);
        if got != wanted {
            return Err(GpuError::Size { what: "electrons", got, wanted });
        }
        let mut encoder = gpu.encoder("read electrons");
        ring.record(&mut encoder, self.buffer.buffer());
        gpu.submit(encoder)?;
        // Exact: the reciprocal of a power of two.
        let electrons_per_unit = 1.0 / self.scale;
        ring.receive(gpu, |bytes| {
            for (pixel, sum) in out.pixels_mut().iter_mut().zip(bytes.as_chunks::<4>().0) {
                *pixel = i32::from_ne_bytes(*sum) as f32 * electrons_per_unit;
            }
        })
    }
}
