//! Device buffers that are kept from frame to frame and only ever grow.
//!
//! *Readback.* Device -> host: a ring of buffers that the host can map.
//!
//! `record` puts a copy at the end of a list of commands, `receive` waits for the oldest one. Depth 1 is right on a
//! software adapter (deeper adds a frame of latency each and gains nothing); a discrete GPU may gain from 2.
//!
//! *Texture.* A table of `vec4`s: software adapters fetch texels by vector gathers, buffers lane by lane.

use crate::gpu::device::{GpuDevice, GpuError};
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

/// The ring.
#[derive(Debug)]
pub struct ReadbackRing {
    slots: Vec<wgpu::Buffer>,
    recorded: usize,
    received: usize,
}

impl ReadbackRing {
    /// Returns a ring of `depth` buffers of `bytes` each.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn new(gpu: &GpuDevice, depth: usize, bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let slots = (0..depth.max(1)).map(|_| create(gpu, "readback", usage, bytes)).collect::<Result<_, _>>()?;
        Ok(Self { slots, recorded: 0, received: 0 })
    }

    /// Copies the start of `source` into the next buffer; false when all of them wait to be received.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, source: &wgpu::Buffer) -> bool {
        if self.recorded - self.received >= self.slots.len() {
            return false;
        }
        let slot = &self.slots[self.recorded % self.slots.len()];
        encoder.copy_buffer_to_buffer(source, 0, slot, 0, slot.size().min(source.size()));
        self.recorded += 1;
        true
    }

    /// Asks for the oldest copy, waits for it and shows it to `read`. Call after the commands were submitted.
    ///
    /// # Errors
    /// When the device failed, or nothing was recorded.
    pub fn receive<T>(&mut self, gpu: &GpuDevice, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuError> {
        if self.received == self.recorded {
            return Err(GpuError::Failed("nothing to read back: no copy was recorded".into()));
        }
        let slot = &self.slots[self.received % self.slots.len()];
        self.received += 1;
        // A mapping that fails shows when the range is asked for.
        slot.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        let value = {
            let view = slot.get_mapped_range(..).map_err(|error| GpuError::Failed(error.to_string()))?;
            read(&view)
        };
        slot.unmap();
        Ok(value)
    }
}

/// Largest ratio of a texture's kept size to the size that is needed.
const MOST_GROWTH: u64 = 2;

/// Layers of two-dimensional tables of four floats each, kept from frame to frame.
#[derive(Debug)]
pub struct TableTexture {
    what: &'static str,
    size: [u32; 3],
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl TableTexture {
    /// Returns one empty layer.
    ///
    /// # Errors
    /// When the device failed.
    pub fn new(gpu: &GpuDevice, what: &'static str) -> Result<Self, GpuError> {
        let size = [1, 1, 1];
        let (texture, view) = create_texture_of(gpu, what, size)?;
        Ok(Self { what, size, texture, view })
    }

    /// Returns the resource for a bind group.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(&self.view)
    }

    /// Reserves `layers` tables of `size` texels and returns true when the texture is a new and empty one (bind groups
    /// must be made again).
    ///
    /// # Errors
    /// When the device takes no texture of this size.
    pub fn reserve(&mut self, gpu: &GpuDevice, size: [usize; 2], layers: usize) -> Result<bool, GpuError> {
        let wanted = [size[0], size[1], layers].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        if (0..3).all(|i| wanted[i] <= self.size[i]) {
            return Ok(false);
        }
        // As large as any side ever was, so that sizes that come and go do not make textures; but sides multiply.
        let grown: [u32; 3] = core::array::from_fn(|i| wanted[i].max(self.size[i]));
        let texels = |size: [u32; 3]| size.into_iter().map(u64::from).product::<u64>();
        let size = if texels(grown) <= MOST_GROWTH * texels(wanted) { grown } else { wanted };
        (self.texture, self.view) = create_texture_of(gpu, self.what, size)?;
        self.size = size;
        Ok(true)
    }

    /// Writes rows of `columns` texels from the corner of a layer that [`Self::reserve`] has made.
    pub fn write(&self, gpu: &GpuDevice, layer: u32, columns: usize, texels: &[[f32; 4]]) {
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (width, height) = (side(columns), side(texels.len() / columns.max(1)));
        if width == 0 || height == 0 {
            return;
        }
        let mut target = self.texture.as_image_copy();
        target.origin.z = layer;
        gpu.queue().write_texture(
            target,
            bytemuck::cast_slice(texels),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * side(size_of::<[f32; 4]>())),
                rows_per_image: Some(height),
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
}

fn create_texture_of(
    gpu: &GpuDevice,
    what: &'static str,
    [width, height, layers]: [u32; 3],
) -> Result<(wgpu::Texture, wgpu::TextureView), GpuError> {
    let limits = gpu.device().limits();
    let most = limits.max_texture_dimension_2d;
    if layers > limits.max_texture_array_layers {
        let (got, most) = (u64::from(layers), u64::from(limits.max_texture_array_layers));
        return Err(GpuError::TooLarge { what, got, most });
    }
    if width.max(height) > most {
        let bytes = |n: u32| u64::from(n) * size_of::<[f32; 4]>() as u64;
        return Err(GpuError::TooLarge { what, got: bytes(width.max(height)), most: bytes(most) });
    }
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some(what),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    });
    gpu.check()?;
    Ok((texture, view))
}
