//! A table of `vec4`s as a texture: software adapters fetch texels by vector gathers, buffers lane by lane.

use crate::gpu::device::GpuDevice;
use crate::gpu::error::GpuError;

/// A two-dimensional table of four floats each, kept from frame to frame; it only ever grows.
#[derive(Debug)]
pub struct TableTexture {
    what: &'static str,
    size: [u32; 2],
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl TableTexture {
    /// An empty table.
    ///
    /// # Errors
    /// When the device failed.
    pub fn new(gpu: &GpuDevice, what: &'static str) -> Result<Self, GpuError> {
        let size = [1, 1];
        let (texture, view) = create(gpu, what, size)?;
        Ok(Self { what, size, texture, view })
    }

    /// For a bind group.
    #[must_use]
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::TextureView(&self.view)
    }

    /// Writes rows of `columns` texels from the corner; true when the texture is a new one (bind groups must be made
    /// anew).
    ///
    /// # Errors
    /// When the device takes no texture of this size.
    pub fn write(&mut self, gpu: &GpuDevice, columns: usize, texels: &[[f32; 4]]) -> Result<bool, GpuError> {
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (width, height) = (side(columns), side(texels.len() / columns.max(1)));
        if width == 0 || height == 0 {
            return Ok(false);
        }
        let grew = width > self.size[0] || height > self.size[1];
        if grew {
            let size = [width.max(self.size[0]), height.max(self.size[1])];
            (self.texture, self.view) = create(gpu, self.what, size)?;
            self.size = size;
        }
        let texel_bytes = side(size_of::<[f32; 4]>());
        gpu.queue().write_texture(
            self.texture.as_image_copy(),
            bytemuck::cast_slice(texels),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * texel_bytes),
                rows_per_image: Some(height),
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Ok(grew)
    }
}

fn create(
    gpu: &GpuDevice,
    what: &'static str,
    [width, height]: [u32; 2],
) -> Result<(wgpu::Texture, wgpu::TextureView), GpuError> {
    let most = gpu.device().limits().max_texture_dimension_2d;
    if width.max(height) > most {
        let bytes = |n: u32| u64::from(n) * size_of::<[f32; 4]>() as u64;
        return Err(GpuError::TooLarge { what, got: bytes(width.max(height)), most: bytes(most) });
    }
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some(what),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    gpu.check()?;
    Ok((texture, view))
}
