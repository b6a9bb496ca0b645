//! Device buffers that are kept from frame to frame and only ever grow.

use crate::gpu::{device::GpuDevice, error::GpuError};
use bytemuck::Pod;
use core::num::NonZeroU64;
use wgpu::BufferUsages;

/// A buffer that can grow.
#[derive(Debug)]
pub struct GrowableBuffer {
    what: &'static str,
    usage: BufferUsages,
    buffer: wgpu::Buffer,
}

impl GrowableBuffer {
    /// Returns a storage buffer of `bytes` zeros.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn storage(gpu: &GpuDevice, what: &'static str, bytes: u64) -> Result<Self, GpuError> {
        Self::new(gpu, what, BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC, bytes)
    }

    /// Returns a uniform buffer of `bytes` zeros.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn uniform(gpu: &GpuDevice, what: &'static str, bytes: u64) -> Result<Self, GpuError> {
        Self::new(gpu, what, BufferUsages::UNIFORM | BufferUsages::COPY_DST, bytes)
    }

    fn new(gpu: &GpuDevice, what: &'static str, usage: BufferUsages, bytes: u64) -> Result<Self, GpuError> {
        let buffer = create(gpu, what, usage, bytes)?;
        Ok(Self { what, usage, buffer })
    }

    /// Returns the buffer itself.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Reserves space for `bytes` and returns true when the buffer is a new one (bind groups must be made again). Grows
    /// by half at least, so that a slowly growing frame does not allocate every time.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn reserve(&mut self, gpu: &GpuDevice, bytes: u64) -> Result<bool, GpuError> {
        if bytes <= self.buffer.size() {
            return Ok(false);
        }
        let roomy = (self.buffer.size() + self.buffer.size() / 2).clamp(bytes, largest(gpu, self.usage).max(bytes));
        self.buffer = create(gpu, self.what, self.usage, roomy)?;
        Ok(true)
    }

    /// Writes `values` at the start, in a larger buffer if necessary, and returns true when the buffer is a new one.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn write<T: Pod>(&mut self, gpu: &GpuDevice, values: &[T]) -> Result<bool, GpuError> {
        self.write_slices(gpu, core::iter::once(values))
    }

    /// Writes slices one behind the other from the start, in a larger buffer if necessary, and returns true when the buffer
    /// is a new one.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn write_slices<'a, T: Pod>(
        &mut self,
        gpu: &GpuDevice,
        slices: impl Iterator<Item = &'a [T]> + Clone,
    ) -> Result<bool, GpuError> {
        let bytes: u64 = slices.clone().map(|slice| size_of_val(slice) as u64).sum();
        let grew = self.reserve(gpu, bytes)?;
        let view = NonZeroU64::new(bytes).and_then(|bytes| gpu.queue().write_buffer_with(&self.buffer, 0, bytes));
        if let Some(mut view) = view {
            let mut first = 0;
            for slice in slices {
                let end = first + size_of_val(slice);
                view.slice(first..end).copy_from_slice(bytemuck::cast_slice(slice));
                first = end;
            }
        }
        Ok(grew)
    }
}

/// Returns the largest buffer of a usage, bytes.
fn largest(gpu: &GpuDevice, usage: BufferUsages) -> u64 {
    let limits = gpu.device().limits();
    let binding = if usage.contains(BufferUsages::STORAGE) {
        limits.max_storage_buffer_binding_size
    } else if usage.contains(BufferUsages::UNIFORM) {
        limits.max_uniform_buffer_binding_size
    } else {
        limits.max_buffer_size
    };
    binding.min(limits.max_buffer_size)
}

/// Returns a zeroed buffer; sizes are rounded up to whole `vec4`s.
pub(crate) fn create(
    gpu: &GpuDevice,
    what: &'static str,
    usage: BufferUsages,
    bytes: u64,
) -> Result<wgpu::Buffer, GpuError> {
    let size = bytes.max(16).next_multiple_of(16);
    let most = largest(gpu, usage);
    if size > most {
        return Err(GpuError::TooLarge { what, got: size, most });
    }
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some(what),
        size,
        usage,
        mapped_at_creation: false,
    });
    gpu.check()?;
    Ok(buffer)
}
