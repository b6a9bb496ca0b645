//! The display's painter: every grey of every format is stored as that grey, in all three colours, and what is beyond
//! the picture is black.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use image::gpu::{AdapterChoice, GpuDevice};
use starloop_outputs::display::painter::GreyPainter;
use std::sync::Arc;
use wgpu::TextureFormat;

const SIZE_PX: [u32; 2] = [64, 17];
/// Two columns and a row beyond the picture.
const TARGET_PX: [u32; 2] = [66, 18];
/// Rows of a copy to a buffer begin at multiples of 256 bytes.
const ROW_BYTES: u32 = 512;

/// Returns the device, or `None` (and a printed line that a script counts) when there is none and none is required.
fn device() -> Option<Arc<GpuDevice>> {
    match GpuDevice::open(&AdapterChoice::Best) {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var("STARLOOP_REQUIRE_GPU").as_deref() != Ok("1"), "a GPU is required: {error}");
            println!("SKIPPED: no Vulkan adapter");
            None
        }
    }
}

/// Returns the words that the painter stores for `greys`: one for each pixel of the target.
fn painted(gpu: &GpuDevice, format: TextureFormat, most: u16, greys: &[u16]) -> Vec<u32> {
    let size = wgpu::Extent3d { width: TARGET_PX[0], height: TARGET_PX[1], depth_or_array_layers: 1 };
    let target = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let buffer = gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: Some("copy"),
        size: u64::from(ROW_BYTES * TARGET_PX[1]),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let painter = GreyPainter::new(gpu.device(), format, most, SIZE_PX);
    painter.upload(gpu.queue(), greys);
    let mut encoder = gpu.encoder("greys");
    painter.record(&mut encoder, &target.create_view(&wgpu::TextureViewDescriptor::default()));
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(ROW_BYTES), rows_per_image: None };
    encoder.copy_texture_to_buffer(target.as_image_copy(), wgpu::TexelCopyBufferInfo { buffer: &buffer, layout }, size);
    gpu.submit(encoder).unwrap();
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    gpu.wait().unwrap();
    let bytes = buffer.get_mapped_range(..).unwrap().to_vec();
    let rows = bytes.chunks_exact(ROW_BYTES as usize).map(|row| &row[..4 * TARGET_PX[0] as usize]);
    rows.flat_map(|row| row.chunks_exact(4).map(|word| u32::from_le_bytes(word.try_into().unwrap()))).collect()
}

/// Returns the three colours of a stored word.
fn colours(word: u32, bits: u32) -> [u32; 3] {
    [0, 1, 2].map(|i| (word >> (i * bits)) & ((1 << bits) - 1))
}

/// Returns pixels that do not show the grey of `greys`, or black beyond.
fn wrong(stored: &[u32], greys: &[u16], bits: u32) -> usize {
    let [width, height] = SIZE_PX;
    let is_wrong = |(at, word): (u32, &u32)| {
        let (x, y) = (at % TARGET_PX[0], at / TARGET_PX[0]);
        let is_inside = x < width && y < height;
        let wanted = if is_inside { u32::from(greys[(y * width + x) as usize]) } else { 0 };
        colours(*word, bits) != [wanted; 3]
    };
    (0..).zip(stored).filter(|pixel| is_wrong(*pixel)).count()
}

#[test]
fn every_grey_of_every_format_is_stored_as_it_is() {
    let Some(gpu) = device() else { return };
    for (format, bits) in
        [(TextureFormat::Bgra8Unorm, 8), (TextureFormat::Rgba8Unorm, 8), (TextureFormat::Rgb10a2Unorm, 10)]
    {
        let most = ((1_u32 << bits) - 1) as u16;
        let mut greys: Vec<u16> = (0..SIZE_PX[0] * SIZE_PX[1]).map(|i| (i % (u32::from(most) + 1)) as u16).collect();
        let stored = painted(&gpu, format, most, &greys);
        assert_eq!(stored.len() as u32, TARGET_PX[0] * TARGET_PX[1]);
        assert_eq!(wrong(&stored, &greys, bits), 0, "{format:?}");
        greys[700] ^= 1;
        assert_eq!(wrong(&stored, &greys, bits), 1, "{format:?}: control, one bit of one grey");
    }
}

#[test]
fn a_format_that_encodes_is_seen() {
    let Some(gpu) = device() else { return };
    let greys: Vec<u16> = (0..SIZE_PX[0] * SIZE_PX[1]).map(|i| (i % 256) as u16).collect();
    let stored = painted(&gpu, TextureFormat::Bgra8UnormSrgb, 255, &greys);
    assert!(wrong(&stored, &greys, 8) > 1000, "control: sRGB stores other greys");
}
