//! A table of `vec4`s as a texture: software adapters fetch texels by vector gathers, buffers lane by lane.

use crate::gpu::{device::GpuDevice, error::GpuError};

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
        let (texture, view) = create(gpu, what, size)?;
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
        (self.texture, self.view) = create(gpu, self.what, size)?;
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

fn create(
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
