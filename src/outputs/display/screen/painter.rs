//! Whole greys -> a texture of unsigned normalised numbers that stores exactly these greys, in all three colours.
//!
//! The shader divides by `2^bits - 1`, the hardware multiplies by it and rounds. The division errs by 2.5 units in the
//! last place at most (WGSL), so what is rounded is within 1023 * 3 * 6e-8 = 2e-4 of a whole number: any rounding to
//! the nearest gives the grey. Every grey of every format: `tests/greys/main.rs`.

use crate::display::{error::DisplayError, params::Bits};
use bytemuck::cast_slice;
use wgpu::{Device, Queue, SurfaceColorSpaces, SurfaceFormatCapabilities, TextureFormat, TextureView};

/// Paints greys of one size onto surfaces of one format.
#[derive(Debug)]
pub struct GreyPainter {
    pipeline: wgpu::RenderPipeline,
    greys: wgpu::Texture,
    group: wgpu::BindGroup,
    size_px: [u32; 2],
}

impl GreyPainter {
    /// Returns a painter for pictures of `size_px` (columns, rows) on textures of `format`, which stores greys up to
    /// `most`. Failures go to the device's error callback.
    pub fn new(device: &Device, format: TextureFormat, most: u16, size_px: [u32; 2]) -> Self {
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("greys"),
            source: wgpu::ShaderSource::Wgsl(include_str!("grey.wgsl").into()),
        });
        let constants = [("most", f64::from(most))];
        let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("greys"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &shader,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            fragment: Some(wgpu::FragmentState {
                module: &shader,
                entry_point: Some("grey"),
                compilation_options: options,
                targets: &[Some(format.into())],
            }),
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            multiview_mask: None,
            cache: None,
        });
        let greys = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("greys"),
            size: extent(size_px),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TextureFormat::R16Uint,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = greys.create_view(&wgpu::TextureViewDescriptor::default());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("greys"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) }],
        });
        Self { pipeline, greys, group, size_px }
    }

    /// Takes new greys, row by row from the top.
    pub fn upload(&self, queue: &Queue, greys: &[u16]) {
        let [width, _] = self.size_px;
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(2 * width), rows_per_image: None };
        queue.write_texture(self.greys.as_image_copy(), cast_slice(greys), layout, extent(self.size_px));
    }

    /// Records the painting of the greys onto `target`, which is overwritten completely.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, target: &TextureView) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("greys"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn extent([width, height]: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width, height, depth_or_array_layers: 1 }
}

// Which format of a surface shows greys as they are.
//
// Only formats that store what the shader gives times `2^bits - 1`, rounded, will do: no sRGB encoding, no HDR
// transfer.

/// Formats with 8 bits of a grey.
const EIGHT: [TextureFormat; 2] = [TextureFormat::Bgra8Unorm, TextureFormat::Rgba8Unorm];
/// Formats with 10.
const TEN: [TextureFormat; 1] = [TextureFormat::Rgb10a2Unorm];

/// Returns the format to take.
///
/// # Errors
/// When the surface offers none of them; the message lists its formats.
pub(super) fn choose_format(offered: &[SurfaceFormatCapabilities], bits: Bits) -> Result<TextureFormat, DisplayError> {
    let wanted: &[TextureFormat] = match bits {
        Bits::Eight => &EIGHT,
        Bits::Ten => &TEN,
    };
    let is_plain = |format: TextureFormat| {
        offered
            .iter()
            .any(|obtained| obtained.format == format && obtained.color_spaces.contains(SurfaceColorSpaces::SRGB))
    };
    wanted.iter().copied().find(|format| is_plain(*format)).ok_or_else(|| {
        let names: Vec<String> = offered.iter().map(|obtained| format!("{:?}", obtained.format)).collect();
        let advice = match bits {
            Bits::Eight => "another driver or server may",
            Bits::Ten => "ask for bits = 8, or set the X server to depth 30 and take a driver that offers A2B10G10R10",
        };
        let offered = if names.is_empty() { "nothing".into() } else { names.join(", ") };
        DisplayError::refuse(format!(
            "{} bits are not offered here: the driver offers {offered}; {advice}",
            bits.count()
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(format: TextureFormat, color_spaces: SurfaceColorSpaces) -> SurfaceFormatCapabilities {
        SurfaceFormatCapabilities { format, color_spaces }
    }

    #[test]
    fn greys_are_never_encoded() {
        let plain = SurfaceColorSpaces::SRGB;
        let encoding = offer(TextureFormat::Bgra8UnormSrgb, plain);
        let eight = offer(TextureFormat::Bgra8Unorm, plain);
        let ten = offer(TextureFormat::Rgb10a2Unorm, plain);
        let hdr = offer(TextureFormat::Rgb10a2Unorm, SurfaceColorSpaces::BT2100_PQ);
        let offered = [encoding, eight, ten];
        assert_eq!(choose_format(&offered, Bits::Eight), Ok(TextureFormat::Bgra8Unorm));
        assert_eq!(choose_format(&offered, Bits::Ten), Ok(TextureFormat::Rgb10a2Unorm));
        assert!(choose_format(&offered[..1], Bits::Eight).is_err(), "sRGB would encode");
        let text = choose_format(&[eight, hdr], Bits::Ten).unwrap_err().to_string();
        assert!(text.contains("Bgra8Unorm") && text.contains("bits = 8"), "{text}");
    }
}
