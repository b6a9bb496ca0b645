//! PNG images: 8-bit grey for people ([`Stretch`]), 16-bit grey with the raw DN.

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

// Pixels -> 8-bit grey that shows faint stars and bright ones together.
//
// `grey = 255 asinh((v - black) / soft) / asinh((white - black) / soft)`, clipped, with
// * `sigma`: median minus the 15.87 % quantile, the background's noise whatever the stars do;
// * `black`: median - `sigma`; `white`: the brightest pixel;
// * `soft`: 3 `sigma`, at least 1/1000 of the range, so that noise stays dark and a 10-sigma star is plainly seen.
//
// Assumption: more than half of the pixels are background. Only for people: it is not invertible, and two frames
// are stretched differently.

/// Quantile one standard deviation below the mean of a normal distribution.
const ONE_SIGMA_BELOW: f64 = 0.158_655;
/// Softening, in units of the background noise.
const SOFT_SIGMA: f64 = 3.0;
/// Least softening, as a share of the range.
const SOFT_SHARE: f64 = 1e-3;

/// A grey scale fitted to one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    black: f64,
    soft: f64,
    grey_per_asinh: f64,
}

impl Stretch {
    /// Fits the scale to 16-bit pixels.
    pub fn of_dn(pixels: &[u16]) -> Self {
        let mut counts = vec![0_usize; 1 << 16];
        pixels.iter().for_each(|&v| counts[usize::from(v)] += 1);
        let quantile = |q: f64| {
            let mut left = rank(q, pixels.len());
            let reached = |&count: &usize| {
                let here = left < count;
                left = left.saturating_sub(count);
                here
            };
            counts.iter().position(reached).unwrap_or(0) as f64
        };
        Self::from_quantiles(quantile)
    }

    /// Fits the scale to real pixels; those that are not finite do not count.
    pub fn of_electrons(pixels: &[f32]) -> Self {
        let mut finite: Vec<f32> = pixels.iter().copied().filter(|v| v.is_finite()).collect();
        let quantile = |q: f64| {
            let at = rank(q, finite.len());
            if finite.is_empty() { 0.0 } else { f64::from(*finite.select_nth_unstable_by(at, f32::total_cmp).1) }
        };
        Self::from_quantiles(quantile)
    }

    fn from_quantiles(mut quantile: impl FnMut(f64) -> f64) -> Self {
        let (below, median, white) = (quantile(ONE_SIGMA_BELOW), quantile(0.5), quantile(1.0));
        let sigma = median - below;
        let black = median - sigma;
        let soft = (SOFT_SIGMA * sigma).max(SOFT_SHARE * (white - black)).max(f64::MIN_POSITIVE);
        let range = ((white - black) / soft).asinh();
        Self { black, soft, grey_per_asinh: if range > 0.0 { 255.0 / range } else { 0.0 } }
    }

    /// Returns the grey of one pixel value; black when it is not a number.
    pub fn grey(&self, value: f64) -> u8 {
        // A float-to-int cast saturates, and takes NaN to 0.
        (((value - self.black) / self.soft).asinh() * self.grey_per_asinh).round() as u8
    }
}

/// Returns the index of the `q` quantile among `count` sorted values.
fn rank(q: f64, count: usize) -> usize {
    (q * count.saturating_sub(1) as f64).round() as usize
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

#[cfg(test)]
mod stretch_tests {
    use super::*;

    /// Returns the background of 64 +- 4 DN (triangular noise), one star of 10 sigma and one of 4000 DN.
    fn star_field() -> Vec<u16> {
        let mut pixels: Vec<u16> = (0..10_000_u32).map(|i| 60 + ((i * 7_919 % 5) + (i * 104_729 % 4)) as u16).collect();
        (pixels[5_000], pixels[7_000]) = (104, 4_000);
        pixels
    }

    #[test]
    fn background_is_dark_a_faint_star_is_seen_and_the_brightest_is_white() {
        let pixels = star_field();
        let stretch = Stretch::of_dn(&pixels);
        assert!(stretch.grey(64.0) < 40, "background {}", stretch.grey(64.0));
        assert!(stretch.grey(104.0) > 60, "10 sigma star {}", stretch.grey(104.0));
        assert_eq!(stretch.grey(4_000.0), 255, "brightest");
    }

    #[test]
    fn both_fits_agree_on_the_same_numbers() {
        let pixels = star_field();
        let real: Vec<f32> = pixels.iter().map(|&v| f32::from(v)).collect();
        assert_eq!(Stretch::of_dn(&pixels), Stretch::of_electrons(&real));
        assert_ne!(Stretch::of_dn(&pixels), Stretch::of_electrons(&real[..5_000]), "the comparison can fail");
    }

    #[test]
    fn flat_empty_and_non_finite_images_are_stretched() {
        assert_eq!(Stretch::of_dn(&[]).grey(0.0), 0);
        assert_eq!(Stretch::of_dn(&[9; 50]).grey(9.0), 0, "a flat image is black");
        let stretch = Stretch::of_electrons(&[f32::NAN, f32::INFINITY, 0.0, 1.0]);
        assert_eq!(stretch.grey(f64::NAN), 0);
        assert_eq!(stretch.grey(f64::INFINITY), 255);
    }

    #[test]
    fn a_noise_free_field_with_few_stars_shows_them() {
        let mut pixels = vec![0.0_f32; 10_000];
        (pixels[10], pixels[20]) = (20.0, 20_000.0);
        let stretch = Stretch::of_electrons(&pixels);
        assert!(stretch.grey(20.0) > 20, "{}", stretch.grey(20.0));
        assert_eq!(stretch.grey(0.0), 0);
    }
}
