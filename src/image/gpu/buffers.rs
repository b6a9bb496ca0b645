//! Device buffers that are kept from frame to frame and only ever grow.

use crate::gpu::device::GpuDevice;
use crate::gpu::error::GpuError;
use bytemuck::Pod;
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
    #[must_use]
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
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let grew = self.reserve(gpu, bytes.len() as u64)?;
        if !bytes.is_empty() {
            gpu.queue().write_buffer(&self.buffer, 0, bytes);
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
