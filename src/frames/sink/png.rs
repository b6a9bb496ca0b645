//! PNG images: 8-bit grey for people ([`stretch`](crate::sink::stretch)), 16-bit grey with the raw DN.

use crate::sink::stretch::Stretch;
use base::image::{DnImage, ElectronImage};
use std::io::{self, Write};

/// Writes DN as 8-bit grey, stretched for people.
///
/// # Errors
/// When the output fails, or the image has no pixels.
pub fn write_dn_for_people(out: impl Write, image: &DnImage) -> io::Result<()> {
    let stretch = Stretch::of_dn(image.pixels());
    // One grey per possible DN: cheaper than one asinh per pixel.
    let greys: Vec<u8> = (0..=u16::MAX).map(|dn| stretch.grey(f64::from(dn))).collect();
    let bytes: Vec<u8> = image.pixels().iter().map(|&dn| greys[usize::from(dn)]).collect();
    write_grey(out, image.width(), image.height(), png::BitDepth::Eight, &bytes)
}

/// Writes mean electrons as 8-bit grey, stretched for people.
///
/// # Errors
/// When the output fails, or the image has no pixels.
pub fn write_electrons_for_people(out: impl Write, image: &ElectronImage) -> io::Result<()> {
    let stretch = Stretch::of_electrons(image.pixels());
    let bytes: Vec<u8> = image.pixels().iter().map(|&e| stretch.grey(f64::from(e))).collect();
    write_grey(out, image.width(), image.height(), png::BitDepth::Eight, &bytes)
}

/// Writes DN unchanged as 16-bit grey. Many viewers show a 12-bit image in it as nearly black.
///
/// # Errors
/// When the output fails, or the image has no pixels.
pub fn write_dn_raw(out: impl Write, image: &DnImage) -> io::Result<()> {
    let mut bytes = vec![0; 2 * image.pixels().len()];
    for (bytes, dn) in bytes.as_chunks_mut().0.iter_mut().zip(image.pixels()) {
        *bytes = dn.to_be_bytes();
    }
    write_grey(out, image.width(), image.height(), png::BitDepth::Sixteen, &bytes)
}

/// Writes greys up to 255 unchanged as 8-bit grey; brighter ones as 255.
///
/// # Errors
/// When the output fails, or the image has no pixels.
pub fn write_greys(out: impl Write, image: &DnImage) -> io::Result<()> {
    let bytes: Vec<u8> = image.pixels().iter().map(|grey| u8::try_from(*grey).unwrap_or(u8::MAX)).collect();
    write_grey8(out, [image.width(), image.height()], &bytes)
}

/// Writes 8-bit grey as it is: `bytes` are the pixels row by row from the top.
///
/// # Errors
/// When the output fails, the image has no pixels, or `bytes` are not as many as the pixels.
pub fn write_grey8(out: impl Write, [width, height]: [usize; 2], bytes: &[u8]) -> io::Result<()> {
    write_grey(out, width, height, png::BitDepth::Eight, bytes)
}

fn write_grey(mut out: impl Write, width: usize, height: usize, depth: png::BitDepth, bytes: &[u8]) -> io::Result<()> {
    let side = |n: usize| u32::try_from(n).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e));
    let mut encoder = png::Encoder::new(&mut out, side(width)?, side(height)?);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(io_error)?;
    writer.write_image_data(bytes).map_err(io_error)?;
    writer.finish().map_err(io_error)?;
    out.flush()
}

/// Returns the system's own error where there is one: the crate's conversion hides its kind (a full disk would not be
/// recognised).
fn io_error(error: png::EncodingError) -> io::Error {
    if let png::EncodingError::IoError(source) = error {
        source
    } else {
        io::Error::new(io::ErrorKind::InvalidInput, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::sample::sample_frame;

    fn decoded(bytes: &[u8]) -> (png::BitDepth, [u32; 2], Vec<u8>) {
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.bit_depth, [info.width, info.height], pixels)
    }

    #[test]
    fn raw_dn_read_back_exactly() {
        let image = sample_frame(3).image;
        let mut bytes = Vec::new();
        write_dn_raw(&mut bytes, &image).unwrap();
        let (depth, size, pixels) = decoded(&bytes);
        let dn: Vec<u16> = pixels.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        assert_eq!((depth, size), (png::BitDepth::Sixteen, [31, 17]));
        assert_eq!(dn, image.pixels());
        assert_ne!(dn, sample_frame(4).image.pixels(), "the comparison can fail");
    }

    #[test]
    fn people_see_eight_bits_with_black_and_white_in_them() {
        let mut dn = DnImage::new(20, 10);
        dn.pixels_mut().fill(64);
        dn.pixels_mut()[33] = 900;
        let mut electrons = ElectronImage::new(20, 10);
        electrons.pixels_mut()[33] = 900.0;
        let (mut a, mut b) = (Vec::new(), Vec::new());
        write_dn_for_people(&mut a, &dn).unwrap();
        write_electrons_for_people(&mut b, &electrons).unwrap();
        for bytes in [a, b] {
            let (depth, size, pixels) = decoded(&bytes);
            assert_eq!((depth, size), (png::BitDepth::Eight, [20, 10]));
            assert_eq!((pixels[0], pixels[33]), (0, 255));
        }
    }

    #[test]
    fn an_image_without_pixels_is_an_error() {
        write_dn_raw(Vec::new(), &DnImage::new(0, 0)).unwrap_err();
    }
}
